"""Base classes of filters: fixed parameters, a state that carries over between parts, and checks of the input."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from inspect import get_annotations
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, Quantity, check
from neuro_events._events import Events, checked_size, empty_columns
from neuro_events.parts import joined_parts

kernels = LazyModule("neuro_events._kernels")

Size = tuple[int, int]
State = tuple[Any, ...]
"""State of a filter. Kernels write into its arrays."""

NEVER = np.iinfo(np.int64).min
"""A time before all others, us, for pixels without an event so far."""


class FilterError(ModelError):
    """Error about a parameter or about events that a filter cannot process.

    The message reads ``FILTER: what was found, and what was expected``.
    """


@dataclass(frozen=True, eq=False)
class Filter(ABC):
    """Base class of filters, which transform events part by part.

    The parameters are fixed. The state carries over from part to part, so the output does not depend on how the
    recording is divided into parts::

        tar = TAR((34, 34), tau=0.08, theta=2.4)
        for part in tar.stream(neuro.events.stream(path)):
            ...

    Attributes:
        word: short name for the command line. Default: the name of the class.
        units: units of those parameters that have neither a `quantity` nor a unit in their name.
        sensor_size: width and height of the input sensor, px.
    """

    word: ClassVar[str] = ""
    units: ClassVar[Mapping[str, str]] = {}

    sensor_size: Size
    _clock: npt.NDArray[np.int64] = field(init=False, repr=False)  # (1,) time of the last event, us
    _state: State = field(init=False, repr=False)

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "sensor_size", checked_size(self.sensor_size))
            for entry in fields(self):
                if entry.init and (q := _quantity_of(entry)) is not None:
                    value = check(q, getattr(self, entry.name), entry.name)
                    object.__setattr__(self, entry.name, value)
            self._check()
        except FilterError:
            raise
        except ModelError as error:
            raise FilterError(f"{self._name}: {error.message}", hint=error.hint, path=error.path) from None
        self.reset()

    @classmethod
    def called(cls) -> str:
        """Return the name on the command line: the class's own `word`, or the name of the class."""
        return str(cls.__dict__.get("word") or cls.__name__)

    @property
    def out_size(self) -> Size:
        """Width and height of the output sensor, px."""
        return self.sensor_size

    def reset(self) -> None:
        """Reset the filter to its initial state."""
        object.__setattr__(self, "_clock", np.full(1, NEVER, np.int64))
        self._hold(*self._fresh())

    def __call__(self, events: Events) -> Events:
        """Filter the next part of a recording.

        Args:
            events: a part from this sensor, not earlier than the part before.

        Returns:
            The output that is final so far. `finish` returns the remaining events.

        Raises:
            FilterError: another sensor, or time runs back from the part before.
        """
        if events.sensor_size != self.sensor_size:
            (w, h), (width, height) = events.sensor_size, self.sensor_size
            raise FilterError(f"{self._name}: events of a {w}x{h} sensor, expected {width}x{height}")
        if not len(events):
            return self._of(events, events._columns)
        if events.t[0] < self._clock[0]:
            raise FilterError(
                f"{self._name}: time runs back from {self._clock[0]} to {events.t[0]} us, expected the next part "
                "of the same recording; reset() before another one"
            )
        out = self._part(events)
        self._clock[0] = events.t[-1]
        return out

    def finish(self) -> Events:
        """End the recording: return the remaining events, and reset the filter."""
        remaining = self._rest()
        self.reset()
        return remaining

    def apply(self, events: Events) -> Events:
        """Reset the filter, and filter a complete recording.

        Args:
            events: the recording, from this sensor.
        """
        self.reset()
        first = self(events)
        remaining = self.finish()
        return joined_parts([first, remaining]) if len(remaining) else first

    def stream(self, parts: Iterable[Events]) -> Iterator[Events]:
        """Reset the filter, and filter the parts of one recording.

        Args:
            parts: the parts in order, as from `neuro.events.stream`.

        Yields:
            The output of each part, and at the end the remaining events, if any.
        """
        self.reset()
        for part in parts:
            yield self(part)
        remaining = self.finish()
        if len(remaining):
            yield remaining

    def fresh(self) -> Self:
        """Return a new filter with the same parameters and its own state, e.g. to filter two recordings in turn."""
        return replace(self)

    @abstractmethod
    def _part(self, events: Events) -> Events:
        """Filter a non-empty part."""

    def _check(self) -> None:  # noqa: B027 (not every filter has parameters)
        """Check parameters beyond the ranges that their quantities state."""

    def _fresh(self) -> State:
        """Return the initial state."""
        return ()

    def _rest(self) -> Events:
        """Return the remaining events at the end of a recording."""
        return Events._trusted(*empty_columns(0), self.out_size, {})

    def _hold(self, *state: Any) -> None:
        object.__setattr__(self, "_state", state)

    def _of(self, source: Events, arrays: tuple[npt.NDArray[Any], ...]) -> Events:
        """Build events of the output sensor without a second check."""
        t, x, y, p = arrays
        return Events._trusted(t, x, y, p, self.out_size, source.metadata)

    @property
    def _name(self) -> str:
        return type(self).__name__

    def _expect(self, is_valid: bool, name: str, value: object, expected: str) -> None:
        if not is_valid:
            raise FilterError(f"{self._name}: {name} = {value!r:.60}: expected {expected}")


def complete(kind: type[Filter]) -> type[Filter]:
    """Check that a filter class is complete, and return it.

    Raises:
        TypeError: a method is missing, or the class has an annotated attribute but no dataclass decorator.
    """
    if missing := sorted(kind.__abstractmethods__):
        raise TypeError(f"filter '{kind.called()}' has no method '{missing[0]}'")
    parameters = {field.name for field in fields(kind)}
    annotated = (name for name, annotation in get_annotations(kind).items() if "ClassVar" not in str(annotation))
    if undeclared := [name for name in annotated if name not in parameters]:
        above = "expected @dataclass(frozen=True, eq=False) above the class"
        raise TypeError(f"filter '{kind.called()}': '{undeclared[0]}' is no parameter: {above}")
    return kind


class Sieve(Filter):
    """A filter that passes or drops events without changing them."""

    @abstractmethod
    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        """Decide for each event whether it passes.

        Args:
            events: a non-empty part.
            keep: (n,) output, True for events that pass.
        """

    def _part(self, events: Events) -> Events:
        keep = np.zeros(len(events), np.bool_)
        self._keep(events, keep)
        return self._of(events, selected_columns(events, keep))


def selected_columns(events: Events, keep: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[Any], ...]:
    """Return the times, columns, rows and polarities of the selected events.

    Args:
        events: the events to select from.
        keep: (n,) True for the events to select.
    """
    n = int(np.count_nonzero(keep))
    if n == len(events):
        return events._columns
    out = empty_columns(n + 1)
    for column, target in zip(events._columns, out, strict=True):
        kernels.compact(keep, column, target)
    return tuple(target[:n] for target in out)


def _quantity_of(entry: Field[Any]) -> Quantity | None:
    """Return the range of a parameter: the field's `quantity`, else the range of a number type, else None."""
    kind = str(getattr(entry.type, "__name__", entry.type))
    quantity: Quantity | None = entry.metadata.get("quantity")
    return quantity or _PLAIN.get(kind)


_PLAIN = {"int": Quantity(kind="integer"), "float": Quantity(infinite=True), "bool": Quantity(kind="boolean")}


@dataclass(frozen=True, eq=False)
class Chain(Filter):
    """Filters applied in sequence, made by `chain`.

    Attributes:
        filters: the filters in order. The chain works on copies with their own states.
    """

    filters: tuple[Filter, ...] = ()

    def _check(self) -> None:
        self._expect(len(self.filters) > 0, "filters", self.filters, "at least one")
        size = self.sensor_size
        for k, f in enumerate(self.filters):
            if not isinstance(f, Filter):
                raise FilterError(f"Chain: filter {k} is {f!r}, expected a filter such as TAR((346, 260))")
            if f.sensor_size != size:
                (w, h), (width, height) = f.sensor_size, size
                raise FilterError(f"Chain: filter {k}, {type(f).__name__}, is for {w}x{h}, expected {width}x{height}")
            size = f.out_size

    @property
    def out_size(self) -> Size:
        """Width and height of the last filter's output, px."""
        return self.filters[-1].out_size

    def _fresh(self) -> State:
        return tuple(part.fresh() for part in self.filters)

    def _part(self, events: Events) -> Events:
        for part in self._state:
            events = part(events)
        return events

    def _rest(self) -> Events:
        remaining: Events | None = None
        for f in self._state:
            filtered = [] if remaining is None else [f(remaining)]
            parts = [part for part in (*filtered, f.finish()) if len(part)]
            remaining = joined_parts(parts) if parts else None
        return super()._rest() if remaining is None else remaining


def chain(*filters: Filter) -> Chain:
    """Combine filters into a filter that applies all of them in sequence.

    Args:
        filters: at least one filter. The sensor size of each filter is the output size of the filter before.

    Returns:
        A filter with its own state, independent of the states of `filters`.

    Raises:
        FilterError: no filters, or sizes that do not match.

    Example:
        >>> clean = chain(Crop((346, 260), x=(0, 300)), TAR((300, 260)))
        >>> clean.out_size
        (300, 260)
    """
    size = filters[0].sensor_size if filters and isinstance(filters[0], Filter) else (1, 1)
    return Chain(size, filters)
