"""How well HOTS recognises: `python benchmarks/hots_splits.py nmnist|poker|poker-upright`.

N-MNIST: random splits of the 1000 training recordings into 900 to learn from and 100 to test on; POKER-DVS: 5 folds.
Prints accuracies by each readout of the last layer's histogram: the paper's distances from class means, a linear
support vector machine, and one on histograms of cells. `--inside` tests on a part of the first training split alone:
for choosing settings.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neuro.cli.options import assignments
from neuro.events import Events, Recordings, recordings
from neuro_recognise.hots.hierarchy import Hots, Layers
from neuro_recognise.parts.histograms import DISTANCES, class_means

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
POKER = "poker_dvs/poker_dvs_shared_aedat2.zip"
FILES = {"nmnist": "nmnist/nmnist_train1000_bin.zip", "poker": POKER, "poker-upright": POKER}
SIZES = {"nmnist": (34, 34), "poker": (35, 35), "poker-upright": (35, 35)}
"""Fields, px; recordings of POKER tell the camera's 128x128, of which pips are cut out."""
Ints = NDArray[np.int64]


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("case", choices=FILES)
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="settings of the hierarchy")
    options.add_argument("--seeds", type=int, default=3, help="splits of N-MNIST, repetitions of POKER's folds")
    options.add_argument("--learn", type=int, default=200, help="recordings that prototypes are learnt from")
    options.add_argument("--cell", type=int, default=7, help="side of the cells, px")
    options.add_argument("--C", type=float, default=0.01, help="of the support vector machines")
    options.add_argument("--inside", action="store_true", help="stay inside the first training split")
    asked = options.parse_args()
    found = recordings(SHARED / FILES[asked.case])
    if asked.case == "poker-upright":
        found = found.take([k for k, item in enumerate(found) if not Path(item.name).stem.endswith("i")])
    events = [item.load() for item in found]
    rows = []
    for seed, (learn, test) in enumerate(splits(found, asked.case, asked.seeds, asked.inside)):
        rows.append(measured(events, found, learn, test, seed, asked))
        print(", ".join(f"{name} {value:.4g}" for name, value in rows[-1].items()), flush=True)
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        print(f"{name}: {values.mean():.4g} +- {values.std():.2g}")


def splits(found: Recordings, case: str, seeds: int, inside: bool) -> Iterator[tuple[Ints, Ints]]:
    """Indices to learn from and to test on."""
    if inside:
        learn, _ = next(splits(found, case, 1, inside=False))
        within = found.take(learn)
        for a, b in within.folds(5, seed=99)[: 1 if case == "nmnist" else 5]:
            yield learn[a], learn[b]
        return
    for seed in range(seeds):
        if case == "nmnist":
            order = np.random.default_rng(seed).permutation(len(found))
            yield np.sort(order[100:]), np.sort(order[:100])
        else:
            yield from found.folds(5, seed=seed)


def measured(
    events: list[Events], found: Recordings, learn: Ints, test: Ints, seed: int, asked: argparse.Namespace
) -> dict[str, float]:
    """Accuracy by each readout, and processor times."""
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import LinearSVC

    layers = Layers(Hots(**assignments(asked.set)), SIZES[asked.case], seed=seed)
    order = np.random.default_rng(seed).permutation(learn)[: asked.learn]
    began = time.process_time()
    layers.learn([events[k] for k in order])
    trained = time.process_time() - began
    began = time.process_time()
    cells = np.array([layers.features(one, cell=asked.cell).ravel() for one in events], np.float64)
    took = (time.process_time() - began) / len(events) * 1e3
    counts = cells.reshape(len(events), -1, layers.centres[-1].shape[-1]).sum(axis=1)
    labels = found.labels
    means = class_means(counts[learn], labels[learn], len(found.classes))
    right = {
        name: float((distance(counts[test], means).argmin(axis=1) == labels[test]).mean())
        for name, distance in DISTANCES.items()
    }
    for name, x in (("svm", counts), ("svm of cells", cells)):
        shares = np.sqrt(x / np.maximum(x.sum(axis=1, keepdims=True), 1))
        machine = make_pipeline(StandardScaler(), LinearSVC(C=asked.C, random_state=0, max_iter=5000))
        machine.fit(shares[learn], labels[learn])
        right[name] = float(machine.score(shares[test], labels[test]))
    return right | {"ms": took, "train s": trained}


if __name__ == "__main__":
    main()
