"""How data sets lie in their folders: which files are recordings, and of which class and part.

| name | data set | how it lies |
| --- | --- | --- |
| nmnist | N-MNIST | ``Train/<digit>/<index>.bin``, 34x34 px |
| ncaltech101 | N-Caltech101 | ``Caltech101/<class>/image_0001.bin``; the annotations, also ``.bin``, are left out |
| ncars | N-CARS | ``n-cars_train/<class>/obj_000001_td.dat`` |
| poker_dvs | POKER-DVS | ``xclub01.aedat``: the class is in the name; 35x35 px |
| dvs_gesture | DVS Gesture | ``user01_led.aedat``, the gestures of a file in ``user01_led_labels.csv`` |
| manifest | any | ``MANIFEST.csv`` with the columns file, label, class |
| folders | any | ``.../<class>/<sample>`` |

Source: Orchard et al., Front. Neurosci. 9:437, 2015 (N-MNIST, N-Caltech101); Sironi et al., CVPR 2018 (N-CARS);
Serrano-Gotarredona and Linares-Barranco, Front. Neurosci. 9:481, 2015 (POKER-DVS); Amir et al., CVPR 2017 (DVS
Gesture); their archives.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from neuro.errors import unknown
from neuro.events.dataset._files import Files, natural
from neuro.events.dataset._gesture import gestures, is_gestures
from neuro.events.dataset._item import Item
from neuro.events.errors import EventFileError
from neuro.events.formats import FORMATS

MANIFEST = "MANIFEST.csv"
MANIFEST_COLUMNS = ("file", "label", "class")

TABLES = (".csv", ".txt")
"""Endings that are recordings only where there is nothing else: notes and lists have them too."""

_POKER = re.compile(r"x?(club|diamond|heart|spade)\d+i?\.aedat")
_NCARS = {"background", "cars"}


def _by_folder(item: Item, part: str) -> bool:
    """Whether a folder above the class folder is that of a part: ``train`` or such as ``n-cars_train``."""
    above = (folder.lower() for folder in item.file.split("/")[:-2])
    return any(folder == part or folder.endswith((f"-{part}", f"_{part}")) for folder in above)


def _by_item(item: Item, part: str) -> bool:
    return item.part == part


@dataclass(frozen=True, slots=True)
class Layout:
    """How a data set lies in its folder.

    Attributes:
        name: the word that ``Dataset(..., layout=name)`` takes.
        title: what to call it.
        fits: whether these files lie so.
        find: the recordings, classes in the order of their labels; raises `EventFileError`.
        in_part: whether an item is of a part, such as ``train``, in lower case.
        sensor_size: width and height, px; None where the files tell it, or it differs.
    """

    name: str
    title: str
    fits: Callable[[Files], bool]
    find: Callable[[str, Files], list[Item]]
    in_part: Callable[[Item, str], bool] = _by_folder
    sensor_size: tuple[int, int] | None = None


def recordings_in(files: Files) -> list[str]:
    """The names of event files; of tables only if there is no other."""
    endings = tuple(suffix for f in FORMATS for suffix in f.suffixes)
    events = [name for name in files if name.lower().endswith(endings)]
    others = [name for name in events if not name.lower().endswith(TABLES)]
    return others or [name for name in events if PurePosixPath(name).parent.name]


def _folders(where: str, files: Files) -> list[Item]:
    events = recordings_in(files)
    if not events:
        text = "no recordings, expected class folders with event files such as 3/00017.bin"
        raise EventFileError(where, f"{text}; 'neuro events formats' lists the endings")
    if flat := [name for name in events if "/" not in name]:
        raise EventFileError(
            where, f"{flat[0]} lies in no class folder, and there is no {MANIFEST} with "
            f"the columns {', '.join(MANIFEST_COLUMNS)}"
        )  # fmt: skip
    return _in_order([Item(name, name, PurePosixPath(name).parent.name) for name in events])


def _in_order(items: list[Item]) -> list[Item]:
    return sorted(items, key=lambda item: natural(item.label))


def _rows(files: Files) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(files[MANIFEST]().decode("utf-8-sig", "replace"))))


def _has_manifest(files: Files) -> bool:
    return MANIFEST in files and bool(rows := _rows(files)) and set(MANIFEST_COLUMNS) <= set(rows[0])


def _listed(where: str, files: Files) -> list[Item]:
    rows = _rows(files)
    for line, row in enumerate(rows, 2):
        if row["file"] not in files:
            raise EventFileError(where, f"{MANIFEST} line {line}: no file {row['file']!r}")
    return [
        Item(row["file"], row["file"], row["class"]) for row in sorted(rows, key=lambda r: natural(r["label"] or ""))
    ]


def _poker(where: str, files: Files) -> list[Item]:
    found = {name: _POKER.fullmatch(PurePosixPath(name).name) for name in files}
    return _in_order([Item(name, name, match[1]) for name, match in found.items() if match])


def _classes(files: Files, ending: str) -> tuple[set[str], bool]:
    """The folders of all event files, and whether all have an ending."""
    events = recordings_in(files)
    return {PurePosixPath(name).parent.name for name in events}, all(e.lower().endswith(ending) for e in events)


def _is_nmnist(files: Files) -> bool:
    classes, same = _classes(files, ".bin")
    return bool(classes) and same and classes <= set("0123456789")


def _is_ncars(files: Files) -> bool:
    classes, same = _classes(files, "_td.dat")
    return bool(classes) and same and classes <= _NCARS


def _is_poker(files: Files) -> bool:
    events = recordings_in(files)
    return bool(events) and all(_POKER.fullmatch(PurePosixPath(name).name) for name in events)


def _images(files: Files) -> Files:
    """Without annotations."""
    return {name: read for name, read in files.items() if "annotation" not in name.lower()}


def _is_ncaltech(files: Files) -> bool:
    images = [PurePosixPath(name).name for name in recordings_in(_images(files))]
    return bool(images) and all(re.fullmatch(r"image_\d{4}\.bin", name) for name in images)


LAYOUTS: Sequence[Layout] = (
    Layout("dvs_gesture", "DVS Gesture", is_gestures, gestures, _by_item),
    Layout("manifest", f"files listed in {MANIFEST}", _has_manifest, _listed),
    Layout("nmnist", "N-MNIST", _is_nmnist, _folders),
    Layout("ncaltech101", "N-Caltech101", _is_ncaltech, lambda where, files: _folders(where, _images(files))),
    Layout("ncars", "N-CARS", _is_ncars, _folders),
    Layout("poker_dvs", "POKER-DVS", _is_poker, _poker, sensor_size=(35, 35)),
    Layout("folders", "a folder for each class", lambda files: True, _folders),
)
"""In the order in which they are tried."""


def layout_of(where: str, files: Files, name: str | None = None) -> Layout:
    """The layout of some files.

    Args:
        where: the folder or zip, for messages.
        files: what lies there.
        name: of the layout; None finds it.

    Raises:
        ModelError: there is no layout of this name.
        EventFileError: the files do not lie so.
    """
    if name is None:
        return next(layout for layout in LAYOUTS if layout.fits(files))
    known = {layout.name: layout for layout in LAYOUTS}
    if name not in known:
        raise unknown("layout", name, known)
    if not known[name].fits(files):
        raise EventFileError(where, f"does not lie as {known[name].title} does")
    return known[name]
