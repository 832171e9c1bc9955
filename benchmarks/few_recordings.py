"""Accuracy of what learnt from few recordings: `python benchmarks/few_recordings.py --out FOLDER`.

Each draw holds a fifth of the recordings back, the same for all ways of learning, and of the others takes the first 1,
5, 10 and 30 of each class, then all. Gradients make the same number of steps of learning however few recordings there
are; ReMuS is shown each recording 8 times, and, as a row of its own, as often as makes the same number of showings.

FOLDER/accuracy.jsonl has a line for each training; what is there is not done again. Then it prints tables and draws
FOLDER/few_recordings.png. `--joules` prices learning and deciding on Loihi instead, see `priced`: it writes
FOLDER/joules.json and prints it.
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
"""Of a class: as many as there are."""
SIZES = (1, 5, 10, 30, ALL)
LONG = (1, 5, 10)
"""Sizes of which 1600 showings are more than 8 epochs."""
FOLDS = 5
"""Of which the first is held back."""
BATCH, STEPS, SHOWINGS = 20, 1200, 1600
"""Recordings in a batch; steps of learning by gradients: of 30 epochs of 800; showings of recordings to ReMuS."""
PLAN = TrainingPlan(input="pixels", output="out", duration=105.0, shift=2, warp=0.15, decay=0.1, batch=BATCH)
"""Of docs/how-to/train.md, without a chip's grid."""
WAYS = {
    "hats": ("HATS", "#0072B2"),
    "gradients": ("gradients, 2312-128-10", "#D55E00"),
    "remus": ("ReMuS, 8 epochs", "#009E73"),
    "remus_long": ("ReMuS, 1600 showings", "#56B4E9"),
}
PER_CLASS = 30
"""Recordings of each class that are learnt from."""
TESTED = 100
"""Recordings that deciding is the mean of."""
INK, GREY, PAPER = "#17263c", "#8a94a3", "#fbfaf7"


@dataclass(frozen=True, slots=True)
class Learnt:
    """Which of the held-out recordings were decided rightly, and seconds of a core that learning took."""

    right: npt.NDArray[np.bool_]
    cpu_s: float


class Bench:
    """The recordings as each way sees them, looked at when first asked for."""

    def __init__(self, data: Recordings) -> None:
        self.data = data

    @cached_property
    def remus(self) -> tuple[Any, Any]:
        """The method and what the recordings show to it."""
        return self._observed("remus")

    @cached_property
    def hats(self) -> tuple[Any, Any]:
        """Likewise."""
        return self._observed("hats")

    @cached_property
    def dense(self) -> tuple[neuro.Network, Any]:
        """The network that learns by gradients, and what it is shown."""
        net = neuro.load(network_path("dense"))
        return net, show(net, self.data, PLAN, lambda what, done, n: None)

    def _observed(self, name: str) -> tuple[Any, Any]:
        method = method_of(name).fitting(self.data.sensor_size(setting="another field"))
        return method, observe(method, self.data)

    def learnt(self, way: str, rows: Ints, held: Ints, seed: int) -> Learnt:
        """Learn from some recordings, and decide on others."""
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
    """The training by gradients that makes `STEPS` steps, as near as whole epochs allow."""
    words = PLAN.as_words() | {"epochs": round(STEPS / math.ceil(recordings / BATCH)), "seed": seed} | changes
    return TrainingPlan(**words)


def showings_epochs(recordings: int) -> int:
    """Epochs in which ReMuS is shown `SHOWINGS` recordings, as near as whole epochs allow."""
    return max(1, round(SHOWINGS / recordings))


def split(data: Recordings, per_class: int, draw: int) -> tuple[Ints, Ints]:
    """Recordings to learn from and those held back; a draw's smaller sets are part of its larger ones."""
    pool, held = data.folds(FOLDS, seed=draw)[0]
    order = np.random.default_rng([draw, 17]).permutation(pool)
    if per_class == ALL:
        return np.sort(order), held
    chosen = [order[data.labels[order] == label][:per_class] for label in range(len(data.classes))]
    return np.concatenate(chosen), held


def lines(file: Path) -> list[dict[str, Any]]:
    """What is measured; a line that a kill cut off is none."""
    found = []
    for text in file.read_text("utf-8").splitlines() if file.exists() else ():
        try:
            found.append(json.loads(text))
        except ValueError:
            continue
    return found


def measured(bench: Bench, file: Path, draws: int, ways: tuple[str, ...]) -> list[dict[str, Any]]:
    """All lines, those that were missing measured now, draw by draw."""
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
    """Size, draw and way of each training: those of all recordings, which take longest, come last."""
    for some in (SIZES[:-1], SIZES[-1:]):
        for draw in range(draws):
            yield from ((size, draw, way) for size in some for way in ways if way != "remus_long" or size in LONG)


def _cut(file: Path) -> bool:
    """Whether the last line has no end."""
    return file.stat().st_size > 0 and not file.read_bytes().endswith(b"\n")


def spread(shares: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Mean, lowest and highest of the draws: of three, an interval by Student's t would tell little more."""
    return float(shares.mean()), float(shares.min()), float(shares.max())


def points(found: list[dict[str, Any]], way: str) -> Iterator[tuple[int, float, float, float, float]]:
    """Of each size: recordings a class on the mean, mean accuracy, its lowest and its highest, CPU s."""
    for size in SIZES:
        some = [one for one in found if one["way"] == way and one["per_class"] == size]
        if some:
            shares = np.array([one["right"] / one["tested"] for one in some])
            spent = float(np.mean([one["cpu_s"] for one in some]))
            yield round(some[0]["recordings"] / 10), *spread(shares), spent


def drawn(found: list[dict[str, Any]]) -> Figure:
    """Accuracy against recordings a class, a line for each way of learning."""
    figure = Figure(figsize=(8.0, 4.6), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    axis.set_facecolor(PAPER)
    for place, (way, (name, colour)) in enumerate(WAYS.items()):
        at = np.array(list(points(found, way)))
        if len(at):
            shift = 1.0 + 0.02 * (place - 1.5)  # bars beside each other
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
    """A table of all ways and sizes."""
    columns = ("way", *(f">{size or 'all'} a class" for size in SIZES))
    rows = []
    for way in WAYS:
        cells = [word(*values) for _, *values in points(found, way)]
        rows.append((WAYS[way][0], *cells, *[""] * (len(SIZES) - len(cells))))
    return table(columns, rows, title=title)


def priced(bench: Bench, steps: int) -> dict[str, Any]:
    """What learning and deciding take on Loihi: of ReMuS a recording, of the drone's network a control step.

    The host writes the weights of ReMuS; the drone's network learns by the chip's own learning engine.
    """
    rows, held = split(bench.data, PER_CLASS, 0)
    method, shown = bench.remus
    return {"drone": of_drone(steps), "remus": of_remus(method, shown.take(rows), shown.take(held[:TESTED]), 0)}


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
    return {"learning": _flown(model, True), "deciding": _flown(model, False)}


def _flown(model: Model, learns: bool) -> dict[str, Any]:
    start = Start((0.0, 0.0))
    env = Flights(model.scenario, [reset_arguments(start)])
    loop = model.loop(env, learns=learns, block=ENDLESS)
    lap = fly_lap(loop, env, start, learns)
    env.close()
    return in_words(loop.sim.energy("loihi").per(lap.steps, "control step")) | {"error_px": lap.error_px}


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


def main() -> None:
    """Measure, print and draw."""
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
