"""Accuracy of what learnt from few recordings: `python benchmarks/few_recordings.py --out FOLDER`.

Each draw holds a fifth of the recordings back, the same for all ways of learning, and of the others takes the first 1,
5, 10 and 30 of each class, then all. Gradients make the same number of steps of learning however few recordings there
are; ReMuS is shown each recording 8 times, and, as a row of its own, as often as makes the same number of showings.

FOLDER/accuracy.jsonl has a line for each training; what is there is not done again. Then it prints tables and draws
FOLDER/few_recordings.png. `few_recordings_joules.py` says what learning takes.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.figure import Figure

import neuro
from neuro.apps import console, make_folder, table, write_picture
from neuro.events import Recordings, recordings
from neuro_models import path as network_path
from neuro_recognise.method import choose
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn, method_of
from neuro_train import trainer
from neuro_train.data import show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import by_module

Ints = npt.NDArray[np.int64]

NMNIST = Path(__file__).resolve().parents[2] / "shared" / "data" / "nmnist" / "nmnist_train1000_bin.zip"
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


def main() -> None:
    """Measure, print and draw."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--draws", type=int, default=3)
    options.add_argument("--way", action="append", choices=WAYS, help="all if not given")
    asked = options.parse_args()
    torch.set_num_threads(1)
    make_folder(asked.out)
    bench = Bench(recordings(asked.data, part="Train"))
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
