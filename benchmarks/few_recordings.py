"""Accuracy after learning from few recordings: `python benchmarks/few_recordings.py --out FOLDER`.

Each draw holds out a fifth of the recordings, the same for all ways of learning. Of the others, the first 1, 5, 10 and
30 of each class are learnt, then all. Learning by gradients makes the same number of steps with any number of
recordings. ReMuS sees each recording 8 times; in a further row the number of showings is the same for all numbers of
recordings.

FOLDER/accuracy.jsonl has a line for each training, and no training is repeated. At the end the program prints tables
and draws FOLDER/few_recordings.png. `--joules` instead computes the energy of learning and deciding on Loihi, see
`priced`, writes it to FOLDER/joules.json and prints it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch
from kept import NMNIST
from matplotlib.figure import Figure

import neuro
from neuro.apps import console, make_folder, table, write_picture
from neuro.events import Recordings, recordings
from neuro_drone.evaluate import ENDLESS, Flights, Start, fly_lap, reset_arguments
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train
from neuro_models import path as network_path
from neuro_recognise.method import choose
from neuro_recognise.methods.framewise import Framewise
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import Frames
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features
from neuro_train import trainer
from neuro_train.data import show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import by_module

if TYPE_CHECKING:
    from neuro.chips import Energy

Ints = npt.NDArray[np.int64]

ALL = 0
"""Size that means all recordings of a class."""
SIZES = (1, 5, 10, 30, ALL)
LONG = (1, 5, 10)
"""Sizes at which 1600 showings are more than 8 epochs."""
FOLDS = 5
"""Number of folds, of which the first is held out."""
BATCH, STEPS, SHOWINGS = 20, 1200, 1600
"""Recordings in a batch; steps of learning by gradients, as in 30 epochs of 800; showings of recordings to ReMuS."""
PLAN = TrainingPlan(input="pixels", output="out", duration=105.0, shift=2, warp=0.15, decay=0.1, batch=BATCH)
"""The plan of docs/how-to/train.md, without the grid of a chip."""
WAYS = {
    "hats": ("HATS", "#0072B2"),
    "gradients": ("gradients, 2312-128-10", "#D55E00"),
    "remus": ("ReMuS, 8 epochs", "#009E73"),
    "remus_long": ("ReMuS, 1600 showings", "#56B4E9"),
}
PER_CLASS = 30
"""Number of recordings of each class that are learnt, for the energy."""
TESTED = 100
"""Number of recordings over which the energy of deciding is averaged."""
INK, GREY, PAPER = "#17263c", "#8a94a3", "#fbfaf7"


@dataclass(frozen=True, slots=True)
class Learnt:
    """Masks of the held-out recordings that were decided rightly, and CPU time of learning in s."""

    right: npt.NDArray[np.bool_]
    cpu_s: float


class Bench:
    """The recordings in the form that each way of learning needs, computed on first use."""

    def __init__(self, data: Recordings) -> None:
        self.data = data

    @cached_property
    def remus(self) -> tuple[Any, Any]:
        """Return the method ReMuS and its features of the recordings."""
        return self._observed("remus")

    @cached_property
    def hats(self) -> tuple[Any, Any]:
        """Return the method HATS and its features of the recordings."""
        return self._observed("hats")

    @cached_property
    def dense(self) -> tuple[neuro.Network, Any]:
        """Return the network that learns by gradients, and its inputs."""
        net = neuro.load(network_path("dense"))
        return net, show(net, self.data, PLAN, lambda what, done, n: None)

    def _observed(self, name: str) -> tuple[Any, Any]:
        method = method_of(name).fitting(self.data.sensor_size(setting="another field"))
        return method, observe(method, self.data)

    def learnt(self, way: str, rows: Ints, held: Ints, seed: int) -> Learnt:
        """Learn from the recordings `rows`, and decide the recordings `held`."""
        if way == "gradients":
            return self._by_gradients(rows, held, seed)
        method, shown = self.hats if way == "hats" else self.remus
        if way == "remus_long":
            method = method.changed({"epochs": showings_epochs(len(rows))})
        began = time.process_time()
        made = learn(method, shown.take(rows), "few recordings", seed=seed)
        spent, part = time.process_time() - began, shown.take(held)
        return Learnt(choose(method.answer(made.learnt, part).scores) == part.labels, spent)

    def _by_gradients(self, rows: Ints, held: Ints, seed: int) -> Learnt:
        net, shown = self.dense
        plan = plan_of(len(rows), seed)
        began = time.process_time()
        made = trainer.learn(net, shown.take(rows), plan)
        spent, tried = time.process_time() - began, by_module(made.module, shown.take(held), plan)
        return Learnt(tried.decided == tried.labels, spent)


def plan_of(recordings: int, seed: int, **changes: Any) -> TrainingPlan:
    """Return the plan of a training by gradients with about `STEPS` steps, in whole epochs."""
    words = PLAN.as_words() | {"epochs": round(STEPS / math.ceil(recordings / BATCH)), "seed": seed} | changes
    return TrainingPlan(**words)


def showings_epochs(recordings: int) -> int:
    """Return the number of epochs in which ReMuS sees about `SHOWINGS` recordings."""
    return max(1, round(SHOWINGS / recordings))


def split(data: Recordings, per_class: int, draw: int) -> tuple[Ints, Ints]:
    """Return the recordings to learn from and the held-out recordings.

    A smaller set of a draw is part of the larger sets of the draw.
    """
    pool, held = data.folds(FOLDS, seed=draw)[0]
    order = np.random.default_rng([draw, 17]).permutation(pool)
    if per_class == ALL:
        return np.sort(order), held
    chosen = [order[data.labels[order] == label][:per_class] for label in range(len(data.classes))]
    return np.concatenate(chosen), held


def lines(file: Path) -> list[dict[str, Any]]:
    """Return the measured lines of a file, without a last line that was cut off when the process was killed."""
    found = []
    for text in file.read_text("utf-8").splitlines() if file.exists() else ():
        try:
            found.append(json.loads(text))
        except ValueError:
            continue
    return found


def measured(bench: Bench, file: Path, draws: int, ways: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return all lines. Missing lines are measured now, draw by draw."""
    done = {(one["way"], one["per_class"], one["draw"]) for one in lines(file)}
    for per_class, draw, way in jobs(draws, ways):
        if (way, per_class, draw) in done:
            continue
        rows, held = split(bench.data, per_class, draw)
        found = bench.learnt(way, rows, held, draw)
        told = {"way": way, "per_class": per_class, "draw": draw, "recordings": len(rows)}
        told |= {"right": int(found.right.sum()), "tested": len(held), "cpu_s": round(found.cpu_s, 2)}
        with file.open("a", encoding="utf-8") as out:
            out.write(("\n" if _cut(file) else "") + json.dumps(told) + "\n")
            out.flush()
            os.fsync(out.fileno())
        print(told, flush=True)
    return lines(file)


def jobs(draws: int, ways: tuple[str, ...]) -> Iterator[tuple[int, int, str]]:
    """Yield size, draw and way of each training. Trainings with all recordings take longest and come last."""
    for some in (SIZES[:-1], SIZES[-1:]):
        for draw in range(draws):
            yield from ((size, draw, way) for size in some for way in ways if way != "remus_long" or size in LONG)


def _cut(file: Path) -> bool:
    """Return True if the last line of a file has no newline."""
    return file.stat().st_size > 0 and not file.read_bytes().endswith(b"\n")


def spread(shares: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Return mean, lowest and highest of the draws.

    With three draws, an interval by Student's t would say little more.
    """
    return float(shares.mean()), float(shares.min()), float(shares.max())


def points(found: list[dict[str, Any]], way: str) -> Iterator[tuple[int, float, float, float, float]]:
    """Yield for each size: mean number of recordings per class, mean, lowest and highest accuracy, CPU s."""
    for size in SIZES:
        some = [one for one in found if one["way"] == way and one["per_class"] == size]
        if some:
            shares = np.array([one["right"] / one["tested"] for one in some])
            spent = float(np.mean([one["cpu_s"] for one in some]))
            yield round(some[0]["recordings"] / 10), *spread(shares), spent


def drawn(found: list[dict[str, Any]]) -> Figure:
    """Draw the accuracy against recordings per class, with a line for each way of learning."""
    figure = Figure(figsize=(8.0, 4.6), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    axis.set_facecolor(PAPER)
    for place, (way, (name, colour)) in enumerate(WAYS.items()):
        at = np.array(list(points(found, way)))
        if len(at):
            shift = 1.0 + 0.02 * (place - 1.5)  # so that error bars are beside each other
            ends = 100 * np.abs(at[:, 2:4] - at[:, 1:2]).T
            axis.errorbar(at[:, 0] * shift, 100 * at[:, 1], ends, color=colour, marker="o", capsize=3, label=name)
    axis.set_xscale("log")
    axis.set_xticks([1, 5, 10, 30, 80], ["1", "5", "10", "30", "80"])
    axis.minorticks_off()
    axis.set_xlabel("recordings of each class that were learnt from", color=INK)
    axis.set_ylabel("right of 200 held out, %", color=INK)
    axis.set_ylim(0, 100)
    axis.grid(color="#e4e8ee", linewidth=0.8)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    axis.legend(frameon=False, loc="lower right", labelcolor=INK)
    axis.set_title("N-MNIST from few recordings", loc="left", color=INK, fontsize=12.5)
    draws = max(one["draw"] for one in found) + 1
    axis.text(1, 1.01, f"mean, lowest and highest of {draws} draws", transform=axis.transAxes, ha="right", color=GREY)
    return figure


def table_of(found: list[dict[str, Any]], word: Callable[..., str], title: str) -> Any:
    """Return a table of all ways and sizes."""
    columns = ("way", *(f">{size or 'all'} a class" for size in SIZES))
    rows = []
    for way in WAYS:
        cells = [word(*values) for _, *values in points(found, way)]
        rows.append((WAYS[way][0], *cells, *[""] * (len(SIZES) - len(cells))))
    return table(columns, rows, title=title)


def priced(bench: Bench, steps: int) -> dict[str, Any]:
    """Return the energy of learning and deciding on Loihi: ReMuS by recording, the drone's network by control step.

    The host writes the weights of ReMuS. The drone's network learns by the learning engine of the chip.
    """
    rows, held = split(bench.data, PER_CLASS, 0)
    method, shown = bench.remus
    return {"drone": of_drone(steps), "remus": of_remus(method, shown.take(rows), shown.take(held[:TESTED]), 0)}


def of_remus(method: Framewise, learning: Features, held: Features, seed: int) -> dict[str, Any]:
    """Return joules on Loihi per learnt recording, as a mean of all epochs, and per decided recording."""
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
    """Return joules on Loihi per control step, while its engine learns and with frozen weights."""
    model = train(load("B60"), "snn-loihi", steps=steps, seed=0)
    return {"learning": _flown(model, True), "deciding": _flown(model, False)}


def _flown(model: Model, learns: bool) -> dict[str, Any]:
    start = Start((0.0, 0.0))
    env = Flights(model.scenario, [reset_arguments(start)])
    loop = model.loop(env, learns=learns, block=ENDLESS)
    lap = fly_lap(loop, env, start, learns)
    env.close()
    return in_words(loop.sim.energy("loihi").per(lap.steps, "control step")) | {"error_px": lap.error_px}


def in_words(bill: Energy) -> dict[str, Any]:
    """Return the sums of a bill at both clocks, and its counts by name, also counts without a published figure."""
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


def main() -> None:
    """Measure, print the tables and draw the figure."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--draws", type=int, default=3)
    options.add_argument("--way", action="append", choices=WAYS, help="all if not given")
    options.add_argument("--joules", action="store_true", help="what learning takes instead")
    options.add_argument("--drone-steps", type=int, default=2000, help="of which joules are told")
    asked = options.parse_args()
    torch.set_num_threads(1)
    make_folder(asked.out)
    bench = Bench(recordings(asked.data, part="Train"))
    if asked.joules:
        file = asked.out / "joules.json"
        if not file.exists():
            file.write_text(json.dumps(priced(bench, asked.drone_steps), indent=1), "utf-8")
        print(file.read_text("utf-8"))
        return
    found = measured(bench, asked.out / "accuracy.jsonl", asked.draws, tuple(asked.way or WAYS))
    shown: Mapping[str, Callable[..., str]] = {
        "right, %": lambda mean, low, high, spent: f"{100 * mean:.1f} ({100 * low:.1f} - {100 * high:.1f})",
        "learning, s of a core": lambda mean, low, high, spent: f"{spent:.1f}",
    }
    for title, word in shown.items():
        console().print(table_of(found, word, title))
    write_picture(asked.out / "few_recordings.png", drawn(found))


if __name__ == "__main__":
    main()
