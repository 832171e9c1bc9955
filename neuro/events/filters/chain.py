"""One filter after the other."""

from __future__ import annotations

from dataclasses import dataclass

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, FilterError, Size, State
from neuro.events.parts import together


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
