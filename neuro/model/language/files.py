"""Files named in a description: included files, arrays, spikes and recordings.

Only files in the folder of the description or below are read, and no code in them is run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import hdf5 as hdf5_file
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, Where, nearest
from neuro.core.hints import near
from neuro.core.inputs import record_input
from neuro.core.values import FromFile, shown
from neuro.model.language.reader import Node, mistake, put_at, words

MAX_ELEMENTS = 2**28
HDF5 = (".h5", ".hdf5")
ENDINGS = (*HDF5, ".npy")
_ELSEWHERE: ContextVar[Callable[[str | None], Path | None] | None] = ContextVar("locate_recordings", default=None)


@contextmanager
def locate_recordings(find: Callable[[str | None], Path | None]) -> Iterator[None]:
    """Find recordings outside the folder of the description, e.g. for descriptions stored in files of results.

    Args:
        find: returns the path of a recording from its name in the description. The name is None for events that were
            passed to the network in Python and have no file.
    """
    token = _ELSEWHERE.set(find)
    try:
        yield
    finally:
        _ELSEWHERE.reset(token)


def recording(node: Node, name: str) -> Path | None:
    """Return the path of a recording that a description names."""
    find = _ELSEWHERE.get()
    return inside(node, name) if find is None else find(name)


def of_program(node: Node, what: str) -> None:
    """Return None, the value of a recording whose events were passed in Python and have no file.

    Raises:
        ModelError: `locate_recordings` is not in use, so the events cannot be found.
    """
    if (find := _ELSEWHERE.get()) is None:
        raise mistake(node, f"{what}: events of a program: expected a file", "write file: NAME")
    find(None)


def inside(node: Node, name: str) -> Path:
    """Return the path of a file named in a description. The file must be in the folder of the description or below.

    Args:
        node: the node with the name, for errors.
        name: the path relative to the folder of the description's file.
    """
    folder = Path(node.where.file).parent
    parts = PurePosixPath(name).parts
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).drive or "\\" in name or ".." in parts:
        raise mistake(node, f"file {shown(name)}: expected a path inside the folder of the description, without '..'")
    path = folder / name
    try:
        real = path.resolve()
        is_outside = not real.is_relative_to(folder.resolve())
        exists = real.is_file()
    except (OSError, ValueError, RuntimeError):
        raise mistake(node, f"file {shown(name)}: expected the name of a file") from None
    if is_outside:
        message = f"file {shown(name)} is a link out of the folder of the description: expected a file inside it"
        raise mistake(node, message)
    if not exists:
        files = [p.name for p in path.parent.iterdir() if p.is_file()] if path.parent.is_dir() else []
        hint = near(path.name, [other for other in files if other != Path(node.where.file).name])
        raise mistake(node, f"no file {shown(name)} beside the description", hint)
    record_input(path)
    return path


def array(node: Node) -> FromFile:
    """Read the array that `{file: w.h5, key: name}` names."""
    path, file_words = file_and_words(node, ENDINGS)
    has_key = "key" in file_words
    values = hdf5(path, file_words["file"], file_words["key"]) if has_key else npy(path, file_words["file"])
    return with_origin(file_words, values)


def file_and_words(node: Node, endings: tuple[str, ...]) -> tuple[Path, dict[str, Node]]:
    """Return the path and the words of `{file: ..., key: ...}`. Only HDF5 files have a key.

    Args:
        node: the mapping.
        endings: the accepted endings of the name.
    """
    file_words = words(node, ("file", "key"), "a file", needs=("file",))
    for word in file_words:
        if not isinstance(file_words[word].value, str):
            raise mistake(file_words[word], f"{word} = {file_words[word].value!r}: expected a name")
    name = file_words["file"].value
    check_name_and_key(file_words["file"], PurePosixPath(name).suffix, endings, node, file_words.get("key"))
    return inside(file_words["file"], name), file_words


def check_name_and_key(file: Node, ending: str, endings: tuple[str, ...], whole: Node, key: Node | None) -> None:
    """Raise an error for a file name with another ending, or for a key that is missing or must not be there.

    Args:
        file: the node with the name.
        ending: the ending of the name.
        endings: the accepted endings.
        whole: the node to which a missing key is reported.
        key: the node with the key of the data set, or None.
    """
    name = file.value
    if ending not in endings:
        raise mistake(file, f"file {shown(name)}: expected a name ending in {', '.join(endings)}")
    needs_key = ending in HDF5
    if not needs_key and key is not None:
        content = "an NPY file holds one array" if ending == ".npy" else "a CSV file holds one table"
        raise mistake(key, f"a key for '{name}': expected none, {content}")
    if needs_key and key is None:
        raise mistake(whole, f"file {shown(name)} needs 'key', the data set in it")


def with_origin(file_words: Mapping[str, Node], values: NDArray[np.float64]) -> FromFile:
    """Return values with the file and key from which they were read."""
    values.flags.writeable = False
    return FromFile(file_words["file"].value, file_words["key"].value if "key" in file_words else "", values)


def npy(path: Path, node: Node) -> NDArray[np.float64]:
    """Read the array of an NPY file."""
    try:
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError, SyntaxError):
        raise mistake(node, f"file '{node.value}': expected an NPY file with an array of numbers") from None
    check_numbers(values, node, f"file '{node.value}'")
    return np.array(values, dtype=np.float64)


def hdf5(path: Path, file: Node, key: Node) -> NDArray[np.float64]:
    """Read a data set of an HDF5 file. Links and data stored in other files are errors."""
    import h5py

    label = f"'{key.value}' in '{file.value}'"
    check(path, file)
    try:
        with h5py.File(path, "r") as hdf5_root:
            node = hdf5_root
            for part in [p for p in key.value.split("/") if p]:
                link = node.get(part, getlink=True) if isinstance(node, h5py.Group) else None
                if link is None:
                    raise mistake(key, f"no data set {label}", nearest(key.value, _names(hdf5_root)))
                if not isinstance(link, h5py.HardLink):
                    raise mistake(key, f"{label} is a link: expected a data set of the file itself")
                node = node[part]
            if not isinstance(node, h5py.Dataset):
                raise mistake(key, f"{label} is a group: expected a data set", nearest("", _names(node)))
            if node.is_virtual or node.external:
                raise mistake(key, f"{label} is stored in other files: expected a data set of the file itself")
            check_numbers(node, key, label)
            return np.asarray(node[()], dtype=np.float64)
    except ModelError:
        raise
    except (OSError, ValueError, KeyError, RuntimeError, TypeError, MemoryError):
        raise mistake(file, f"file '{file.value}': expected an HDF5 file that can be read") from None


def check(path: Path, node: Node) -> None:
    """Verify the digest of a file that neuro wrote. A file older than 2 s is verified once and remembered."""
    try:
        status = path.stat()
        # Two changes in quick succession may have the same time stamp, so a recent file is verified each time.
        is_old = time.time_ns() - status.st_mtime_ns > 2 * 10**9
        (_verify if is_old else _verify.__wrapped__)(path, (status.st_ino, status.st_size, status.st_mtime_ns))
    except ModelError as error:
        raise put_at(node, error) from None
    except OSError as error:
        raise mistake(node, f"file '{node.value}': cannot be read: {error.strerror}") from None


@lru_cache(maxsize=64)
def _verify(path: Path, status: tuple[int, ...]) -> str:
    return hdf5_file.check(path)


def _names(group: Any) -> list[str]:
    """Return at most 100 names of members of a group, for hints."""
    return [str(name) for name in group][:100]


def check_numbers(data: Any, node: Node, what: str) -> None:
    """Raise an error unless the data are an array of numbers of at most `MAX_ELEMENTS` elements."""
    if data.dtype is None or data.dtype.kind not in "iuf" or not data.shape:
        content = "one number" if not data.shape else f"elements of type {data.dtype}"
        raise mistake(node, f"{what} holds {content}: expected an array of numbers")
    if data.size > MAX_ELEMENTS:
        raise mistake(node, f"{what} holds {data.size} numbers: expected at most {MAX_ELEMENTS}")


CSV = ".csv"
COLUMNS = ("times", "ids")
"""Columns of a file of spikes."""
_STEPS = ("steps", "ids", "multiplicity")
"""Data sets with the spikes of a population in a file of results."""


def train(node: Node) -> FromFile:
    """Read the spikes that `{file: ..., key: ...}` names, a row of time and neuron per spike."""
    path, file_words = file_and_words(node, (*ENDINGS, CSV))
    return with_origin(file_words, _rows(path, file_words["file"], file_words.get("key")))


def train_of(path: Path, key: str | None, where: Where) -> NDArray[np.float64]:
    """Read the spikes of a file in any folder, for a program.

    Args:
        path: path of the file.
        key: for HDF5 files, the data set or group with the spikes, else None.
        where: the caller's line, for errors.

    Raises:
        ModelError: the file does not exist, or holds no spikes.
    """
    file = Node(str(path), where, where)
    check_name_and_key(file, path.suffix, (*ENDINGS, CSV), file, None if key is None else file)
    if not path.is_file():
        raise mistake(file, f"{path}: no such file")
    record_input(path)
    return _rows(path, file, None if key is None else Node(key, where, where))


def _rows(path: Path, file: Node, key: Node | None) -> NDArray[np.float64]:
    if key is not None:
        return _hdf5(path, file, key)
    return _csv(path, file) if path.suffix == CSV else _npy(path, file)


def _hdf5(path: Path, file: Node, key: Node) -> NDArray[np.float64]:
    """Read spikes from a group with a data set per column, as in results, or from a data set of two columns."""
    check(path, file)
    label, group = f"'{key.value}' in '{file.value}'", _group(path, key.value)
    if group is None:
        return _two_columns(hdf5(path, file, key), key, label)
    names, clock = group
    times, ids, *multiplicity = (
        Node(f"{key.value}/{name}", key.where, key.label, key.source) for name in (COLUMNS if clock is None else _STEPS)
    )
    columns = [hdf5(path, file, times), hdf5(path, file, ids)]
    if clock is not None:
        columns[0] = clock.array_ms(columns[0].astype(np.int64))
    rows = _stack_columns(columns, key, label)
    if multiplicity and "multiplicity" in names:
        rows = np.repeat(rows, hdf5(path, file, multiplicity[0]).astype(np.int64), axis=0)
    return rows


def _group(path: Path, key: str) -> tuple[list[str], Clock | None] | None:
    """Return the names in a group, and the clock if there is a data set `steps`, as in files of results.

    The result is None if the key is not a group. The result is also None if the file cannot be read, because the
    function that reads the data reports this error.
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
    """Read spikes from an array with two columns or with the fields `times` and `ids`."""
    label = f"file '{file.value}'"
    try:
        fields = np.load(path, mmap_mode="r", allow_pickle=False).dtype.names
    except (OSError, ValueError, EOFError, MemoryError, SyntaxError):
        fields = None  # `npy` below reports the error
    if fields is None:
        return _two_columns(npy(path, file), file, label)
    _check_columns(list(fields), file, label)
    values = np.load(path, allow_pickle=False)
    return _stack_columns([values[name].astype(np.float64) for name in COLUMNS], file, label)


def _csv(path: Path, file: Node) -> NDArray[np.float64]:
    """Read spikes from a table whose first line names the columns. Columns other than times and ids are ignored."""
    label = f"file '{file.value}'"
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError):
        raise mistake(file, f"{label}: expected a CSV file that can be read") from None
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    _check_columns(names, file, label)
    if 2 * len(lines) > MAX_ELEMENTS:
        raise mistake(file, f"{label} holds {len(lines) - 1} spikes: expected at most {MAX_ELEMENTS // 2}")
    column_indices, rows = [names.index(name) for name in COLUMNS], np.empty((len(lines) - 1, 2))
    for k, line in enumerate(lines[1:]):
        cells = line.split(",")
        try:
            rows[k] = [float(cells[column]) for column in column_indices]
        except (ValueError, IndexError):
            raise mistake(file, f"{label}, line {k + 2}: found {line!r}: expected a time and a neuron") from None
    return rows


def _check_columns(names: list[str], node: Node, what: str) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        columns = ", ".join(repr(name) for name in names) or "nothing"
        raise mistake(node, f"{what} has no column '{missing[0]}': found {columns}: expected 'times' and 'ids'")


def _two_columns(values: NDArray[np.float64], node: Node, what: str) -> NDArray[np.float64]:
    if values.ndim != 2 or values.shape[1] != 2:
        content = f"an array of shape {list(values.shape)}"
        raise mistake(node, f"{what} holds {content}: expected two columns, times and ids")
    return values


def _stack_columns(columns: list[NDArray[np.float64]], node: Node, what: str) -> NDArray[np.float64]:
    times, ids = columns
    if times.shape != ids.shape or times.ndim != 1:
        message = f"{what} holds {times.size} times and {ids.size} ids"
        raise mistake(node, f"{message}: expected two lists of the same length")
    return np.stack(columns, axis=1)
