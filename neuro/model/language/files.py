"""Files of a description: those it includes, and arrays and spikes beside it.

Files outside the folder of the description are not read, and nothing in a file is run.
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
_ELSEWHERE: ContextVar[Callable[[str | None], Path | None] | None] = ContextVar("elsewhere", default=None)


@contextmanager
def elsewhere(find: Callable[[str | None], Path | None]) -> Iterator[None]:
    """Load descriptions whose recordings lie elsewhere, as those that results hold.

    Args:
        find: the path of a recording by the name that a description has for it; None stands for events of a program.
    """
    token = _ELSEWHERE.set(find)
    try:
        yield
    finally:
        _ELSEWHERE.reset(token)


def recording(node: Node, name: str) -> Path | None:
    """The path of a recording that a description names."""
    find = _ELSEWHERE.get()
    return inside(node, name) if find is None else find(name)


def of_program(node: Node, what: str) -> None:
    """Nothing, in the place of events of a program, where recordings may be elsewhere.

    Raises:
        ModelError: they may not.
    """
    if (find := _ELSEWHERE.get()) is None:
        raise mistake(node, f"{what}: events of a program: expected a file", "write file: NAME")
    find(None)


def inside(node: Node, name: str) -> Path:
    """The path of a file named in a description, which must lie in the folder of the description or below.

    Args:
        node: where it is named.
        name: relative to the folder of the file that `node` stands in.
    """
    folder = Path(node.where.file).parent
    parts = PurePosixPath(name).parts
    if PurePosixPath(name).is_absolute() or PureWindowsPath(name).drive or "\\" in name or ".." in parts:
        raise mistake(node, f"file {shown(name)}: expected a path inside the folder of the description, without '..'")
    path = folder / name
    try:
        real = path.resolve()
        leads_out = not real.is_relative_to(folder.resolve())
        there = real.is_file()
    except (OSError, ValueError, RuntimeError):
        raise mistake(node, f"file {shown(name)}: expected the name of a file") from None
    if leads_out:
        message = f"file {shown(name)} is a link out of the folder of the description: expected a file inside it"
        raise mistake(node, message)
    if not there:
        files = [p.name for p in path.parent.iterdir() if p.is_file()] if path.parent.is_dir() else []
        hint = near(path.name, [other for other in files if other != Path(node.where.file).name])
        raise mistake(node, f"no file {shown(name)} beside the description", hint)
    record_input(path)
    return path


def array(node: Node) -> FromFile:
    """The values that `{file: w.h5, key: name}` stands for."""
    path, said = named(node, ENDINGS)
    values = hdf5(path, said["file"], said["key"]) if "key" in said else npy(path, said["file"])
    return held(said, values)


def named(node: Node, endings: tuple[str, ...]) -> tuple[Path, dict[str, Node]]:
    """The file that `{file: ..., key: ...}` names, and its words; only HDF5 has a key.

    Args:
        node: the words.
        endings: those that a name may have.
    """
    said = words(node, ("file", "key"), "a file", needs=("file",))
    for word in said:
        if not isinstance(said[word].value, str):
            raise mistake(said[word], f"{word} = {said[word].value!r}: expected a name")
    name = said["file"].value
    check_named(said["file"], PurePosixPath(name).suffix, endings, node, said.get("key"))
    return inside(said["file"], name), said


def check_named(file: Node, ending: str, endings: tuple[str, ...], whole: Node, key: Node | None) -> None:
    """Refuse the name of a file that cannot be read, or one without a key that needs one.

    Args:
        file: the name.
        ending: its ending.
        endings: those that it may have.
        whole: where a missing key is reported.
        key: of the data set.
    """
    name = file.value
    if ending not in endings:
        raise mistake(file, f"file {shown(name)}: expected a name ending in {', '.join(endings)}")
    keyed = ending in HDF5
    if not keyed and key is not None:
        holds = "an NPY file holds one array" if ending == ".npy" else "a CSV file holds one table"
        raise mistake(key, f"a key for '{name}': expected none, {holds}")
    if keyed and key is None:
        raise mistake(whole, f"file {shown(name)} needs 'key', the data set in it")


def held(said: Mapping[str, Node], values: NDArray[np.float64]) -> FromFile:
    """Values with the words by which they were named."""
    values.flags.writeable = False
    return FromFile(said["file"].value, said["key"].value if "key" in said else "", values)


def npy(path: Path, node: Node) -> NDArray[np.float64]:
    """The array of an NPY file."""
    try:
        values = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError, SyntaxError):
        raise mistake(node, f"file '{node.value}': expected an NPY file with an array of numbers") from None
    check_numbers(values, node, f"file '{node.value}'")
    return np.array(values, dtype=np.float64)


def hdf5(path: Path, file: Node, key: Node) -> NDArray[np.float64]:
    """A data set of an HDF5 file."""
    import h5py

    what = f"'{key.value}' in '{file.value}'"
    check(path, file)
    try:
        with h5py.File(path, "r") as opened:
            data = opened
            for part in [p for p in key.value.split("/") if p]:
                link = data.get(part, getlink=True) if isinstance(data, h5py.Group) else None
                if link is None:
                    raise mistake(key, f"no data set {what}", nearest(key.value, _names(opened)))
                if not isinstance(link, h5py.HardLink):
                    raise mistake(key, f"{what} is a link: expected a data set of the file itself")
                data = data[part]
            if not isinstance(data, h5py.Dataset):
                raise mistake(key, f"{what} is a group: expected a data set", nearest("", _names(data)))
            if data.is_virtual or data.external:
                raise mistake(key, f"{what} is kept in other files: expected a data set of the file itself")
            check_numbers(data, key, what)
            return np.asarray(data[()], dtype=np.float64)
    except ModelError:
        raise
    except (OSError, ValueError, KeyError, RuntimeError, TypeError, MemoryError):
        raise mistake(file, f"file '{file.value}': expected an HDF5 file that can be read") from None


def check(path: Path, node: Node) -> None:
    """Refuse a file of ours that is not what was written; of one that lies still it is seen once."""
    try:
        status = path.stat()
        still = time.time_ns() - status.st_mtime_ns > 2 * 10**9  # two changes at once have the same time
        (_checked if still else _checked.__wrapped__)(path, (status.st_ino, status.st_size, status.st_mtime_ns))
    except ModelError as error:
        raise put_at(node, error) from None
    except OSError as error:
        raise mistake(node, f"file '{node.value}': cannot be read: {error.strerror}") from None


@lru_cache(maxsize=64)
def _checked(path: Path, status: tuple[int, ...]) -> str:
    return hdf5_file.check(path)


def _names(group: Any) -> list[str]:
    """Names of what lies in a group, for hints."""
    return [str(name) for name in group][:100]


def check_numbers(data: Any, node: Node, what: str) -> None:
    """Refuse what is no array of numbers, or too large for memory whatever its file says."""
    if data.dtype is None or data.dtype.kind not in "iuf" or not data.shape:
        found = "one number" if not data.shape else f"elements of type {data.dtype}"
        raise mistake(node, f"{what} holds {found}: expected an array of numbers")
    if data.size > MAX_ELEMENTS:
        raise mistake(node, f"{what} holds {data.size} numbers: expected at most {MAX_ELEMENTS}")


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
    times, ids, *more = (
        Node(f"{key.value}/{name}", key.where, key.label, key.source) for name in (COLUMNS if clock is None else _STEPS)
    )
    columns = [hdf5(path, file, times), hdf5(path, file, ids)]
    if clock is not None:
        columns[0] = clock.array_ms(columns[0].astype(np.int64))
    rows = _joined(columns, key, what)
    if more and "multiplicity" in names:
        rows = np.repeat(rows, hdf5(path, file, more[0]).astype(np.int64), axis=0)
    return rows


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
