"""What a recording is: counts, rates, gaps, hot pixels, and what its file says of itself."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from neuro.events._events import Events
from neuro.events.check import Checked
from neuro.events.errors import EventFileWarning
from neuro.events.files import BLOCK, _open, _scanned, _whole

BIN_US = 10_000
"""In which the highest rate is counted."""
GAPS = 3
HOT = 10
"""Most gaps and hot pixels that are named."""

FOUND_WHILE_READING = ("format", "t0")


@dataclass(slots=True)
class Info:
    """A recording as `info` sees it.

    Attributes:
        path: the file.
        format: its name.
        title: what the format is called.
        untested: why readers of this format were not tried on real files, "" where they were.
        bytes: of the file.
        sensor_size: width and height, px.
        sensor_told: whether the file tells the sensor; otherwise it is the smallest or usual one that holds all events.
        events: how many.
        on: how many are ON.
        start_us: time of the first event, None without events.
        stop_us: time of the last.
        peak_hz: highest rate in 10 ms, events/s.
        active_pixels: how many pixels have events.
        gaps: the longest times without events, each (from us, how long us), longest first.
        hot: columns, rows and counts of pixels with more than 10 times the events of their busiest neighbour.
        hot_pixels: how many there are; `hot` has the busiest.
        damage: what is wrong with the file; counts are those of what is whole.
        metadata: what else the file tells, such as other streams.
    """

    path: str
    format: str
    title: str
    untested: str
    bytes: int
    sensor_size: tuple[int, int]
    sensor_told: bool
    events: int = 0
    on: int = 0
    start_us: int | None = None
    stop_us: int | None = None
    peak_hz: float = 0.0
    active_pixels: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    hot: list[tuple[int, int, int]] = field(default_factory=list)
    hot_pixels: int = 0
    damage: list[str] = field(default_factory=list)
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def duration_us(self) -> int:
        """From the first to the last event, us."""
        return 0 if self.start_us is None or self.stop_us is None else self.stop_us - self.start_us

    @property
    def rate_hz(self) -> float | None:
        """Mean rate, events/s; None without duration."""
        return self.events * 1e6 / self.duration_us if self.duration_us else None

    def as_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        share = self.on / self.events if self.events else None
        told = {"duration_us": self.duration_us, "rate_hz": self.rate_hz, "on_share": share}
        return {**asdict(self), **told}


def info(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    report: Callable[[int], None] | None = None,
) -> Info:
    """Look through a recording once, in constant memory.

    Damage is told in the result and not raised, as long as the file can be opened.

    Args:
        path: the file.
        format: its name, where neither content nor ending tells.
        sensor_size: as for `neuro.events.load`.
        report: called with the number of events seen so far.

    Raises:
        EventFileError: there is no such file, or it is of no known kind.
    """
    opened, reader, found = _open(path, format, None)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", EventFileWarning)
        size = sensor_size or reader.sensor_size or _scanned(opened, reader, found, False)
        del told[:]  # the second look sees the same damage
        told_size = reader.sensor_size is not None
        out = Info(opened.name, found.name, found.title, found.untested, opened.size or 0, size, told_size)
        checked = Checked(opened.name, size, strict=False, sort=False)
        parts = (
            Events._trusted(*checked.piece(piece), size, {}) for piece in _whole(opened.name, reader, BLOCK, False)
        )
        _survey(out, parts, report)
        checked.warn()
    out.damage = [str(one.message).removeprefix(f"{opened.name}: ") for one in told]
    out.metadata = {key: value for key, value in reader.metadata.items() if key not in FOUND_WHILE_READING}
    return out


def _survey(out: Info, parts: Iterator[Events], report: Callable[[int], None] | None) -> None:
    """Count."""
    from neuro.events.filters.hot import hot_pixels

    width, height = out.sensor_size
    counts = np.zeros(width * height, np.int64)
    peak = _Peak()

    def seen() -> Iterator[Events]:
        for part in parts:
            if len(part):
                _add(out, part)
                counts[:] += np.bincount(part.y.astype(np.int64) * width + part.x, minlength=counts.size)
                peak.add(part.t)
                yield part
            if report is not None:
                report(out.events)

    hot = hot_pixels(seen())
    out.peak_hz = peak.most * 1e6 / BIN_US
    out.active_pixels = int(np.count_nonzero(counts))
    found = [(int(x), int(y), int(counts[y * width + x])) for x, y in hot]
    out.hot = sorted(found, key=lambda pixel: -pixel[2])[:HOT]
    out.hot_pixels = len(found)


def _add(out: Info, part: Events) -> None:
    before = int(part.t[0]) if out.stop_us is None else out.stop_us
    pauses = np.diff(part.t, prepend=before)
    longest = np.argsort(-pauses, kind="stable")[:GAPS]
    more = [(int(part.t[k] - pauses[k]), int(pauses[k])) for k in longest if pauses[k] > 0]
    out.gaps = sorted(out.gaps + more, key=lambda gap: -gap[1])[:GAPS]
    out.start_us = int(part.t[0]) if out.start_us is None else out.start_us
    out.stop_us = int(part.t[-1])
    out.events += len(part)
    out.on += int(np.count_nonzero(part.p))


class _Peak:
    """The most events in one bin of time."""

    def __init__(self) -> None:
        self.most = 0
        self._bin, self._held = np.iinfo(np.int64).min, 0

    def add(self, t: Any) -> None:
        """Count events by their times, us."""
        bins, counts = np.unique(t // BIN_US, return_counts=True)
        if bins[0] == self._bin:
            counts[0] += self._held
        self.most = max(self.most, int(counts.max()))
        self._bin, self._held = int(bins[-1]), int(counts[-1])
