"""What learning and deciding take on Loihi: `python benchmarks/few_recordings_joules.py --out FOLDER`.

Of ReMuS a recording, of which the host writes the weights; of the drone's network a control step, with the chip's own
learning engine. Writes FOLDER/joules.json and prints it; what is there is not done again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from few_recordings import NMNIST, Bench, split

import neuro
from neuro.apps import make_folder
from neuro.events import recordings
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, fly_lap
from neuro_drone.scenario import load
from neuro_drone.train import train
from neuro_recognise.methods.framewise import Framewise
from neuro_recognise.parts.frames import Frames
from neuro_recognise.shown import Features

if TYPE_CHECKING:
    from neuro.chips import Energy

PER_CLASS = 30
"""Recordings of each class that are learnt from."""
TESTED = 100
"""Recordings that deciding is the mean of."""


def main() -> None:
    """Price, print and keep."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--drone-steps", type=int, default=2000)
    asked = options.parse_args()
    make_folder(asked.out)
    bench = Bench(recordings(asked.data, part="Train"))
    rows, held = split(bench.data, PER_CLASS, 0)
    method, shown = bench.remus
    parts: dict[str, Callable[[], dict[str, Any]]] = {
        "drone": lambda: of_drone(asked.drone_steps),
        "remus": lambda: of_remus(method, shown.take(rows), shown.take(held[:TESTED]), 0),
    }
    file = asked.out / "joules.json"
    bills = json.loads(file.read_text("utf-8")) if file.exists() else {}
    for name, priced in parts.items():
        if name not in bills:
            bills[name] = priced()
            file.write_text(json.dumps(bills, indent=1), "utf-8")
    print(json.dumps(bills, indent=1))


def of_remus(method: Framewise, learning: Features, held: Features, seed: int) -> dict[str, Any]:
    """Joules on Loihi of a recording that is learnt from, mean of all epochs, and of one that is decided."""
    net = method.layer.network(method.inputs, len(learning.classes))
    sim, frames = neuro.compile(net, seed=seed), Frames.of(learning)
    told, parts = method.encoder.learn(frames.codes), []
    for epoch in range(method.epochs):
        method.layer.begin(sim, epoch, None)
        turn = frames.take(np.random.default_rng([seed, epoch]).permutation(len(frames)))
        labels, times = learning.labels[turn.recording], method.encoder.times(turn.codes, told)
        words: dict[str, Any] = {"labels": labels, "learn": True, "samples": turn.recording, "epoch": epoch}
        parts.append(sim.trials(times, turn.ids, turn.offsets, **words).taken)
        sim.forget(before=sim.time)
    learnt = sim.energy("loihi", of=reduce(add, parts)).per(method.epochs * len(learning), "recording")
    asked = Frames.of(held)
    decided = sim.trials(method.encoder.times(asked.codes, told), asked.ids, asked.offsets)
    return {
        "learning": in_words(learnt),
        "deciding": in_words(sim.energy("loihi", of=decided.taken).per(len(held), "recording")),
    }


def of_drone(steps: int) -> dict[str, Any]:
    """Joules on Loihi of a control step, while its engine learns and with weights frozen."""
    model = train(load("B60"), "snn-loihi", steps=steps, seed=0)
    return {"learning": _flown(model.scenario, model.learner()), "deciding": _flown(model.scenario, model.frozen())}


def _flown(scenario: Any, pilot: Any) -> dict[str, Any]:
    env = DroneEnv(scenario)
    lap = fly_lap(env, pilot, Start((0.0, 0.0)))
    env.close()
    return in_words(pilot.sim.energy("loihi").per(lap.steps, "control step")) | {"error_px": lap.error_px}


def in_words(bill: Energy) -> dict[str, Any]:
    """Sums of a bill at both clocks, and counts by what they are of; what has no published figure is counted only."""
    counts: dict[str, float] = {}
    unpriced = set()
    for item in bill.items:
        counts[item.what] = counts.get(item.what, 0.0) + item.count
        if item.joules_each is None:
            unpriced.add(item.what)
    return {
        **{name: value for name, value in bill.as_dict().items() if name not in ("items", "extrapolated", "notes")},
        "counts": counts,
        "by_cost": dict(bill.by_cost()),
        "not_priced": sorted(unpriced),
    }


if __name__ == "__main__":
    main()
