"""The bill of a run: what was done how often, what each costs, and where that figure comes from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from neuro.chips.description import Range
from neuro.core.errors import ModelError
from neuro.core.tables import aligned

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"), (1e-15, "f"))
STATIC = "static_per_chip"
CHIP_TIME = "chip time: "
"""How notes begin that say where figures of the chip time come from."""
FASTEST, AS_GIVEN, REAL_TIME = "as fast as the chip can", "at the given steps", "in real time"
"""What clock static energy goes by: steps follow each other at once, or in a given time, or each lasts its own time."""
REFUSED = "refused"
"""What stands in place of a total on a chip that cannot run the network."""
COLUMNS = (">dynamic", f">{FASTEST}", f">{REAL_TIME}", ">chip time", ">chips")
"""Heads of the columns of a bill in a table, see `Energy.cells`."""


@dataclass(frozen=True, slots=True)
class BillItem:
    """One line of a bill.

    Attributes:
        what: the name of the cost, see `neuro.chips.description.COSTS`.
        kind: what `of` names: "population", "projection", "signal", "host", "layers" or "chip".
        of: the population, the projection, the signal, the processor of the host, the layers or the target.
        count: how often; of `static_per_chip` chips x seconds.
        joules_each: what one costs in J; None if no figure is published, then it is not in the sums.
        joules: what all cost.
        source: of the figure.
        conditions: under which it holds.
        low, high: what all may cost at least and at most, by the range of the figure.
        spread: where that range comes from.
        extrapolated: why the figure is not known to hold for this run, "" if it is.
    """

    what: str
    kind: str
    of: str
    count: float
    joules_each: float | None
    joules: float | None
    source: str
    conditions: str
    low: float | None = None
    high: float | None = None
    spread: str = ""
    extrapolated: str = ""


@dataclass(frozen=True, slots=True)
class Energy:
    """The bill of a run on a target, or of one part of it, see `per`.

    Static energy depends on the clock: this bill goes by `clock`, `real_time` is the same bill in real time.

    Attributes:
        target: the name of the chip or processor.
        title: the same for people.
        chips: chips that are on.
        chip_time_s: how long the chip takes for the run, in s; None where that is not known.
        steps: steps of the run.
        items: the lines, populations first, then projections, then the chip.
        notes: what is assumed, and what is not in the sums.
        of: what the bill is of: "run", or what it was divided by.
        chip_time_range_s: between what the chip time lies, by the ranges of its figures.
        duration_s: how long the run is in real time, in s: steps x resolution, or what the caller of `price` gave.
        clock: what the chip time goes by: `FASTEST`, `AS_GIVEN` or `REAL_TIME`.
        waiting: the bill of a chip that waits for the end of each step, None where it has nothing to wait for.
        refused: why the chip cannot run the network, "" if it can. A bill that is refused has lines and no total.
    """

    target: str
    title: str
    chips: int
    chip_time_s: float | None
    steps: float
    items: tuple[BillItem, ...]
    notes: tuple[str, ...]
    of: str = "run"
    chip_time_range_s: Range | None = None
    duration_s: float = 0.0
    clock: str = FASTEST
    waiting: Energy | None = None
    refused: str = ""

    @property
    def real_time(self) -> Energy:
        """The same bill where each step lasts its own time, as it does while events come; a late chip does not wait."""
        return self.waiting or self

    @property
    def total_j(self) -> float:
        """Joules in all, without the costs in `missing`; NaN on a chip that refuses the network."""
        return math.nan if self.refused else self.dynamic_j + self.static_j

    @property
    def dynamic_j(self) -> float:
        """Joules of what is done."""
        return _sum(self._dynamic())

    @property
    def static_j(self) -> float:
        """Joules of chips being on; 0 where no figure is published, then a note says so."""
        return _sum(self._static())

    @property
    def low_j(self) -> float:
        """Joules in all if every figure is at the low end of its range; NaN as `total_j`."""
        return math.nan if self.refused else _ends(self.items)[0]

    @property
    def high_j(self) -> float:
        """Joules in all if every figure is at the high end of its range; NaN as `total_j`."""
        return math.nan if self.refused else _ends(self.items)[1]

    @property
    def extrapolated(self) -> dict[str, tuple[str, ...]]:
        """What does not hold for this run, by the reason: the names of the costs."""
        found: dict[str, dict[str, None]] = {}
        for item in self.items:
            if item.extrapolated:
                found.setdefault(item.extrapolated, {})[item.what] = None
        return {why: tuple(names) for why, names in found.items()}

    @property
    def static_known(self) -> bool:
        """Whether there is a figure of static power, and a time that it lasts."""
        return any(item.what == STATIC for item in self.items)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the costs that the total lacks, as no figure is published: totals with any are shown behind ">"."""
        unpriced = dict.fromkeys(item.what for item in self.items if item.joules is None)
        return (*unpriced, *(() if self.static_known else (STATIC,)))

    @property
    def late(self) -> bool:
        """Whether the chip is slower than real time."""
        return self.chip_time_s is not None and self.chip_time_s > self.duration_s * (1.0 + 1e-9)

    def sums(self) -> list[tuple[str, ...]]:
        """Rows of text: chip time, dynamic, static and total energy, each at the bill's clock and in real time."""
        rows = zip(("chip time", "dynamic", "static"), self._column(), self.real_time._column(), strict=True)
        return [("", self.clock, REAL_TIME), *rows, ("total", *_totals(self._both()))]

    def _column(self) -> tuple[str, str, str]:
        time = "-" if self.chip_time_s is None else quantity(self.chip_time_s, "s")
        static = quantity(self.static_j, "J") if self.static_known else "not priced"
        return time, quantity(self.dynamic_j, "J"), static

    def cells(self) -> tuple[str, ...]:
        """What stands below `COLUMNS`."""
        return cells(self._both())

    def totals(self) -> str:
        """The total with its range at both clocks, in one line."""
        if self.refused:
            return f"{REFUSED}: {self.refused}"
        one, other = _totals(self._both())
        return f"{one} {self.clock}, {'the same' if one == other else other} {REAL_TIME}"

    def total(self, digits: int = 4) -> str:
        """The total of this clock without its range, e.g. "8.234 uJ", "> 8.234 uJ" or "refused".

        Args:
            digits: how many.
        """
        if self.refused:
            return REFUSED
        return "> " * bool(self.missing) + quantity(self.total_j, "J", digits)

    def by_population(self) -> dict[str, float]:
        """Dynamic joules of each population's neurons."""
        return self._by("population")

    def by_projection(self) -> dict[str, float]:
        """Dynamic joules of each projection: synapses, learning and the ways of its spikes."""
        return self._by("projection")

    def _by(self, kind: str) -> dict[str, float]:
        sums: dict[str, float] = {}
        for item in self.items:
            if item.kind == kind:
                sums[item.of] = sums.get(item.of, 0.0) + (item.joules or 0.0)
        return sums

    def by_cost(self) -> dict[str, float]:
        """Joules of each cost, in the order of the items."""
        sums: dict[str, float] = {}
        for item in self.items:
            if item.joules is not None:
                sums[item.what] = sums.get(item.what, 0.0) + item.joules
        return sums

    def per(self, n: int, what: str) -> Energy:
        """The same bill for one of `n` equal parts.

        Args:
            n: how many the run had.
            what: what one is called, e.g. "recording" or "control step".

        Raises:
            ModelError: `n` is not a whole number >= 1.
        """
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise ModelError(f"per = {n!r}: expected a whole number >= 1")
        items = tuple(
            replace(
                item,
                count=item.count / n,
                joules=_share(item.joules, n),
                low=_share(item.low, n),
                high=_share(item.high, n),
            )
            for item in self.items
        )
        ends = self.chip_time_range_s
        span = None if ends is None else (ends[0] / n, ends[1] / n)
        time, lasts = _share(self.chip_time_s, n), self.duration_s / n
        waiting = None if self.waiting is None else self.waiting.per(n, what)
        times = replace(self, chip_time_s=time, chip_time_range_s=span, duration_s=lasts, waiting=waiting)
        return replace(times, items=items, steps=self.steps / n, of=what)

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values, for JSON; what is not known is None."""
        about = {"target": self.target, "title": self.title, "of": self.of, "clock": self.clock}
        items = [asdict(item) for item in self.items]
        extrapolated = [{"why": why, "costs": list(names)} for why, names in self.extrapolated.items()]
        rest = {"items": items, "extrapolated": extrapolated, "notes": list(self.notes)}
        return {**about, **self._both(), "refused": self.refused or None, **rest}

    def _both(self) -> dict[str, Any]:
        """The figures of both clocks."""
        machine = {"chips": None if self.chip_time_s is None else self.chips, "steps": self.steps}
        real = {"duration_s": self.duration_s, "late": self.late, "real_time": self.real_time._figures()}
        return {**self._figures(), **machine, **real}

    def _figures(self) -> dict[str, Any]:
        """Sums with their ranges and the chip time, of one clock."""
        static = self.static_j if self.static_known else None
        sums = {"total_j": None if self.refused else self.total_j, "dynamic_j": self.dynamic_j, "static_j": static}
        dynamic, chips_on = self._dynamic(), self._static()
        unknown = ("total",) * bool(self.refused) + ("static",) * (static is None)
        ranges = {
            f"{name}_{end}_j": None if name in unknown else value
            for name, items in (("total", self.items), ("dynamic", dynamic), ("static", chips_on))
            for end, value in zip(("low", "high"), _ends(items), strict=True)
        }
        ends = self.chip_time_range_s or (None, None)
        time = {"chip_time_s": self.chip_time_s, "chip_time_low_s": ends[0], "chip_time_high_s": ends[1]}
        return {**sums, **ranges, **time, "missing": list(self.missing)}

    def _dynamic(self) -> tuple[BillItem, ...]:
        return tuple(item for item in self.items if item.what != STATIC)

    def _static(self) -> tuple[BillItem, ...]:
        return tuple(item for item in self.items if item.what == STATIC)

    def __str__(self) -> str:
        return self.told()

    def told(self, sources: bool = False) -> str:
        """The bill as text: its lines, the sums, and what they assume.

        Args:
            sources: whether to tell of each figure where it comes from.
        """
        cited = list(dict.fromkeys(sourced(item.source, item.conditions) for item in self.items if item.source))
        table = [("item", "of", "count", "each", "energy", "source"), *(_row(item, cited) for item in self.items)]
        head = [f"{number(self.steps)} steps"]
        if self.chip_time_s is not None:
            chips = f"{self.chips} chip" + "s" * (self.chips != 1)
            head = [chips, *head, f"{quantity(self.chip_time_s, 's')} of chip time"]
        rows = aligned(table if sources else [row[:-1] for row in table], "<<>>>")
        listed = [f"[{i}] {each}" for i, each in enumerate(cited, 1)] if sources else []
        parts = (
            [f"{self.title} ({self.target}), energy per {self.of}: {', '.join(head)}"],
            rows,
            aligned(self.sums(), "<>>"),
            listed,
            [f"- {note}" for note in self.noted(sources)],
        )
        return "\n\n".join("\n".join(part) for part in parts if part)

    def noted(self, sources: bool = False) -> tuple[str, ...]:
        """The notes, with what is extrapolated; if sources are asked for, with those of the chip time and of ranges."""
        marked = tuple(f"extrapolated (*): {', '.join(names)}: {why}" for why, names in self.extrapolated.items())
        if not sources:
            return tuple(note for note in self.notes if not note.startswith(CHIP_TIME)) + marked
        spreads: dict[str, dict[str, None]] = {}
        for item in self.items:
            if item.spread:
                spreads.setdefault(item.spread, {})[item.what] = None
        return self.notes + marked + tuple(f"range of {', '.join(names)}: {text}" for text, names in spreads.items())


def _row(item: BillItem, cited: list[str]) -> tuple[str, ...]:
    unit = "W" if item.what == STATIC else "J"
    each = "-" if item.joules_each is None else quantity(item.joules_each, unit)
    energy = "not priced" if item.joules is None else quantity(item.joules, "J")
    mark = f"[{cited.index(sourced(item.source, item.conditions)) + 1}]" if item.source else ""
    count = f"{quantity(item.count, 's')}" if item.what == STATIC else number(item.count)
    return item.what + " *" * bool(item.extrapolated), item.of, count, each, energy, mark


def _share(value: float | None, n: int) -> float | None:
    return None if value is None else value / n


def _ends(items: Iterable[BillItem]) -> Range:
    """The sums of the low and of the high ends."""
    priced = [(item.joules, item.low, item.high) for item in items if item.joules is not None]
    low = sum((joules if least is None else least for joules, least, _ in priced), 0.0)
    return low, sum((joules if most is None else most for joules, _, most in priced), 0.0)


def _sum(items: Iterable[BillItem]) -> float:
    return sum((item.joules for item in items if item.joules is not None), 0.0)


def sourced(source: str, conditions: str) -> str:
    """A source with its conditions."""
    return f"{source} ({conditions})" if conditions else source


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Some digits with a prefix, e.g. "23.6 pJ"."""
    if value == 0:
        return f"0 {unit}"
    least = 1.0 - 0.5 * 10.0**-digits
    scale, prefix = next((pair for pair in _PREFIXES if abs(value) >= pair[0] * least), _PREFIXES[-1])
    return f"{value / scale:.{digits}g} {prefix}{unit}"


def between(value: float, low: float, high: float) -> str:
    """Joules with their range, e.g. "8.234 uJ (4.14 to 45.1 uJ)"."""
    if low == high:
        return f"{quantity(value, 'J')} (no range)"
    least, most = (quantity(end, "J", 3) for end in (low, high))
    number, unit = least.split()
    return f"{quantity(value, 'J')} ({number if most.endswith(f' {unit}') else least} to {most})"


def cells(bill: Mapping[str, Any]) -> tuple[str, ...]:
    """What stands below `COLUMNS`, of a bill as plain values; "-" where no time is known, and so no chips."""
    time, chips = "-", "-" if bill["chips"] is None else f"{bill['chips']:,}"
    if bill["chip_time_s"] is not None:
        time = " of ".join(quantity(bill[name], "s", 3) for name in ("chip_time_s", "duration_s"))
    return quantity(bill["dynamic_j"], "J"), *_totals(bill), time, chips


def _totals(bill: Mapping[str, Any]) -> tuple[str, str]:
    """The total with its range at both clocks: behind ">" where it lacks a cost, "refused" where there is none."""
    if bill["total_j"] is None:
        return REFUSED, REFUSED
    one, other = (
        "> " * bool(each["missing"]) + between(*(each[f"total{end}_j"] for end in ("", "_low", "_high")))
        for each in (bill, bill["real_time"])
    )
    return one, other + " late" * bill["late"]


def number(count: float) -> str:
    """A count with separators; a fraction has four digits, a large one none."""
    if count == int(count):
        return f"{int(count):,}"
    return f"{count:,.0f}" if abs(count) >= 1000 else f"{count:.4g}"


def footnotes(priced: Iterable[Energy], sources: bool = True) -> Iterator[str]:
    """Figures by their source, if asked for, and the bills' notes; what holds for several is said once."""
    targets: dict[str, list[str]] = {}
    for bill in priced:
        for line in (*(_sources(bill) if sources else ()), *bill.noted(sources)):
            targets.setdefault(line, []).append(bill.target)
    return (f"{', '.join(names)}: {line}" for line, names in targets.items())


def _sources(bill: Energy) -> list[str]:
    figures: dict[str, dict[str, None]] = {}
    for item in bill.items:
        if item.joules_each is not None:
            each = quantity(item.joules_each, "W" if item.what == STATIC else "J")
            figures.setdefault(sourced(item.source, item.conditions), {})[f"{item.what} {each}"] = None
    return [f"{', '.join(each)}: {source}" for source, each in figures.items()]
