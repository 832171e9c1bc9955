"""Joules: each target on one scale, and what they are spent on."""

from __future__ import annotations

import math
from collections.abc import Iterator

from neuro.chips.description import COSTS
from neuro.chips.pricing.energy import STATIC, Energy, Item, number, quantity, sourced
from neuro.compare import html
from neuro.compare.html import Html, tag
from neuro.compare.result import Bill, Comparison

WIDTH, LEFT, RIGHT, ROW = 1040.0, 230.0, 90.0, 44.0
MOST_LINES = 300
COLOURS = 8
FIGURE_COLUMNS = ("target", "what", ">each", "source")
ITEM_COLUMNS = ("what", "of", ">count", ">each", ">energy", ">source")


def joules(comparison: Comparison) -> Html:
    """Bars of all bills, and the lines of each."""
    bills = [(bill, bill.energy) for bill in comparison.bills if bill.energy is not None]
    if not bills:
        return tag("p", "There is no bill.")
    kinds = list(dict.fromkeys(name for _, e in bills for name in e.by_cost() if name != STATIC))
    return html.join([_totals(bills), _shares(bills, kinds), _figures(bills), *(_details(b, e) for b, e in bills)])


Bills = list[tuple[Bill, Energy]]


def _name(bill: Bill, y: float) -> list[Html]:
    about = f"counts of {bill.counted_on}"
    return [
        html.text(LEFT - 14, y - 1, bill.target, "name", "end"),
        html.text(LEFT - 14, y + 13, about, "quiet", "end"),
    ]


def _totals(bills: Bills) -> Html:
    """Dynamic and static joules on a logarithmic scale: dots, since such a scale has no zero to begin a bar at."""
    values = [j for _, e in bills for j in (e.dynamic_j, e.static_j) if j > 0.0] or [1.0]
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)) + 1e-9)
    high = max(high, low + 1)

    def x(value: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (math.log10(value) - low) / (high - low)

    bottom = 10 + ROW * len(bills)
    parts: list[object] = []
    for exponent in range(low, high + 1):
        at = x(10.0**exponent)
        parts.append(html.line(at, 6, at, bottom, "rule"))
        parts.append(html.text(at, bottom + 16, quantity(10.0**exponent, "J"), "tick", "middle"))
    for row, (bill, e) in enumerate(bills):
        y = 10 + ROW * (row + 0.5)
        parts += _name(bill, y)
        told = [(kind, j) for kind, j in (("static", e.static_j), ("dynamic", e.dynamic_j)) if j > 0.0]
        if len(told) == 2:
            parts.append(html.line(x(e.dynamic_j), y, x(e.static_j), y, "link"))
        for kind, j in told:
            dot = tag("circle", tag("title", f"{kind}: {quantity(j, 'J')}"), cx=x(j), cy=y, r=6, class_=kind)
            parts += [dot, html.text(x(j), y - 11, quantity(j, "J"), "value", "middle")]
    picture = html.svg(WIDTH, bottom + 24, *parts, label="joules of each target, logarithmic", class_="wide")
    key = html.legend(("dynamic", "dynamic: what is done"), ("static", "static: chips that are on"))
    return html.figure(html.join([key, picture]), "Joules of the whole run on a logarithmic scale.")


def _shares(bills: Bills, kinds: list[str]) -> Html:
    """What dynamic joules are spent on, and the share of static ones."""
    parts: list[object] = []
    for row, (bill, e) in enumerate(bills):
        y = 6 + ROW * row
        parts += _name(bill, y + 16)
        dynamic = [(f"item{kinds.index(name) % COLOURS}", name, j) for name, j in e.by_cost().items() if name != STATIC]
        parts += _bar(dynamic, y, 20.0)
        parts += _bar([("dynamic", "dynamic", e.dynamic_j), ("static", "static", e.static_j)], y + 23, 5.0)
        parts.append(html.text(WIDTH - RIGHT + 10, y + 15, quantity(e.dynamic_j, "J"), "value"))
    picture = html.svg(WIDTH, 6 + ROW * len(bills), *parts, label="what joules are spent on", class_="wide")
    key = html.legend(*((f"item{i % COLOURS}", _meaning(name)) for i, name in enumerate(kinds)))
    caption = "Thick: dynamic joules by what they are spent on. Thin: dynamic and static of the total."
    return html.figure(html.join([key, picture]), caption)


def _bar(parts: list[tuple[str, str, float]], y: float, height: float) -> Iterator[Html]:
    total, x = sum(j for _, _, j in parts), LEFT
    for kind, name, j in parts:
        width = (WIDTH - LEFT - RIGHT) * j / total if total else 0.0
        if width > 0.2:
            told = f"{_meaning(name)}: {quantity(j, 'J')}, {j / total:.1%}"
            yield html.box(x, y, max(width - 1.0, 0.5), height, kind, told)
        x += width


def _meaning(name: str) -> str:
    return name.replace("_", " ")


def _figures(bills: Bills) -> Html:
    """Each figure once, and where it is from."""
    found = {(e.target, item.what): item for _, e in bills for item in e.items if item.source}
    rows, before = [], ""
    for (target, what), item in found.items():
        about = sourced(item.source, item.conditions)
        rows.append((target if target != before else "", _meaning(what), _each(item), about))
        before = target
    return html.table(FIGURE_COLUMNS, rows, "The figures and where they are published")


def _each(item: Item) -> str:
    unit = COSTS[item.what][0] if item.what in COSTS else "J"
    return "-" if item.joules_each is None else quantity(item.joules_each, unit)


def _details(bill: Bill, e: Energy) -> Html:
    sources = list(dict.fromkeys(sourced(item.source, item.conditions) for item in e.items if item.source))
    rows = [_line(item, sources) for item in e.items[:MOST_LINES]]
    if len(e.items) > MOST_LINES:
        rows.append((f"{len(e.items) - MOST_LINES:,} more lines", "", "", "", "", ""))
    rows += [(name, "", "", "", told, "") for name, told in zip(("dynamic", "static", "total"), e.sums(), strict=True)]
    time = "" if e.chip_time_s is None else f", {quantity(e.chip_time_s, 's')} of chip time"
    head = f"{e.title}, counts of {bill.counted_on}: {quantity(e.total_j, 'J')}{time}"
    foot = tag("ol", *(tag("li", source) for source in sources))
    notes = tag("ul", *(tag("li", note) for note in e.notes)) if e.notes else None
    return tag("details", tag("summary", head), html.table(ITEM_COLUMNS, rows), tag("h4", "Sources"), foot, notes)


def _line(item: Item, sources: list[str]) -> tuple[object, ...]:
    static = item.what == STATIC
    energy = "not priced" if item.joules is None else quantity(item.joules, "J")
    count = f"{quantity(item.count, 's')}" if static else number(item.count)
    mark = sources.index(sourced(item.source, item.conditions)) + 1 if item.source else ""
    return (_meaning(item.what), item.of, count, _each(item), energy, mark)
