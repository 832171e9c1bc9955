"""Accuracy against the seen ms of a recording: `python benchmarks/recognise_time.py --out FOLDER`.

Each method learns from nine tenths of the recordings (`Recordings.folds`), and decides the others from their first ms.
Results are stored in the folder, so the same command continues an interrupted run. At the end the script prints a table
and writes `accuracy.png` to the folder. `--method "hats:poker readout=svm"` measures one method, with a preset and
settings.

`--stop` instead prints when a decision may stop for an allowed error. Networks, beginnings and rules are learnt from
the same nine tenths, and tested on the other recordings, which are not used before. The other figures are for rules
that are learnt from nine tenths of these nine tenths, and tested on the last tenth (`stopping.outcome`).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from kept import NMNIST
from matplotlib.figure import Figure

from neuro import ModelError
from neuro.apps import assignments, console, make_folder, table, write_picture
from neuro.events import Recordings, recordings
from neuro.events.dataset import Sample
from neuro_recognise.deciding import Held, margins, outcome, stopped, stopping_rule, upper_bound
from neuro_recognise.early import learn_early, moments
from neuro_recognise.method import METHODS, Method, choose
from neuro_recognise.recogniser import Recogniser, fit, method_of
from neuro_recognise.shown import Floats, Ints
from neuro_recognise.telling.pictures import GREY, INK, PAPER

EVERY_MS = 10.0
FOLDS = 10
"""Number of folds, of which the first is tested."""
TIMES_MS = (10, 20, 30, 50, 80, 100, 140, 200, 300)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7b4fb3", "#17263c", "#8a94a3", "#b8860b")
DEAR = ("hfirst", "mozafari", "edhmax_tempotron", "hots")
"""Methods that take longest and therefore come last."""
CASES = ("hats readout=ridge", "remus epochs=3")
ALLOWED = (0.075, 0.085, 0.1, 0.125, 0.15)
ASSURANCES = (0.5, 0.9)
"""Methods, allowed errors and assurances of the table of `--stop`."""


def main() -> None:
    """Measure all methods, print the table and draw the figure."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--part", default="Train")
    options.add_argument("--method", action="append", metavar="'NAME SETTING=VALUE ...'", help="all if not given")
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--stop", action="store_true", help="for an allowed error; of HATS and ReMuS if no method")
    options.add_argument("--every", type=float, default=EVERY_MS, help="ms; of networks that are to stop")
    options.add_argument("--folds", type=int, default=5, help="of those to learn from; of networks that are to stop")
    asked = options.parse_args()
    make_folder(asked.out)
    data = recordings(asked.data, part=asked.part)
    learning, held = (data.take(rows) for rows in data.folds(FOLDS, seed=0)[0])
    if asked.stop:
        for case in asked.method or CASES:
            print_rules(case, learning, held, asked)
        return
    times = moments(data, EVERY_MS)
    found = {}
    for case in asked.method or default_cases():
        began = time.process_time()
        found[case] = measured(case, learning, held, times, asked.out)
        print(f"{case}: {found[case][-1]:.1%} at the end, {time.process_time() - began:.0f} s", flush=True)
    at = np.searchsorted(times, 1000 * np.array(TIMES_MS), "right") - 1
    rows = [(case, *(f"{share:.1%}" for share in right[at])) for case, right in found.items()]
    told = f"right of {len(held)} after learning from {len(learning)}"
    console().print(table(("method", *(f">{ms} ms" for ms in TIMES_MS)), rows, title=told))
    write_picture(asked.out / "accuracy.png", drawn(found, times, told))


def print_rules(case: str, learning: Recordings, tried: Recordings, asked: argparse.Namespace) -> None:
    """Print a table of rules that are learnt from some recordings and tested on others."""
    made = prepared(case, learning, asked.out)
    if made.early is None:
        file = asked.out / f"{place(case)}.h5"
        made = learn_early(made, learning, every_ms=asked.every, folds=asked.folds, out=file)
    assert made.early is not None
    held = made.early.held
    seen = seen_of(made, tried, asked.out / f"{place(case)}-tried.npz")
    heads = ("allowed", ">assurance", ">wrong", ">95 % interval", ">after", f">wrong of {len(held)}", ">after")
    console().print(table(heads, list(rules(held, seen)), title=f"{case}, tried on {len(seen)} recordings"))


def default_cases() -> list[str]:
    """Return all methods. Least squares replace a support vector machine that would be trained at every moment."""
    names = sorted(METHODS, key=lambda name: DEAR.index(name) if name in DEAR else -1)
    return [f"{name} readout=ridge" if METHODS[name].by_moment else name for name in names]


def of_case(case: str) -> Method:
    """Return the method of a text such as "hats:poker readout=svm": name, preset and settings."""
    told, *settings = case.split()
    name, _, preset = told.partition(":")
    return method_of(name, preset, assignments(settings))


def prepared(case: str, learning: Recordings, folder: Path) -> Recogniser:
    """Return a trained recogniser, from the folder or trained now, also on beginnings if the method needs them."""
    file = folder / f"{place(case)}.h5"
    made = fit(learning, of_case(case), out=file)
    needs = made.method.by_moment and made.early is None
    return learn_early(made, learning, every_ms=EVERY_MS, out=file) if needs else made


def measured(case: str, learning: Recordings, held: Recordings, times: Ints, folder: Path) -> Floats:
    """Return the share of right decisions at each moment, (moments,), from the folder or measured now."""
    file, told = folder / f"{place(case)}.npz", f"{case} {EVERY_MS:g} {FOLDS} {learning.fingerprint()}"
    if file.exists():
        with np.load(file) as kept:
            if str(kept["told"]) == told:
                return np.array(kept["right"])
    made = prepared(case, learning, folder)
    decided = np.array([choose(scores_of(made, item, times)) for item in held])
    right = (decided == held.labels[:, None]).mean(axis=0)
    np.savez(file, told=told, decided=decided, right=right)
    return np.asarray(right)


def scores_of(made: Recogniser, item: Sample, times: Ints) -> Floats:
    """Return the scores of a recording at each moment, (moments, classes)."""
    return made.scores_at(item.load(), (times / 1000).tolist())


def place(case: str) -> str:
    """Return the name of a case as the name of a file."""
    return case.replace(" ", ",").replace("/", "-").replace(":", "-")


def seen_of(made: Recogniser, tried: Recordings, file: Path) -> Held:
    """Return the decisions about recordings at each moment, from a file or made now."""
    assert made.early is not None
    times = made.early.held.times_us
    if file.exists():
        with np.load(file) as kept:
            scores = kept["scores"]
    else:
        scores = np.array([scores_of(made, item, times) for item in tried])
        np.savez(file, scores=scores)
    chosen = np.array([choose(one) for one in scores])
    return Held(times, margins(scores), chosen == tried.labels[:, None])


def rules(held: Held, seen: Held) -> Iterator[tuple[str, ...]]:
    """Yield a row for each allowed error and assurance. The rules come from `held`, and are tested on `seen`."""
    for allowed in ALLOWED:
        for assurance in ASSURANCES:
            told = f"{allowed:.1%}", f"{assurance:g}"
            try:
                rule = stopping_rule(held, allowed, assurance)
            except ModelError:
                yield (*told, "not supported", "", "", "", "")
                continue
            at = stopped(held.errors(seen.margins), rule.level)
            n, wrong = len(seen), int(np.count_nonzero(~seen.right[np.arange(len(seen)), at]))
            low, high = 1.0 - upper_bound(n - wrong, n, 0.975), upper_bound(wrong, n, 0.975)
            own = outcome(held, allowed, assurance)
            yield (*told, f"{wrong / n:.1%}", f"{low:.1%} to {high:.1%}", f"{held.times_us[at].mean() / 1000:.0f} ms",
                   f"{own.error:.1%}", f"{own.mean_ms:.0f} ms")  # fmt: skip


def drawn(found: dict[str, Floats], times: Ints, told: str) -> Figure:
    """Draw the accuracy over time, with a line for each method."""
    figure = Figure(figsize=(9.6, 4.8), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    best_first = sorted(found.items(), key=lambda one: -one[1][-1])
    for colour, (case, right) in zip(COLOURS, best_first, strict=False):
        axis.plot(times / 1000, 100 * right, color=colour, linewidth=2, label=case)
    axis.set_xlabel("seen, ms", color=INK)
    axis.set_ylabel("right, %", color=INK)
    axis.set_ylim(0, 100)
    axis.set_xlim(left=0)
    axis.grid(color="#e4e8ee", linewidth=0.8)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    axis.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0), labelcolor=INK)
    axis.set_title("Decided after the first ms of a recording", loc="left", color=INK, fontsize=12.5)
    axis.text(1, 1.01, told, transform=axis.transAxes, ha="right", fontsize=9.5, color=GREY)
    return figure


if __name__ == "__main__":
    main()
