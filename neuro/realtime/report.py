"""What a live run took: how late its actions were, and why."""

from __future__ import annotations

import operator
import resource
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from neuro.core.tables import Table, as_html, as_text
from neuro.realtime.histogram import Histogram

PHASES = ("take", "feed", "run", "act")
"""What a tick does, in this order."""


class Cost(NamedTuple):
    """What kept this thread from going on: counts of the operating system.

    Attributes:
        preempted: times that another thread got the processor.
        minor_faults: pages that were given or mapped anew.
        major_faults: pages that were read from a disk.
    """

    preempted: int
    minor_faults: int
    major_faults: int

    @classmethod
    def now(cls) -> Cost:
        """Up to now."""
        used = resource.getrusage(getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF))
        return cls(used.ru_nivcsw, used.ru_minflt, used.ru_majflt)

    def plus(self, other: Cost) -> Cost:
        """Both together."""
        return Cost(*map(operator.add, self, other))

    def since(self, before: Cost) -> Cost:
        """What came since."""
        return Cost(*map(operator.sub, self, before))


@dataclass(eq=False)
class LiveRun:
    """What a live run took.

    Attributes:
        tick_ms: the length of a tick.
        ticks: how many were run.
        misses: ticks whose action came after the next tick was due.
        skipped: ticks that were left out, of `late="skip"`.
        ended: why it ended before its time; "" where it did not.
        latency: from the receipt of an event to the action of its tick.
        response: from the moment when a tick was due to its action; the network's own part of the latency.
        empty: the same of a loop that does nothing, on the same ticks: from the moment to awakening.
        phases: the time of each of `PHASES`.
        cost: of all ticks.
        missed_cost: of those that missed.
        largest_tick: the number of the slowest tick, and the ms of its phases.
        inputs: of each input events taken, fed and dropped, and all that its source counts.
    """

    tick_ms: float
    ticks: int = 0
    misses: int = 0
    skipped: int = 0
    ended: str = ""
    latency: Histogram = field(default_factory=Histogram)
    response: Histogram = field(default_factory=Histogram)
    empty: Histogram = field(default_factory=Histogram)
    phases: dict[str, Histogram] = field(default_factory=lambda: {word: Histogram() for word in PHASES})
    cost: Cost = Cost(0, 0, 0)
    missed_cost: Cost = Cost(0, 0, 0)
    largest_tick: tuple[int, dict[str, float]] = (0, {})
    inputs: dict[str, dict[str, int]] = field(default_factory=dict)

    @property
    def drops(self) -> int:
        """Events that came and were not given to the network."""
        return sum(counts["dropped"] for counts in self.inputs.values())

    @property
    def losses(self) -> int:
        """What sources lost before: all that they count beside events and datagrams, such as datagrams without room."""
        return sum(sum(_losses(counts).values()) for counts in self.inputs.values())

    def __repr__(self) -> str:
        lost = f", {self.losses:,} lost by sources" if self.losses else ""
        ticks = f"{self.ticks:,} ticks of {self.tick_ms:g} ms"
        return f"LiveRun({ticks}, {self.misses:,} missed, {self.drops:,} drops{lost})"

    def __str__(self) -> str:
        return as_text(repr(self), self.tables())

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.tables())

    def tables(self) -> list[Table]:
        """Latencies, the slowest tick, inputs, and what misses cost."""
        times = tuple((name, *h.texts) for name, h in self._histograms())
        inputs = tuple(
            (name, *(f"{counts[word]:,}" for word in ("taken", "fed", "dropped")), _said(_losses(counts)))
            for name, counts in self.inputs.items()
        )
        found = (("all ticks", self.cost), ("missed ticks", self.missed_cost))
        costs = tuple((name, *(f"{count:,}" for count in cost)) for name, cost in found)
        number, phases = self.largest_tick
        slowest = ((f"{number:,}", *(f"{ms:.3f}" for ms in phases.values())),) if phases else ()
        return [
            Table("times", ("ms", ">p50", ">p99", ">largest"), times),
            Table("slowest", ("tick, ms", *(f">{word}" for word in phases)), slowest),
            Table("inputs", ("name", ">taken", ">fed", ">dropped", "lost by its source"), inputs),
            Table("costs", ("in", ">preempted", ">minor page faults", ">major page faults"), costs),
        ]

    def _histograms(self) -> Iterator[tuple[str, Histogram]]:
        yield "event to action", self.latency
        yield "tick to action", self.response
        yield "empty loop", self.empty
        yield from self.phases.items()

    def kept(self) -> dict[str, Any]:
        """The same as attributes and arrays of a file."""
        numbers = {word: getattr(self, word) for word in ("tick_ms", "ticks", "misses", "skipped", "ended")}
        numbers |= {"drops": self.drops, "losses": self.losses}
        for name, h in self._histograms():
            word = name.replace(" ", "_")
            numbers |= {f"{word}.p50_ms": h.ms(0.5), f"{word}.p99_ms": h.ms(0.99), f"{word}.largest_ms": h.largest_ms}
        for name, counts in self.inputs.items():
            numbers |= {f"{name}.{word}": count for word, count in counts.items()}
        return numbers


def _losses(counts: dict[str, int]) -> dict[str, int]:
    """What a source counts that is not as it should be."""
    plain = ("taken", "fed", "dropped", "events", "datagrams")
    return {word: n for word, n in counts.items() if n and word not in plain}


def _said(losses: dict[str, int]) -> str:
    return ", ".join(f"{n:,} {word}" for word, n in losses.items()) or "nothing"
