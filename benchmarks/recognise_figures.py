"""Pictures of docs/reference/recognisers.md: `python benchmarks/recognise_figures.py [N-MNIST POKER]`.

The script draws the accuracies of all methods. benchmarks/measured/recognisers.json has the right decisions of each
seed. The arguments are folders of `neuro recognise compare`; the page has the commands. The decisions in these folders
about all recordings are counted and stored first. Confusion matrices are drawn beside figures 85 (BOE without and with
TAR) and 86 (TAR-HATS) of the thesis. `conv`, `dense`, `learnt_delays` and `recurrent` on N-MNIST come from `neuro train
--folds 5`. The first two have seeds 1 to 3, the last two one seed. docs/reference/learning.md has their folds.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from kept import NMNIST, POKER
from matplotlib.figure import Figure

from neuro.apps import Evaluation, evaluate, write_picture
from neuro.events import Recordings, recordings
from neuro_recognise.telling.pictures import INK, ORANGE, PAPER, SHADES, accuracies

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "benchmarks" / "measured" / "recognisers.json"
MATRICES = {"boe": "BOE", "boe-tar": "BOE behind TAR", "tar_hats": "TAR-HATS"}


class Right(NamedTuple):
    """Number of right decisions of one seed, and number of recordings."""

    right: int
    n: int

    @property
    def accuracy(self) -> float:
        """Share of right decisions."""
        return self.right / self.n


def main() -> None:
    """Draw all pictures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folders", type=Path, nargs="*", help="of N-MNIST's and of POKER-DVS' comparison")
    asked = options.parse_args()
    folder = ROOT / "docs" / "reference"
    if asked.folders:
        nmnist, poker = asked.folders
        digits, pips = found(nmnist, recordings(NMNIST)), found(poker, recordings(POKER))
        keep({"N-MNIST": digits, "POKER-DVS": pips})
        write_picture(folder / "recognisers_confusion.png", matrices({name: digits[name][0] for name in MATRICES}))
    for data, file in (("N-MNIST", "recognisers_nmnist.png"), ("POKER-DVS", "recognisers_poker.png")):
        write_picture(folder / file, accuracies(list(kept(data).items())))


def keep(counted: Mapping[str, Mapping[str, Sequence[Evaluation]]]) -> None:
    """Store the right decisions of methods that were tested on all recordings."""
    told = json.loads(KEPT.read_text())
    for data, methods in counted.items():
        every = told[data]["recordings"]
        whole = {name: each for name, each in methods.items() if all(one.n == every for one in each)}
        told[data]["right"] |= {name: [one.correct for one in each] for name, each in whole.items()}
    KEPT.write_text(json.dumps(told, indent=1) + "\n")


def kept(data: str) -> dict[str, list[Right]]:
    """Return the stored right decisions of each seed, by method."""
    told = json.loads(KEPT.read_text())[data]
    return {name: [Right(right, told["recordings"]) for right in each] for name, each in told["right"].items()}


def found(folder: Path, data: Recordings) -> dict[str, list[Evaluation]]:
    """Return an evaluation for each seed over all tested recordings, by method of a folder."""
    decided: dict[tuple[str, int], dict[int, int]] = defaultdict(dict)
    for file in sorted(folder.glob("*.json")):
        name, seed, _ = file.stem.rsplit("-", 2)
        kept = json.loads(file.read_text())
        decided[name, int(seed)].update(zip(kept["tested"], kept["decided"], strict=True))
    each: dict[str, list[Evaluation]] = defaultdict(list)
    for (name, _), one in decided.items():
        tested = np.array(sorted(one))
        each[name.removesuffix("-poker")].append(
            evaluate(np.array([one[k] for k in tested]), data.labels[tested], data.classes)
        )
    return each


def matrices(shown: dict[str, Evaluation]) -> Figure:
    """Draw confusion matrices beside each other, in percent of each class."""
    figure = Figure(figsize=(4.3 * len(shown), 4.8), dpi=120, layout="tight", facecolor=PAPER)
    for axis, (name, one) in zip(figure.subplots(1, len(shown)), shown.items(), strict=True):
        table = one.confusion[:, : len(one.classes)]
        share = 100 * table / one.confusion.sum(axis=1, keepdims=True)
        axis.imshow(share, cmap=SHADES, vmin=0, vmax=100)
        for i, j in np.argwhere(share >= 0.5):
            colour = PAPER if share[i, j] > 50 else INK if i == j else ORANGE
            axis.text(j, i, f"{share[i, j]:.0f}", ha="center", va="center", fontsize=8.5, color=colour)
        axis.set_title(f"{MATRICES[name]}: {one.accuracy:.1%}", loc="left", fontsize=12, color=INK)
        axis.set(xticks=range(len(one.classes)), yticks=range(len(one.classes)), xlabel="decided", ylabel="shown")
        axis.set_xticklabels(one.classes), axis.set_yticklabels(one.classes)
        axis.tick_params(length=0, colors=INK)
        axis.spines[:].set_visible(False)
    return figure


if __name__ == "__main__":
    main()
