"""Recordings wherever they lie: in a folder, a zip or an HDF5 file, or a single one."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from neuro.core.errors import ModelError
from neuro.core.inputs import note
from neuro.core.paths import file_path
from neuro.events.dataset._files import ARCHIVES, is_hdf5
from neuro.events.dataset._labelled import labelled
from neuro.events.dataset._recording import Recording
from neuro.events.dataset._recordings import Recordings
from neuro.events.dataset._sample import UNKNOWN
from neuro.events.dataset._stored import holds_samples, stored_samples
from neuro.events.errors import EventFileError
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
    note(file_path(path, "path"))
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
