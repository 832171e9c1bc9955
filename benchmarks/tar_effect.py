"""Effect of TAR on the accuracy of a classifier: `python benchmarks/tar_effect.py nmnist|poker`.

The thesis (B.2) reports for a bag of events (BOE) with a linear support vector classifier: N-MNIST, 1000 samples to
learn and 400 to test, 0.830 without and 0.8525 with TAR(0.08 s, 2.4, R = 1), which removes 3.3 % of the events; POKER
0.944 and 1.0 with TAR(0.08 s, 2, R = 2), which removes 1 %. This script uses
stratified folds with several seeds. Each recording is decided with and without TAR by classifiers that learnt from the
same other recordings. The parameters of TAR and all other settings were fixed before, as in the thesis.

BOE (thesis 6.1.3, eqs 117-118): a motion symbol detector cuts a recording into segments. The feature of a pixel is the
share of the events of a segment at this pixel, times log(n / n_i), if n_i of the n training segments have an event
there. The thesis prints -log(n / n_i), which is negative. The classifier decides each segment. A recording is decided
by the sum of the decision values of its segments. The script requires scikit-learn.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recognisers import FILES, Split
from scipy.sparse import csr_matrix, vstack
from scipy.stats import binomtest, t as student
from sklearn.svm import LinearSVC

from neuro.events import Events, msd_segments, recordings
from neuro.events.filters import TAR

PARAMETERS = {"nmnist": {"tau": 0.08, "theta": 2.4, "radius": 1}, "poker": {"tau": 0.08, "theta": 2.0, "radius": 2}}
TAU, THRESHOLD = 0.02, 150.0
"""Time constant (s) and threshold (events) of the motion symbol detector; thesis table 3."""

Bags = list[csr_matrix]


def main() -> None:
    """Measure all seeds and print the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("case", choices=PARAMETERS)
    options.add_argument("--data", type=Path, help="recordings, if not those of ../shared")
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--folds", type=int, default=5)
    options.add_argument("--tau", type=float, help="of TAR, s; the thesis' if not given, as theta and radius")
    options.add_argument("--theta", type=float, help="of TAR, events")
    options.add_argument("--radius", type=int, help="of TAR, px")
    options.add_argument("--svm", type=float, default=1.0, help="C of the classifier")
    asked = options.parse_args()
    found = recordings(asked.data or FILES[asked.case])
    labels = np.array([one.label for one in found])
    plain = [one.load() for one in found]
    size = (max(int(one.x.max()) for one in plain) + 1, max(int(one.y.max()) for one in plain) + 1)
    plain = [Events(one.t, one.x, one.y, one.p, size) for one in plain]
    given = {name: getattr(asked, name) for name in ("tau", "theta", "radius") if getattr(asked, name) is not None}
    tar = TAR(size, **(PARAMETERS[asked.case] | given))
    filtered = [tar.apply(one) for one in plain]
    removed = 1.0 - sum(map(len, filtered)) / sum(map(len, plain))
    print(f"{asked.case}: {len(plain)} recordings, {tar} removes {removed:.2%} of the events")
    bags = [[bag(one) for one in of] for of in (plain, filtered)]
    right = np.zeros((2, asked.seeds, len(labels)), bool)
    for seed in range(asked.seeds):
        folds = found.folds(asked.folds, seed=seed)
        for k in range(2):
            right[k, seed] = cross_validate(bags[k], labels, folds, asked.svm)
        print(f"seed {seed}: without {right[0, seed].mean():.4f}, with {right[1, seed].mean():.4f}", flush=True)
    report(right)


def bag(events: Events) -> csr_matrix:
    """Return the share of events at each pixel for each segment of a recording, (segments, pixels).

    A recording without a complete segment is a single segment.
    """
    bounds = msd_segments(events.t, tau=TAU, threshold=THRESHOLD)
    if len(bounds) == 1:
        bounds = np.array([0, len(events)])
    pixels = events.y.astype(np.int64) * events.sensor_size[0] + events.x
    n, lengths = len(bounds) - 1, np.diff(bounds)
    share = np.repeat(1.0 / np.maximum(lengths, 1), lengths)
    rows = np.repeat(np.arange(n), lengths)
    return csr_matrix((share, (rows, pixels[: bounds[-1]])), shape=(n, events.sensor_size[0] * events.sensor_size[1]))


def cross_validate(bags: Bags, labels: NDArray[np.int64], folds: list[Split], c: float) -> NDArray[np.bool_]:
    """Return a mask of the recordings that are decided rightly after learning from the other folds."""
    right = np.zeros(len(labels), bool)
    for learnt, held_out in folds:
        segments = vstack([bags[i] for i in learnt], format="csr")
        segments.sum_duplicates()
        weight = np.log(segments.shape[0] / np.maximum(1, (segments > 0).sum(axis=0).A1))
        scale = weight / np.sqrt(segments.multiply(weight).power(2).sum() / segments.shape[0])
        machine = LinearSVC(C=c, random_state=0, max_iter=20_000)
        machine.fit(segments.multiply(scale).tocsr(), np.repeat(labels[learnt], [bags[i].shape[0] for i in learnt]))
        for i in held_out:
            votes = machine.decision_function(bags[i].multiply(scale).tocsr()).sum(axis=0)
            right[i] = machine.classes_[votes.argmax()] == labels[i]
    return right


def report(right: NDArray[np.bool_]) -> None:
    """Print the paired difference.

    Args:
        right: True for right decisions, (2, seeds, recordings), first without TAR, then with TAR.
    """
    of_recording = right.mean(axis=1)
    difference = of_recording[1] - of_recording[0]
    n = len(difference)
    half = student.ppf(0.975, n - 1) * difference.std(ddof=1) / np.sqrt(n)
    mean = difference.mean()
    print(f"mean: without {of_recording[0].mean():.4f}, with {of_recording[1].mean():.4f}")
    print(f"difference {mean:+.4f}, 95 % interval over recordings {mean - half:+.4f} to {mean + half:+.4f}")
    for seed in range(right.shape[1]):
        gained = int((right[1, seed] & ~right[0, seed]).sum())
        lost = int((right[0, seed] & ~right[1, seed]).sum())
        p = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        print(f"seed {seed}: {gained} right only with TAR, {lost} only without; McNemar, exact: p = {p:.3f}")


if __name__ == "__main__":
    main()
