"""Compare a backend with golden traces: a folder has the files NAME.json and NAME.npz of each case.

The JSON file describes the simulation, and the npz file has its recorded results. The kind of a case follows from its
content; see `neuro.testing.nest_traces`.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from neuro.core.errors import ModelError
from neuro.program.backend import Backend
from neuro.testing.chip_traces import chip_of
from neuro.testing.golden import Golden, Result, failure
from neuro.testing.nest_traces import compare


def verify(
    folder: str | PathLike[str],
    backend: str | Backend | None = None,
    *,
    progress: Callable[[str], None] = lambda name: None,
) -> list[Result]:
    """Run each case of a folder on a backend and return a result for each quantity.

    Spikes must be equal. Values must be equal within 1e-9, or exactly for chips. Neurons that NEST integrates with
    adaptive steps have limits of their own; see `neuro.testing.nest_traces.LIMITS`. A case that cannot be read, or is
    of an unknown kind, gives a result that is not ok.

    Args:
        folder: folder with NAME.json and NAME.npz for each case.
        backend: name of the backend, or the backend itself; by default the chip of the traces, or "event".
        progress: function that is called with the name of each case before the case runs.

    Raises:
        ModelError: the folder does not exist or has no case, or the backend is unknown.
    """
    path = Path(folder)
    if not path.is_dir():
        raise ModelError(f"{path}: no such folder: expected a folder with cases NAME.json and NAME.npz")
    files = sorted(path.glob("*.json"))
    if not files:
        raise ModelError(f"{path}: no case in it: expected files NAME.json and NAME.npz")
    results = []
    for file in files:
        progress(file.stem)
        for result in _run(file, backend):
            name = f"{file.stem}: {result.case}" if result.case else file.stem
            results.append(replace(result, case=name))
    return results


def _run(file: Path, backend: str | Backend | None) -> list[Result]:
    try:
        golden = _read(file)
        return compare(golden, backend or chip_of(golden.facts) or "event")
    except ModelError as error:
        return [failure(str(error))]
    except KeyError as error:
        return [failure(f"{error.args[0]!r} is missing")]
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        return [failure(f"it is not of the expected form: {error}")]


def _read(file: Path) -> Golden:
    try:
        facts = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ModelError(f"{file.name} cannot be read: {error}") from None
    if not isinstance(facts, dict):
        raise ModelError(f"{file.name}: expected an object that describes a case")
    arrays = file.with_suffix(".npz")
    if not arrays.is_file():
        raise ModelError(f"{arrays.name} is missing")
    try:
        with arrays.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            return Golden(facts, {name: stored[name] for name in stored.files})
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise ModelError(f"{arrays.name} cannot be read: {error}") from None
