"""Predicted and measured weights of ReMuS: `python benchmarks/weight_drift.py --split 1 --set theta=30`.

ReMuS (`--preset adapted`, changed by `--set`) learns from 300 recordings of N-MNIST and is tested on 300 others. The
shares of trials that change a weight are counted in blocks of 1000 trials. The last weights are predicted from the
first weights and these shares alone. For each `--epsilon` the script prints the share of right decisions, the share of
weights at the bound, the deviation of the prediction, and the epsilon above which the mean weight rises with the shares
of the first 1000 trials. `--table` trains five settings and ends with the largest deviation.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from kept import NMNIST

import neuro
from neuro.cli.options import assignments
from neuro.events import recordings
from neuro_doctor.drift import drift_of, shares_of
from neuro_recognise.method import choose
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.methods.framewise import Labelled, to_text
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import Frames
from neuro_recognise.recogniser import method_of
from neuro_recognise.shown import Features

LEARNT, BLOCK, NAME = 300, 1000, "c1_s2"
TABLE: tuple[tuple[int, dict[str, Any]], ...] = (
    (0, {}),
    (1, {"theta": 30.0}),
    (1, {"per_class": 4}),
    (1, {"Ar_plus": 0.05, "Ar_minus": -0.02, "Ap_plus": 0.01, "Ap_minus": -0.05}),
    (2, {"field": 9, "theta": 40.0, "ties_after": True}),
)
"""Splits and settings of the table in docs/explanation/recognisers.md."""


def measured(method: Remus, train: Features, test: Features, seed: int) -> list[float]:
    """Return the share of right decisions, the share of weights at the bound, the deviation, and the epsilon."""
    frames, layer = Frames.of(train), method.layer
    assert isinstance(layer, Labelled)
    net = layer.network(method.inputs, len(train.classes))
    rule = net.projections[NAME].synapse
    assert isinstance(rule, neuro.r_stdp)
    codes, sim = method.encoder.learn(frames.codes), neuro.compile(net, seed=seed)
    predicted, limit = np.asarray(sim.weights(NAME)), np.nan
    for epoch in range(method.epochs):
        place = np.empty(len(train), np.int64)
        place[np.random.default_rng([seed, epoch]).permutation(len(train))] = np.arange(len(train))
        turn = np.argsort(place[frames.recording], kind="stable")
        for first in range(0, len(turn), BLOCK):
            batch, weight = frames.take(turn[first : first + BLOCK]), np.asarray(sim.weights(NAME))
            labels = train.labels[batch.recording]
            shown = method.encoder.times(batch.codes, codes), batch.ids, batch.offsets, labels
            results = sim.trials(*shown, learn=True, samples=batch.recording, epoch=epoch)
            sim.forget(before=sim.time)
            shares = shares_of(sim, NAME, *shown, results)
            drift = drift_of(rule, shares)
            predicted = drift.after(predicted, len(results))
            if np.isnan(limit):
                limit = float(-np.mean(drift.push * weight * (1.0 - weight)) / shares.grown.mean())
    last = np.asarray(sim.weights(NAME))
    answer = method.answer({NAME: last, "network": to_text(net), "seed": np.array(seed), **codes}, test)
    right = float(np.mean(choose(answer.votes["majority"]) == test.labels))
    return [right, float(np.mean(last > 0.99)), float(np.sqrt(np.mean((predicted - last) ** 2))), limit]


def main() -> None:
    """Measure all settings and print the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--split", type=int, default=0, help="draws the recordings; also the seed")
    options.add_argument("--epsilon", type=float, nargs="+", default=[0.0002])
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--table", action="store_true", help="five settings, in place of those asked for")
    asked = options.parse_args()
    data, deviations = recordings(NMNIST), []
    method = method_of("remus", "adapted").changed(assignments(asked.set)).fitting((34, 34))
    shown = observe(method, data)
    cases = TABLE if asked.table else [(asked.split, {"epsilon": epsilon}) for epsilon in asked.epsilon]
    for split, values in cases:
        order = np.random.default_rng([57, 4, split]).permutation(len(data))
        parts = [shown.take(order[first : first + LEARNT]) for first in (0, LEARNT)]
        changed = method.changed(values).fitting((34, 34))
        assert isinstance(changed, Remus)
        right, bound, deviation, limit = measured(changed, parts[0], parts[1], split)
        deviations.append(deviation)
        text = f"split {split}, {values}: {right:.1%} right, {bound:.1%} at the bound, predicted within {deviation:.1%}"
        print(f"{text} rms; after {BLOCK} trials weights rise above epsilon {limit:.2g}", flush=True)
    print(f"largest deviation {max(deviations):.1%}")


if __name__ == "__main__":
    main()
