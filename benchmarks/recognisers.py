"""Accuracy of a method: `python benchmarks/recognisers.py nmnist|poker|poker-upright|mnist|natural METHOD`.

`--preset` and `--set` have the same meaning as in `neuro recognise train`. On POKER-DVS, ReMuS has its preset for it.

The training recordings are divided into stratified folds, anew for each of `--seeds`. Each fold is tested after
learning from the other folds. `--random N` instead makes N random splits into 900 recordings to learn from and 100 to
test. The script prints the accuracy by each vote for each seed or split, mean, deviation and interval, and CPU seconds.
`--backend loihi` trains and tests with 8-bit weights. `natural` has 120 crops of scikit-learn's two photographs, which
are the classes.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from kept import NMNIST, POKER, SHARED
from numpy.typing import NDArray

from neuro.apps import side_by_side, wilson
from neuro.cli.options import assignments
from neuro.events import Recordings, recordings
from neuro_recognise.method import Method, choose
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features

FILES = {"nmnist": NMNIST, "poker": POKER, "poker-upright": POKER, "mnist": SHARED / "mnist5k" / "mnist5k.npz"}
PICTURES = ("mnist", "natural")
Split = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Indices of the recordings to learn from, and of the recordings to test."""
FIELD = (34, 34)
"""Size of the pips of POKER-DVS in px, which are crops from a sensor of 128 x 128 px."""


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """Recordings to learn from and others to test, with a seed."""

    shown: Features
    split: Split
    method: Method
    seed: int
    backend: str

    def run(self, report: Callable[[Any], None]) -> tuple[dict[str, NDArray[np.bool_]], float, float]:
        """Return masks of the rightly decided test recordings by vote, and CPU s of learning and of deciding."""
        began, (others, held_out) = time.process_time(), self.split
        made = learn(self.method, self.shown.take(others), "fold", seed=self.seed, backend=self.backend)
        learnt, part = time.process_time(), self.shown.take(held_out)
        answer = self.method.answer(made.learnt, part, self.backend)
        right = {vote: choose(scores) == part.labels for vote, scores in {"own": answer.scores, **answer.votes}.items()}
        return right, learnt - began, time.process_time() - learnt


def splits(data: Recordings, folds: int, seeds: int, random: int, only: int) -> dict[int, list[Split]]:
    """Return the splits of each seed."""
    if not random:
        return {seed: data.folds(folds, seed=seed)[: only or folds] for seed in range(seeds)}
    orders = {seed: np.random.default_rng([seed, 14]).permutation(len(data)) for seed in range(random)}
    return {seed: [(order[100:], order[:100])] for seed, order in orders.items()}


def crops() -> Path:
    """Return the path of crops of a temple and of a flower, side by side.

    A crop has 32 x 32 px, each the mean of 2 x 2 px of a photograph. It fades to black outwards, because filters would
    respond most to edges of the crop that are not black.
    """
    from sklearn.datasets import load_sample_images

    fade = np.outer(window := np.hanning(32), window)
    images = []
    for photograph in load_sample_images().images:
        grey = photograph[:384].mean(axis=2).reshape(6, 32, 2, 10, 32, 2).mean(axis=(2, 5))
        images += [np.round(grey[row, :, column] * fade) for row in range(6) for column in range(10)]
    path = Path(tempfile.mkdtemp()) / "crops.npz"
    np.savez(path, images=np.array(images, np.uint8), labels=np.repeat([0, 1], 60))
    return path


def main() -> None:
    """Measure all splits and print the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("case", choices=[*FILES, "natural"])
    options.add_argument("method", help="see 'neuro recognise list'")
    options.add_argument("--data", type=Path, help="recordings, if not those of ../shared")
    options.add_argument("--preset", default="", help="a preset of the method")
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--seeds", type=int, default=1)
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--only", type=int, default=0, metavar="N", help="the first N folds of each seed; 0: all")
    options.add_argument("--random", type=int, default=0, metavar="N", help="so many random splits, no folds")
    options.add_argument("--backend", default="event", help="trains and tests")
    options.add_argument("--json", action="store_true")
    asked = options.parse_args()
    method = method_of(asked.method, asked.preset)
    poker = method.presets["poker"] if asked.method == "remus" and asked.case.startswith("poker") else {}
    data = recordings(asked.data or (crops() if asked.case == "natural" else FILES[asked.case]))
    field = data.sensor_size() if asked.case in PICTURES else FIELD
    method = method.changed({**poker, **assignments(asked.set)}).fitting(field)
    shown = observe(method, data)
    upright = np.array([not Path(name).stem.endswith("i") for name in shown.names])
    if asked.case == "poker-upright":
        kept = np.flatnonzero(upright)
        data, shown, upright = data.take(kept), shown.take(kept), upright[kept]
    parts = splits(data, asked.folds, asked.seeds, asked.random, asked.only)
    jobs = [Fold(shown, split, method, seed, asked.backend) for seed, folds in parts.items() for split in folds]
    found = side_by_side(Fold.run, jobs)
    tested = [np.concatenate([job.split[1] for job in jobs if job.seed == seed]) for seed in parts]
    report: dict[str, Any] = {word: getattr(asked, word) for word in ("case", "method", "preset", "set", "backend")}
    report |= {"recordings": len(shown), "folds": asked.folds, "seeds": len(parts)}
    report["learn_s"] = sum(spent for _, spent, _ in found) / len(jobs)
    report["decide_ms"] = 1e3 * sum(spent for *_, spent in found) / sum(map(len, tested))
    for vote in found[0][0]:
        right = [
            np.concatenate([told[vote] for job, (told, *_) in zip(jobs, found, strict=True) if job.seed == seed])
            for seed in parts
        ]
        every, only = np.concatenate(right), upright[np.concatenate(tested)]
        mean, of_seeds = float(every.mean()), [float(one.mean()) for one in right]
        low, high = wilson(round(mean * len(right[0])), len(right[0]))
        report[vote] = {"mean": mean, "of_seeds": of_seeds, "interval": [low, high]}
        report[vote]["mean_of_upright"] = float(every[only].mean())
        if not asked.json:
            text = f"by {vote}: {mean:.2%} ± {np.std(of_seeds):.2%} (95 % interval {low:.1%} - {high:.1%}), each "
            text += ", ".join(f"{one:.2%}" for one in of_seeds)
            print(text if only.all() else f"{text}; of the upright ones {every[only].mean():.2%}")
    if asked.json:
        print(json.dumps(report, indent=1))
    else:
        print(f"learning {report['learn_s']:.1f} s, deciding {report['decide_ms']:.1f} ms a recording")


if __name__ == "__main__":
    main()
