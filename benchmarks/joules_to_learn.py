"""Joules to a mean return of 475 in CartPole: the spiking agent beside PPO, both with their defaults.

    python benchmarks/joules_to_learn.py FOLDER [--seeds 101-105]

The script runs `neuro energy cartpole --until 475` and `neuro agent energy CartPole-v1 --until 475` for each seed, and
prints the means. The bills are stored in FOLDER, and no run is repeated.

Further rows have the energy on processors of a program that only computes where there is a spike (`EVENT`).
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import quantity
from neuro.chips import dense

COMMANDS = {
    "agent": "neuro energy cartpole --until 475 --chips loihi,loihi2,spinnaker,cpu,gpu,arm",
    "ppo": "neuro agent energy CartPole-v1 --until 475 --chips cpu,gpu,arm",
}
STEP = 20
"""Number of steps of the network in a control step, after which a signal teaches."""
EVENT = {
    "synaptic_op": 1.0,
    "neuron_update_active": 10.0,  # decay of potential and adaptation, input, rate with its exponential, draw
    "neuron_update_inactive": 10.0,
    "learning_update": 0.16,  # e += x where there is a trace: 91 of 1,176 places spike in a step, and traces last two
    "signal_update": 2.0 / STEP,  # w += eta n z and z = decay z + e, of every synapse
}
"""Largest number of multiply-accumulates of each count of a bill, for a program that only computes at spikes."""
ENDS = ("", "_low", "_high")


def bills(folder: Path, who: str, seed: int) -> dict[str, Any]:
    """Return the bills of a training, from their file or from the command."""
    path = folder / f"{who}_{seed}.json"
    if not path.exists():
        command = [*COMMANDS[who].split(), "--seed", str(seed), "--json"]
        told = subprocess.run(command, capture_output=True, text=True, check=True)
        path.write_text(json.dumps({**json.loads(told.stdout), "told": told.stderr}))
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def control_steps(run: dict[str, Any]) -> int:
    """Return the number of control steps up to the goal, which must have been reached."""
    if "told" not in run or "solved" in run:
        assert run["solved"]
        return int(run["steps"])
    told = re.search(r"([\d,]+) steps; .*reached$", run["told"].strip(), re.MULTILINE)
    assert told, "the goal was not reached"
    return int(told[1].replace(",", ""))


def joules(bill: dict[str, Any], real: bool) -> list[float]:
    """Return the best, low and high energy of a bill, or the sum of its lines if the chip refuses the network."""
    bill = bill["real_time"] if real else bill
    return [(bill[f"dynamic{end}_j"] or 0.0) + (bill[f"static{end}_j"] or 0.0) for end in ENDS]


def by_events(bill: dict[str, Any], target: str) -> list[float]:
    """Return the best, low and high energy of a processor that only computes at spikes."""
    macs = {f"{item['what']} {item['of']}": item["count"] * EVENT.get(item["what"], 0.0) for item in bill["items"]}
    priced = dense(macs, target)
    return [priced.total_j, priced.low_j, priced.high_j]


def told(each: list[list[float]]) -> str:
    """Return the mean of the best values and the means of both ends of the ranges, as text."""
    best, low, high = np.mean(each, axis=0)
    return f"{quantity(best, 'J', 3)} ({quantity(low, 'J', 3)} to {quantity(high, 'J', 3)})"


def main() -> None:
    """Run the missing trainings, and print a row for each contestant and target."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="101-105")
    asked = parser.parse_args()
    asked.folder.mkdir(exist_ok=True)
    first, _, last = asked.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    for who in COMMANDS:
        runs = [bills(asked.folder, who, seed) for seed in seeds]
        steps = [control_steps(run) for run in runs]
        print(f"{who}: {np.mean(steps):,.0f} +- {np.std(steps, ddof=1):,.0f} control steps, {steps}")
        for k, bill in enumerate(runs[0]["bills"]):
            same = [run["bills"][k] for run in runs]
            real = told([joules(each, True) for each in same])
            lacks = f"without {', '.join(bill['missing'])}" + "; the chip refuses the network" * bool(bill["refused"])
            print(f"  {bill['target']}: {told([joules(each, False) for each in same])}; real time {real}; {lacks}")
        for target in ("cpu", "gpu", "arm") if who == "agent" else ():
            print(f"  {target}, by events: {told([by_events(run['bills'][0], target) for run in runs])}")


if __name__ == "__main__":
    main()
