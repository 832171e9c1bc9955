"""The file of a recogniser.

```
/            attributes: format "neuro recogniser 1", method, settings and training (JSON), and the versions of neuro,
             python, numpy and numba
/classes     names of the classes
/learnt      arrays and texts by name, as the method gives them
/early       what decisions while events arrive need, where it was learnt: see `neuro_recognise.deciding.early`
```
"""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import neuro
from neuro.apps import hdf5, provenance, record_input
from neuro_recognise.deciding.early import Early, part_of
from neuro_recognise.method import Learnt, Method
from neuro_recognise.methods import method_of

__all__ = ["FORMAT", "read", "write"]

FORMAT = "neuro recogniser 1"
Parts: TypeAlias = tuple[Method, tuple[str, ...], Learnt, Mapping[str, Any], Early | None]


def write(path: Path, parts: Parts) -> None:
    """Write a file, in the place of another recogniser of that name.

    Args:
        path: of the file.
        parts: what a recogniser is made of, in the order of its attributes.

    Raises:
        Unwritable: it cannot be written, or something else stands there.
    """
    method, classes, learnt, training, early = parts
    told = {word: training.get(word) for word in ("backend", "seed")}
    with hdf5.writing(path, FORMAT, record=provenance(**told)) as file:
        file.attrs["method"] = method.called()
        file.attrs["settings"] = json.dumps(method.as_words())
        file.attrs["training"] = json.dumps(dict(training))
        file.attrs.update(_versions())
        file["classes"] = list(classes)
        group = file.create_group("learnt")
        for name, part in learnt.items():
            group[name] = part
        if early is not None:
            early.write(file.create_group("early"))


def read(path: Path) -> Parts:
    """What `write` was given; errors as of `Recogniser.load`."""
    with hdf5.reading(path, FORMAT) as file:
        record_input(path)
        method = method_of(str(file.attrs["method"])).from_words(json.loads(file.attrs["settings"]))
        classes = tuple(file["classes"].asstr()[:].tolist())
        learnt = {name: part_of(data) for name, data in file["learnt"].items()}
        early = Early.read(file["early"]) if "early" in file else None
        return method, classes, learnt, json.loads(file.attrs["training"]), early


def _versions() -> dict[str, str]:
    """What a file was written with."""
    packages = {"neuro": neuro.__version__} | {name: version(name) for name in ("numpy", "numba")}
    return {"python": platform.python_version()} | packages
