"""Properties of a recording: counts, rates, gaps, hot pixels, and the metadata of its file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_events.files import BLOCK
from neuro_events.opening import Checker, opened, smallest
from neuro_events.source import EventFileError, EventFileWarning, FileInput

BIN_US = 10_000
"""Length of the bins whose counts give the highest rate, us."""
GAPS = 3
"""Number of gaps that `Info` lists."""
HOT = 10
"""Number of hot pixels that `Info` lists."""
PIXELS = 1 << 24
"""Largest sensor whose events are counted per pixel, px. Sensors on the market have at most 1/16 of this size."""

OWN_METADATA = ("format", "t0")
"""Metadata that the readers add. `Info` has attributes for both."""


@dataclass(slots=True)
class Info:
    """Properties of a recording, as from `info`.

    Attributes:
        path: the file, as named in messages.
        format: name of the format.
        title: title of the format.
        untested: reason why the format was not tested on real files, "" if it was.
        bytes: size of the file, None for a pipe.
        sensor_size: width and height, px.
        sensor_told: True if the file states the sensor. Otherwise the sensor is the usual or smallest one that contains
            all events.
        events: number of events.
        on: number of ON events.
        start_us: time of the first event, us, None without events.
        stop_us: time of the last event, us, None without events.
        peak_hz: highest rate in 10 ms, events/s.
        active_pixels: number of pixels with events, None for a sensor of more than 2^24 px.
        gaps: the longest times without events, longest first, each as (start, duration) in us.
        hot: (column, row, count) of the busiest hot pixels. A hot pixel has more than 10 times the events of its
            busiest neighbour.
        hot_pixels: number of all hot pixels.
        damage: faults of the file. The counts cover the readable part.
        metadata: other properties that the file states, by name, such as the streams without events.
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
        """Time from the first to the last event, us."""
        return 0 if self.start_us is None or self.stop_us is None else self.stop_us - self.start_us

    @property
    def rate_hz(self) -> float | None:
        """Mean rate, events/s, or None without duration."""
        return self.events * 1e6 / self.duration_us if self.duration_us else None

    def as_dict(self) -> dict[str, Any]:
        """Return all attributes and the derived rates as a dictionary for JSON."""
        share = self.on / self.events if self.events else None
        facts = {"duration_us": self.duration_us, "rate_hz": self.rate_hz, "on_share": share}
        return {**asdict(self), **facts}


def info(
    source: FileInput,
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    report: Callable[[int], None] | None = None,
) -> Info:
    """Read a recording once, in constant memory, and return its properties.

    Damage is listed in the result and raises no error, as long as the file can be opened.

    Args:
        source: a path, the bytes of a file, or an open binary file such as standard input.
        format: name of the format, if neither content nor ending shows it.
        sensor_size: see `neuro.events.load`.
        name: name of bytes or of an open file.
        report: called with the number of events read so far.

    Raises:
        EventFileError: no such file, or an unknown format.
    """
    with opened(source, format, name, sensor_size) as file:
        kind, stated_size = file.format, None
        try:
            stated_size = file.sensor_size
        except EventFileError:
            if sensor_size is None:  # the user's sensor takes precedence over an ambiguous one in the file
                raise
        size = sensor_size or stated_size
        untested = kind.untested or getattr(file.reader, "untested", "")
        is_stated = stated_size is not None
        out = Info(file.name, kind.name, kind.title, untested, file.source.size, size or (1, 1), is_stated)
        pixels, peak = _Pixels(size or (0, 0)), _Peak()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", EventFileWarning)
            checker = Checker(file.name, size, strict=False, sort=False)
            for piece in file.pieces(BLOCK, False):
                t, x, y, p = checker.check(piece)
                if t.size:
                    _add(out, t, p)
                    pixels.add(x, y)
                    peak.add(t)
                if report is not None:
                    report(out.events)
            checker.warn()
        out.peak_hz = peak.most * 1e6 / BIN_US
        out.active_pixels, hot = pixels.active(), pixels.hot()
        out.hot, out.hot_pixels = hot[:HOT], len(hot)
        out.sensor_size = size or smallest(kind, pixels.width - 1, pixels.height - 1)
        out.damage = [str(warning.message).removeprefix(f"{file.name}: ") for warning in caught]
        out.metadata = {key: value for key, value in file.reader.metadata.items() if key not in OWN_METADATA}
    return out


def _add(out: Info, t: npt.NDArray[np.int64], p: npt.NDArray[np.uint8]) -> None:
    """Add the next events to the counts, the times and the longest gaps."""
    previous = np.concatenate((t[:1] if out.stop_us is None else np.array([out.stop_us], np.int64), t[:-1]))
    pauses = t.view(np.uint64) - previous.view(np.uint64)  # unsigned, so that gaps of more than 2^63 us are right
    longest = np.argsort(~pauses, kind="stable")[:GAPS]
    gaps = [(int(t[k]) - int(pauses[k]), int(pauses[k])) for k in longest if pauses[k]]
    out.gaps = sorted(out.gaps + gaps, key=lambda gap: -gap[1])[:GAPS]
    out.start_us = int(t[0]) if out.start_us is None else out.start_us
    out.stop_us = int(t[-1])
    out.events += t.size
    out.on += int(np.count_nonzero(p))


class _Pixels:
    """Event counts of each pixel. The sensor grows with the positions of the events.

    Attributes:
        width, height: current size of the sensor, px.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.width, self.height = 0, 0
        self._counts = np.zeros((0, 0), np.int64)
        self._grow(*size)

    def _grow(self, width: int, height: int) -> None:
        growth = max(0, height - self.height), max(0, width - self.width)
        if any(growth):
            self.width, self.height = self.width + growth[1], self.height + growth[0]
            padding = ((0, growth[0]), (0, growth[1]))
            self._counts = np.pad(self._counts, padding) if self._counted else np.zeros((0, 0), np.int64)

    @property
    def _counted(self) -> bool:
        return self.width * self.height <= PIXELS

    def add(self, x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16]) -> None:
        """Count events."""
        self._grow(int(x.max()) + 1, int(y.max()) + 1)
        if self._counted:
            pixel_counts = np.bincount(y.astype(np.int64) * self.width + x)
            self._counts.reshape(-1)[: pixel_counts.size] += pixel_counts

    def active(self) -> int | None:
        """Return the number of pixels with events, None for a sensor of more than `PIXELS`."""
        return int(np.count_nonzero(self._counts)) if self._counted else None

    def hot(self) -> list[tuple[int, int, int]]:
        """Return column, row and count of each hot pixel, the busiest first."""
        from neuro_events.filters.noise import busier_than_neighbours

        positions = np.argwhere(busier_than_neighbours(self._counts))
        pixels = ((int(x), int(y), int(self._counts[y, x])) for y, x in positions)
        return sorted(pixels, key=lambda pixel: -pixel[2])


class _Peak:
    """Counter of the largest number of events in one time bin."""

    def __init__(self) -> None:
        self.most = 0
        self._bin, self._bin_count = np.iinfo(np.int64).min, 0

    def add(self, t: Any) -> None:
        """Count events by their times, us."""
        bins, counts = np.unique(t // BIN_US, return_counts=True)
        if bins[0] == self._bin:
            counts[0] += self._bin_count
        self.most = max(self.most, int(counts.max()))
        self._bin, self._bin_count = int(bins[-1]), int(counts[-1])
