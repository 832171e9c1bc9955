"""Accuracy of ReMuS against seen ms, on frames and on surfaces: `python benchmarks/remus_early.py`.

Surfaces allow decisions before the first frame. The script uses one fold of the training recordings of N-MNIST. A
network that has learnt from the frames of MSD decides on frames and on surfaces. `--own` adds a network that has learnt
from surfaces, which takes five times as long.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from kept import NMNIST

from neuro.apps import console, table
from neuro.events import Recordings, recordings
from neuro_recognise.method import Method, choose
from neuro_recognise.recogniser import Recogniser, fit, method_of
from neuro_recognise.shown import unlabelled

TIMES_MS = (20, 30, 50, 80, 100, 140, 200, 300)
AT_ONCE = 25


def main() -> None:
    """Measure all cases and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST)
    options.add_argument("--epochs", type=int, default=3)
    options.add_argument("--train", type=int, default=800, help="recordings of the other folds, at most")
    options.add_argument("--own", action="store_true", help="also teach a network on surfaces")
    asked = options.parse_args()
    data = recordings(asked.data, part="Train")
    others, held = data.folds(5, seed=0)[0]
    learning = data.take(np.sort(np.random.default_rng(0).permutation(others)[: asked.train]))
    rows = list(measured(learning, data.take(held), asked.epochs, asked.own))
    heads = ("read", *(f">{ms} ms" for ms in TIMES_MS), ">ms a moment")
    console().print(table(heads, rows, title=f"right of {len(held)}, after {asked.epochs} epochs of {len(learning)}"))


def measured(learning: Recordings, held: Recordings, epochs: int, own: bool) -> Iterator[tuple[str, ...]]:
    """Yield a row for each case."""
    early = method_of("remus", "early", {"epochs": epochs})
    made = fit(learning, method_of("remus", values={"epochs": epochs}))
    yield "MSD's frames", *accuracies(made, held)
    for name in ("leaky", "surface"):
        yield f"its network on {name}", *accuracies(made.changed(looks(early) | {"representation": name}), held)
    if own:
        yield "a network of leaky", *accuracies(fit(learning, early), held)


def looks(method: Method) -> dict[str, object]:
    """Return the settings by which a method turns recordings into frames or surfaces."""
    return {name: getattr(method, name) for name in ("segmenter", "representation")}


def accuracies(made: Recogniser, held: Recordings) -> Iterator[str]:
    """Yield the share of right decisions at each time, and the duration of a decision, as texts."""
    right, began = np.zeros(len(TIMES_MS)), time.process_time()
    ask = made.method.asker(made.learnt)
    for first in range(0, len(held), AT_ONCE):
        part = held[first : first + AT_ONCE]
        times = [1000 * ms for ms in TIMES_MS]
        evidence = [one for item in part for one in made.method.observe_until(item.load(), times)]
        decided = choose(ask(unlabelled(evidence, made.classes)).scores).reshape(len(part), -1)
        right += (decided == held.labels[first : first + AT_ONCE, None]).sum(axis=0)
    spent = time.process_time() - began
    yield from (f"{share:.1%}" for share in right / len(held))
    yield f"{1000 * spent / len(held) / len(TIMES_MS):.1f}"


if __name__ == "__main__":
    main()
