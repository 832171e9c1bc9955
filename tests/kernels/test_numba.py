"""Private names of numba are there and used in one module; told to compile nothing, only what need not be runs."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from neuro.kernels import numba_internals
from neuro.run.ports import within

ROOT = Path(__file__).parents[2]
PUBLIC = {"numba", "numba.extending"}


def test_all_that_is_used_is_there():
    assert within(np.zeros(1), 0.0, 1.0)
    assert numba_internals.missing(within) == []


def test_what_has_disappeared_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(numba_internals.OF_MODULES, "numba.core.serialize", ("dumps", "gone"))
    monkeypatch.setattr(numba_internals, "OF_KERNELS", ("overloads.gone",))
    assert numba_internals.missing(within) == ["numba.core.serialize.gone", "Dispatcher.overloads.gone"]


def imported(path: Path) -> set[str]:
    """Modules of numba that a file imports, and of llvmlite those from which it imports names."""
    text = path.read_text()
    nodes = [*ast.walk(ast.parse(text))] if "numba" in text or "llvmlite" in text else []
    found = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    found |= {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names} - {"llvmlite"}
    return {name for name in found if name.split(".")[0] in ("numba", "llvmlite")}


def test_no_other_module_imports_private_names():
    sources = {path for room in ("neuro", "backends", "models", "apps") for path in (ROOT / room).rglob("*.py")}
    found = {str(path): imported(path) - PUBLIC for path in sources - {Path(numba_internals.__file__)}}
    assert {path: names for path, names in found.items() if names} == {}


CODE = """
import sys
import neuro
net = neuro.Network("n", resolution=1.0)
net.population("a", 1, neuro.iaf_psc_delta(I_e=500.0))
sim = neuro.compile(net, sys.argv[1])
sim.run(50.0)
print(sim.spikes("a")[0].size > 0)
"""
REFUSED = """\
neuro.core.errors.ModelError: backend 'event' has to be compiled, and NUMBA_DISABLE_JIT is set: expected it to be unset
  hint: unset it, or run on backend 'reference', which is not compiled
"""


@pytest.mark.parametrize(("backend", "out", "err"), [("event", "", REFUSED), ("reference", "True\n", "")])
def test_numba_that_compiles_nothing(backend, out, err):
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", CODE, backend], env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr[-len(err) :] if err else done.stderr) == (out, err)
