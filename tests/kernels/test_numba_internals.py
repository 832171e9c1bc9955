"""Private names of numba and llvmlite: they are there, and used in one module."""

import ast
from pathlib import Path

import pytest

from neuro.kernels import numba_internals
from neuro.run.ports import within

ROOT = Path(__file__).parents[2]
PUBLIC = {"numba", "numba.extending"}
SOURCES = [path for folder in ("neuro", "backends", "models", "apps") for path in sorted((ROOT / folder).rglob("*.py"))]


def test_all_that_is_used_is_there():
    import numpy as np

    assert within(np.zeros(1), 0.0, 1.0)
    assert numba_internals.missing(within) == []


def test_what_has_disappeared_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(numba_internals.OF_MODULES, "numba.core.serialize", ("dumps", "gone"))
    monkeypatch.setattr(numba_internals, "OF_KERNELS", ("overloads.gone",))
    assert numba_internals.missing(within) == ["numba.core.serialize.gone", "Dispatcher.overloads.gone"]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_other_module_imports_private_names(path: Path):
    if path == Path(numba_internals.__file__):
        return
    for node in ast.walk(ast.parse(path.read_text())):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in filter(None, names):
            ours = name.split(".")[0] not in ("numba", "llvmlite") or name in PUBLIC
            assert ours or (name == "llvmlite" and isinstance(node, ast.Import)), f"{path} imports {name}"
