"""Where the figures of several bills come from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from neuro.chips.pricing.energy import STATIC, Energy, quantity, sourced

__all__ = ["footnotes"]


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
