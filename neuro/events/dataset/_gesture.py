"""DVS Gesture: recordings of people with a table beside each that says when which gesture was made.

``user01_led_labels.csv`` has the columns class (from 1), startTime_usec, endTime_usec; the times are those of the
events. ``trials_to_train.txt`` and ``trials_to_test.txt`` list the files of the parts.

Source: the archive's README (Amir et al., CVPR 2017); names of the gestures from its ``gesture_mapping.csv``.
"""

from __future__ import annotations

import csv
import io
from pathlib import PurePosixPath

from neuro.events.dataset._files import Files, natural
from neuro.events.dataset._item import Item
from neuro.events.errors import EventFileError

LABELS = "_labels.csv"
COLUMNS = ("class", "startTime_usec", "endTime_usec")
NAMES = (
    "hand_clapping", "right_hand_wave", "left_hand_wave", "right_arm_clockwise", "right_arm_counter_clockwise",
    "left_arm_clockwise", "left_arm_counter_clockwise", "arm_roll", "air_drums", "air_guitar", "other_gestures",
)  # fmt: skip
"""Gestures 1 to 11."""


def is_gestures(files: Files) -> bool:
    """Whether there is a recording with a table of gestures beside it."""
    return any(name.endswith(LABELS) and f"{name.removesuffix(LABELS)}.aedat" in files for name in files)


def gestures(where: str, files: Files) -> list[Item]:
    """All gestures, classes in the order of their numbers.

    Args:
        where: the folder or zip, for messages.
        files: what lies there.

    Raises:
        EventFileError: a table is wrong; the line is named.
    """
    parts = _parts(files)
    found = []
    for table in sorted((name for name in files if name.endswith(LABELS)), key=natural):
        file = f"{table.removesuffix(LABELS)}.aedat"
        if file not in files:
            raise EventFileError(where, f"{table} has no recording {file} beside it")
        part = parts.get(PurePosixPath(file).name, "")
        spans = enumerate(_spans(f"{where}/{table}", files[table]()))
        found += [(number, Item(f"{file}#{k}", file, NAMES[number - 1], span, part)) for k, (number, span) in spans]
    return [item for _, item in sorted(found, key=lambda pair: pair[0])]


def _spans(path: str, data: bytes) -> list[tuple[int, tuple[int, int]]]:
    """Number and span of each gesture of a table."""
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
    """The part of every file that a list names."""
    parts: dict[str, str] = {}
    for name in files:
        for part in ("train", "test"):
            if PurePosixPath(name).name == f"trials_to_{part}.txt":
                parts |= dict.fromkeys(files[name]().decode("utf-8", "replace").split(), part)
    return parts
