"""The C1 spikes of a whole data set, computed once and kept."""

from __future__ import annotations

import contextlib
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.apps import Unwritable, hdf5
from neuro.events import EventFileError, Recordings
from neuro_remus.bars import shown
from neuro_remus.frontend import FrontEnd

VERSION = 1
FORMAT = "neuro remus spikes 1"
"""Of the front end's code: another number, and what was kept before is not used."""

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Spikes:
    """C1 spikes of all pseudo-frames of all recordings.

    Attributes:
        times: (spikes,) float64, ms from the start of the frame, on the front end's grid.
        ids: (spikes,) int64, indices into ``shape`` (C order).
        offsets: (frames + 1,) int64: frame i has the spikes ``[offsets[i], offsets[i + 1])``.
        sample: (frames,) int64, the recording that each frame is of, ascending.
        labels: (recordings,) int64, indices into ``classes``.
        names: (recordings,) names of the recordings.
        classes: class names.
        shape: orientations, rows, columns.
    """

    times: npt.NDArray[np.float64]
    ids: Ints
    offsets: Ints
    sample: Ints
    labels: Ints
    names: tuple[str, ...]
    classes: tuple[str, ...]
    shape: tuple[int, int, int]

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.names)

    def of_frames(self, frames: Ints) -> tuple[Ints, Ints]:
        """Where the spikes of some frames are.

        Args:
            frames: indices, in any order.

        Returns:
            (spikes,) indices into `times` and `ids`, one frame after the other; (frames + 1,) offsets into them.
        """
        where = _ranges(self.offsets[frames], self.offsets[frames + 1])
        return where, _offsets(np.diff(self.offsets)[frames])

    def take(self, recordings: npt.ArrayLike) -> Spikes:
        """Some of the recordings, in the order given.

        Args:
            recordings: indices.

        Returns:
            Their spikes; recording ``recordings[i]`` becomes number i.
        """
        chosen = np.asarray(recordings, np.int64)
        first, last = np.searchsorted(self.sample, [chosen, chosen + 1])
        frames = _ranges(first, last)
        spikes, offsets = self.of_frames(frames)
        return Spikes(
            self.times[spikes],
            self.ids[spikes],
            offsets,
            np.repeat(np.arange(len(chosen)), last - first),
            self.labels[chosen],
            tuple(self.names[i] for i in chosen),
            self.classes,
            self.shape,
        )


def c1_spikes(
    data: Recordings,
    front: FrontEnd | None = None,
    *,
    cache: str | os.PathLike[str] | None = None,
    progress: bool = True,
) -> Spikes:
    """Compute the C1 spikes of a data set, or read them where they were kept.

    Args:
        data: labelled recordings, from `neuro.events.recordings`.
        front: the front end; None takes the default.
        cache: folder for the HDF5 files in which results are kept, one per contents of the data and
            parameters; None takes the user's cache folder. A folder that cannot be written is not used.
        progress: show a bar.

    Returns:
        The spikes.

    Raises:
        EventFileError: a recording is damaged or does not fit the front end.
    """
    front = front or FrontEnd()
    file = _cache_file(data, front, cache)
    if (kept := _read(file, front)) is not None:
        return kept
    spikes = _compute(data, front, progress)
    with contextlib.suppress(OSError, Unwritable):
        _write(file, spikes, front)
    return spikes


def _compute(data: Recordings, front: FrontEnd, progress: bool) -> Spikes:
    times, ids, counts, frames = [], [], [], []
    for item in shown(data, "C1 spikes", len(data), progress):
        events = item.load()
        try:
            t, i, offsets = front.spikes(events)
        except ValueError as error:
            raise EventFileError(item.path, str(error)) from None
        times.append(t)
        ids.append(i.astype(np.uint16))
        counts.append(np.diff(offsets))
        frames.append(len(offsets) - 1)
    return Spikes(
        np.concatenate(times) if times else np.empty(0),
        np.concatenate(ids).astype(np.int64) if ids else np.empty(0, np.int64),
        _offsets(np.concatenate(counts) if counts else np.empty(0, np.int64)),
        np.repeat(np.arange(len(data)), frames),
        np.array([item.label for item in data], np.int64),
        tuple(item.name for item in data),
        data.classes,
        front.shape,
    )


def _offsets(counts: Ints) -> Ints:
    return np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))


def _ranges(first: Ints, last: Ints) -> Ints:
    """All of ``range(first[i], last[i])``, one after the other."""
    length = last - first
    start = np.repeat(first - _offsets(length)[:-1], length)
    return start + np.arange(len(start))


def _cache_file(data: Recordings, front: FrontEnd, cache: str | os.PathLike[str] | None) -> Path:
    import platformdirs

    folder = Path(cache) if cache is not None else platformdirs.user_cache_path("neuro") / "remus"
    key = hashlib.sha256(f"{VERSION} {front!r} {data.fingerprint()}".encode()).hexdigest()
    return folder / f"c1-{key[:32]}.h5"


def _write(file: Path, spikes: Spikes, front: FrontEnd) -> None:
    """Keep spikes, in the place of a file that could not be read."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with hdf5.writing(file, FORMAT, replace=True) as f:
        f["ticks"] = np.rint(spikes.times / front.resolution).astype(np.uint16)
        f["ids"] = spikes.ids.astype(np.uint16)
        f["offsets"], f["sample"], f["labels"] = spikes.offsets, spikes.sample, spikes.labels
        f["names"], f["classes"] = list(spikes.names), list(spikes.classes)


def _read(file: Path, front: FrontEnd) -> Spikes | None:
    """What was kept; None where there is nothing, or nothing that can be read."""
    import h5py

    try:
        with h5py.File(file) as f:
            names, classes = (tuple(f[k].asstr()[:].tolist()) for k in ("names", "classes"))
            ticks, ids = f["ticks"][:], f["ids"][:].astype(np.int64)
            offsets, sample, labels = f["offsets"][:], f["sample"][:], f["labels"][:]
    except (OSError, KeyError):
        return None
    return Spikes(ticks * front.resolution, ids, offsets, sample, labels, names, classes, front.shape)
