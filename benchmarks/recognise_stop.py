"""When to stop for an allowed error: `python benchmarks/recognise_stop.py --out FOLDER`.

Networks, beginnings and rules are learnt from nine tenths of the recordings (`Recordings.folds`), and tried on the
rest, which had no say in anything. The other figures are of nine tenths of these nine tenths on the last
(`stopping.outcome`). What is done is kept in the folder, so the same command goes on after a kill.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from recognise_time import EVERY_MS, FOLDS, NMNIST, place, prepared, scores_of

from neuro import ModelError
from neuro.apps import console, make_folder, table
from neuro.events import Recordings, recordings
from neuro_recognise.deciding.held import Held, margins
from neuro_recognise.deciding.learn_early import learn_early
from neuro_recognise.deciding.stopping import outcome, stopped, stopping_rule, upper_bound
from neuro_recognise.method import choose
from neuro_recognise.recogniser import Recogniser

CASES = ("hats readout=ridge", "remus epochs=3")
ALLOWED = (0.075, 0.085, 0.1, 0.125, 0.15)
ASSURANCES = (0.5, 0.9)


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--method", action="append", metavar="'NAME SETTING=VALUE ...'", help="HATS and ReMuS if none")
    options.add_argument("--every", type=float, default=EVERY_MS, help="ms; of networks")
    options.add_argument("--folds", type=int, default=5, help="of those to learn from; of networks")
    options.add_argument("--out", type=Path, required=True)
    asked = options.parse_args()
    make_folder(asked.out)
    data = recordings(asked.data, part="Train")
    learning, tried = (data.take(rows) for rows in data.folds(FOLDS, seed=0)[0])
    for case in asked.method or CASES:
        made = prepared(case, learning, asked.out)
        if made.early is None:
            file = asked.out / f"{place(case)}.h5"
            made = learn_early(made, learning, every_ms=asked.every, folds=asked.folds, out=file)
        assert made.early is not None
        held = made.early.held
        seen = seen_of(made, tried, asked.out / f"{place(case)}-tried.npz")
        heads = ("allowed", ">assurance", ">wrong", ">95 % interval", ">after", f">wrong of {len(held)}", ">after")
        console().print(table(heads, list(rows(held, seen)), title=f"{case}, tried on {len(seen)} recordings"))


def seen_of(made: Recogniser, tried: Recordings, file: Path) -> Held:
    """What is decided of recordings at each moment, from a file or found now."""
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


def rows(held: Held, seen: Held) -> Iterator[tuple[str, ...]]:
    """A row for each allowed error and assurance: rules of some recordings on others."""
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


if __name__ == "__main__":
    main()
