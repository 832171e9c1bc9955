"""Accuracy against the ms that were seen, and when to stop: `python benchmarks/recognise_time.py --out FOLDER`.

Each recording is decided on by what was learnt of the other folds, at each moment (`learn_early`). Stopping rules come
from one half of the recordings and are measured on the other. What is done is kept in the folder, so the same command
goes on after a kill; then it writes `accuracy.png` there. `--method "hats readout=svm"` measures one, with settings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from neuro import ModelError
from neuro.apps import Checkpoint, assignments, console, make_folder, table, write_picture
from neuro.events import Recordings, recordings
from neuro_recognise.learn_early import learn_early
from neuro_recognise.method import METHODS
from neuro_recognise.pictures import GREY, INK, PAPER
from neuro_recognise.recogniser import Recogniser, method_of, settled
from neuro_recognise.stopping import Held, stopped, stopping_rule

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
NMNIST = SHARED / "nmnist" / "nmnist_train1000_bin.zip"
TIMES_MS = (10, 20, 30, 50, 80, 100, 140, 200, 300)
ALLOWED = (0.05, 0.07, 0.1, 0.125, 0.15)
HALVES = 20
"""Random halves over which stopping is averaged."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7b4fb3", "#17263c", "#8a94a3", "#b8860b")


def main() -> None:
    """Measure, print and draw."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--part", default="Train")
    options.add_argument("--method", action="append", metavar="'NAME SETTING=VALUE ...'", help="all if not given")
    options.add_argument("--every", type=float, default=10.0, help="ms")
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--out", type=Path, required=True)
    asked = options.parse_args()
    make_folder(asked.out)
    data = recordings(asked.data, part=asked.part)
    found = {}
    for case in asked.method or default_cases():
        found[case] = measured(case, data, asked)
        print(f"{case}: {found[case].right[:, -1].mean():.1%} at the end", flush=True)
    show(found)
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


def show(found: dict[str, Held]) -> None:
    """Print accuracy against time, and error and time of stopping."""
    out = console()
    rows = [(case, *(f"{accuracy(held, ms):.1%}" for ms in TIMES_MS)) for case, held in found.items()]
    out.print(table(("method", *(f">{ms} ms" for ms in TIMES_MS)), rows, title="right after"))
    rows = [(case, *(stopping(held, allowed) for allowed in ALLOWED)) for case, held in found.items()]
    heads = (f">allowed {allowed:.1%}" for allowed in ALLOWED)
    out.print(
        table(("method", *heads), rows, title=f"wrong, at a mean time: rules of one half on the other, {HALVES} x")
    )


def accuracy(held: Held, ms: float) -> float:
    """Share of right decisions at the last moment up to a time."""
    moment = max(0, int(np.searchsorted(held.times_us, 1000 * ms, "right")) - 1)
    return float(held.right[:, moment].mean())


def stopping(held: Held, allowed: float) -> str:
    """Error and time of rules, each learnt from one half of the recordings and measured on the other."""
    rng, errors, times = np.random.default_rng(0), [], []
    for _ in range(HALVES):
        order = rng.permutation(len(held.right))
        learnt, tried = (part(held, order[half]) for half in (slice(None, None, 2), slice(1, None, 2)))
        try:
            rule = stopping_rule(learnt, allowed)
        except ModelError:
            return "cannot"
        wrong = np.array(
            [[learnt.error(t, m) for t, m in zip(held.times_us, row, strict=True)] for row in tried.margins]
        )
        at = stopped(tried, wrong, rule.level)
        errors.append(1.0 - tried.right[np.arange(len(at)), at].mean())
        times.append(held.times_us[at].mean() / 1000)
    return f"{np.mean(errors):.1%} at {np.mean(times):.0f} ms"


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
