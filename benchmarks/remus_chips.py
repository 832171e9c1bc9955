"""Decisions of chips beside the float simulator: `python benchmarks/remus_chips.py --preset adapted|best`.

A network learns on `event`. Then the same network with the same weights decides recordings on each backend. With
`--folds 5` each recording is decided by a network that has not learnt from it. The script prints the share of frames
with the same label and winner, the share of recordings with the same decision by each vote, the accuracy and the time.

`--times 5` instead prints the microseconds of a frame with and without learning. This is the processor time of one
thread on a tenth of the recordings, the least of 5 rounds in which the backends take turns. Beside it is its ratio to
the time of the first backend.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from kept import NMNIST
from recognisers import FIELD, Split

import neuro
from neuro.cli.options import assignments
from neuro.events import recordings
from neuro_recognise.method import choose
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import VOTES, Frames, votes
from neuro_recognise.recogniser import Recogniser, learn
from neuro_recognise.shown import Features

BACKENDS = ["event", "loihi", "spinnaker"]
"""Backends, of which the first is the reference of the others."""

FRAMES = ("frame_label", "frame_winner", "frame_step")
Found = dict[str, np.ndarray[Any, Any]]


def main() -> None:
    """Measure all backends and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=NMNIST, help="recordings")
    options.add_argument("--preset", choices=("best", "adapted"), default="best")
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--folds", type=int, default=1, help="1: show what was learnt from")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--times", type=int, default=0, metavar="ROUNDS", help="only time frames, in turn")
    options.add_argument("--backends", nargs="+", default=BACKENDS)
    options.add_argument("--json", action="store_true")
    asked = options.parse_args()
    warnings.simplefilter("ignore", neuro.ApproximationWarning)
    method = Remus().preset(asked.preset).changed(assignments(asked.set)).fitting(FIELD)
    data = recordings(asked.data)
    if asked.times:
        time_frames(method, observe(method, data[::10]), asked.backends, asked.times)
        return
    shown = observe(method, data)
    folds = data.folds(asked.folds, seed=asked.seed) if asked.folds > 1 else []
    found: dict[str, list[Found]] = {backend: [] for backend in asked.backends}
    for made, part in models(shown, folds, method, asked.seed):
        for backend in asked.backends:
            found[backend].append(decided(made, part, backend))
    report = {"settings": asked.preset, "recordings": len(shown), "frames": len(Frames.of(shown))}
    report |= {"folds": asked.folds}
    rows = {backend: compared(joined(found[backend]), joined(found[asked.backends[0]])) for backend in asked.backends}
    for backend, row in rows.items():
        learning = method.changed({"epochs": 1})
        row["learn_ms_a_frame"] = 1e3 * learning_time(shown, learning, backend)
        if not asked.json:
            print(f"{backend:10}" + ", ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
    if asked.json:
        print(json.dumps(report | {"backends": rows}, indent=1))


def time_frames(method: Remus, shown: Features, backends: list[str], rounds: int) -> None:
    """Print the microseconds of a frame on each backend."""
    frames = Frames.of(shown)
    net = method.layer.network(method.inputs, len(shown.classes))
    sims = {backend: neuro.compile(net, backend=backend, seed=0) for backend in backends}
    times = method.encoder.times(frames.codes, method.encoder.learn(frames.codes))
    labels = np.asarray(shown.labels)[frames.recording]
    for learns in (True, False):
        took: dict[str, list[float]] = {backend: [] for backend in sims}
        for _ in range(rounds):
            for backend, sim in sims.items():
                began = time.process_time()
                sim.trials(times, frames.ids, frames.offsets, labels, learn=learns)
                took[backend].append((time.process_time() - began) / len(frames) * 1e6)
        least = {backend: min(each) for backend, each in took.items()}
        ratios = {backend: round(each / least[backends[0]], 2) for backend, each in least.items()}
        us = {backend: round(each, 1) for backend, each in least.items()}
        print(json.dumps({"learn": learns, "frames": len(frames), "us_a_frame": us, "times_the_first": ratios}))


def models(shown: Features, folds: list[Split], method: Remus, seed: int) -> Iterator[tuple[Recogniser, Features]]:
    """Yield recognisers, each with the recordings that it decides."""
    if not folds:
        yield learn(method, shown, "all", seed=seed), shown
        return
    for k, (others, held_out) in enumerate(folds):
        yield learn(method, shown.take(others), f"fold {k}", seed=seed), shown.take(held_out)


def decided(made: Recogniser, shown: Features, backend: str) -> Found:
    """Return the decisions of a backend: label, winner and step of frames, and votes of recordings with right votes."""
    method = made.method
    assert isinstance(method, Remus)
    sim = method.simulation(made.learnt, backend)
    method.present(sim, made.learnt, shown.take([0]))  # compiles
    began = time.process_time()
    trials, frames = method.present(sim, made.learnt, shown)
    seconds = time.process_time() - began
    by = votes(trials, frames.recording, len(shown), len(shown.classes))
    found = dict(zip(FRAMES, (trials.label, trials.winner, trials.step), strict=True))
    found |= {vote: choose(by[vote]) for vote in VOTES}
    found |= {f"{vote}_right": choose(by[vote]) == shown.labels for vote in VOTES}
    return found | {"seconds": np.array([seconds])}


def joined(parts: list[Found]) -> Found:
    """Return the joined decisions of several models."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def compared(mine: Found, first: Found) -> dict[str, float]:
    """Return the shares of equal decisions, the accuracies, and the time of a frame."""
    same = {f"same_{name}": float(np.mean(mine[name] == first[name])) for name in (*FRAMES, *VOTES)}
    right = {f"{vote}_accuracy": float(mine[f"{vote}_right"].mean()) for vote in VOTES}
    return same | right | {"decide_ms_a_frame": 1e3 * float(mine["seconds"].sum()) / len(mine["frame_label"])}


def learning_time(shown: Features, method: Remus, backend: str) -> float:
    """Return the processor time of a frame in one epoch of learning in s, over a fifth of the recordings."""
    part = shown.take(range(0, len(shown), 5))
    learn(method, part.take(range(2)), "two", backend=backend)  # compiles
    began = time.process_time()
    learn(method, part, "a fifth", backend=backend)
    return (time.process_time() - began) / len(Frames.of(part))


if __name__ == "__main__":
    main()
