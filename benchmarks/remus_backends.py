"""Microseconds of a frame of ReMuS on backends, in turn: `python benchmarks/remus_backends.py --settings thesis|best`.

The frames of some N-MNIST recordings are shown to one network on each backend, learning and not. Processor time of one
thread, the least of several rounds, in which the backends take turns; prints it beside that of the first backend.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from pathlib import Path

import numpy as np
from remus_folds import FIELD, FILES, SHARED

import neuro
from neuro.events import recordings
from neuro_recognise.methods.remus import Remus
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import Frames


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=SHARED / FILES["nmnist"], help="recordings")
    options.add_argument("--settings", choices=("best", "thesis"), default="best")
    options.add_argument("--every", type=int, default=10, help="show every so-manieth recording")
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--backends", nargs="+", default=["event", "loihi"])
    asked = options.parse_args()
    warnings.simplefilter("ignore", neuro.ApproximationWarning)
    method = Remus().preset(asked.settings).fitting(FIELD)
    shown = observe(method, recordings(asked.data)[:: asked.every])
    frames = Frames.of(shown)
    net = method.layer.network(method.inputs, len(shown.classes))
    sims = {backend: neuro.compile(net, backend=backend, seed=0) for backend in asked.backends}
    times = method.encoder.times(frames.codes, method.encoder.learn(frames.codes))
    labels = np.asarray(shown.labels)[frames.recording]
    for learn in (True, False):
        took: dict[str, list[float]] = {backend: [] for backend in sims}
        for _ in range(asked.rounds):
            for backend, sim in sims.items():
                began = time.process_time()
                sim.trials(times, frames.ids, frames.offsets, labels, learn=learn)
                took[backend].append((time.process_time() - began) / len(frames) * 1e6)
        least = {backend: min(each) for backend, each in took.items()}
        first = least[asked.backends[0]]
        ratios = {backend: round(each / first, 2) for backend, each in least.items()}
        us = {backend: round(each, 1) for backend, each in least.items()}
        print(json.dumps({"learn": learn, "frames": len(frames), "us_a_frame": us, "times_the_first": ratios}))


if __name__ == "__main__":
    main()
