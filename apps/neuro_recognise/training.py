"""The record of a training: what follows from its recordings, and what makes it the same as another."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from neuro import ModelError
from neuro.events import EventFileError, Recordings
from neuro.events.dataset import UNKNOWN
from neuro_recognise.code import code_of
from neuro_recognise.method import Method

Training: TypeAlias = Mapping[str, Any]
OTHER = {"data": "other recordings", "code": "other code, of an earlier version or before an edit"}
REPLACE = "give another name, or --force (in Python replace=True) to replace it"


def settled(method: Method, data: Recordings) -> Method:
    """A method with everything decided that follows from the recordings to learn from.

    Raises:
        EventFileError: as of `field_of`.
        ModelError: the method cannot look at a field of this size.
    """
    return method.fitting(field_of(data))


def field_of(data: Recordings) -> tuple[int, int]:
    """Width and height of the field that recordings to learn from need, px.

    Raises:
        EventFileError: there are none, all are of one class, or one is damaged.
    """
    there = set(data.labels.tolist()) - {UNKNOWN}
    if len(there) < 2:
        only = f"has only the class '{data.classes[there.pop()]}'" if there else "has no recordings with a class"
        if data.layout == "recording":
            only = "is a single recording"
        raise EventFileError(data.path, f"{only}: expected recordings of at least two classes")
    return data.sensor_size(setting="--set size=[WIDTH, HEIGHT]")


def digest_of(fingerprint: str) -> str:
    """A short text that differs for other recordings."""
    return hashlib.blake2b(fingerprint.encode(), digest_size=16).hexdigest()


def told(method: Method, digest: str, recordings: int, seed: int, backend: str) -> dict[str, Any]:
    """The record of a training beside the settings."""
    return {"seed": seed, "backend": backend, "data": digest, "recordings": recordings, "code": code_of(method)}


def check_same(out: Path, there: tuple[Method, Training], now: tuple[Method, Training]) -> None:
    """Refuse to replace a recogniser by that of another training.

    Raises:
        ModelError: with the first thing that differs.
    """
    before, after = (_words(*one) for one in (there, now))
    for name in before | after:
        if before.get(name) != after.get(name):
            what = OTHER.get(name, f"{name} = {_word(before.get(name))}: found {_word(after.get(name))} now")
            raise ModelError(f"{out}: a recogniser that was trained with {what}", hint=REPLACE)


def _words(method: Method, training: Training) -> dict[str, Any]:
    return {"method": method.called(), **method.as_words(), **training}


def _word(value: Any) -> str:
    """A value, or the name of a part."""
    return next(iter(value)) if isinstance(value, dict) else str(value)
