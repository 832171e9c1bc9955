"""Evidence of a data set, computed once and cached in files of a few hundred recordings each.

A file is either complete or missing, so an interruption loses at most one file. The folder's name is a hash of the
settings, the recordings and the source code that computes evidence, so results of other code are never used. Each array
of a recording is read on access:

```
/NAME/shape     (recordings, axes) shapes of the arrays of this name
/NAME/values    these arrays, flattened and concatenated
```
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from neuro import ModelError
from neuro.apps import Settings, Unwritable, hdf5
from neuro_events import Events, Recordings
from neuro_events.dataset import Sample
from neuro_recognise.method import Method
from neuro_recognise.shown import Array, Evidence, Features, Ints, Lazy, unlabelled

OURS = ("neuro", "neuro_event", "neuro_models", "neuro_recognise", "neuro_torch", "neuro_train")
"""Packages whose code affects evidence and training. Code of other backends is not included: a backend is a setting."""
ONLY_TELL = {
    ("neuro", "cli"),
    ("neuro_recognise", "telling"),
    ("neuro_recognise", "cli.py"),
    ("neuro_train", "telling.py"),
    ("neuro_train", "cli.py"),
}
"""Modules and packages that only report results, so their code does not affect cached evidence."""
PLAIN = (bool, int, float, str)


def code_of(method: Settings) -> str:
    """Return a hash of the source code of a method and its parts.

    The hash covers the project's packages in `OURS`. For a third-party class, the hash also covers its file,
    and files of the same package or folder from which this file imports names. For a class of a notebook, the hash
    covers the bytecode of its functions.
    """
    classes = dict.fromkeys(_classes(method))
    digest = hashlib.sha256(_ours().encode())
    for name, module in sorted(_with_neighbours(cls.__module__ for cls in classes).items()):
        members = vars(module).values() if module else [cls for cls in classes if cls.__module__ == name]
        file = getattr(module, "__file__", None)
        digest.update(
            f"\0{name}\0".encode() + (_text(Path(file)) if file else repr([*_bytecode(members, name)]).encode())
        )
    return digest.hexdigest()[:32]


def _classes(settings: Settings) -> Iterator[type]:
    """Yield the classes of settings and of their parts, with all base classes."""
    yield from type(settings).__mro__
    for field in fields(settings):
        value = getattr(settings, field.name)
        if isinstance(value, Settings):
            yield from _classes(value)


@cache
def _ours() -> str:
    """Return the hash of the project's sources. It is computed once, because the loaded code does not change."""
    digest = hashlib.sha256()
    for folder in _folders():
        for file in sorted(folder.rglob("*")):
            inside = file.relative_to(folder)
            if file.suffix in (".py", ".yaml") and (folder.name, inside.parts[0]) not in ONLY_TELL:
                digest.update(f"\0{folder.name}/{inside.as_posix()}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def _folders() -> list[Path]:
    specs = [find_spec(name) for name in OURS]
    return [Path(spec.submodule_search_locations[0]) for spec in specs if spec and spec.submodule_search_locations]


def _with_neighbours(names: Iterable[str]) -> dict[str, ModuleType | None]:
    """Return the third-party modules with these names, and modules of the same packages or folders that they import."""
    modules: dict[str, ModuleType | None] = {}
    waiting = [*names]
    while waiting:
        name = waiting.pop()
        first = name.partition(".")[0]
        if name not in modules and first not in OURS and (first == "__main__" or first not in sys.stdlib_module_names):
            modules[name] = module = sys.modules.get(name)
            members = vars(module).values() if module else ()
            module_names = {m.__name__ if isinstance(m, ModuleType) else getattr(m, "__module__", "") for m in members}
            waiting += [item for item in module_names if isinstance(item, str) and _same_package(name, item)]
    return modules


def _same_package(name: str, other: str) -> bool:
    """Return whether two modules belong to one package, or are files of one folder."""
    if "." in name or "." in other:
        return name.partition(".")[0] == other.partition(".")[0]
    own_file, other_file = (getattr(sys.modules.get(module_name), "__file__", None) for module_name in (name, other))
    return bool(own_file and other_file and Path(own_file).parent == Path(other_file).parent)


@cache
def _text(file: Path) -> bytes:
    """Return the source of a module, cached."""
    return file.read_bytes() if file.is_file() else b""


def _bytecode(members: Iterable[object], module: str) -> Iterator[object]:
    """Yield the bytecode of the functions and methods defined in a module, with the plain globals that they read."""
    for entry in members:
        inner = getattr(entry, "fget", None) or getattr(entry, "__func__", entry)  # unwrap properties and class methods
        if getattr(inner, "__module__", None) == module:
            if isinstance(inner, type):
                yield from _bytecode([*vars(inner).values()], module)
            elif isinstance(inner, FunctionType):
                namespace = inner.__globals__
                plain = {
                    name: namespace[name] for name in inner.__code__.co_names if isinstance(namespace.get(name), PLAIN)
                }
                yield _instructions(inner.__code__), plain


def _instructions(code: CodeType) -> tuple[object, ...]:
    """Return the instructions of a function without its source position."""
    inner = (_instructions(c) if isinstance(c, CodeType) else c for c in code.co_consts)
    return (code.co_code, code.co_names, [sorted(c, key=repr) if isinstance(c, frozenset) else c for c in inner])


FORMAT = "neuro recognise evidence 1"


def keep(file: Path, evidence: Sequence[Evidence]) -> None:
    """Write evidence to a file, and replace an existing file.

    Raises:
        OSError: the folder cannot be created.
        Unwritable: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with hdf5.writing(file, FORMAT, replace=True) as out:
        write_evidence(out, evidence)


def write_evidence(group: Any, evidence: Sequence[Evidence]) -> None:
    """Write the evidence of at least one recording into an HDF5 group, with one subgroup for each name."""
    for name in evidence[0]:
        arrays = [item[name] for item in evidence]
        group[f"{name}/shape"] = np.array([array.shape for array in arrays], np.int64)
        group[f"{name}/values"] = np.concatenate([array.ravel() for array in arrays])


class KeptAnswers(Lazy[Evidence]):
    """Evidence of the recordings in a file. The file is opened on first access.

    Args:
        file: file that `keep` wrote.
        n: number of recordings in the file.
    """

    def __init__(self, file: Path, n: int) -> None:
        super().__init__(n, partial(_One, self))
        self.file = file


class _One(Mapping[str, Array]):
    """The arrays of one recording."""

    def __init__(self, answers: KeptAnswers, number: int) -> None:
        self._answers, self._number = answers, number

    def __getitem__(self, name: str) -> Array:
        return _opened(self._answers).read(name, self._number)

    def __iter__(self) -> Iterator[str]:
        return iter(_opened(self._answers).places)

    def __len__(self) -> int:
        return len(_opened(self._answers).places)


class _Place(NamedTuple):
    """Position of the arrays of one name in a file.

    Attributes:
        offset: position of the first byte.
        dtype: data type of the values.
        shapes: (recordings, axes) shape of the array of each recording.
        begins: (recordings + 1,) index of the first value of each recording.
    """

    offset: int
    dtype: np.dtype[np.generic]
    shapes: Ints
    begins: Ints


class _File:
    """An open file of evidence. It stays readable after another file has taken its name.

    HDF5 is used only to find the arrays' positions, because reading a small array with it takes ten times as long.
    """

    def __init__(self, path: Path) -> None:
        self.places = dict[str, _Place]()
        with hdf5.reading(path, FORMAT) as stored:
            for name, group in stored.items():
                shapes, values = group["shape"][()], group["values"]
                begins = np.concatenate(([0], np.cumsum(shapes.prod(axis=1)))).astype(np.int64)
                self.places[name] = _Place(values.id.get_offset() or 0, values.dtype, shapes, begins)
        self._path, self._number = path, os.open(path, os.O_RDONLY)

    def read(self, name: str, k: int) -> Array:
        """Read one array of a recording.

        Raises:
            ModelError: the file is damaged.
        """
        place = self.places[name]
        values = np.empty(place.shapes[k], place.dtype)
        begin = place.offset + int(place.begins[k]) * place.dtype.itemsize
        if values.size and os.preadv(self._number, [values.data], begin) != values.nbytes:
            raise ModelError(f"{self._path}: damaged {FORMAT}: it ends too early")
        return values

    def __del__(self) -> None:
        if hasattr(self, "_number"):
            os.close(self._number)


@lru_cache(maxsize=64)
def _opened(evidence: KeptAnswers) -> _File:
    return _File(evidence.file)


AT_ONCE = 500
"""Number of recordings in a file."""

Report = Callable[[int, int], None]
T = TypeVar("T")


def observed(method: Method, recordings: Iterable[Events], classes: Sequence[str]) -> Features:
    """Compute the evidence of recordings without labels, in memory.

    Raises:
        ModelError: a recording does not fit the method.
    """
    return unlabelled([method.observe(events) for events in recordings], tuple(classes))


def seen_of(recording: Sample, look: Callable[[Events], T]) -> T:
    """Load the events of a recording, and return `look(events)`.

    Raises:
        EventFileError: the recording is damaged.
        ModelError: the recording does not fit the method; the message names it.
    """
    events = recording.load()
    try:
        return look(events)
    except ModelError as error:
        raise error.at(None, recording.path) from None


def observe(
    method: Method, data: Recordings, *, fingerprint: str = "", cache: Path | None = None, report: Report | None = None
) -> Features:
    """Return the evidence of a data set, from the cache or computed now.

    Args:
        method: method that observes the recordings.
        data: labelled recordings.
        fingerprint: fingerprint of the data, if known; computing it reads all recordings.
        cache: folder for results, with a subfolder for each combination of contents, settings and code; None uses the
            user's cache. If it is not writable, results stay in memory.
        report: function that is called with the number of finished and of all recordings.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: a recording does not fit the method; the message names it.
    """
    import platformdirs

    settings = json.dumps(method.observing(), sort_keys=True)
    key = f"{method.called()} {settings} {code_of(method)} {fingerprint or data.fingerprint()}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    folder = (cache or platformdirs.user_cache_path("neuro") / "recognise") / name
    parts: list[Sequence[Evidence]] = []
    for first in range(0, len(data), AT_ONCE):
        file = folder / f"{first:08d}.h5"
        count = min(AT_ONCE, len(data) - first)
        parts.append(KeptAnswers(file, count))
        if not hdf5.is_whole(file, FORMAT):
            computed: list[Evidence] = []
            for item in data[first : first + count]:
                computed.append(seen_of(item, method.observe))
                if report:
                    report(first + len(computed), len(data))
            try:
                keep(file, computed)
            except (OSError, Unwritable):
                parts[-1] = computed
        if report:
            report(first + count, len(data))
    evidence = Lazy(len(data), partial(_evidence_at, parts))
    return Features(evidence, data.labels, tuple(item.name for item in data), data.classes)


def _evidence_at(parts: Sequence[Sequence[Evidence]], k: int) -> Evidence:
    """Return evidence k of a data set that is stored in parts of `AT_ONCE` recordings."""
    part, place = divmod(k, AT_ONCE)
    return parts[part][place]
