"""Accuracy against joules on Loihi of networks from `neuro train --search`, beside ReMuS.

python benchmarks/train_front.py FOLDER/front.csv --out docs/how-to/train_front.png
"""

import argparse
import csv
from pathlib import Path

from matplotlib.figure import Figure

from neuro.apps import wilson, write_picture
from neuro_train.telling import logarithmic

REMUS = ((149.0, 217), (175.0, 218), (210.0, 224), (477.0, 220), (548.0, 224))
"""Microjoules, and right decisions of 250 held-out recordings, after two epochs: docs/how-to/tune.md."""
WHOLE = (471.0, 914)
"""Microjoules, and right decisions of 1000 in five folds, after eight epochs: docs/reference/recognisers.md."""


def figure(rows):
    """Draw all points of a search, its front on the held-out recordings, and ReMuS."""
    made = Figure(figsize=(7.0, 4.2), dpi=150, layout="constrained")
    axis = made.subplots()
    axis.spines[["top", "right"]].set_visible(False)
    spent, judged = ([float(row[name]) for row in rows] for name in ("microjoules", "accuracy"))
    axis.plot(spent, [100.0 * share for share in judged], "o", color="0.7", markersize=4, label="judged in the search")
    front = [row for row in rows if row["held_out"]]
    held = [(float(row["held_out_microjoules"]), int(row["held_out_right"]), int(row["held_out"])) for row in front]
    drawn(axis, held, "D", "#0072B2", "its front, learnt anew, held out")
    drawn(axis, [(*each, 250) for each in REMUS], "s", "#D55E00", "ReMuS, two epochs, held out")
    drawn(axis, [(*WHOLE, 1000)], "*", "#D55E00", "ReMuS, eight epochs, five folds")
    logarithmic(axis)
    axis.set_xlabel("microjoules of a recording on Loihi, as fast as the chip can")
    axis.set_ylabel("right decisions, %")
    axis.legend(frameon=False, fontsize="small", loc="lower right")
    return made


def drawn(axis, points, mark, colour, label):
    """Draw points with their 95 % intervals."""
    share = [100.0 * right / n for _, right, n in points]
    ends = [[100.0 * end for end in wilson(right, n)] for _, right, n in points]
    below, above = ([abs(at - end[k]) for at, end in zip(share, ends, strict=True)] for k in (0, 1))
    x = [joules for joules, _, _ in points]
    axis.errorbar(
        x, share, yerr=(below, above), fmt=mark, color=colour, label=label, markersize=6, linewidth=1.0, capsize=2
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    words = parser.parse_args()
    with words.table.open(encoding="utf-8", newline="") as opened:
        write_picture(words.out, figure(list(csv.DictReader(opened))))
