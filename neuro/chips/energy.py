"""Bill of a run: the number of operations, the costs of operations, and the sources of the costs."""

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
"""Prefix of the notes with the sources of the chip time."""
FASTEST, AS_GIVEN, REAL_TIME = "as fast as the chip can", "at the given steps", "in real time"
"""Clocks of a bill: a step takes the shortest possible time, a given time, or its simulated time."""
REFUSED = "refused"
"""Text in place of a total on a chip that cannot run the network."""
NOT_PRICED = "the bytes are not priced"
"""End of the note on the operations of one use of each part of the host."""
COLUMNS = (">dynamic", f">{FASTEST}", f">{REAL_TIME}", ">chip time", ">chips")
"""Column heads for a table with a bill per row, see `Energy.cells`."""


@dataclass(frozen=True, slots=True)
class BillItem:
    """A line of a bill.

    Attributes:
        what: name of the cost, see `neuro.chips.description.COSTS`, or "host": operations of the host.
        kind: kind of the part that `of` names: "population", "projection", "signal", "host", "layers" or "chip".
        of: name of the population, projection, signal, part and processor of the host, layers or target.
        count: number of operations; for `static_per_chip` chips x seconds.
        joules_each: cost of one operation in J; None if no figure is published. Such a line is not in the sums.
        joules: cost of all operations in J.
        source: source of the figure.
        conditions: conditions of the figure.
        low, high: lowest and highest cost of all operations, by the range of the figure.
        spread: source of that range.
        extrapolated: reason why the figure may not hold for this run, "" if it holds.
        bytes: bytes that the host reads and writes, without a price.
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
    bytes: float = 0.0


@dataclass(frozen=True, slots=True)
class Energy:
    """The bill of a run on a target, or of one part of the run, see `per`.

    Static energy depends on the clock: this bill uses `clock`, and `real_time` is the same bill in real time.

    Attributes:
        target: name of the chip or processor.
        title: name for readers.
        chips: number of chips that are on.
        chip_time_s: time that the chip needs for the run, in s; None if no time is known.
        steps: number of steps of the run.
        items: lines of the bill: populations first, then projections, then the chip.
        notes: assumptions, and costs that the sums lack.
        of: "run", or the name of the parts into which `per` divided the run.
        chip_time_range_s: lowest and highest chip time, by the ranges of its figures.
        duration_s: duration of the run in real time, in s: steps x resolution, or the value that the caller of `price`
            passed.
        clock: the clock of the chip time: `FASTEST`, `AS_GIVEN` or `REAL_TIME`.
        waiting: the bill at real time, if the chip can wait for the end of each step; else None.
        refused: reason why the chip cannot run the network, "" if it can. A refused bill has lines but no total.
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
        """The same bill if each step lasts its simulated time, as for live events. A late chip does not wait."""
        return self.waiting or self

    @property
    def total_j(self) -> float:
        """Total energy in J, without the costs in `missing`; NaN on a chip that refuses the network."""
        return math.nan if self.refused else self.dynamic_j + self.static_j

    @property
    def dynamic_j(self) -> float:
        """Energy of all operations in J."""
        return _sum(self._dynamic())

    @property
    def static_j(self) -> float:
        """Energy of chips that are on, in J. If no figure is published, it is 0, and a note says so."""
        return _sum(self._static())

    @property
    def low_j(self) -> float:
        """Total energy in J if every figure is at the low end of its range; NaN if refused."""
        return math.nan if self.refused else _ends(self.items)[0]

    @property
    def high_j(self) -> float:
        """Total energy in J if every figure is at the high end of its range; NaN if refused."""
        return math.nan if self.refused else _ends(self.items)[1]

    @property
    def extrapolated(self) -> dict[str, tuple[str, ...]]:
        """Names of the extrapolated costs of this run, by reason."""
        costs: dict[str, dict[str, None]] = {}
        for item in self.items:
            if item.extrapolated:
                costs.setdefault(item.extrapolated, {})[item.what] = None
        return {why: tuple(names) for why, names in costs.items()}

    @property
    def static_known(self) -> bool:
        """True if a static power and a time for it are known."""
        return any(item.what == STATIC for item in self.items)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the costs without a published figure. The total lacks these costs and has the prefix ">"."""
        unpriced = dict.fromkeys(item.what for item in self.items if item.joules is None)
        return (*unpriced, *(() if self.static_known else (STATIC,)))

    @property
    def late(self) -> bool:
        """True if the chip is slower than real time."""
        return self.chip_time_s is not None and self.chip_time_s > self.duration_s * (1.0 + 1e-9)

    def sums(self) -> list[tuple[str, ...]]:
        """Return rows of text: chip time, dynamic, static and total energy, at the bill's clock and in real time."""
        rows = zip(("chip time", "dynamic", "static"), self._column(), self.real_time._column(), strict=True)
        return [("", self.clock, REAL_TIME), *rows, ("total", *_totals(self._both()))]

    def _column(self) -> tuple[str, str, str]:
        time = "-" if self.chip_time_s is None else quantity(self.chip_time_s, "s")
        static = quantity(self.static_j, "J") if self.static_known else "not priced"
        return time, quantity(self.dynamic_j, "J"), static

    def cells(self) -> tuple[str, ...]:
        """Return the cells below `COLUMNS`."""
        return cells(self._both())

    def totals(self) -> str:
        """Return the total with its range at both clocks, as a line of text."""
        if self.refused:
            return f"{REFUSED}: {self.refused}"
        at_clock, in_real_time = _totals(self._both())
        return f"{at_clock} {self.clock}, {'the same' if at_clock == in_real_time else in_real_time} {REAL_TIME}"

    def total(self, digits: int = 4) -> str:
        """Return the total at this clock without its range, e.g. "8.234 uJ", "> 8.234 uJ" or "refused".

        Args:
            digits: number of significant digits.
        """
        if self.refused:
            return REFUSED
        return "> " * bool(self.missing) + quantity(self.total_j, "J", digits)

    def by_population(self) -> dict[str, float]:
        """Return the dynamic energy of each population's neurons in J."""
        return self._joules_by("population")

    def by_projection(self) -> dict[str, float]:
        """Return the dynamic energy of each projection in J: synapses, learning, and routing of its spikes."""
        return self._joules_by("projection")

    def _joules_by(self, kind: str) -> dict[str, float]:
        sums: dict[str, float] = {}
        for item in self.items:
            if item.kind == kind:
                sums[item.of] = sums.get(item.of, 0.0) + (item.joules or 0.0)
        return sums

    def by_cost(self) -> dict[str, float]:
        """Return the energy of each cost in J, in the order of the items."""
        sums: dict[str, float] = {}
        for item in self.items:
            if item.joules is not None:
                sums[item.what] = sums.get(item.what, 0.0) + item.joules
        return sums

    def per(self, n: int, what: str) -> Energy:
        """Return the bill for one of `n` equal parts of the run.

        Args:
            n: number of parts in the run.
            what: name of one part, e.g. "recording" or "control step".

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
                bytes=item.bytes / n,
            )
            for item in self.items
        )
        range_j = self.chip_time_range_s
        span = None if range_j is None else (range_j[0] / n, range_j[1] / n)
        time, lasts = _share(self.chip_time_s, n), self.duration_s / n
        waiting = None if self.waiting is None else self.waiting.per(n, what)
        times = replace(self, chip_time_s=time, chip_time_range_s=span, duration_s=lasts, waiting=waiting)
        return replace(times, items=items, steps=self.steps / n, of=what)

    def as_dict(self) -> dict[str, Any]:
        """Return the bill as plain values for JSON, with None for unknown values."""
        fields = {"target": self.target, "title": self.title, "of": self.of, "clock": self.clock}
        items = [asdict(item) for item in self.items]
        extrapolated = [{"why": why, "costs": list(names)} for why, names in self.extrapolated.items()]
        lists = {"items": items, "extrapolated": extrapolated, "notes": list(self.notes)}
        return {**fields, **self._both(), "refused": self.refused or None, **lists}

    def _both(self) -> dict[str, Any]:
        """Return the figures at both clocks."""
        machine = {"chips": None if self.chip_time_s is None else self.chips, "steps": self.steps}
        real_time = {"duration_s": self.duration_s, "late": self.late, "real_time": self.real_time._figures()}
        return {**self._figures(), **machine, **real_time}

    def _figures(self) -> dict[str, Any]:
        """Return the sums, ranges and chip time at one clock."""
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
        """Return the bill as text: lines, sums and assumptions.

        Args:
            sources: whether to add the source of each figure.
        """
        cited = list(dict.fromkeys(sourced(item.source, item.conditions) for item in self.items if item.source))
        table = [("item", "of", "count", "each", "energy", "source"), *(_row(item, cited) for item in self.items)]
        head = [f"{number(self.steps)} steps"]
        if self.chip_time_s is not None:
            chips = f"{self.chips} chip" + "s" * (self.chips != 1)
            head = [chips, *head, f"{quantity(self.chip_time_s, 's')} of chip time"]
        rows = aligned(table if sources else [row[:-1] for row in table], "<<>>>")
        references = [f"[{i}] {source}" for i, source in enumerate(cited, 1)] if sources else []
        parts = (
            [f"{self.title} ({self.target}), energy per {self.of}: {', '.join(head)}"],
            rows,
            aligned(self.sums(), "<>>"),
            references,
            [f"- {note}" for note in self.remarks(sources)],
        )
        return "\n\n".join("\n".join(part) for part in parts if part)

    def remarks(self, sources: bool = False) -> tuple[str, ...]:
        """Return the notes and the extrapolated costs; with `sources` also the sources of chip time and ranges."""
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
    joules_each = "-" if item.joules_each is None else quantity(item.joules_each, unit)
    energy = "not priced" if item.joules is None else quantity(item.joules, "J")
    mark = f"[{cited.index(sourced(item.source, item.conditions)) + 1}]" if item.source else ""
    count = f"{quantity(item.count, 's')}" if item.what == STATIC else number(item.count)
    count += f" mac, {number(item.bytes)} bytes" if item.bytes else ""
    return item.what + " *" * bool(item.extrapolated), item.of, count, joules_each, energy, mark


def _share(value: float | None, n: int) -> float | None:
    return None if value is None else value / n


def _ends(items: Iterable[BillItem]) -> Range:
    """Return the sum of the low ends and the sum of the high ends."""
    priced = [(item.joules, item.low, item.high) for item in items if item.joules is not None]
    low = sum((joules if lowest is None else lowest for joules, lowest, _ in priced), 0.0)
    return low, sum((joules if highest is None else highest for joules, _, highest in priced), 0.0)


def _sum(items: Iterable[BillItem]) -> float:
    return sum((item.joules for item in items if item.joules is not None), 0.0)


def sourced(source: str, conditions: str) -> str:
    """Return a source with its conditions in brackets, if any."""
    return f"{source} ({conditions})" if conditions else source


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Return a number with its unit and an SI prefix, e.g. "23.6 pJ"."""
    if value == 0:
        return f"0 {unit}"
    threshold = 1.0 - 0.5 * 10.0**-digits
    scale, prefix = next((pair for pair in _PREFIXES if abs(value) >= pair[0] * threshold), _PREFIXES[-1])
    return f"{value / scale:.{digits}g} {prefix}{unit}"


def between(value: float, low: float, high: float) -> str:
    """Return joules with their range, e.g. "8.234 uJ (4.14 to 45.1 uJ)"."""
    if low == high:
        return f"{quantity(value, 'J')} (no range)"
    lowest, highest = (quantity(end, "J", 3) for end in (low, high))
    number, unit = lowest.split()
    return f"{quantity(value, 'J')} ({number if highest.endswith(f' {unit}') else lowest} to {highest})"


def cells(bill: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells below `COLUMNS` for a bill as plain values; "-" marks an unknown time or number of chips."""
    time, chips = "-", "-" if bill["chips"] is None else f"{bill['chips']:,}"
    if bill["chip_time_s"] is not None:
        time = " of ".join(quantity(bill[name], "s", 3) for name in ("chip_time_s", "duration_s"))
    return quantity(bill["dynamic_j"], "J"), *_totals(bill), time, chips


def _totals(bill: Mapping[str, Any]) -> tuple[str, str]:
    """Return the total with its range at both clocks: with the prefix ">" if a cost is missing, or "refused"."""
    if bill["total_j"] is None:
        return REFUSED, REFUSED
    at_clock, in_real_time = (
        "> " * bool(figures["missing"]) + between(*(figures[f"total{end}_j"] for end in ("", "_low", "_high")))
        for figures in (bill, bill["real_time"])
    )
    return at_clock, in_real_time + " late" * bill["late"]


def number(count: float) -> str:
    """Return a count with separators, e.g. "12,345"; a fraction below 1,000 has four significant digits."""
    if count == int(count):
        return f"{int(count):,}"
    return f"{count:,.0f}" if abs(count) >= 1000 else f"{count:.4g}"


def footnotes(priced: Iterable[Energy], sources: bool = True) -> Iterator[str]:
    """Yield the rows of the host and notes of several bills, and with `sources` the figures by source.

    A line shared by several bills names their targets.
    """
    targets: dict[str, list[str]] = {}
    for bill in priced:
        notes = (note for note in bill.remarks(sources) if not note.endswith(NOT_PRICED))  # `_of_host` has them
        for line in (*_of_host(bill), *(_sources(bill) if sources else ()), *notes):
            targets.setdefault(line, []).append(bill.target)
    return (f"{', '.join(names)}: {line}" for line, names in targets.items())


def _of_host(bill: Energy) -> list[str]:
    rows = [(item, item.joules) for item in bill.items if item.kind == "host" and item.joules is not None]
    macs, size = (number(sum(each)) for each in ([item.count for item, _ in rows], [item.bytes for item, _ in rows]))
    parts = ", ".join(f"{item.of.rpartition(', ')[0] or item.of} {quantity(joules, 'J')}" for item, joules in rows)
    total = quantity(sum(joules for _, joules in rows), "J")
    return [f"host: {macs} mac, {size} bytes, {total} a {bill.of}: {parts}"] if rows else []


def _sources(bill: Energy) -> list[str]:
    figures: dict[str, dict[str, None]] = {}
    for item in bill.items:
        if item.joules_each is not None:
            each = quantity(item.joules_each, "W" if item.what == STATIC else "J")
            figures.setdefault(sourced(item.source, item.conditions), {})[f"{item.what} {each}"] = None
    return [f"{', '.join(each)}: {source}" for source, each in figures.items()]
