"""Work of the host in a bill: operations of encoders, decoders, teachers and front ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from neuro.chips.description import Chip
from neuro.chips.energy import NOT_PRICED, BillItem, number
from neuro.coding.work import Work, Works

ROW = "host"
"""Name and kind of the rows of the host."""


@dataclass(frozen=True, slots=True)
class HostWork:
    """The work of one part of the host.

    Attributes:
        name: name of the part, e.g. "shares of cells".
        work: operations and bytes of one use, as `neuro.coding.Work` counts them; None without a count.
        each: what the part is used once for, e.g. "control step".
        steps: network steps from one use to the next; 0 if `times` says the number of uses.
        times: number of uses in the run if `steps` is 0.
    """

    name: str
    work: Work | None
    each: str = "control step"
    steps: float = 0.0
    times: float = 1.0

    def as_list(self) -> list[Any]:
        """Return the fields for a file of results: name, multiply-accumulates and bytes or None, each, steps, times."""
        return [self.name, None if self.work is None else [*self.work], self.each, self.steps, self.times]

    @classmethod
    def of_list(cls, fields: list[Any]) -> Self:
        """Return the work that `as_list` wrote."""
        name, work, *other_fields = fields
        return cls(name, None if work is None else Work(*work), *other_fields)

    def uses(self, network_steps: float) -> float:
        """Return the number of uses in a run of `network_steps` steps."""
        return network_steps / self.steps if self.steps else self.times


def mean_work(
    parts: Mapping[str, Works], uses: Mapping[str, float | None], runs: int, each: str = "recording"
) -> tuple[HostWork, ...]:
    """Return the mean work of each part of the host in one run. A run is e.g. the classification of a recording.

    Args:
        parts: operations of each part, by unit. A part with the unit "event" is used once per event.
        uses: number of events, frames etc. in all runs, by unit; None if unknown.
        runs: number of runs.
        each: unit of a run, e.g. "recording".
    """

    def mean(works: Works) -> Work | None:
        total = Work()
        for unit, work in works.items():
            if work is None or (n := uses[unit]) is None:
                return None
            total += work.times(n / runs)
        return total

    return tuple(HostWork(name, mean(works), each, times=runs) for name, works in parts.items()) if runs else ()


def host_items(host: Iterable[HostWork], network_steps: float, processor: Chip) -> list[BillItem]:
    """Return the rows of the host: one for each part with operations, or a row of 0 if no part has any.

    A part without a count has no joules, so the bill prints ">" before its total.

    Args:
        host: parts of the host.
        network_steps: steps of the network in the run.
        processor: the host's processor, with the figure `mac` for the price of an operation.
    """
    figure, items = processor.costs["mac"], []
    for part in host:
        uses, name = part.uses(network_steps), f"{part.name}, {processor.name}"
        if part.work is None:
            items.append(BillItem(ROW, ROW, part.name, uses, None, None, "", ""))
        elif part.work.macs:
            count = part.work.macs * uses
            low, high = (count * end for end in figure.range())
            price = (figure.value, count * figure.value, figure.source, figure.conditions)
            size = part.work.bytes * uses
            items.append(BillItem(ROW, ROW, name, count, *price, low, high, figure.spread, bytes=size))
    return items or [BillItem(ROW, ROW, processor.name, 0.0, figure.value, 0.0, "", "", 0.0, 0.0)]


def host_notes(host: Iterable[HostWork]) -> list[str]:
    """Return notes on the work of the host: the operations and bytes of one use, and parts without a count."""
    parts = tuple(host)
    counted = [
        f"{part.name} {number(part.work.macs)} mac and {number(part.work.bytes)} bytes a {part.each}"
        for part in parts
        if part.work is not None and any(part.work)
    ]
    unknown = [part.name for part in parts if part.work is None]
    notes = [f"host: {'; '.join(counted)}; {NOT_PRICED}"] if counted else []
    return notes + ([f"host: no count of operations: {', '.join(unknown)}"] if unknown else [])
