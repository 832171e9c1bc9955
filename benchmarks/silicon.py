"""Predicted bills beside measurements on real chips.

`python benchmarks/silicon.py` describes and runs each measured network, computes its bill and prints a table. `--json`
prints JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import yaml

import neuro
from neuro.chips import Energy, chip, place, price

HERE = Path(__file__).resolve().parent / "measured"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measurement, and the settings of its prediction.

    Attributes:
        what: machine and network.
        target: chip of the bill.
        network: file of the network. `params` has its parameters, and `ms` the simulated time.
        share: number of such networks in the measurement; the dynamic energy is multiplied by it.
        chips: number of powered chips; None for the chips that the network needs.
        step_s: published duration of a step, s; None to predict it.
        neurons_per_core: published number of neurons on a core.
        quantity: measured quantity: J or s of the whole run, W, or J per synaptic event.
        measured: the published figure.
        own: True if the best values of the table of costs come from this measurement.
        ends: True if an end of the range of a figure comes from this measurement, which then must lie within.
        source, how: publication, and method of the measurement.
        assumed: facts that the papers do not report.
    """

    what: str
    target: str
    network: str
    params: dict[str, Any] = field(default_factory=dict)
    ms: float
    share: int = 1
    chips: int | None = None
    step_s: float | None = None
    neurons_per_core: int | None = None
    quantity: Literal["dynamic J", "J", "W", "J/event", "s"]
    measured: float
    own: bool = False
    ends: bool = False
    source: str
    how: str
    assumed: str = ""


ROWS = tuple(Row(**words) for words in yaml.safe_load((HERE / "silicon.yaml").read_text("utf-8")))


@dataclass(frozen=True)
class Outcome:
    """The prediction of a bill in the unit of the measurement: low, best, high."""

    row: Row
    low: float
    best: float
    high: float
    extrapolated: tuple[str, ...]

    @property
    def factor(self) -> float:
        """Predicted figure divided by the measured figure."""
        return self.best / self.row.measured

    @property
    def inside(self) -> bool:
        """True if the measurement lies within the range of the bill."""
        return self.low <= self.row.measured <= self.high


def predict(row: Row) -> Outcome:
    """Run the network of a row, and predict the measurement."""
    sim = neuro.compile(neuro.load(HERE / row.network, params=row.params), seed=1)
    sim.run(row.ms)
    target = chip(row.target)
    placed = None if target.mesh is None else place(sim.program, target, neurons_per_core=row.neurons_per_core)
    bill = price(sim.program, sim._engine.counts(), placed, target, step_s=row.step_s, chips=row.chips)
    told = bill.as_dict()
    ends = [_told(row, told, bill, sim.counts().synaptic_ops, end) for end in ("_low", "", "_high")]
    return Outcome(row, *ends, tuple(bill.extrapolated))


def _told(row: Row, told: dict[str, Any], bill: Energy, events: int, end: str) -> float:
    dynamic, static, time = told[f"dynamic{end}_j"] * row.share, told[f"static{end}_j"] or 0.0, bill.chip_time_s
    if row.quantity == "dynamic J":
        return float(dynamic)
    if row.quantity == "s":
        return float(told[f"chip_time{end}_s"])
    total = float(dynamic + static)
    if row.quantity == "J/event":
        return total / (events * row.share)
    return total if time is None or row.quantity == "J" else total / time


UNITS = {"dynamic J": "J", "J": "J", "W": "W", "J/event": "J", "s": "s"}


def table(found: Sequence[Outcome]) -> str:
    """Return the outcomes as a table for a page."""
    from neuro.apps import quantity

    head = "| what | predicted | range | measured | predicted / measured | |\n| --- | --- | --- | --- | --- | --- |"
    rows = [head]
    for each in found:
        unit = UNITS[each.row.quantity]
        low, best, high, real = (f"{n:.2g}" for n in (each.low, each.best, each.high, each.row.measured))
        low, best, high, real = (quantity(float(n), unit) for n in (low, best, high, real))
        mark = "sets the table" if each.row.own else "sets an end" if each.row.ends else ""
        mark = mark if each.inside else "outside the range"
        span = "-" if each.low == each.high else f"{low} to {high}"
        rows.append(f"| {each.row.what} | {best} | {span} | {real} | {each.factor:.2g} | {mark} |")
    return "\n".join(rows)


def main() -> int:
    """Print the table, and the source of each row."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--json", action="store_true", help="print JSON instead of a table")
    asked = options.parse_args()
    found = []
    for row in ROWS:
        print(f"running: {row.what}", file=sys.stderr, flush=True)
        found.append(predict(row))
    if asked.json:
        names = ("what", "target", "quantity", "measured", "own", "ends", "source", "how", "assumed")
        told = [
            {**{name: getattr(each.row, name) for name in names}, "low": each.low, "predicted": each.best,
             "high": each.high, "factor": each.factor, "inside": each.inside, "extrapolated": each.extrapolated}
            for each in found
        ]  # fmt: skip
        print(json.dumps(told, indent=2))
        return 0
    print(table(found))
    for each in found:
        row = each.row
        notes = [f"assumed: {row.assumed}"] * bool(row.assumed)
        notes += [f"extrapolated: {why}" for why in each.extrapolated]
        print(f"\n{row.what}: {row.source}\n  {row.how}" + "".join(f"\n  {note}" for note in notes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
