"""What a recording is: counts, rates, gaps, hot pixels, and what its file says of itself."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_events.files import BLOCK
from neuro_events.opening import Checked, opened, smallest
from neuro_events.source import EventFileError, EventFileWarning, Given

BIN_US = 10_000
"""In which the highest rate is counted."""
GAPS = 3
HOT = 10
"""Most gaps and hot pixels that are named."""
PIXELS = 1 << 24
"""On larger sensors, 16 times those that are sold, the events of single pixels are not counted."""

FOUND_WHILE_READING = ("format", "t0")


@dataclass(slots=True)
class Info:
    """A recording as `info` sees it.

    Attributes:
        path: the file, as it is called in messages.
        format: its name.
        title: what the format is called.
        untested: why readers of this format were not tried on real files, "" where they were.
        bytes: of the file, None where they came through a pipe.
        sensor_size: width and height, px.
        sensor_told: whether the file states the sensor; else it is the smallest or usual one that holds all events.
        events: how many.
        on: how many are ON.
        start_us: time of the first event, None without events.
        stop_us: time of the last.
        peak_hz: highest rate in 10 ms, events/s.
        active_pixels: how many pixels have events; None: not counted on a sensor of more than 2^24 px.
        gaps: the longest times without events, each (from us, how long us), longest first.
        hot: columns, rows and counts of pixels with more than 10 times the events of their busiest neighbour.
        hot_pixels: how many there are; `hot` has the busiest.
        damage: what is wrong with the file; counts are those of what is whole.
        metadata: what else the file states, such as other streams.
    """

    path: str
    format: str
    title: str
    untested: str
    bytes: int | None
    sensor_size: tuple[int, int]
    sensor_told: bool
    events: int = 0
    on: int = 0
    start_us: int | None = None
    stop_us: int | None = None
    peak_hz: float = 0.0
    active_pixels: int | None = 0
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
        facts = {"duration_us": self.duration_us, "rate_hz": self.rate_hz, "on_share": share}
        return {**asdict(self), **facts}


def info(
    source: Given,
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    report: Callable[[int], None] | None = None,
) -> Info:
    """Look through a recording once, in constant memory.

    Damage is reported in the result and not raised, as long as the file can be opened.

    Args:
        source: a path, the bytes of a file, or an open binary file such as standard input.
        format: its name, where neither content nor ending shows it.
        sensor_size: as for `neuro.events.load`.
        name: what to call bytes or an open file.
        report: called with the number of events seen so far.

    Raises:
        EventFileError: there is no such file, or it is of no known kind.
    """
    with opened(source, format, name, sensor_size) as file:
        kind, told_size = file.format, None
        try:
            told_size = file.sensor_size
        except EventFileError:
            if sensor_size is None:  # else it does not matter that the file states one that may mean two things
                raise
        size = sensor_size or told_size
        untested = kind.untested or getattr(file.reader, "untested", "")
        is_told = told_size is not None
        out = Info(file.name, kind.name, kind.title, untested, file.source.size, size or (1, 1), is_told)
        pixels, peak = _Pixels(size or (0, 0)), _Peak()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", EventFileWarning)
            checked = Checked(file.name, size, strict=False, sort=False)
            for piece in file.pieces(BLOCK, False):
                t, x, y, p = checked.piece(piece)
                if t.size:
                    _add(out, t, p)
                    pixels.add(x, y)
                    peak.add(t)
                if report is not None:
                    report(out.events)
            checked.warn()
        out.peak_hz = peak.most * 1e6 / BIN_US
        out.active_pixels, hot = pixels.active(), pixels.hot()
        out.hot, out.hot_pixels = hot[:HOT], len(hot)
        out.sensor_size = size or smallest(kind, pixels.width - 1, pixels.height - 1)
        out.damage = [str(one.message).removeprefix(f"{file.name}: ") for one in caught]
        out.metadata = {key: value for key, value in file.reader.metadata.items() if key not in FOUND_WHILE_READING}
    return out


def _add(out: Info, t: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]) -> None:
    before = np.concatenate((t[:1] if out.stop_us is None else np.array([out.stop_us], np.int64), t[:-1]))
    pauses = t.view(np.uint64) - before.view(np.uint64)  # right beyond 2^63 us, too
    longest = np.argsort(~pauses, kind="stable")[:GAPS]
    more = [(int(t[k]) - int(pauses[k]), int(pauses[k])) for k in longest if pauses[k]]
    out.gaps = sorted(out.gaps + more, key=lambda gap: -gap[1])[:GAPS]
    out.start_us = int(t[0]) if out.start_us is None else out.start_us
    out.stop_us = int(t[-1])
    out.events += t.size
    out.on += int(np.count_nonzero(p))


class _Pixels:
    """Events of each pixel, of a sensor that grows with them.

    Attributes:
        width, height: px.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.width, self.height = 0, 0
        self._counts = np.zeros((0, 0), np.int64)
        self._grow(*size)

    def _grow(self, width: int, height: int) -> None:
        more = max(0, height - self.height), max(0, width - self.width)
        if any(more):
            self.width, self.height = self.width + more[1], self.height + more[0]
            after = ((0, more[0]), (0, more[1]))
            self._counts = np.pad(self._counts, after) if self._counted else np.zeros((0, 0), np.int64)

    @property
    def _counted(self) -> bool:
        return self.width * self.height <= PIXELS

    def add(self, x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16]) -> None:
        """Count events."""
        self._grow(int(x.max()) + 1, int(y.max()) + 1)
        if self._counted:
            more = np.bincount(y.astype(np.int64) * self.width + x)
            self._counts.reshape(-1)[: more.size] += more

    def active(self) -> int | None:
        """How many have events."""
        return int(np.count_nonzero(self._counts)) if self._counted else None

    def hot(self) -> list[tuple[int, int, int]]:
        """Columns, rows and counts of those that never rest, the busiest first."""
        from neuro_events.filters.noise import alone

        found = ((int(x), int(y), int(self._counts[y, x])) for y, x in np.argwhere(alone(self._counts)))
        return sorted(found, key=lambda pixel: -pixel[2])


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
