"""Claims of the thesis on ReMuS: `python benchmarks/remus_claims.py CLAIM nmnist|poker|digits6789`.

- fields: accuracy by the side of the receptive field (figure 49), with 8 grids and rescue, with the same and a
  threshold in proportion to the inputs of a field, and with the rule of the preset `adapted` and two grids
- dropout: accuracy by dropout and its decay, with the rule of `adapted`
- rates: punishment as strong as reward (line 2444), with the rule of `adapted` and with 8 grids
- unsupervised: every decision is rewarded, whatever the label (section 6.2.5). Then grids get the label of the frames
  that they win, or a linear machine reads their potentials.

On `nmnist` 300 recordings are learnt and 300 tested, on the others four folds are learnt and the fifth is tested. No
setting was chosen on `digits6789`, 240 recordings. The script prints mean and deviation of the seeds and draws them.
`--set` changes settings of all trainings. FOLDER/CLAIM-DATA/ has a file for each seed, and no seed is repeated.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from kept import NMNIST, POKER, markdown
from matplotlib.figure import Figure

import neuro
from neuro.apps import JobResults, grid, make_folder, provenance, write_picture
from neuro.cli.options import assignments
from neuro.events import recordings
from neuro_recognise.method import Course, choose
from neuro_recognise.methods import method_of
from neuro_recognise.methods.frame_networks import ADAPTED, Remus, features_of
from neuro_recognise.methods.framewise import RemusLayer
from neuro_recognise.observations import code_of, observe
from neuro_recognise.parts.readouts import Svm
from neuro_recognise.shown import Features, Ints

RESULTS = JobResults("a result of remus_claims.py", "remus claims 1")
FILES = {"nmnist": NMNIST, "poker": POKER, "digits6789": NMNIST.with_name("nmnist_extra_6789_train240_bin.zip")}
UNLABELLED = {"wrong": 1.0, "rescue": False, "epsilon": 0.0}
EQUAL, SCALED, LARGEST = {"Ap_minus": -0.075}, "threshold in proportion", 11
CASES: dict[str, dict[str, dict[str, Any]]] = {
    "fields": {
        f"{side} x {side}{also}": {"field": side} | values
        for also, values in (("", {}), (", scaled", {SCALED: True}), (", two grids", ADAPTED))
        for side in (5, 7, 9, 11)
    },
    "dropout": {
        f"{dropout:g}, decay {decay:g}": ADAPTED | {"dropout": dropout, "decay": decay}
        for dropout, decay in ((0.0, 1.0), (0.25, 0.7), (0.25, 1.0), (0.5, 0.7), (0.5, 1.0))
    },
    "rates": {
        f"{name}{also}": values | rates
        for also, values in ((", two grids", ADAPTED), (", 8 grids", {}))
        for name, rates in (("table 3", {}), ("Ap- = -Ar+", EQUAL), ("also Ap+ = -Ar-", EQUAL | {"Ap_plus": 0.025}))
    },
    "unsupervised": {
        "with labels": {},
        "reward always positive": UNLABELLED,
        "without dropout": UNLABELLED | {"dropout": 0.0},
        "weights at first": UNLABELLED | {"Ar_plus": 0.0, "Ar_minus": 0.0},
    },
}


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A training of one seed and its test."""

    method: Remus
    learning: Features
    held: Features
    of: Mapping[str, Any]
    file: Path

    def work(self, report: Callable[[Any], None]) -> dict[str, Any]:
        """Return accuracies by the kind of read-out, and the share of grids that win a frame."""
        learnt = self.method.fit(self.learning, Course(self.of["seed"]))
        sim = self.method.simulation(learnt)
        (winners, of, potentials), (tested, of_held, potentials_held) = (
            self._answers(sim, learnt, shown) for shown in (self.learning, self.held)
        )
        grids, classes = potentials.shape[1], len(self.learning.classes)
        names = neuro.assign_labels(winners, self.learning.labels[of], grids)
        wins = np.zeros((len(self.held), classes))
        decided = np.flatnonzero((tested >= 0) & (names[tested] >= 0))
        np.add.at(wins, (of_held[decided], names[tested[decided]]), 1.0)
        wins[~wins.any(axis=1)] = np.nan
        machine = Svm(C=0.1)
        read = machine.fit(potentials, self.learning.labels, classes, Course(self.of["seed"]))
        scores = {
            "own vote": self.method.answer(learnt, self.held).scores,
            "grids named": wins,
            "linear readout": machine.scores(read, potentials_held),
        }
        shares = {name: float(np.mean(choose(rows) == self.held.labels)) for name, rows in scores.items()}
        shares["grids that win"] = len(np.unique(tested[tested >= 0])) / grids
        report(f"{self.file.stem}: {shares}")
        return {"provenance": provenance(backend="event", seed=self.of["seed"]), "shares": shares}

    def _answers(self, sim: neuro.Simulation, learnt: Any, shown: Features) -> tuple[Ints, Ints, Any]:
        """Return the winning grid of each frame or -1, (frames,), its recording, (frames,), and potentials.

        The potentials have the shape (recordings, grids).
        """
        results, frames = self.method.present(sim, learnt, shown)
        layer, (_, height, width) = self.method.layer, self.method.inputs.shape
        assert isinstance(layer, RemusLayer)
        neurons = (height - layer.field + 1) * (width - layer.field + 1)
        winners = np.where(results.winner < 0, -1, results.winner // neurons)
        return winners, frames.recording, features_of(results, frames, len(shown))


def main() -> None:
    """Train all seeds, print the table and draw the figure."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("claim", choices=CASES)
    options.add_argument("data", choices=FILES)
    options.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options.add_argument("--workers", type=int, default=1)
    asked = options.parse_args()
    data, folder = recordings(FILES[asked.data]), asked.out / f"{asked.claim}-{asked.data}"
    make_folder(folder)
    base = method_of("remus", "poker" if asked.data == "poker" else "", {"size": (34, 34), **assignments(asked.set)})
    assert isinstance(base, Remus)
    shown, fingerprint, jobs = observe(base, data), data.fingerprint()[:32], []
    for seed in range(asked.seeds):
        for name, values in CASES[asked.claim].items():
            method = base.changed({word: value for word, value in values.items() if word != SCALED})
            if SCALED in values:
                share = method.layer.as_words()["field"] ** 2 / LARGEST**2
                method = method.changed({"theta": base.layer.as_words()["theta"] * share})
            if asked.data == "nmnist":
                order = np.random.default_rng([seed, 49]).permutation(len(data))
                parts = order[:300], order[300:600]
            else:
                parts = data.folds(5, seed=seed)[0]
            of = {"settings": method.as_words(), "code": code_of(method), "data": fingerprint, "seed": seed}
            file = folder / f"{name.replace(' ', '_').replace(',', '')}-{seed}.json"
            jobs.append(Trial(method, *map(shown.take, parts), of, file))
    found = [one["shares"] for one in grid(RESULTS, jobs, asked.workers, lambda told: told and print(told, flush=True))]
    cases = CASES[asked.claim]
    table = {name: found[k :: len(cases)] for k, name in enumerate(cases)}
    reads = list(found[0])
    rows = [
        (name, *(f"{np.mean(each):.1f} ± {np.std(each, ddof=1):.1f}" for each in columns(shares, reads)))
        for name, shares in table.items()
    ]
    print(markdown((asked.claim, *reads), rows))
    write_picture(folder.with_suffix(".png"), drawn(table, reads[:1] if asked.claim != "unsupervised" else reads[:3]))


def columns(shares: list[dict[str, float]], reads: list[str]) -> list[list[float]]:
    """Return the percentages of all seeds, by read-out."""
    return [[100 * one[read] for one in shares] for read in reads]


def drawn(table: Mapping[str, list[dict[str, float]]], reads: list[str]) -> Figure:
    """Draw a dot for each seed, and a bar for the mean."""
    figure = Figure(figsize=(7.2, 3.4), dpi=140, layout="constrained")
    axis = figure.subplots()
    for k, read in enumerate(reads):
        means = [np.mean(columns(shares, [read])) for shares in table.values()]
        for x, shares in enumerate(table.values()):
            axis.plot([x + 0.12 * k] * len(shares), *columns(shares, [read]), "o", color=f"C{k}", ms=4, alpha=0.5)
        axis.plot(np.arange(len(table)) + 0.12 * k, means, "_", color=f"C{k}", ms=18, mew=2.5, label=f"{read}, mean")
    axis.set(ylim=(0, 105), ylabel="held-out recordings right, %")
    axis.set_xticks(range(len(table)), list(table), fontsize=8, rotation=25, ha="right", rotation_mode="anchor")
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(axis="y", alpha=0.3)
    figure.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=8)
    return figure


if __name__ == "__main__":
    main()
