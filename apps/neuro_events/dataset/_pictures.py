"""Labelled grey pictures in an NPZ file as recordings: a pixel with grey level g has g events, all at 0 us."""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro_events._events import Events
from neuro_events.formats.npz import FAILURES
from neuro_events.source import EventFileError

ARRAYS = ("images", "labels")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A grey picture as a recording; see `neuro.events.dataset.Sample`.

    Attributes:
        name: ``#`` and the number of the picture in the file.
        path: path of the file followed by the name, for messages.
        label: index of its class.
        image: (height, width) uint8, grey levels.
    """

    name: str
    path: str
    label: int
    image: npt.NDArray[np.uint8]

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """Return events at 0 us. The number of ON events of a pixel is its grey level."""
        y, x = np.nonzero(self.image)
        levels = self.image[y, x]
        n = int(levels.sum(dtype=np.int64))
        columns, rows = (np.repeat(axis, levels).astype(np.uint16) for axis in (x, y))
        return Events(np.zeros(n, np.int64), columns, rows, np.ones(n, np.uint8), sensor_size or self.sensor()[0])

    def read(self) -> bytes:
        """Return the grey levels, row by row."""
        return self.image.tobytes()

    def stamp(self) -> str:
        """Return a digest of the grey levels."""
        return hashlib.sha256(self.read()).hexdigest()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Return the width and height, px, and True, since the file states them."""
        height, width = self.image.shape
        return (width, height), True


def is_pictures(where: str) -> bool:
    """Return True if a path is an NPZ file with pictures."""
    if not os.path.isfile(where):  # opening a pipe would block until it has a writer
        return False
    try:
        with zipfile.ZipFile(where) as archive:
            return f"{ARRAYS[0]}.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def pictures(where: str, classes: Sequence[str] | None) -> tuple[tuple[str, ...], list[Picture]]:
    """Return the names of the classes and the pictures of an NPZ file.

    Args:
        where: a file with ``images`` (n, height, width) uint8 and ``labels`` (n,), whole numbers.
        classes: names in the order of their labels. None: the labels of the file as text, in numeric order.

    Raises:
        EventFileError: an array is missing or has another shape or type, or a class is not in `classes`.
    """
    try:
        with np.load(where, allow_pickle=False) as file:
            images, labels = (file.get(name) for name in ARRAYS)
    except FAILURES as error:
        raise EventFileError(where, f"not an intact NPZ: {error}") from None
    if labels is None:
        raise EventFileError(where, "has no array 'labels', expected one beside 'images', a whole number per picture")
    if images.ndim != 3 or images.dtype != np.uint8 or 0 in images.shape:
        description = f"{images.dtype} of shape {images.shape}"
        raise EventFileError(where, f"images are {description}, expected uint8 (n, height, width), grey levels")
    if labels.shape != images.shape[:1] or labels.dtype.kind not in "iu":
        description = f"{labels.dtype} of shape {labels.shape}"
        raise EventFileError(
            where, f"labels are {description}, expected whole numbers ({len(images)},), one per picture"
        )
    class_names = tuple(map(str, np.unique(labels))) if classes is None else tuple(classes)
    names = [str(label) for label in labels.tolist()]
    if new := [name for name in names if name not in class_names]:
        raise EventFileError(where, f"class {new[0]!r} is new, expected one of {', '.join(class_names)}")
    index = {name: k for k, name in enumerate(class_names)}
    numbered = enumerate(zip(names, images, strict=True))
    return class_names, [Picture(f"#{k}", f"{where}#{k}", index[name], image) for k, (name, image) in numbered]
