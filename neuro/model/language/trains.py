"""Recorded spikes in files: times and neurons, as two data sets, fields or columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.errors import Where
from neuro.core.inputs import record_input
from neuro.core.values import FromFile
from neuro.model.language.files import ENDINGS, MAX_ELEMENTS, check, check_named, hdf5, held, named, npy
from neuro.model.language.nodes import mistake
from neuro.model.language.reader import Node

CSV = ".csv"
COLUMNS = ("times", "ids")
_STEPS = ("steps", "ids", "multiplicity")
"""Of a population in a file of results."""


def train(node: Node) -> FromFile:
    """The spikes that `{file: ..., key: ...}` stands for, a row of time and neuron for each."""
    path, said = named(node, (*ENDINGS, CSV))
    return held(said, _rows(path, said["file"], said.get("key")))


def train_of(path: Path, key: str | None, where: Where) -> NDArray[np.float64]:
    """The spikes of any file, as a program names it.

    Args:
        path: of the file.
        key: what in it has them; only HDF5 has one.
        where: the file is named.

    Raises:
        ModelError: there is no such file, or it holds no spikes.
    """
    file = Node(str(path), where, where)
    check_named(file, path.suffix, (*ENDINGS, CSV), file, None if key is None else file)
    if not path.is_file():
        raise mistake(file, f"{path}: there is no such file")
    record_input(path)
    return _rows(path, file, None if key is None else Node(key, where, where))


def _rows(path: Path, file: Node, key: Node | None) -> NDArray[np.float64]:
    if key is not None:
        return _hdf5(path, file, key)
    return _csv(path, file) if path.suffix == CSV else _npy(path, file)


def _hdf5(path: Path, file: Node, key: Node) -> NDArray[np.float64]:
    """A group with a data set for each column, as results have for each population, or a data set of two columns."""
    check(path, file)
    what, group = f"'{key.value}' in '{file.value}'", _group(path, key.value)
    if group is None:
        return _two_columns(hdf5(path, file, key), key, what)
    names, clock = group
    times, ids, *more = (_inner(key, name) for name in (COLUMNS if clock is None else _STEPS))
    columns = [hdf5(path, file, times), hdf5(path, file, ids)]
    if clock is not None:
        columns[0] = clock.array_ms(columns[0].astype(np.int64))
    rows = _joined(columns, key, what)
    if more and "multiplicity" in names:
        rows = np.repeat(rows, hdf5(path, file, more[0]).astype(np.int64), axis=0)
    return rows


def _inner(key: Node, name: str) -> Node:
    return Node(f"{key.value}/{name}", key.where, key.label, key.source)


def _group(path: Path, key: str) -> tuple[list[str], Clock | None] | None:
    """The names in a group, and the clock of its steps where it has steps, as results do.

    None where there is no group, or where it cannot be read: the reader of its data reports that.
    """
    import h5py

    try:
        with h5py.File(path, "r") as opened:
            group = opened.get(key)
            if not isinstance(group, h5py.Group):
                return None
            step = group.attrs.get("resolution_ms") if "steps" in group else None
            return list(group), None if step is None else Clock(float(step))
    except (OSError, ValueError, KeyError, RuntimeError):
        return None


def _npy(path: Path, file: Node) -> NDArray[np.float64]:
    """An array with two columns, or with a field for each."""
    what = f"file '{file.value}'"
    try:
        fields = np.load(path, mmap_mode="r", allow_pickle=False).dtype.names
    except (OSError, ValueError, EOFError, MemoryError, SyntaxError):
        fields = None  # whoever reads it tells
    if fields is None:
        return _two_columns(npy(path, file), file, what)
    _check_named(list(fields), file, what)
    values = np.load(path, allow_pickle=False)
    return _joined([values[name].astype(np.float64) for name in COLUMNS], file, what)


def _csv(path: Path, file: Node) -> NDArray[np.float64]:
    """A table whose first line names its columns; what it has beside times and ids is not read."""
    what = f"file '{file.value}'"
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError):
        raise mistake(file, f"{what}: expected a CSV file that can be read") from None
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    _check_named(names, file, what)
    if 2 * len(lines) > MAX_ELEMENTS:
        raise mistake(file, f"{what} holds {len(lines) - 1} spikes: expected at most {MAX_ELEMENTS // 2}")
    wanted, rows = [names.index(name) for name in COLUMNS], np.empty((len(lines) - 1, 2))
    for k, line in enumerate(lines[1:]):
        cells = line.split(",")
        try:
            rows[k] = [float(cells[column]) for column in wanted]
        except (ValueError, IndexError):
            raise mistake(file, f"{what}, line {k + 2}: found {line!r}: expected a time and a neuron") from None
    return rows


def _check_named(names: list[str], node: Node, what: str) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        found = ", ".join(repr(name) for name in names) or "nothing"
        raise mistake(node, f"{what} has no column '{missing[0]}': found {found}: expected 'times' and 'ids'")


def _two_columns(values: NDArray[np.float64], node: Node, what: str) -> NDArray[np.float64]:
    if values.ndim != 2 or values.shape[1] != 2:
        found = f"an array of shape {list(values.shape)}"
        raise mistake(node, f"{what} holds {found}: expected two columns, times and ids")
    return values


def _joined(columns: list[NDArray[np.float64]], node: Node, what: str) -> NDArray[np.float64]:
    times, ids = columns
    if times.shape != ids.shape or times.ndim != 1:
        message = f"{what} holds {times.size} times and {ids.size} ids"
        raise mistake(node, f"{message}: expected as many of each, in lists")
    return np.stack(columns, axis=1)
