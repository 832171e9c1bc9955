"""How well ReMuS recognises: `python benchmarks/remus_folds.py nmnist|poker|poker-upright --settings thesis|best`.

Stratified folds of the recordings to train on; each fold is tested with what was learnt from the others. Prints the
accuracy by each vote for each seed, and the mean of all. `--backend loihi` trains and tests with 8-bit weights.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.apps import side_by_side
from neuro.cli.options import assignments
from neuro.events import recordings
from neuro_recognise.evaluate import wilson
from neuro_recognise.method import choose
from neuro_recognise.methods.remus import Remus
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import VOTES
from neuro_recognise.recogniser import learn
from neuro_recognise.shown import Features

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
POKER = "poker_dvs/poker_dvs_shared_aedat2.zip"
FILES = {"nmnist": "nmnist/nmnist_train1000_bin.zip", "poker": POKER, "poker-upright": POKER}
Split = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Recordings to learn from, and to test."""
FIELD = (34, 34)
"""px; the pips are crops from a sensor of 128 x 128 px."""


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """Recordings to learn from and others to test, with a seed."""

    shown: Features
    split: Split
    method: Remus
    seed: int
    backend: str

    def run(self, report: Callable[[Any], None]) -> tuple[dict[str, NDArray[np.bool_]], float]:
        """Which of the others are decided rightly, by each vote; and CPU, s."""
        began, (others, held_out) = time.process_time(), self.split
        made = learn(self.method, self.shown.take(others), "fold", seed=self.seed, backend=self.backend)
        part = self.shown.take(held_out)
        votes = self.method.answer(made.learnt, part, self.backend).votes
        right = {vote: choose(scores) == part.labels for vote, scores in votes.items()}
        return right, time.process_time() - began


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("case", choices=FILES)
    options.add_argument("--data", type=Path, help="recordings, if not those of ../shared")
    options.add_argument("--settings", choices=("best", "thesis"), default="best")
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--backend", default="event", help="trains and tests")
    options.add_argument("--json", action="store_true")
    asked = options.parse_args()
    poker = Remus.presets["poker"] if asked.case.startswith("poker") else {}
    method = Remus().preset(asked.settings).changed({**poker, **assignments(asked.set)}).fitting(FIELD)
    data = recordings(asked.data or SHARED / FILES[asked.case])
    shown = observe(method, data)
    upright = np.array([not Path(name).stem.endswith("i") for name in shown.names])
    if asked.case == "poker-upright":
        kept = np.flatnonzero(upright)
        data, shown, upright = data.take(kept), shown.take(kept), upright[kept]
    parts = {seed: data.folds(asked.folds, seed=seed) for seed in range(asked.seeds)}
    jobs = [Fold(shown, split, method, seed, asked.backend) for seed, folds in parts.items() for split in folds]
    found = side_by_side(Fold.run, jobs)
    right = [{vote: np.zeros(len(shown), bool) for vote in VOTES} for _ in parts]
    for job, (of_votes, _) in zip(jobs, found, strict=True):
        for vote, decided in of_votes.items():
            right[job.seed][vote][job.split[1]] = decided
    for seed in parts if not asked.json else ():
        print(f"seed {seed}: " + ", ".join(f"{v} {r.mean():.2%}" for v, r in right[seed].items()))
    report = {"case": asked.case, "settings": asked.settings, "set": asked.set, "recordings": len(shown)}
    report |= {"backend": asked.backend, "folds": asked.folds, "seeds": asked.seeds}
    report |= {"cpu_s": round(sum(cpu_s for _, cpu_s in found), 1)}
    for vote in VOTES:
        all_of_them = np.array([found[vote] for found in right])
        low, high = wilson(round(all_of_them.mean() * len(shown)), len(shown))
        report[vote] = {
            "mean": all_of_them.mean(),
            "of_seeds": all_of_them.mean(axis=1).tolist(),
            "interval": [low, high],
            "mean_of_upright": all_of_them[:, upright].mean(),
        }
        if not asked.json:
            mean, only = all_of_them.mean(), all_of_them[:, upright].mean()
            text = f"mean of {asked.seeds} seeds by {vote}: {mean:.2%} (95 % interval {low:.1%} - {high:.1%})"
            print(text if upright.all() else f"{text}, of the upright ones {only:.2%}")
    if asked.json:
        print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
