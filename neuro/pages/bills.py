"""Drawings of energy bills: the totals of all chips on a common scale, and the items of each total."""

from __future__ import annotations

import math
from collections.abc import Sequence

from neuro.chips.description import COSTS
from neuro.chips.energy import FASTEST, REAL_TIME, STATIC, BillItem, Energy, number, quantity, sourced
from neuro.core import html
from neuro.core.html import Html, tag

MOST_LINES = 300
COLOURS = 8
MOST_DECADES = 5
FIGURE_COLUMNS = ("chip", "what", ">each", "source")
ITEM_COLUMNS = ("what", "of", ">count", ">each", ">energy", ">source")

_SPENT = {
    "dynamic": "dynamic: what is done",
    "static": f"static: chips that are on, {FASTEST}",
    "waiting": f"static: chips that are on, {REAL_TIME}",
}
"""Kinds of energy by the style class that draws them."""

Bills = Sequence[tuple[str, Energy]]
"""Pairs of the origin of the counts, e.g. "counts of event", and the bill."""


def joules(bills: Bills) -> Html:
    """Draw all bills, and list the items of each bill."""
    if not bills:
        return tag("p", "There is no bill.")
    kinds = list(dict.fromkeys(name for _, e in bills for name in e.by_cost() if name != STATIC))
    details = (_details(about, e) for about, e in bills)
    # A chip that refuses the network has no total to draw; its items have the reason.
    priced = [(about, e) for about, e in bills if not e.refused]
    pictures = [_totals(priced), _shares(priced, kinds)] if priced else []
    return html.join([*pictures, _figures(bills), *details])


def _row(about: str, e: Energy, *parts: object) -> Html:
    return tag("div", tag("p", tag("b", e.target), tag("small", about)), tag("div", *parts), class_="bill")


def _totals(bills: Bills) -> Html:
    """Draw totals in joules as dots on a logarithmic scale. Bars would need a zero."""
    values = [j for _, e in bills for j in _energies(e).values()] or [1.0]
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)) + 1e-9)
    high = max(high, low + 1)
    decades = range(low, high + 1, -(-(high - low) // MOST_DECADES))
    places = [f"left:{100.0 * (n - low) / (high - low):.1f}%" for n in decades]
    rows = []
    for about, e in bills:
        dots = (_dot(kind, j, 100.0 * (math.log10(j) - low) / (high - low)) for kind, j in _energies(e).items())
        marks = (tag("u", style=place) for place in places)
        rows.append(_row(about, e, tag("div", *marks, *dots, class_="track"), tag("small", e.totals())))
    labels = (tag("span", quantity(10.0**n, "J"), style=place) for n, place in zip(decades, places, strict=True))
    scale = tag("div", tag("p"), tag("div", *labels, class_="decades"), class_="bill")
    key = html.legend(*_SPENT.items())
    return html.figure(html.join([key, *rows, scale]), "Joules of the whole run on a logarithmic scale.")


def _energies(e: Energy) -> dict[str, float]:
    """Return the joules of each kind above 0, at both clocks."""
    kinds = zip(_SPENT, (e.dynamic_j, e.static_j, e.real_time.static_j), strict=True)
    return {kind: j for kind, j in kinds if j > 0.0}


def _dot(kind: str, j: float, percent: float) -> Html:
    return tag("i", class_=kind, style=f"left:{percent:.1f}%", title=f"{_SPENT[kind]}: {quantity(j, 'J')}")


def _shares(bills: Bills, kinds: list[str]) -> Html:
    """Draw the shares of dynamic joules by item, and the share of static joules."""
    rows = []
    for about, e in bills:
        dynamic = [(f"item{kinds.index(name) % COLOURS}", name, j) for name, j in e.by_cost().items() if name != STATIC]
        totals = [
            [(k, k, j) for k, j in _energies(e).items() if k != other_clock] for other_clock in ("waiting", "static")
        ]
        label = f"{about}: {quantity(e.dynamic_j, 'J')}"
        rows.append(_row(label, e, _bar(dynamic, "bar"), *(_bar(parts, "bar thin") for parts in totals)))
    key = html.legend(*((f"item{i % COLOURS}", _meaning(name)) for i, name in enumerate(kinds)))
    caption = (
        f"Thick: dynamic joules by item. Thin: dynamic and static of the total, {FASTEST} and, below, {REAL_TIME}."
    )
    return html.figure(html.join([key, *rows]), caption)


def _bar(parts: Sequence[tuple[str, str, float]], class_: str) -> Html:
    total = sum(j for _, _, j in parts)
    return tag("div", *(_share(*part, total) for part in parts if part[2] > 0.0), class_=class_)


def _share(kind: str, name: str, j: float, total: float) -> Html:
    label = f"{_SPENT.get(name, _meaning(name))}: {quantity(j, 'J')}, {j / total:.1%}"
    return tag("i", class_=kind, style=f"width:{100.0 * j / total:.2f}%", title=label)


def _meaning(name: str) -> str:
    return name.replace("_", " ")


def _figures(bills: Bills) -> Html:
    """Return a table with each cost once, and its source."""
    costs = {(e.target, item.what): item for _, e in bills for item in e.items if item.source}
    rows, previous = [], ""
    for (target, what), item in costs.items():
        source = sourced(item.source, item.conditions)
        rows.append((target if target != previous else "", _meaning(what), _cost_of(item), source))
        previous = target
    return html.folded("The figures and where they are published", html.table(FIGURE_COLUMNS, rows))


def _cost_of(item: BillItem) -> str:
    unit = COSTS[item.what][0] if item.what in COSTS else "J"
    return "-" if item.joules_each is None else quantity(item.joules_each, unit)


def _details(about: str, e: Energy) -> Html:
    sources = list(dict.fromkeys(sourced(item.source, item.conditions) for item in e.items if item.source))
    rows = [_line(item, sources) for item in e.items[:MOST_LINES]]
    if len(e.items) > MOST_LINES:
        rows.append((f"{len(e.items) - MOST_LINES:,} more lines", "", "", "", "", ""))
    (_, *clocks), *sums = e.sums()
    sums_table = html.table(("", *(f">{clock}" for clock in clocks)), sums)
    foot = tag("ol", *(tag("li", source) for source in sources))
    remarks = e.remarks(sources=True)
    notes = tag("ul", *(tag("li", note) for note in remarks)) if remarks else None
    summary = f"{e.title}, {about}: {e.totals()}"
    return html.folded(summary, html.table(ITEM_COLUMNS, rows), sums_table, tag("h4", "Sources"), foot, notes)


def _line(item: BillItem, sources: list[str]) -> tuple[object, ...]:
    static = item.what == STATIC
    energy = "not priced" if item.joules is None else quantity(item.joules, "J")
    count = f"{quantity(item.count, 's')}" if static else number(item.count)
    mark = sources.index(sourced(item.source, item.conditions)) + 1 if item.source else ""
    return (_meaning(item.what) + " *" * bool(item.extrapolated), item.of, count, _cost_of(item), energy, mark)
