"""What the recordings of a data set show, computed once and kept in files of a few hundred recordings each.

A file is whole or not there, so a kill costs only what was being computed. What other code observed is not used: a
folder is named after the settings, the recordings and a digest of the code that computes. Each array of each recording
is read when it is asked for:

```
/NAME/shape     (recordings, axes) of the arrays of this name
/NAME/values    these arrays, flat, one after the other
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
"""Packages that compute what is observed and learnt; another backend is a setting."""
ONLY_TELL = {
    ("neuro", "cli"),
    ("neuro_recognise", "telling"),
    ("neuro_recognise", "cli.py"),
    ("neuro_train", "telling.py"),
    ("neuro_train", "cli.py"),
}
"""Rooms in which nothing is computed that is kept."""
PLAIN = (bool, int, float, str)


def code_of(method: Settings) -> str:
    """A digest of the sources that a method and its parts come from: equal for equal code.

    Of this package all that computes counts; of a third-party class its file, and the files beside it or of its package
    that it takes names from. What was typed into a notebook counts by its functions.
    """
    classes = dict.fromkeys(_classes(method))
    digest = hashlib.sha256(_ours().encode())
    for name, module in sorted(_with_neighbours(cls.__module__ for cls in classes).items()):
        held = vars(module).values() if module else [cls for cls in classes if cls.__module__ == name]
        file = getattr(module, "__file__", None)
        digest.update(f"\0{name}\0".encode() + (_text(Path(file)) if file else repr([*_told(held, name)]).encode()))
    return digest.hexdigest()[:32]


def _classes(settings: Settings) -> Iterator[type]:
    """The classes of settings and of the parts in them, with all that they inherit from."""
    yield from type(settings).__mro__
    for one in fields(settings):
        value = getattr(settings, one.name)
        if isinstance(value, Settings):
            yield from _classes(value)


@cache
def _ours() -> str:
    """The digest of our own sources; read once, as it is the code that runs which counts."""
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
    """The third-party modules of some names, and those of the same place that they have names of."""
    found: dict[str, ModuleType | None] = {}
    waiting = [*names]
    while waiting:
        name = waiting.pop()
        first = name.partition(".")[0]
        if name not in found and first not in OURS and (first == "__main__" or first not in sys.stdlib_module_names):
            found[name] = module = sys.modules.get(name)
            held = vars(module).values() if module else ()
            others = {one.__name__ if isinstance(one, ModuleType) else getattr(one, "__module__", "") for one in held}
            waiting += [other for other in others if isinstance(other, str) and _together(name, other)]
    return found


def _together(name: str, other: str) -> bool:
    """Whether two modules are of one package, or files of one folder."""
    if "." in name or "." in other:
        return name.partition(".")[0] == other.partition(".")[0]
    here, there = (getattr(sys.modules.get(each), "__file__", None) for each in (name, other))
    return bool(here and there and Path(here).parent == Path(there).parent)


@cache
def _text(file: Path) -> bytes:
    """The source of a module, likewise read once."""
    return file.read_bytes() if file.is_file() else b""


def _told(things: Iterable[object], module: str) -> Iterator[object]:
    """What the functions and classes do that were defined in a module."""
    for thing in things:
        inner = getattr(thing, "fget", None) or getattr(thing, "__func__", thing)  # of properties and class methods
        if getattr(inner, "__module__", None) == module:
            if isinstance(inner, type):
                yield from _told([*vars(inner).values()], module)
            elif isinstance(inner, FunctionType):
                known = inner.__globals__
                plain = {name: known[name] for name in inner.__code__.co_names if isinstance(known.get(name), PLAIN)}
                yield _instructions(inner.__code__), plain


def _instructions(code: CodeType) -> tuple[object, ...]:
    """What a function does, without where it stands."""
    inner = (_instructions(one) if isinstance(one, CodeType) else one for one in code.co_consts)
    return code.co_code, code.co_names, [sorted(one, key=repr) if isinstance(one, frozenset) else one for one in inner]


FORMAT = "neuro recognise evidence 1"


def keep(file: Path, evidence: Sequence[Evidence]) -> None:
    """Write a file, in the place of whatever is there.

    Raises:
        OSError: its folder cannot be made.
        Unwritable: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with hdf5.writing(file, FORMAT, replace=True) as out:
        write_evidence(out, evidence)


def write_evidence(group: Any, evidence: Sequence[Evidence]) -> None:
    """Write evidence of some recordings, at least one, into a group of HDF5, a group for each name."""
    for name in evidence[0]:
        arrays = [one[name] for one in evidence]
        group[f"{name}/shape"] = np.array([array.shape for array in arrays], np.int64)
        group[f"{name}/values"] = np.concatenate([array.ravel() for array in arrays])


class KeptAnswers(Lazy[Evidence]):
    """The recordings of a file, which is opened when one of them is asked for.

    Args:
        file: as `keep` wrote it.
        n: recordings in it.
    """

    def __init__(self, file: Path, n: int) -> None:
        super().__init__(n, partial(_One, self))
        self.file = file


class _One(Mapping[str, Array]):
    """The arrays of one recording."""

    def __init__(self, of: KeptAnswers, number: int) -> None:
        self._of, self._number = of, number

    def __getitem__(self, name: str) -> Array:
        return _opened(self._of).read(name, self._number)

    def __iter__(self) -> Iterator[str]:
        return iter(_opened(self._of).places)

    def __len__(self) -> int:
        return len(_opened(self._of).places)


class _Place(NamedTuple):
    """Where the arrays of a name lie in a file.

    Attributes:
        offset: of the first byte.
        dtype: of the values.
        shapes: (recordings, axes).
        begins: (recordings + 1,) number of the first value of each.
    """

    offset: int
    dtype: np.dtype[np.generic]
    shapes: Ints
    begins: Ints


class _File:
    """An open file, which stays what it was where another takes its name.

    HDF5 takes ten times as long for so little, so it is asked only where the arrays lie.
    """

    def __init__(self, path: Path) -> None:
        self.places = dict[str, _Place]()
        with hdf5.reading(path, FORMAT) as kept:
            for name, group in kept.items():
                shapes, values = group["shape"][()], group["values"]
                begins = np.concatenate(([0], np.cumsum(shapes.prod(axis=1)))).astype(np.int64)
                self.places[name] = _Place(values.id.get_offset() or 0, values.dtype, shapes, begins)
        self._path, self._number = path, os.open(path, os.O_RDONLY)

    def read(self, name: str, k: int) -> Array:
        """The array of a recording.

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
def _opened(kept: KeptAnswers) -> _File:
    return _File(kept.file)


AT_ONCE = 500
"""Recordings in a file."""

Report = Callable[[int, int], None]
T = TypeVar("T")


def observed(method: Method, recordings: Iterable[Events], classes: Sequence[str]) -> Features:
    """What some recordings without labels show, in memory.

    Raises:
        ModelError: one does not fit the method.
    """
    return unlabelled([method.observe(events) for events in recordings], tuple(classes))


def seen_of(recording: Sample, look: Callable[[Events], T]) -> T:
    """What a function makes of the events of a recording.

    Raises:
        EventFileError: the recording is damaged.
        ModelError: it does not fit the method; it is named.
    """
    events = recording.load()
    try:
        return look(events)
    except ModelError as error:
        raise error.at(None, recording.path) from None


def observe(
    method: Method, data: Recordings, *, fingerprint: str = "", cache: Path | None = None, report: Report | None = None
) -> Features:
    """What a data set shows, from where it was kept or computed now.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        fingerprint: of the data, where it is known already; to find it all recordings are read.
        cache: folder in which results are kept, one folder for each contents, settings and code; None takes the
            user's cache. Where it cannot be written everything stays in memory.
        report: called with how many recordings are done, and of how many.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: one does not fit the method; it is named.
    """
    import platformdirs

    looks = json.dumps(method.observing(), sort_keys=True)
    key = f"{method.called()} {looks} {code_of(method)} {fingerprint or data.fingerprint()}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    folder = (cache or platformdirs.user_cache_path("neuro") / "recognise") / name
    parts: list[Sequence[Evidence]] = []
    for first in range(0, len(data), AT_ONCE):
        file = folder / f"{first:08d}.h5"
        wanted = min(AT_ONCE, len(data) - first)
        parts.append(KeptAnswers(file, wanted))
        if not hdf5.is_whole(file, FORMAT):
            computed: list[Evidence] = []
            for item in data[first : first + wanted]:
                computed.append(seen_of(item, method.observe))
                if report:
                    report(first + len(computed), len(data))
            try:
                keep(file, computed)
            except (OSError, Unwritable):
                parts[-1] = computed
        if report:
            report(first + wanted, len(data))
    evidence = Lazy(len(data), partial(_joined, parts))
    return Features(evidence, data.labels, tuple(item.name for item in data), data.classes)


def _joined(parts: Sequence[Sequence[Evidence]], k: int) -> Evidence:
    """Return that of one of several files of `AT_ONCE` recordings."""
    part, place = divmod(k, AT_ONCE)
    return parts[part][place]
