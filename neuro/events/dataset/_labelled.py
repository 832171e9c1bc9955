"""The labelled recordings of a folder or zip: found by its layout, of one part, sorted."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from neuro.events.dataset._files import files_of, natural
from neuro.events.dataset._item import Item
from neuro.events.dataset._layouts import Layout, is_part, layout_of
from neuro.events.dataset._recording import Recording
from neuro.events.dataset._recordings import Recordings
from neuro.events.errors import EventFileError, EventFileWarning

PARTS = ("train", "test")
"""Parts by which data is known to have some."""


def labelled(
    where: str,
    part: str | None,
    classes: Sequence[str] | None,
    layout: str | None,
    ending: str | None,
    whole: bool,
) -> Recordings:
    """The recordings of a folder or zip; arguments and errors as of `neuro.events.recordings`."""
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
    if inside := [item for item in items if layout.in_part(item, wanted)]:
        return inside
    found = {name: [item for item in items if layout.in_part(item, name)] for name in PARTS}
    only = [name for name in PARTS if len(found[name]) == len(items)]
    if only and whole:
        warnings.warn(f"{where}: has only the part '{only[0]}', taken for {part!r}", EventFileWarning, stacklevel=4)
        return items
    if any(found.values()):
        raise EventFileError(where, f"no recordings in a folder {part!r}")
    if whole or is_part(Path(where).resolve().stem, wanted):
        return items
    raise EventFileError(where, f"has no parts, expected one named {part!r}; split() divides it")
