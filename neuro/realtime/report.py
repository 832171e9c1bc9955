"""Latencies of a live run: histograms of times, and a report on late actions and their reasons."""

from __future__ import annotations

import operator
import resource
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neuro.core.tables import Table, as_html, as_text
from neuro.kernels.jit import kernel
from neuro.program.program import Ints

_FINE = 5
"""Bits of resolution: bins are 1/32 of a power of two wide, so a percentile is at most 3.2 % too large."""


def _bins() -> Ints:
    return np.zeros((64 - _FINE) << _FINE, dtype=np.int64)


@dataclass(slots=True, eq=False)
class Histogram:
    """Histogram of durations.

    Attributes:
        counts: counts of bins that are 1/32 of a power of two wide, in ns; bins below 64 ns are one ns wide.
        largest_ns: longest duration, exact.
    """

    counts: Ints = field(default_factory=_bins)
    largest_ns: int = 0

    def add(self, ns: int) -> None:
        """Count one duration; a negative duration counts as 0."""
        ns = max(0, ns)
        shift = max(0, ns.bit_length() - _FINE - 1)
        self.counts[(shift << _FINE) + (ns >> shift)] += 1
        if ns > self.largest_ns:
            self.largest_ns = ns

    def add_since(self, moments: NDArray[np.int64], end_ns: int) -> None:
        """Count the durations from moments to `end_ns`, all in ns of one clock."""
        self.largest_ns = max(self.largest_ns, count_since(moments, end_ns, self.counts))

    def __len__(self) -> int:
        return int(self.counts.sum())

    def ms(self, share: float) -> float:
        """Return a percentile in ms, e.g. for `share` 0.99; NaN for an empty histogram."""
        sums = np.cumsum(self.counts)
        if not sums[-1]:
            return float("nan")
        bin_index = int(np.searchsorted(sums, share * sums[-1]))
        shift = max(0, (bin_index >> _FINE) - 1)
        upper = ((bin_index - (shift << _FINE) + 1) << shift) - 1
        return min(upper, self.largest_ns) / 1e6

    @property
    def largest_ms(self) -> float:
        """Longest duration in ms."""
        return self.largest_ns / 1e6

    @property
    def texts(self) -> tuple[str, str, str]:
        """p50, p99 and the longest duration in ms; dashes for an empty histogram."""
        p50, p99, largest = (f"{ms:.3f}" for ms in (self.ms(0.5), self.ms(0.99), self.largest_ms))
        return (p50, p99, largest) if len(self) else ("–", "–", "–")

    def __str__(self) -> str:
        return "p50 {}, p99 {}, largest {} ms".format(*self.texts)


@kernel
def count_since(moments: NDArray[np.int64], end_ns: int, counts: Ints) -> int:
    """Count the durations from moments to `end_ns`, and return the longest."""
    largest, shift = 0, 0
    for k in range(moments.shape[0]):
        ns = max(0, end_ns - moments[k])
        largest = max(largest, ns)
        while ns >> shift >= 2 << _FINE:
            shift += 1
        while shift > 0 and ns >> shift < 1 << _FINE:
            shift -= 1
        counts[(shift << _FINE) + (ns >> shift)] += 1
    return largest


PHASES = ("take", "feed", "run", "act")
"""Phases of a tick, in order."""


class Cost(NamedTuple):
    """Events of the operating system that delayed this thread.

    Attributes:
        preempted: number of times that another thread got the processor.
        minor_faults: pages allocated or mapped.
        major_faults: pages read from a disk.
    """

    preempted: int
    minor_faults: int
    major_faults: int

    @classmethod
    def now(cls) -> Cost:
        """Return the counts since the start of this thread."""
        used = resource.getrusage(getattr(resource, "RUSAGE_THREAD", resource.RUSAGE_SELF))
        return cls(used.ru_nivcsw, used.ru_minflt, used.ru_majflt)

    def plus(self, other_cost: Cost) -> Cost:
        """Return the sum with other counts."""
        return Cost(*map(operator.add, self, other_cost))

    def since(self, earlier: Cost) -> Cost:
        """Return the difference from earlier counts."""
        return Cost(*map(operator.sub, self, earlier))


@dataclass(eq=False)
class LiveRun:
    """Counts and times of a live run.

    Attributes:
        tick_ms: length of a tick on the clock.
        ticks: number of ticks.
        misses: ticks with an action after the next tick was due.
        skipped: ticks left out by `late="skip"`.
        ended: reason for an early end; "" for a complete run.
        latency: time from the receipt of an event to the action of its tick.
        response: time from the due time of a tick to its action; the network's part of the latency.
        empty: time from the due time of a tick to the wake-up of the thread.
        phases: time of each phase of `PHASES`.
        cost: events of the operating system in all ticks.
        missed_cost: events of the operating system in missed ticks.
        largest_tick: number of the slowest tick, and the ms of its phases.
        inputs: for each input, the number of events taken, fed and dropped, and all counts of its source.
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
        """Number of events that were received but not fed to the network."""
        return sum(counts["dropped"] for counts in self.inputs.values())

    @property
    def losses(self) -> int:
        """Number of losses that sources report, e.g. datagrams without room."""
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
        """Return tables of latencies, of the slowest tick, of inputs, and of events of the operating system."""
        times = tuple((name, *h.texts) for name, h in self._histograms())
        inputs = list[tuple[str, ...]]()
        for name, counts in self.inputs.items():
            lost = ", ".join(f"{n:,} {word}" for word, n in _losses(counts).items()) or "nothing"
            inputs.append((name, *(f"{counts[word]:,}" for word in ("taken", "fed", "dropped")), lost))
        rows = (("all ticks", self.cost), ("missed ticks", self.missed_cost))
        costs = tuple((name, *(f"{count:,}" for count in cost)) for name, cost in rows)
        number, phases = self.largest_tick
        slowest = ((f"{number:,}", *(f"{ms:.3f}" for ms in phases.values())),) if phases else ()
        return [
            Table("times", ("ms", ">p50", ">p99", ">largest"), times),
            Table("slowest", ("tick, ms", *(f">{word}" for word in phases)), slowest),
            Table("inputs", ("name", ">taken", ">fed", ">dropped", "lost by its source"), tuple(inputs)),
            Table("costs", ("in", ">preempted", ">minor page faults", ">major page faults"), costs),
        ]

    def _histograms(self) -> Iterator[tuple[str, Histogram]]:
        yield "event to action", self.latency
        yield "tick to action", self.response
        yield "empty loop", self.empty
        yield from self.phases.items()

    def as_attributes(self) -> dict[str, Any]:
        """Return the figures of the run as attributes of a results file."""
        numbers = {word: getattr(self, word) for word in ("tick_ms", "ticks", "misses", "skipped", "ended")}
        numbers |= {"drops": self.drops, "losses": self.losses}
        for name, h in self._histograms():
            word = name.replace(" ", "_")
            numbers |= {f"{word}.p50_ms": h.ms(0.5), f"{word}.p99_ms": h.ms(0.99), f"{word}.largest_ms": h.largest_ms}
        for name, counts in self.inputs.items():
            numbers |= {f"{name}.{word}": count for word, count in counts.items()}
        return numbers


def _losses(counts: dict[str, int]) -> dict[str, int]:
    """Return the counts of losses or damage of a source."""
    no_losses = ("taken", "fed", "dropped", "events", "datagrams")
    return {word: n for word, n in counts.items() if n and word not in no_losses}
