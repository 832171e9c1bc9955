"""Layouts of data sets in folders: the recordings among the files, with their classes and parts.

| name | data set | files |
| --- | --- | --- |
| nmnist | N-MNIST | ``Train/<digit>/<index>.bin``, 34x34 px |
| ncaltech101 | N-Caltech101 | ``Caltech101/<class>/image_0001.bin``; the annotations, also ``.bin``, are skipped |
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
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from neuro.apps import hdf5, unknown
from neuro_events.formats import FORMATS
from neuro_events.source import EventFileError

Files = Mapping[str, Callable[[], bytes]]
"""Mapping from the path inside the folder or zip, with ``/``, to a function that returns the bytes."""

ARCHIVES = (".tar", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar")
"""Endings of archives that must be unpacked first."""


def is_hdf5(path: str) -> bool:
    """Return whether the path is an HDF5 file."""
    try:
        with Path(path).open("rb") if Path(path).is_file() else io.BytesIO() as file:
            return hdf5.is_hdf5(file.read(hdf5.FRONT))
    except OSError:
        return False


def files_of(where: str) -> Files:
    """Return all files of a folder or zip, except hidden ones.

    Args:
        where: the folder or zip.

    Raises:
        EventFileError: no such path, or a file of another kind.
    """
    path = Path(where)
    if path.is_dir():
        paths = (Path(folder, f) for folder, _, names in os.walk(path) for f in names)
        contents = {f.relative_to(path).as_posix(): FileContent(f) for f in paths}
        return {name: read for name, read in contents.items() if not _is_hidden(name)}
    if not path.exists():
        raise EventFileError(where, "no such folder, zip or HDF5 file")
    if not path.is_file():
        raise EventFileError(where, "is neither file nor folder, expected a folder, zip or HDF5 file")
    try:
        archive = _Zip(where)
        return {name: _Member(archive, name) for name in archive.names() if not _is_hidden(name)}
    except zipfile.BadZipFile:
        text = "is not a folder, zip or HDF5 file, expected one with recordings"
        hint = "; unpack it first" if where.lower().endswith(ARCHIVES) else ""
        raise EventFileError(where, f"{text}{hint}") from None


class _Zip:
    """A zip that is opened on use and can be sent to another process.

    A forked process opens the file again, because processes share the position of an inherited file.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._open: zipfile.ZipFile | None = None
        self._process = 0

    def __getstate__(self) -> str:
        return self.path

    def __setstate__(self, path: str) -> None:
        self.__init__(path)  # type: ignore[misc]

    def _zip(self) -> zipfile.ZipFile:
        if self._open is None or self._process != os.getpid():
            self._open, self._process = zipfile.ZipFile(self.path), os.getpid()
        return self._open

    def names(self) -> list[str]:
        return [info.filename for info in self._zip().infolist() if not info.is_dir()]

    def entry(self, name: str) -> zipfile.ZipInfo:
        return self._zip().getinfo(name)

    def read(self, name: str) -> bytes:
        try:
            return self._zip().read(name)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
            raise EventFileError(f"{self.path}/{name}", f"damaged in the zip: {error}") from None


@dataclass(frozen=True, slots=True)
class _Member:
    archive: _Zip
    name: str

    def __call__(self) -> bytes:
        return self.archive.read(self.name)

    def stamp(self) -> str:
        """Return the size and the checksum that the zip states."""
        entry = self.archive.entry(self.name)
        return f"{entry.file_size} {entry.CRC:08x}"


@dataclass(frozen=True, slots=True)
class FileContent:
    """Function that returns the bytes of a file."""

    path: Path

    def __call__(self) -> bytes:
        return self.path.read_bytes()

    def stamp(self) -> str:
        """Return the size and the time of the last change, which differ after the content is replaced."""
        stat = self.path.stat()
        return f"{stat.st_size} {stat.st_mtime_ns}"


def _is_hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key that orders names with numbers by their values, e.g. "a2" before "a10"."""
    pieces = re.split(r"(\d+)", name)
    return tuple((0, int(s), s) if s.isascii() and s.isdigit() else (1, 0, s) for s in pieces if s)


LABELS = "_labels.csv"
COLUMNS = ("class", "startTime_usec", "endTime_usec")
NAMES = (
    "hand_clapping", "right_hand_wave", "left_hand_wave", "right_arm_clockwise", "right_arm_counter_clockwise",
    "left_arm_clockwise", "left_arm_counter_clockwise", "arm_roll", "air_drums", "air_guitar", "other_gestures",
)  # fmt: skip
"""Names of the gestures 1 to 11."""


MANIFEST = "MANIFEST.csv"
MANIFEST_COLUMNS = ("file", "label", "class")

TABLES = (".csv", ".txt")
"""Endings of tables. Notes have them too, so tables count as recordings only if there are no other event files."""

_POKER = re.compile(r"x?(club|diamond|heart|spade)\d+i?\.aedat")
_POKER_ES = re.compile(r"(tr|ts)(cl|di|he|sp)\d+\.es")
_SUITS = {"cl": "club", "di": "diamond", "he": "heart", "sp": "spade"}
_NCALTECH = re.compile(r"image_\d{4}\.bin")


def is_part(folder: str, part: str) -> bool:
    """Return whether a folder has the name of a part, e.g. ``Train`` or ``n-cars_train`` for the part "train"."""
    return folder.lower() == part or folder.lower().endswith((f"-{part}", f"_{part}"))


def _is_in_part_folder(item: LayoutItem, part: str) -> bool:
    """Return whether a folder above the class folder has the name of a part."""
    return any(is_part(folder, part) for folder in item.file.split("/")[:-2])


@dataclass(frozen=True, slots=True)
class LayoutItem:
    """A recording in a folder or zip.

    Attributes:
        name: name of the recording.
        file: file that contains the recording.
        label: name of its class.
        span_us: first us and end (exclusive) of the recording. None: the complete file.
        part: part of the recording, in lower case, "" if the data set does not state it.
    """

    name: str
    file: str
    label: str
    span_us: tuple[int, int] | None = None
    part: str = ""


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of a data set in its folder.

    Attributes:
        name: value of ``Dataset(..., layout=name)``.
        title: name for messages.
        fits: function that returns whether files have this layout.
        find: function from path and files to the recordings, with classes in the order of their labels; raises
            `EventFileError`.
        in_part: function that returns whether an item belongs to a part, such as ``train``, in lower case.
        sensor_size: width and height, px. None: the files state the size, or the sizes differ.
    """

    name: str
    title: str
    fits: Callable[[Files], bool]
    find: Callable[[str, Files], list[LayoutItem]]
    in_part: Callable[[LayoutItem, str], bool] = _is_in_part_folder
    sensor_size: tuple[int, int] | None = None


def recordings_in(files: Files) -> list[str]:
    """Return the names of event files. Tables are returned only if there are no other event files."""
    endings = tuple(suffix for f in FORMATS.values() for suffix in f.suffixes)
    events = [name for name in files if name.lower().endswith(endings)]
    other_files = [name for name in events if not name.lower().endswith(TABLES)]
    return other_files or [name for name in events if PurePosixPath(name).parent.name]


def _find_in_folders(path: str, files: Files) -> list[LayoutItem]:
    events = recordings_in(files)
    if not events:
        raise EventFileError(path, f"no recordings, {_describe_others(files)}")
    if loose_files := [name for name in events if "/" not in name]:
        raise EventFileError(
            path, f"{loose_files[0]} is in no class folder (is this folder one? then specify its parent), and there is "
            f"no {MANIFEST} with the columns {', '.join(MANIFEST_COLUMNS)}"
        )  # fmt: skip
    return _sorted_by_label([LayoutItem(name, name, PurePosixPath(name).parent.name) for name in events])


def _describe_others(files: Files) -> str:
    """Describe the files of a folder without recordings, and the remedy."""
    if archives := sorted((name for name in files if name.lower().endswith((".zip", *ARCHIVES))), key=natural):
        return f"but {archives[0]}: unpack it first, or specify its path if it is a zip"
    endings = sorted({PurePosixPath(name).suffix.lower() for name in files} - {""})
    existing = f" (there are only {', '.join(endings[:5])})" if endings else ""
    text = f"expected class folders with event files such as 3/00017.bin{existing}"
    return f"{text}; 'neuro events formats' lists the endings"


def _sorted_by_label(items: list[LayoutItem]) -> list[LayoutItem]:
    return sorted(items, key=lambda item: natural(item.label))


def _manifest_rows(files: Files) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(files[MANIFEST]().decode("utf-8-sig", "replace"))))


def _has_manifest(files: Files) -> bool:
    return MANIFEST in files and bool(rows := _manifest_rows(files)) and set(MANIFEST_COLUMNS) <= set(rows[0])


def _find_in_manifest(path: str, files: Files) -> list[LayoutItem]:
    rows = _manifest_rows(files)
    for line, row in enumerate(rows, 2):
        if row["file"] not in files:
            raise EventFileError(path, f"{MANIFEST} line {line}: no file {row['file']!r}")
    return [
        LayoutItem(row["file"], row["file"], row["class"])
        for row in sorted(rows, key=lambda r: natural(r["label"] or ""))
    ]


def _find_poker(path: str, files: Files) -> list[LayoutItem]:
    matches = {name: _POKER.fullmatch(PurePosixPath(name).name) for name in files}
    return _sorted_by_label([LayoutItem(name, name, match[1]) for name, match in matches.items() if match])


def _find_poker_es(path: str, files: Files) -> list[LayoutItem]:
    parts, items = {"tr": "train", "ts": "test"}, []
    for name in files:
        if match := _POKER_ES.fullmatch(PurePosixPath(name).name):
            items.append(LayoutItem(name, name, _SUITS[match[2]], part=parts[match[1]]))
    return _sorted_by_label(items)


def _all_in_folders(ending: str, folders: set[str]) -> Callable[[Files], bool]:
    """Return a function that returns whether there are recordings, all with this ending and in one of the folders."""

    def fits(files: Files) -> bool:
        events = [PurePosixPath(name) for name in recordings_in(files)]
        return bool(events) and all(e.parent.name in folders and e.name.lower().endswith(ending) for e in events)

    return fits


def _all_match(pattern: re.Pattern[str]) -> Callable[[Files], bool]:
    """Return a function that returns whether there are recordings whose names all match a pattern."""

    def fits(files: Files) -> bool:
        events = recordings_in(files)
        return bool(events) and all(pattern.fullmatch(PurePosixPath(name).name) for name in events)

    return fits


def _without_annotations(files: Files) -> Files:
    return {name: read for name, read in files.items() if "annotation" not in name.lower()}


def is_gestures(files: Files) -> bool:
    """Return whether there is a recording with a table of gestures beside it."""
    return any(name.endswith(LABELS) and f"{name.removesuffix(LABELS)}.aedat" in files for name in files)


def gestures(where: str, files: Files) -> list[LayoutItem]:
    """Return all gestures of DVS Gesture, with classes in the order of their numbers.

    Each recording has a table of the gestures and their times. ``user01_led_labels.csv`` has the columns class (from
    1), startTime_usec, endTime_usec, on the clock of the events. ``trials_to_train.txt`` and ``trials_to_test.txt``
    list the files of the parts.

    Args:
        where: the folder or zip, for messages.
        files: files of the folder or zip.

    Raises:
        EventFileError: a table is invalid; the message names the line.

    Source: the archive's README (Amir et al., CVPR 2017); names of the gestures from its ``gesture_mapping.csv``.
    """
    parts = _parts(files)
    numbered_items = []
    for table in sorted((name for name in files if name.endswith(LABELS)), key=natural):
        file = f"{table.removesuffix(LABELS)}.aedat"
        if file not in files:
            raise EventFileError(where, f"{table} has no recording {file} beside it")
        part = parts.get(PurePosixPath(file).name, "")
        spans = enumerate(_spans(f"{where}/{table}", files[table]()))
        numbered_items += [
            (number, LayoutItem(f"{file}#{k}", file, NAMES[number - 1], span, part)) for k, (number, span) in spans
        ]
    return [item for _, item in sorted(numbered_items, key=lambda pair: pair[0])]


def _spans(path: str, data: bytes) -> list[tuple[int, tuple[int, int]]]:
    """Return number and span of each gesture in a table."""
    rows = csv.DictReader(io.StringIO(data.decode("utf-8-sig", "replace")), skipinitialspace=True)
    if rows.fieldnames is None or not set(COLUMNS) <= set(rows.fieldnames):
        raise EventFileError(path, f"expected the columns {', '.join(COLUMNS)}")
    spans = []
    for line, row in enumerate(rows, 2):
        try:
            number, start, stop = (int(row[column]) for column in COLUMNS)
        except (TypeError, ValueError):
            raise EventFileError(path, f"line {line}: expected three whole numbers") from None
        if not (1 <= number <= len(NAMES) and 0 <= start < stop):
            text = f"line {line}: class {number} from {start} to {stop} us"
            raise EventFileError(path, f"{text}; expected a class from 1 to {len(NAMES)} that ends after it begins")
        spans.append((number, (start, stop)))
    return spans


def _parts(files: Files) -> dict[str, str]:
    """Return the part of every file in the lists of parts."""
    parts: dict[str, str] = {}
    for name in files:
        for part in ("train", "test"):
            if PurePosixPath(name).name == f"trials_to_{part}.txt":
                parts |= dict.fromkeys(files[name]().decode("utf-8", "replace").split(), part)
    return parts


LAYOUTS: Sequence[Layout] = (
    Layout("dvs_gesture", "DVS Gesture", is_gestures, gestures, lambda item, part: item.part == part),
    Layout("manifest", f"files listed in {MANIFEST}", _has_manifest, _find_in_manifest),
    Layout("nmnist", "N-MNIST", _all_in_folders(".bin", set("0123456789")), _find_in_folders),
    Layout(
        "ncaltech101",
        "N-Caltech101",
        lambda files: _all_match(_NCALTECH)(_without_annotations(files)),
        lambda where, files: _find_in_folders(where, _without_annotations(files)),
    ),
    Layout("ncars", "N-CARS", _all_in_folders("_td.dat", {"background", "cars"}), _find_in_folders),
    Layout("poker_dvs", "POKER-DVS", _all_match(_POKER), _find_poker, sensor_size=(35, 35)),
    Layout(
        "poker_dvs_es",
        "POKER-DVS as Event Stream",
        _all_match(_POKER_ES),
        _find_poker_es,
        lambda item, part: item.part == part,
    ),
    Layout("folders", "a folder for each class", lambda files: True, _find_in_folders),
)
"""Layouts in the order in which they are tried."""


def layout_of(where: str, files: Files, name: str | None = None) -> Layout:
    """Return the layout of some files.

    Args:
        where: the folder or zip, for messages.
        files: files of the folder or zip.
        name: name of the layout. None: detected.

    Raises:
        ModelError: no layout has this name.
        EventFileError: the files do not have this layout.
    """
    if name is None:
        return next(layout for layout in LAYOUTS if layout.fits(files))
    layouts = {layout.name: layout for layout in LAYOUTS}
    if name not in layouts:
        raise unknown("layout", name, layouts)
    if not layouts[name].fits(files):
        raise EventFileError(where, f"does not have the layout of {layouts[name].title}")
    return layouts[name]
