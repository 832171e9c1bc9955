"""What all filters share: parameters that stay, a state that goes on from part to part, and checks of what comes in."""

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
from neuro_events.parts import together

kernels = LazyModule("neuro_events._kernels")

Size = tuple[int, int]
State = tuple[Any, ...]
"""What a filter remembers; a kernel writes into its arrays."""

NEVER = np.iinfo(np.int64).min
"""A time before all others, us."""


class FilterError(ModelError):
    """A filter was given a parameter or events that it cannot work with.

    The message reads ``FILTER: what was found, and what was expected``.
    """


@dataclass(frozen=True, eq=False)
class Filter(ABC):
    """Events in, events out, part by part.

    The parameters are fixed; the state goes on from one part to the next, so that the parts of a recording, cut
    anywhere, give what the whole gives::

        tar = TAR((34, 34), tau=0.08, theta=2.4)
        for part in tar.stream(neuro.events.stream(path)):
            ...

    Attributes:
        word: a short name for command lines; the name of the class where it is not given.
        units: of parameters that are no `quantity`, where their names do not tell them.
        sensor_size: width and height of the events that come in, px.
    """

    word: ClassVar[str] = ""
    units: ClassVar[Mapping[str, str]] = {}

    sensor_size: Size
    _clock: npt.NDArray[np.int64] = field(init=False, repr=False)
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
        """The name on the command line: `word` of this very class, or the name of the class."""
        return str(cls.__dict__.get("word") or cls.__name__)

    @property
    def out_size(self) -> Size:
        """Width and height of the events that come out, px."""
        return self.sensor_size

    def reset(self) -> None:
        """Forget all events; the filter is as new."""
        object.__setattr__(self, "_clock", np.full(1, NEVER, np.int64))
        self._hold(*self._fresh())

    def __call__(self, events: Events) -> Events:
        """Filter the next part of a recording.

        Args:
            events: of this sensor, not before those of the part before.

        Returns:
            The events that come out so far; `finish` gives those that are held back.

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
        """End the recording: the events that were held back, if the filter holds any. It is as new thereafter."""
        rest = self._rest()
        self.reset()
        return rest

    def apply(self, events: Events) -> Events:
        """Filter a whole recording, forgetting what came before it.

        Args:
            events: the recording, of this sensor.
        """
        self.reset()
        first = self(events)
        rest = self.finish()
        return together([first, rest]) if len(rest) else first

    def stream(self, parts: Iterable[Events]) -> Iterator[Events]:
        """Filter the parts of one recording, forgetting what came before it.

        Args:
            parts: in order, as `neuro.events.stream` gives them.

        Yields:
            What comes out of each part, and last what was held back, if there is anything.
        """
        self.reset()
        for part in parts:
            yield self(part)
        rest = self.finish()
        if len(rest):
            yield rest

    def fresh(self) -> Self:
        """Another filter with the same parameters and an empty state, for another recording at the same time."""
        return replace(self)

    @abstractmethod
    def _part(self, events: Events) -> Events:
        """What comes out of a part that is not empty."""

    def _check(self) -> None:  # noqa: B027 (not every filter has parameters)
        """Refuse impossible parameters that their quantities do not."""

    def _fresh(self) -> State:
        """The state before any event."""
        return ()

    def _rest(self) -> Events:
        """What is held back."""
        return Events._trusted(*empty_columns(0), self.out_size, {})

    def _hold(self, *state: Any) -> None:
        object.__setattr__(self, "_state", state)

    def _of(self, source: Events, arrays: tuple[npt.NDArray[Any], ...]) -> Events:
        """Events of the outgoing sensor, which need no check."""
        t, x, y, p = arrays
        return Events._trusted(t, x, y, p, self.out_size, source.metadata)

    @property
    def _name(self) -> str:
        return type(self).__name__

    def _expect(self, right: bool, name: str, value: object, expected: str) -> None:
        if not right:
            raise FilterError(f"{self._name}: {name} = {value!r:.60}: expected {expected}")


def complete(kind: type[Filter]) -> type[Filter]:
    """Return a kind of filter if it can be made with its parameters, and raise `TypeError` if not."""
    if missing := sorted(kind.__abstractmethods__):
        raise TypeError(f"filter '{kind.called()}' has no method '{missing[0]}'")
    known = {one.name for one in fields(kind)}
    own = (name for name, what in get_annotations(kind).items() if "ClassVar" not in str(what))
    if lost := [name for name in own if name not in known]:
        above = "expected @dataclass(frozen=True, eq=False) above the class"
        raise TypeError(f"filter '{kind.called()}': '{lost[0]}' is no parameter: {above}")
    return kind


class Sieve(Filter):
    """A filter that lets events through or not, and changes none."""

    @abstractmethod
    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        """Say of each event whether it passes.

        Args:
            events: a part that is not empty.
            keep: (n,) to be written.
        """

    def _part(self, events: Events) -> Events:
        keep = np.zeros(len(events), np.bool_)
        self._keep(events, keep)
        return self._of(events, kept(events, keep))


def kept(events: Events, keep: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[Any], ...]:
    """The times, columns, rows and polarities of some events.

    Args:
        events: from which to take.
        keep: (n,) whether to.
    """
    n = int(np.count_nonzero(keep))
    if n == len(events):
        return events._columns
    out = empty_columns(n + 1)
    for column, to in zip(events._columns, out, strict=True):
        kernels.compact(keep, column, to)
    return tuple(to[:n] for to in out)


def _quantity_of(entry: Field[Any]) -> Quantity | None:
    """What a parameter may be: as said by `quantity`, else by its annotation, if that is the type of a number."""
    kind = str(getattr(entry.type, "__name__", entry.type))
    known: Quantity | None = entry.metadata.get("quantity")
    return known or _PLAIN.get(kind)


_PLAIN = {"int": Quantity(kind="integer"), "float": Quantity(infinite=True), "bool": Quantity(kind="boolean")}


@dataclass(frozen=True, eq=False)
class Chain(Filter):
    """Filters of which each takes what the one before gives; made by `chain`.

    Attributes:
        filters: in order. The chain has copies of its own with their own state.
    """

    filters: tuple[Filter, ...] = ()

    def _check(self) -> None:
        self._expect(len(self.filters) > 0, "filters", self.filters, "at least one")
        size = self.sensor_size
        for k, one in enumerate(self.filters):
            if not isinstance(one, Filter):
                raise FilterError(f"Chain: filter {k} is {one!r}, expected a filter such as TAR((346, 260))")
            if one.sensor_size != size:
                (w, h), (width, height) = one.sensor_size, size
                raise FilterError(f"Chain: filter {k}, {type(one).__name__}, is for {w}x{h}, expected {width}x{height}")
            size = one.out_size

    @property
    def out_size(self) -> Size:
        """That of the last filter."""
        return self.filters[-1].out_size

    def _fresh(self) -> State:
        return tuple(one.fresh() for one in self.filters)

    def _part(self, events: Events) -> Events:
        for one in self._state:
            events = one(events)
        return events

    def _rest(self) -> Events:
        rest: Events | None = None
        for one in self._state:
            through = [] if rest is None else [one(rest)]
            parts = [part for part in (*through, one.finish()) if len(part)]
            rest = together(parts) if parts else None
        return super()._rest() if rest is None else rest


def chain(*filters: Filter) -> Chain:
    """Put filters one behind the other.

    Args:
        filters: at least one; each is for the sensor size that the one before gives.

    Returns:
        A filter that is called like each of them. What was done with the given ones before does not matter to it.

    Raises:
        FilterError: there is none, or sizes do not fit.

    Example:
        >>> clean = chain(Crop((346, 260), x=(0, 300)), TAR((300, 260)))
        >>> clean.out_size
        (300, 260)
    """
    size = filters[0].sensor_size if filters and isinstance(filters[0], Filter) else (1, 1)
    return Chain(size, filters)
