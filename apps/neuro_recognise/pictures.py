"""Pictures of how well something is recognised."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from neuro_recognise.evaluate import Evaluation

INK, PAPER, GREY, BLUE, ORANGE = "#17263c", "#ffffff", "#8a94a3", "#0072B2", "#D55E00"
SHADES = LinearSegmentedColormap.from_list("blue", (PAPER, "#cfe3f1", BLUE, "#08304f"))


def confusion(evaluation: Evaluation, by: str = "") -> Figure:
    """Recordings by class and decision; shades are shares of a class, and each cell tells its number."""
    table = evaluation.confusion
    silence = bool(table[:, -1].any())
    table = table if silence else table[:, :-1]
    share = table / np.maximum(evaluation.confusion.sum(axis=1, keepdims=True), 1)
    names = [*evaluation.classes, *(["silent"] if silence else [])]
    side = 1.6 + 0.46 * len(evaluation.classes)
    figure = Figure(figsize=(side + 0.3, side + 0.55), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    axis.imshow(share, cmap=SHADES, vmin=0.0, vmax=1.0)
    for i, j in np.argwhere(table > 0):
        axis.text(j, i, str(table[i, j]), ha="center", va="center", fontsize=9.5,
                  color=PAPER if share[i, j] > 0.5 else (INK if i == j else ORANGE))  # fmt: skip
    axis.set_xticks(range(len(names)), names)
    axis.set_yticks(range(len(evaluation.classes)), evaluation.classes)
    axis.set_xticks(np.arange(len(names) + 1) - 0.5, minor=True)
    axis.set_yticks(np.arange(len(evaluation.classes) + 1) - 0.5, minor=True)
    axis.grid(which="minor", color="#e4e8ee", linewidth=0.8)
    axis.tick_params(which="both", length=0, colors=INK)
    axis.spines[:].set_visible(False)
    axis.set_xlabel("decided", color=INK)
    axis.set_ylabel("shown", color=INK)
    low, high = evaluation.interval
    told = f" by {by}" if by else ""
    axis.set_title(
        f"{evaluation.accuracy:.1%} of {evaluation.n} right{told}\n", loc="left", fontsize=12.5, color=INK, pad=8
    )
    axis.text(0, 1.02, f"95 % interval {low:.1%} to {high:.1%}", transform=axis.transAxes, fontsize=9.5, color=GREY)
    return figure
