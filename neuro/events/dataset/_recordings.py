"""Labelled recordings in a folder or zip: found, sorted, and loaded one at a time."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

from neuro.core.paths import file_path
from neuro.events._events import Events
from neuro.events.dataset._files import files_of, natural
from neuro.events.dataset._item import Item
from neuro.events.dataset._layouts import Layout, is_part, layout_of
from neuro.events.errors import EventFileError
from neuro.events.files import load


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording that can be loaded.

    Attributes:
        name: path inside the folder or zip, with ``/``; of a part of a file, with ``#`` and its number.
        path: the folder or zip with the name behind it, for messages.
        label: index of its class in `Recordings.classes`.
        read: gives the bytes of the file.
        span_us: of a file with several recordings, the first us of this one and the one after its last.
        sensor_size: width and height that its data set is known for, px.
    """

    name: str
    path: str
    label: int
    read: Callable[[], bytes]
    span_us: tuple[int, int] | None = None
    sensor_size: tuple[int, int] | None = None

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        size = sensor_size or self.sensor_size
        events = load(self.read(), name=self.path, sensor_size=size, sort=sort, strict=strict)
        return events if self.span_us is None else events.between(*self.span_us)


class Recordings(Sequence[Recording]):
    """A sorted sequence of recordings.

    Attributes:
        path: the folder or zip.
        classes: class names; the label of a recording is an index into them.
        layout: name of the layout, see `neuro.events.dataset.LAYOUTS`.
    """

    def __init__(self, path: str, items: Sequence[Recording], classes: Sequence[str], layout: str = "") -> None:
        self.path = path
        self.classes = tuple(classes)
        self.layout = layout
        self._items = tuple(items)

    @overload
    def __getitem__(self, index: int) -> Recording: ...
    @overload
    def __getitem__(self, index: slice) -> Recordings: ...
    def __getitem__(self, index: int | slice) -> Recording | Recordings:
        if isinstance(index, slice):
            return Recordings(self.path, self._items[index], self.classes, self.layout)
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self._items)

    def __repr__(self) -> str:
        return f"<Recordings {len(self)} of {len(self.classes)} classes in {self.path}>"

    def fingerprint(self) -> str:
        """SHA-256 over classes, names, labels and contents: equal for equal data, wherever it lies."""
        digest = hashlib.sha256(repr(self.classes).encode())
        for item in self:
            data = item.read()
            digest.update(f"\0{item.name}\0{item.label}\0{len(data)}\0".encode())
            digest.update(data)
        return digest.hexdigest()


def recordings(
    path: str | os.PathLike[str],
    *,
    part: str | None = None,
    classes: Sequence[str] | None = None,
    layout: str | None = None,
    ending: str | None = None,
    whole: bool = True,
) -> Recordings:
    """Find the labelled recordings of a folder or zip.

    The layouts of well-known data sets are recognised, see `neuro.events.dataset.LAYOUTS`. In any other, the class of
    a file is the name of the folder it lies in, at any depth (``Train/<digit>/<index>.bin``), and files without class
    folders need a ``MANIFEST.csv`` beside them with the columns file, label, class.

    Args:
        path: the folder or zip.
        part: of data with parts, such as ``Train`` and ``Test``, only this one; upper and lower case are the same.
        classes: class names in the order of their labels, of the data trained on for example; None
            takes those found: folders by name (numbers by value), those of a manifest by its labels.
        layout: name of the layout; None finds it.
        ending: only files whose names end so, such as ``bin``.
        whole: whether data without parts stands for any part; if not, only ``Train`` and its like stand for themselves.

    Returns:
        The recordings, sorted by name (numbers by value).

    Raises:
        EventFileError: no such path, no recording in it, a class that ``classes`` lacks, a wrong manifest.
        ModelError: `path` is no name of a file.
    """
    file_path(path, "path")
    where = os.fspath(path)
    files = files_of(where)
    if ending is not None:
        tail = f".{ending.lower().lstrip('.')}"
        files = {name: read for name, read in files.items() if name.lower().endswith((tail, ".csv", ".txt"))}
    chosen = layout_of(where, files, layout)
    items = [item for item in chosen.find(where, files) if ending is None or item.file.lower().endswith(tail)]
    if not items:
        raise EventFileError(where, f"no recordings with names that end in {tail}")
    classes_in_order = list(dict.fromkeys(item.label for item in items))
    items = _of_part(where, chosen, sorted(items, key=lambda item: natural(item.name)), part, whole)
    present = {item.label for item in items}
    found = [c for c in classes_in_order if c in present]
    if classes is None:
        classes = found
    if missing := [c for c in found if c not in classes]:
        raise EventFileError(where, f"class {missing[0]!r} is new, expected one of {', '.join(classes)}")
    index = {c: k for k, c in enumerate(classes)}
    size = chosen.sensor_size
    made = [Recording(i.name, f"{where}/{i.name}", index[i.label], files[i.file], i.span_us, size) for i in items]
    return Recordings(where, made, classes, chosen.name)


def _of_part(where: str, layout: Layout, items: list[Item], part: str | None, whole: bool) -> list[Item]:
    """The items of a part."""
    if part is None:
        return items
    wanted = part.lower()
    inside = [item for item in items if layout.in_part(item, wanted)]
    if inside:
        return inside
    if any(layout.in_part(item, name) for item in items for name in ("train", "test")):
        raise EventFileError(where, f"no recordings in a folder {part!r}")
    if whole or is_part(Path(where).resolve().stem, wanted):
        return items
    raise EventFileError(where, f"has no parts, expected one named {part!r}; split() divides it")
