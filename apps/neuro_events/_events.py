"""The events of one recording: four arrays, a sensor size and the file's metadata."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Table, argument, as_html, is_number, refuse_masked, same

EVENT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""Packed record of 13 bytes for an event: time in us, column and row in px, polarity (1 = ON)."""

T_MAX = (1 << 63) - 1
"""The latest time, us."""


Columns = tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]
"""Times, columns, rows and polarities of events. Numba unpacks this plain tuple four times as fast as a named tuple."""


def empty_columns(n: int) -> Columns:
    """Return uninitialised arrays for n events."""
    return np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16), np.empty(n, np.uint8)


def joined_columns(parts: Iterable[Columns]) -> Columns:
    """Concatenate the columns of consecutive parts."""
    t, x, y, p = zip(empty_columns(0), *parts, strict=True)
    return np.concatenate(t), np.concatenate(x), np.concatenate(y), np.concatenate(p)


class Event(NamedTuple):
    """An event with its time in us, column and row in px, and polarity (1 = ON)."""

    t: int
    x: int
    y: int
    p: int


Index = slice | npt.NDArray[np.integer[Any]] | npt.NDArray[np.bool_]


def first_fault(
    t: npt.NDArray[Any],
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
    p: npt.NDArray[Any],
    sensor_size: tuple[int, int],
) -> tuple[int, str] | None:
    """Return the index of the first impossible event and its fault, or None if all events are valid.

    An event is impossible if a coordinate lies off the sensor, the polarity is neither 0 nor 1, or its time is earlier
    than the time of the event before. Example: x = (0, 3, 9) on a 3x2 sensor gives (1, "x is 3, expected 0 to 2 ...").

    Args:
        t: (n,) time, us.
        x: (n,) column, px, 0 at the left.
        y: (n,) row, px, 0 at the top.
        p: (n,) polarity, 0 or 1.
        sensor_size: width and height, px.
    """
    width, height = sensor_size
    faults: list[tuple[int, str]] = []
    for name, values, limit in (("x", x, width - 1), ("y", y, height - 1), ("p", p, 1)):
        is_outside = (values < 0) | (values > limit)
        if is_outside.any():
            k = int(is_outside.argmax())
            faults.append((k, f"{name} is {values[k]}, expected 0 to {limit} (sensor {width}x{height})"))
    if t.dtype == np.uint64 and (is_late := t > np.uint64(T_MAX)).any():
        k = int(is_late.argmax())
        faults.append((k, f"t is {t[k]}, expected at most {T_MAX} us"))
    runs_back = t[1:] < t[:-1]
    if runs_back.any():
        k = int(runs_back.argmax()) + 1
        faults.append((k, f"time runs back from {t[k - 1]} to {t[k]} us"))
    return min(faults, default=None, key=lambda fault: fault[0])


def checked_size(size: object) -> tuple[int, int]:
    """Return the width and height of a sensor, px.

    Raises:
        ModelError: `size` is not a pair of whole numbers from 1 to 65536.
    """
    sides = tuple(size) if isinstance(size, tuple | list | np.ndarray) else ()
    if len(sides) != 2 or not all(isinstance(n, int | np.integer) and 1 <= n <= 65536 for n in sides):
        raise ModelError(f"sensor_size = {size!r:.60}: expected width and height of 1 to 65536 px")
    return int(sides[0]), int(sides[1])


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """Events of one sensor in the order of time.

    Arrays of other integer types are converted. Values that do not fit raise an error. ``events[index]`` with a slice,
    a mask or indices returns a part with the same sensor and metadata. Iteration yields an `Event` at a time.
    ``np.asarray(events)`` is the array of `records`. ``a + b`` merges two recordings in the order of time.

    Attributes:
        t: (n,) int64, us, non-decreasing.
        x: (n,) uint16, column, px, 0 at the left.
        y: (n,) uint16, row, px, 0 at the top.
        p: (n,) uint8, 1 = ON (brighter), 0 = OFF (darker).
        sensor_size: width and height, px.
        metadata: other properties that the source of the recording states, by name.

    Raises:
        ValueError: lengths differ, values are not integers, or an event is impossible. The message names the first
            impossible event.
    """

    t: npt.NDArray[np.int64]
    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    p: npt.NDArray[np.uint8]
    sensor_size: tuple[int, int]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        width, height = checked_size(self.sensor_size)
        for name, values in zip("txyp", (self.t, self.x, self.y, self.p), strict=True):
            refuse_masked(values, name)
        arrays = t, x, y, p = [np.asarray(a) for a in (self.t, self.x, self.y, self.p)]
        if t.ndim != 1:
            raise ModelError(f"t has shape {t.shape}, expected (n,)")
        for name, a in zip("txyp", arrays, strict=True):
            if a.ndim != 1 or len(a) != len(arrays[0]):
                raise ModelError(f"{name} has shape {a.shape}, expected ({len(arrays[0])},) like t")
            if a.dtype.kind not in "iub" and len(a):
                raise ModelError(f"{name} has type {a.dtype}, expected integers")
        if fault := first_fault(t, x, y, p, (width, height)):
            raise ModelError(f"event {fault[0]}: {fault[1]}")
        for name, a in zip("txyp", arrays, strict=True):
            object.__setattr__(self, name, np.ascontiguousarray(a, EVENT[name]))
        object.__setattr__(self, "sensor_size", (width, height))

    @classmethod
    def _trusted(
        cls,
        t: npt.NDArray[np.int64],
        x: npt.NDArray[np.uint16],
        y: npt.NDArray[np.uint16],
        p: npt.NDArray[np.uint8],
        sensor_size: tuple[int, int],
        metadata: Mapping[str, Any],
    ) -> Events:
        """Build events from arrays that the caller has checked, without a second check."""
        self = object.__new__(cls)
        values = (t, x, y, p, sensor_size, metadata)
        for name, value in zip(("t", "x", "y", "p", "sensor_size", "metadata"), values, strict=True):
            object.__setattr__(self, name, value)
        return self

    @property
    def _columns(self) -> Columns:
        return self.t, self.x, self.y, self.p

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: Index) -> Events:
        if not isinstance(index, slice) and (np.ndim(index) != 1 or np.asarray(index).dtype.kind not in "iub"):
            if np.shape(index) != (0,):
                hint = "events.records()[k] is event k alone"
                raise ModelError(f"events[{index!r:.60}]: expected a slice, a mask or indices", hint=hint)
            index = slice(0, 0)
        parts = (self.t[index], self.x[index], self.y[index], self.p[index])
        if isinstance(index, slice) and (index.step or 1) > 0:
            return Events._trusted(*parts, self.sensor_size, self.metadata)
        return Events(*parts, self.sensor_size, self.metadata)

    def __iter__(self) -> Iterator[Event]:
        """Yield one `Event` at a time. For many events the arrays are faster."""
        return map(Event, *(getattr(self, name).tolist() for name in "txyp"))

    __array_ufunc__ = None
    """None makes numpy leave `array + events` to `__radd__`."""

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        """Return the array of `records`, converted to `dtype` if one is given.

        Raises:
            ModelError: `copy` is False. The columns are separate arrays, so the array of records is always a copy.
        """
        if copy is False:
            raise ModelError("events as one array are a copy: expected copy=None or True")
        return self.records() if dtype is None else self.records().astype(dtype)

    def _of_records(self, array: npt.NDArray[Any]) -> Events:
        """Convert a structured array to events of the same sensor."""
        names = array.dtype.names or ()
        if not {"t", "x", "y", "p"} <= set(names):
            description = f"fields {', '.join(names)}" if names else str(array.dtype)
            raise ModelError(f"events + an array of {description}: expected a structured array with t, x, y and p")
        return Events(array["t"], array["x"], array["y"], array["p"], self.sensor_size, self.metadata)

    def __radd__(self, other: Any) -> Events:
        """Return `array + events`. The function `sum` begins with 0 + events, which returns the events."""
        if isinstance(other, np.ndarray):
            return self._of_records(other) + self
        return self if type(other) is int and other == 0 else NotImplemented

    def __add__(self, other: Events | npt.NDArray[Any]) -> Events:
        """Merge two recordings in the order of time. At equal times the events of the left operand come first.

        Metadata are kept where both recordings have the same value. A structured array counts as events of the same
        sensor.

        Raises:
            ModelError: the sensors differ.
        """
        if isinstance(other, np.ndarray):
            other = self._of_records(other)
        if not isinstance(other, Events):
            return NotImplemented
        if other.sensor_size != self.sensor_size:
            (w, h), (width, height) = other.sensor_size, self.sensor_size
            hint = "neuro.events.filters.Crop and Downsample change a sensor's size"
            raise ModelError(f"events of a {width}x{height} sensor + events of {w}x{h}: expected one size", hint=hint)
        columns = [np.concatenate((getattr(self, name), getattr(other, name))) for name in "txyp"]
        if len(self) and len(other) and self.t[-1] > other.t[0]:
            order = np.argsort(columns[0], kind="stable")
            columns = [column[order] for column in columns]
        shared_metadata = {k: v for k, v in self.metadata.items() if k in other.metadata and same(v, other.metadata[k])}
        t, x, y, p = columns
        return Events._trusted(t, x, y, p, self.sensor_size, shared_metadata)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Events):
            return NotImplemented
        is_equal = self.sensor_size == other.sensor_size and len(self) == len(other)
        return is_equal and bool(np.array_equal(self.records(), other.records()))

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        width, height = self.sensor_size
        span = f", {self.t[0]} to {self.t[-1]} us" if len(self) else ""
        return f"<Events {len(self)} of {width}x{height}{span}>"

    def _repr_html_(self) -> str:
        width, height = self.sensor_size
        seconds = (int(self.t[-1]) - int(self.t[0])) / 1e6 if len(self) else 0.0
        rows = [
            ("events", f"{len(self):,}"),
            ("sensor", f"{width} x {height} px"),
            ("from", f"{self.t[0]:,} us" if len(self) else "-"),
            ("to", f"{self.t[-1]:,} us" if len(self) else "-"),
            ("mean rate", f"{len(self) / seconds:,.0f} events/s" if seconds else "-"),
            ("ON", f"{self.p.mean():.1%}" if len(self) else "-"),
        ]
        return as_html("Events", [Table("", ("", ">"), tuple(rows))])

    @property
    def duration(self) -> int:
        """Time from the first event to the last, us, or 0 without events."""
        return int(self.t[-1]) - int(self.t[0]) if len(self) else 0

    def between(self, start_us: int, stop_us: int) -> Events:
        """Return the events with ``start_us <= t < stop_us``.

        Args:
            start_us: first time, us. Times beyond the range of int64 are allowed.
            stop_us: end time, us, exclusive.

        Raises:
            ModelError: a time is not a whole number.
        """
        return self[self._index_at("start_us", start_us) : self._index_at("stop_us", stop_us)]

    def _index_at(self, name: str, value: float) -> int:
        """Return the index of the first event at a time or later."""
        if is_number(value) and T_MAX < abs(value) < np.inf:
            return 0 if value < 0 else len(self)
        return int(np.searchsorted(self.t, argument(name, value, kind="microseconds")))

    def inside(self, x: tuple[int, int], y: tuple[int, int]) -> Events:
        """Return the events in a rectangle of the sensor, on the same sensor.

        `neuro.events.filters.Crop` also reduces the sensor to the rectangle.

        Args:
            x: first column and end column (exclusive), px.
            y: first row and end row (exclusive), px.
        """
        return self[(self.x >= x[0]) & (self.x < x[1]) & (self.y >= y[0]) & (self.y < y[1])]

    def of_polarity(self, p: int) -> Events:
        """Return the ON events (1) or the OFF events (0).

        Raises:
            ValueError: `p` is neither 0 nor 1.
        """
        if p not in (0, 1):
            raise ModelError(f"polarity {p!r}: expected 1 (ON) or 0 (OFF)")
        return self[self.p == p]

    def records(self, time: str = "t") -> npt.NDArray[np.void]:
        """Return the events as one structured array (n,), packed little-endian.

        Args:
            time: name of the time field. "t" gives the type `EVENT`, "ts" the field names of aertb.
        """
        out = np.empty(len(self), EVENT)
        out["t"], out["x"], out["y"], out["p"] = self.t, self.x, self.y, self.p
        return out if time == "t" else out.view([(time, "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
