"""How data sets lie in their folders: which files are recordings, and of which class and part.

| name | data set | how it lies |
| --- | --- | --- |
| nmnist | N-MNIST | ``Train/<digit>/<index>.bin``, 34x34 px |
| ncaltech101 | N-Caltech101 | ``Caltech101/<class>/image_0001.bin``; the annotations, also ``.bin``, are left out |
| ncars | N-CARS | ``n-cars_train/<class>/obj_000001_td.dat`` |
| poker_dvs | POKER-DVS | ``xclub01.aedat``: the class is in the name; 35x35 px |
| poker_dvs_es | POKER-DVS as Event Stream | ``trcl0.es``, ``tscl0.es``: part and class are in the name |
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

from neuro.core.errors import unknown
from neuro.events.dataset._files import ARCHIVES, Files, natural
from neuro.events.dataset._gesture import gestures, is_gestures
from neuro.events.dataset._item import Item
from neuro.events.errors import EventFileError
from neuro.events.formats import FORMATS

MANIFEST = "MANIFEST.csv"
MANIFEST_COLUMNS = ("file", "label", "class")

TABLES = (".csv", ".txt")
"""Endings that are recordings only where there is nothing else: notes and lists have them too."""

_POKER = re.compile(r"x?(club|diamond|heart|spade)\d+i?\.aedat")
_POKER_ES = re.compile(r"(tr|ts)(cl|di|he|sp)\d+\.es")
_SUITS = {"cl": "club", "di": "diamond", "he": "heart", "sp": "spade"}
_NCALTECH = re.compile(r"image_\d{4}\.bin")
_NCARS = {"background", "cars"}


def is_part(folder: str, part: str) -> bool:
    """Whether a folder of this name is that of a part (lower case): ``Train`` or such as ``n-cars_train``."""
    return folder.lower() == part or folder.lower().endswith((f"-{part}", f"_{part}"))


def _by_folder(item: Item, part: str) -> bool:
    """Whether a folder above the class folder is that of a part."""
    return any(is_part(folder, part) for folder in item.file.split("/")[:-2])


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
    endings = tuple(suffix for f in FORMATS.values() for suffix in f.suffixes)
    events = [name for name in files if name.lower().endswith(endings)]
    others = [name for name in events if not name.lower().endswith(TABLES)]
    return others or [name for name in events if PurePosixPath(name).parent.name]


def _folders(where: str, files: Files) -> list[Item]:
    events = recordings_in(files)
    if not events:
        raise EventFileError(where, f"no recordings, {_others(files)}")
    if flat := [name for name in events if "/" not in name]:
        raise EventFileError(
            where, f"{flat[0]} lies in no class folder (is this one? then give the one above it), and there is no "
            f"{MANIFEST} with the columns {', '.join(MANIFEST_COLUMNS)}"
        )  # fmt: skip
    return _in_order([Item(name, name, PurePosixPath(name).parent.name) for name in events])


def _others(files: Files) -> str:
    """What there is in place of recordings, and what to do about it."""
    if packed := sorted((name for name in files if name.lower().endswith((".zip", *ARCHIVES))), key=natural):
        return f"but {packed[0]}: unpack it first, or give its name if it is a zip"
    endings = sorted({PurePosixPath(name).suffix.lower() for name in files} - {""})
    there = f" (there are only {', '.join(endings[:5])})" if endings else ""
    text = f"expected class folders with event files such as 3/00017.bin{there}"
    return f"{text}; 'neuro events formats' lists the endings"


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


def _poker_es(where: str, files: Files) -> list[Item]:
    parts, found = {"tr": "train", "ts": "test"}, []
    for name in files:
        if match := _POKER_ES.fullmatch(PurePosixPath(name).name):
            found.append(Item(name, name, _SUITS[match[2]], part=parts[match[1]]))
    return _in_order(found)


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


def _named(pattern: re.Pattern[str]) -> Callable[[Files], bool]:
    """Whether there are recordings, and the names of all are of a pattern."""

    def fits(files: Files) -> bool:
        events = recordings_in(files)
        return bool(events) and all(pattern.fullmatch(PurePosixPath(name).name) for name in events)

    return fits


def _images(files: Files) -> Files:
    """Without annotations."""
    return {name: read for name, read in files.items() if "annotation" not in name.lower()}


def _is_ncaltech(files: Files) -> bool:
    return _named(_NCALTECH)(_images(files))


LAYOUTS: Sequence[Layout] = (
    Layout("dvs_gesture", "DVS Gesture", is_gestures, gestures, _by_item),
    Layout("manifest", f"files listed in {MANIFEST}", _has_manifest, _listed),
    Layout("nmnist", "N-MNIST", _is_nmnist, _folders),
    Layout("ncaltech101", "N-Caltech101", _is_ncaltech, lambda where, files: _folders(where, _images(files))),
    Layout("ncars", "N-CARS", _is_ncars, _folders),
    Layout("poker_dvs", "POKER-DVS", _named(_POKER), _poker, sensor_size=(35, 35)),
    Layout("poker_dvs_es", "POKER-DVS as Event Stream", _named(_POKER_ES), _poker_es, _by_item),
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
