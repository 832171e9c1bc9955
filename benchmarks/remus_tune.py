"""Tuning of ReMuS in folds: right decisions against joules on Loihi, by threshold and grids.

    neuro tune run benchmarks/remus_tune.yaml --out FOLDER --with benchmarks/remus_tune.py --workers 1
    neuro tune test FOLDER --with benchmarks/remus_tune.py --workers 1
    neuro tune plot FOLDER

A quarter of the recordings is held out first, and the others are divided into folds. A trial learns from all folds but
one, and is tested on that fold. Only `neuro tune test` decides the held-out quarter, after learning from all others.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import neuro
from neuro.events import recordings
from neuro_recognise.energy import price
from neuro_recognise.method import choose
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.observations import observe
from neuro_recognise.recogniser import learn
from neuro_recognise.shown import Features, Ints

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nmnist" / "nmnist_train1000_bin.zip"
HELD_OUT = 4
"""One of `HELD_OUT` recordings is held out."""


@neuro.register(kind="study")
def remus(
    theta: float, per_class: int, field: int, fold: int | None, folds: int, epochs: int = 8, seed: int = 0
) -> dict[str, float]:
    """Train and test ReMuS. Return the share of right decisions, and joules per decision on Loihi at both clocks.

    Args:
        theta: threshold of the grids, mV.
        per_class: number of grids of each class.
        field: side of their receptive field, cells.
        fold: index of the tested fold; None to test the held-out recordings.
        folds: number of folds of the other recordings.
        epochs: number of times that each recording to learn from is shown.
        seed: seed of the learning.
    """
    values = {"theta": theta, "per_class": per_class, "field": field, "epochs": epochs}
    method = Remus().changed(values).fitting((34, 34))
    train, test = divided(fold, folds)
    shown = evidence()
    made = learn(method, shown.take(train), f"fold {fold}", seed=seed)
    part = shown.take(test)
    answer = method.answer(made.learnt, part)
    assert answer.run is not None
    bill = price(answer.run(), len(part), ["loihi"], duration_s=answer.duration_s).bills["loihi"]
    right = float((choose(answer.scores) == part.labels).mean())
    joules = {"loihi_uJ": 1e6 * bill.total_j, "loihi_real_time_mJ": 1e3 * bill.real_time.total_j}
    return {"accuracy": right, **joules, "recordings": len(part)}


def divided(fold: int | None, folds: int) -> tuple[Ints, Ints]:
    """Return the indices of the recordings to learn from, and of the recordings to decide."""
    inside, held_out = recordings(DATA).folds(HELD_OUT, seed=0)[0]
    if fold is None:
        return inside, held_out
    train, test = recordings(DATA).take(inside).folds(folds, seed=1)[fold]
    return inside[train], inside[test]


@cache
def evidence() -> Features:
    """Return the features of the recordings, which do not depend on the tuned settings."""
    return observe(Remus().fitting((34, 34)), recordings(DATA))
