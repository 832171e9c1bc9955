"""Recordings wherever they lie: in a folder, a zip or an HDF5 file, or a single one."""

from __future__ import annotations

import os
import warnings
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from neuro.core.errors import ModelError
from neuro.core.inputs import record_input
from neuro.core.paths import file_path
from neuro.events.dataset._files import ARCHIVES, files_of, is_hdf5, natural
from neuro.events.dataset._layouts import Layout, LayoutItem, is_part, layout_of
from neuro.events.dataset._recordings import UNKNOWN, Recording, Recordings
from neuro.events.dataset._stored import holds_samples, stored_samples
from neuro.events.errors import EventFileError, EventFileWarning
from neuro.events.opening import find
from neuro.events.source import opened_source


def recordings(
    path: str | os.PathLike[str],
    *,
    part: str | None = None,
    classes: Sequence[str] | None = None,
    layout: str | None = None,
    ending: str | None = None,
    whole: bool = True,
    label: str | None = None,
) -> Recordings:
    """Find the labelled recordings of a folder, a zip or an HDF5 file, or take a single recording.

    The layouts of well-known data sets are recognised, see `neuro.events.dataset.LAYOUTS`. In any other, the class of
    a file is the name of the folder it lies in, at any depth (``Train/<digit>/<index>.bin``), and files without class
    folders need a ``MANIFEST.csv`` beside them with the columns file, label, class. An HDF5 file has
    ``/<class>/<sample>``, as `neuro.events.Dataset.to_hdf5` and ``neuro events tohdf5`` write it. Files may be of any
    format that `neuro.events.load` reads, also of several. A single recording has the class that ``label`` tells.

    Args:
        path: the folder, zip, HDF5 file or recording.
        part: of data with parts, such as ``Train`` and ``Test``, only this one; upper and lower case are the same.
        classes: class names in the order of their labels, of the data trained on for example; None
            takes those found: folders by name (numbers by value), those of a manifest by its labels.
        layout: name of the layout of a folder or zip; None finds it.
        ending: only files of a folder or zip whose names end so, such as ``bin``.
        whole: whether data without parts stands for any part, and data that has only one for the other, which a
            warning says; if not, only ``Train`` and its like stand for themselves.
        label: name of the class of a single recording; None: its label is -1, `neuro.events.dataset.UNKNOWN`.

    Returns:
        The recordings, sorted by name (numbers by value). None is read yet, so that a damaged one is told when it is
        loaded, by an `EventFileError` with its path.

    Raises:
        EventFileError: no such path, no recording in it, a class that ``classes`` lacks, a wrong manifest.
        ModelError: `path` is no name of a file; an option that this kind of data cannot have.
    """
    record_input(file_path(path, "path"))
    where = os.fspath(path)
    asked = {"layout": layout, "ending": ending, "part": None if whole else part}
    if is_hdf5(where) and holds_samples(where):
        _refuse(where, "an HDF5 file", asked | {"layout": None if layout == "hdf5" else layout, "label": label})
        known, samples = stored_samples(where, classes)
        return Recordings(where, samples, known, "hdf5")
    if _is_recording(where):
        _refuse(where, "a single recording", asked)
        return _single(Path(path), where, classes, label)
    _refuse(where, "no single recording", {"label": label})
    return labelled(where, part, classes, layout, ending, whole)


def _refuse(where: str, kind: str, asked: Mapping[str, str | None]) -> None:
    """Refuse what has no meaning for a kind of data."""
    for name, value in asked.items():
        if value is not None:
            raise ModelError(f"{name}={value!r}: expected None, since {where} is {kind}")


def _is_recording(where: str) -> bool:
    """Whether there is a file of a known format, which no zip of recordings is.

    Raises:
        EventFileError: there is a file of no known kind.
    """
    if not Path(where).is_file():
        return False
    with opened_source(where, None) as source:
        try:
            find(source)
        except EventFileError:
            if zipfile.is_zipfile(where) or where.lower().endswith(ARCHIVES):
                return False
            raise
    return True


def _single(path: Path, where: str, classes: Sequence[str] | None, label: str | None) -> Recordings:
    known = tuple(classes if classes is not None else () if label is None else (label,))
    if label is not None and label not in known:
        raise EventFileError(where, f"class {label!r} is new, expected one of {', '.join(known)}")
    number = UNKNOWN if label is None else known.index(label)
    return Recordings(where, [Recording(path.name, where, number, path.read_bytes)], known, "recording")


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


def _of_part(where: str, layout: Layout, items: list[LayoutItem], part: str | None, whole: bool) -> list[LayoutItem]:
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
