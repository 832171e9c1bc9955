"""Joules against silicon: what bills predict beside what was measured on machines.

`python benchmarks/silicon.py` describes each measured network, runs it, prices it and prints a table; `--json` for
programs.
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
    """One measurement, and how it is predicted.

    Attributes:
        what: the machine and the network.
        target: whose bill.
        network: file of the network; `params` are its parameters, `ms` how long it runs.
        share: the network is one such part of what was measured: dynamic energy is taken so often.
        chips: that were on; None: those that the network needs.
        step_s: how long a step took, where it was published; None: predicted, too.
        neurons_per_core: where it was published.
        quantity: what was measured, in J of the whole run, W, J a synaptic event, or s of the whole run.
        measured: the published figure.
        own: whether the table's best values were taken from this measurement.
        ends: whether an end of a figure's range was, so that it lies within by itself.
        source, how: where it is published, and how it was measured.
        assumed: what the papers do not tell.
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
    """What a bill predicts in the unit of the measurement: low, best, high."""

    row: Row
    low: float
    best: float
    high: float
    extrapolated: tuple[str, ...]

    @property
    def factor(self) -> float:
        """Predicted by measured."""
        return self.best / self.row.measured

    @property
    def inside(self) -> bool:
        """Whether the measurement lies within the bill's range."""
        return self.low <= self.row.measured <= self.high


def predict(row: Row) -> Outcome:
    """Run and price the network of a row."""
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
    """The outcomes as rows of a page."""
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
    """Print the table, and of each row where it is from."""
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
