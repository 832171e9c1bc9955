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


BLOUW = "Blouw et al., arXiv:1812.01739, 2018, Table 1"
FRADY = "Frady et al., NICE 2020, arXiv:2004.12691"
AKOPYAN = "Akopyan et al., IEEE TCAD 34:1537, 2015"
MICROCIRCUIT = {"n": 772, "synapses": 3763, "rate": 3.237, "resolution": 0.1}
RANDOM = "random connections, all neurons at the mean rate"
DENSE = {"network": "keyword_spotter.yaml", "ms": 1.0, "quantity": "J"}

ROWS = (
    Row(
        what="Loihi, nearest neighbours, energy of a query",
        ends=True,
        target="loihi",
        network="nearest_neighbours.yaml",
        ms=60.0,
        share=32,
        chips=32,
        neurons_per_core=19,
        quantity="dynamic J",
        measured=1.33e-3,
        source=f"{FRADY}, Table 2",
        how="board of 32 chips; dynamic energy of neuromorphic cores, without leakage, x86 cores and resets",
        assumed="708 input spikes: a quarter to a third of 1,000 are said to be removed",
    ),
    Row(
        what="Loihi, nearest neighbours, time of a query",
        ends=True,
        target="loihi",
        network="nearest_neighbours.yaml",
        ms=60.0,
        share=32,
        chips=32,
        neurons_per_core=19,
        quantity="s",
        measured=60 * 5.8e-6,
        source=f"{FRADY}, section 5.1",
        how="5.8 us a step, unthrottled, of 76,800 patterns on 32 chips",
        assumed="patterns spread evenly over the cores",
    ),
    Row(
        what="Loihi, keyword spotter, power",
        target="loihi",
        network="keyword_spotter.yaml",
        ms=10.0,
        chips=1,
        step_s=1.0 / 296 / 10,
        quantity="W",
        measured=0.110,
        source=BLOUW,
        how="both supplies of one chip (Wolf Mountain board) while it infers 296 times a second; x86 cores are in it",
        assumed="inputs at 100 Hz; the time of a step is the published 1/296 s by 10 steps",
    ),
    Row(
        what="CPU (Xeon E5-2630), keyword spotter, energy of an inference",
        ends=True,
        target="cpu",
        **DENSE,
        measured=0.0063,
        source=BLOUW,
        how="running less idle, batches of 1, TensorFlow; 24 cores",
    ),
    Row(
        what="GPU (Quadro K4000), keyword spotter, energy of an inference",
        ends=True,
        target="gpu",
        **DENSE,
        measured=0.0298,
        source=BLOUW,
        how="running less idle, batches of 1, TensorFlow",
    ),
    Row(
        what="SpiNNaker, cortical circuit on 4 chips, power",
        ends=True,
        target="spinnaker",
        network="recurrent.yaml",
        params={"n": 10_000, "synapses": 400, "rate": 4.55},
        ms=200.0,
        chips=4,
        quantity="W",
        measured=2.0,
        source="Sharp et al., J. Neurosci. Methods 210:110, 2012; total as quoted of van Albada et al. 2018",
        how="board of 4 chips, all of it; 110 nJ for each of 18 M events a second",
        assumed=f"{RANDOM}; the rate that 2 W at 110 nJ an event means",
    ),
    Row(
        what="SpiNNaker, 250,000 neurons on 48 chips, power",
        ends=True,
        target="spinnaker",
        network="recurrent.yaml",
        params={"n": 5208, "synapses": 324, "rate": 22.2},
        ms=200.0,
        share=48,
        chips=48,
        quantity="W",
        measured=36.0,
        source="Stromatias et al., IJCNN 2013, abstract; 20 nJ an event as quoted of van Albada et al. 2018",
        how="board of 48 chips, all of it: 20 nJ for each of 1.8 G events a second; 'less than 1 W a chip'",
        assumed=RANDOM,
    ),
    Row(
        what="SpiNNaker, microcircuit at 0.1 ms, 20 times slower, energy of a synaptic event",
        target="spinnaker",
        network="recurrent.yaml",
        params=MICROCIRCUIT,
        ms=500.0,
        share=100,
        chips=6 * 48,
        step_s=2.0e-3,
        quantity="J/event",
        measured=5.9e-6,
        source="van Albada et al., Front. Neurosci. 12:291, 2018 (4.4 uJ in Senk et al., arXiv:2505.21185)",
        how="rack of 24 boards, of which 6 simulate; about half of it is supplies, switches and cooling",
        assumed=f"{RANDOM}; 6 boards; 0.94 G events in a biological second",
    ),
    Row(
        what="SpiNNaker, microcircuit at 0.1 ms in real time, energy of a synaptic event",
        target="spinnaker",
        network="recurrent.yaml",
        params=MICROCIRCUIT,
        ms=500.0,
        share=100,
        chips=12 * 48,
        step_s=0.1e-3,
        quantity="J/event",
        measured=0.601e-6,
        source="Rhodes et al., Phil. Trans. R. Soc. A 378:20190160, 2020, as listed by Senk et al., arXiv:2505.21185",
        how="12 boards, constant drive; which of supplies, switches and cooling are in it we could not read",
        assumed=f"{RANDOM}; 12 boards; 0.94 G events in a biological second",
    ),
    *(
        Row(
            what=f"TrueNorth, recurrent network at {rate:g} Hz and {volts} V, power",
            target="truenorth",
            network="recurrent.yaml",
            params={"n": 16_384, "synapses": 128, "rate": rate, "resolution": 0.1},
            ms=300.0,
            share=64,
            chips=1,
            step_s=0.1e-3,
            quantity="W",
            measured=watts,
            own=own,
            ends=volts == 0.775 or rate == 20.07,
            source=source,
            how="one chip, all of it, 128 active synapses a neuron",
            assumed=f"{RANDOM}; the table is of 0.8 V" if volts != 0.8 else RANDOM,
        )
        for rate, volts, watts, own, source in (
            (11.58, 0.8, 0.068, True, f"{AKOPYAN}, Fig. 17"),
            (20.07, 0.8, 0.071, False, f"{AKOPYAN}, Fig. 17"),
            (95.93, 0.8, 0.094, True, f"{AKOPYAN}, Fig. 17"),
            (20.0, 0.775, 0.072, False, "Merolla et al., Science 345:668, 2014, Table S1"),
            (20.0, 0.75, 0.065, False, f"{AKOPYAN}, section VII"),
        )
    ),
)


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
