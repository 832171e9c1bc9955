"""Accuracy against the ms that were seen, and when to stop: `python benchmarks/recognise_time.py --out FOLDER`.

Each recording is decided on by what was learnt of the other folds, at each moment (`learn_early`). Stopping rules come
from nine tenths of the recordings and are measured on the rest (`--rules 2`: halves). What is done is kept in the
folder, so the same command goes on after a kill; then it writes `accuracy.png` there.
`--method "hats readout=svm"` measures one, with settings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from neuro import ModelError
from neuro.apps import Checkpoint, assignments, console, make_folder, table, write_picture
from neuro.events import Recordings, recordings
from neuro_recognise.deciding.learn_early import learn_early
from neuro_recognise.deciding.stopping import Held, stopped, stopping_rule
from neuro_recognise.method import METHODS
from neuro_recognise.recogniser import Recogniser, method_of, settled
from neuro_recognise.telling.pictures import GREY, INK, PAPER

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
NMNIST = SHARED / "nmnist" / "nmnist_train1000_bin.zip"
TIMES_MS = (10, 20, 30, 50, 80, 100, 140, 200, 300)
ALLOWED = (0.05, 0.06, 0.07, 0.075, 0.1, 0.125, 0.15)
TIMES = 3
"""Random cuts over which stopping is averaged."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7b4fb3", "#17263c", "#8a94a3", "#b8860b")


def main() -> None:
    """Measure, print and draw."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--part", default="Train")
    options.add_argument("--method", action="append", metavar="'NAME SETTING=VALUE ...'", help="all if not given")
    options.add_argument("--every", type=float, default=10.0, help="ms")
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--rules", type=int, default=10, help="parts, each measured with a rule of the others")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--out", type=Path, required=True)
    asked = options.parse_args()
    make_folder(asked.out)
    data = recordings(asked.data, part=asked.part)
    found = {}
    for case in asked.method or default_cases():
        found[case] = measured(case, data, asked)
        print(f"{case}: {found[case].right[:, -1].mean():.1%} at the end", flush=True)
    show(found, asked.rules)
    write_picture(asked.out / "accuracy.png", drawn(found, len(data), asked.folds))


def default_cases() -> list[str]:
    """All methods; least squares where a support vector machine would be trained at every moment."""
    return [f"{name} readout=ridge" if METHODS[name].by_moment else name for name in METHODS]


def measured(case: str, data: Recordings, asked: argparse.Namespace) -> Held:
    """The held-out decisions of a method, from the folder or computed now."""
    told = f"{case} {asked.every:g} {asked.folds} {asked.seed} {data.fingerprint()}"
    file = asked.out / f"{case.replace(' ', ',').replace('/', '-')}.npz"
    if file.exists():
        with np.load(file) as kept:
            if str(kept["told"]) == told:
                return Held(kept["times_us"], kept["margins"], kept["right"])
    name, *settings = case.split()
    method = settled(method_of(name, values=assignments(settings)), data)
    recogniser = Recogniser(method, data.classes, {}, {"seed": asked.seed})
    checkpoint = Checkpoint(file, "neuro recognise time 1", {"case": told})
    made = learn_early(recogniser, data, every_ms=asked.every, folds=asked.folds, checkpoint=checkpoint)
    held = made.early.held
    np.savez(file, told=told, times_us=held.times_us, margins=held.margins, right=held.right)
    checkpoint.remove()
    return held


def show(found: dict[str, Held], parts: int) -> None:
    """Print accuracy against time, and error and time of stopping."""
    out = console()
    rows = [(case, *(f"{accuracy(held, ms):.1%}" for ms in TIMES_MS)) for case, held in found.items()]
    out.print(table(("method", *(f">{ms} ms" for ms in TIMES_MS)), rows, title="right after"))
    rows = [(case, *(stopping(held, allowed, parts) for allowed in ALLOWED)) for case, held in found.items()]
    heads = (f">allowed {allowed:.1%}" for allowed in ALLOWED)
    told = f"wrong, at a mean time: each of {parts} parts by rules of the others, {TIMES} times"
    out.print(table(("method", *heads), rows, title=told))


def accuracy(held: Held, ms: float) -> float:
    """Share of right decisions at the last moment up to a time."""
    moment = max(0, int(np.searchsorted(held.times_us, 1000 * ms, "right")) - 1)
    return float(held.right[:, moment].mean())


def stopping(held: Held, allowed: float, parts: int) -> str:
    """Error and time of rules, each learnt from some of the recordings and measured on the others."""
    rng, n = np.random.default_rng(0), len(held.right)
    wrong, times, refused = [], [], 0
    for k in range(TIMES * parts):
        if k % parts == 0:
            order = rng.permutation(n)
        tried = order[k % parts :: parts]
        learnt, rest = part(held, np.setdiff1d(order, tried)), part(held, tried)
        try:
            level = stopping_rule(learnt, allowed).level
        except ModelError:  # wrong more often even at the end: the others are decided at theirs
            level, refused = -1.0, refused + 1
        at = stopped(learnt.errors(rest.margins), level)
        wrong += (~rest.right[np.arange(len(at)), at]).tolist()
        times += (held.times_us[at] / 1000).tolist()
    if refused > TIMES * parts / 2:
        return "cannot"
    return f"{np.mean(wrong):.1%} at {np.mean(times):.0f} ms" + (f" ({refused} cannot)" if refused else "")


def part(held: Held, chosen: np.ndarray) -> Held:
    """Some of the recordings."""
    return Held(held.times_us, held.margins[chosen], held.right[chosen])


def drawn(found: dict[str, Held], n: int, folds: int) -> Figure:
    """Accuracy along time, a line for each method."""
    figure = Figure(figsize=(8.4, 4.8), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    for colour, (case, held) in zip(COLOURS, found.items(), strict=False):
        axis.plot(held.times_us / 1000, 100 * held.right.mean(axis=0), color=colour, linewidth=2, label=case)
    axis.set_xlabel("seen, ms", color=INK)
    axis.set_ylabel("right, %", color=INK)
    axis.set_ylim(0, 100)
    axis.set_xlim(left=0)
    axis.grid(color="#e4e8ee", linewidth=0.8)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    axis.legend(frameon=False, loc="lower right", labelcolor=INK)
    axis.set_title(f"Decided after the first ms of {n} recordings", loc="left", color=INK, fontsize=12.5)
    axis.text(1, 1.01, f"{folds} folds", transform=axis.transAxes, ha="right", fontsize=9.5, color=GREY)
    return figure


if __name__ == "__main__":
    main()
