"""Pictures of docs/reference/recognisers.md: `python benchmarks/recognise_figures.py N-MNIST POKER`.

The arguments are folders of `neuro recognise compare`, whose commands that page names. Draws the accuracies of all
methods, and confusion matrices beside those of the thesis' figures 85 (BOE without and with TAR) and 86 (TAR-HATS).
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from neuro.apps import write_picture
from neuro.events import Recordings, recordings
from neuro_recognise.evaluate import Evaluation, evaluate
from neuro_recognise.telling.pictures import INK, ORANGE, PAPER, SHADES, accuracies

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
NMNIST, POKER = DATA / "nmnist" / "nmnist_train1000_bin.zip", DATA / "poker_dvs" / "poker_dvs_shared_aedat2.zip"
MATRICES = {"boe": "BOE", "boe-tar": "BOE behind TAR", "tar_hats": "TAR-HATS"}


def main() -> None:
    """Draw all."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("nmnist", type=Path, help="folder of N-MNIST's comparison")
    options.add_argument("poker", type=Path, help="folder of POKER-DVS'")
    asked = options.parse_args()
    digits, pips = found(asked.nmnist, recordings(NMNIST)), found(asked.poker, recordings(POKER))
    folder = ROOT / "docs" / "reference"
    write_picture(folder / "recognisers_nmnist.png", accuracies(list(digits.items())))
    write_picture(folder / "recognisers_poker.png", accuracies(list(pips.items())))
    write_picture(folder / "recognisers_confusion.png", matrices({name: digits[name][0] for name in MATRICES}))


def found(folder: Path, data: Recordings) -> dict[str, list[Evaluation]]:
    """Of each method in a folder an evaluation a seed, of all recordings that were tested."""
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
    """Confusion matrices beside each other, in percent of each class."""
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
