"""Pictures of how well something is recognised."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from neuro_recognise.evaluate import Evaluation, wilson

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


def accuracies(found: Sequence[tuple[str, Sequence[Evaluation]]]) -> Figure:
    """Accuracy of each method, a dot a seed, over the 95 % interval of the mean; the best at the top.

    Args:
        found: names with an evaluation for each seed.
    """
    ordered = sorted(found, key=lambda pair: np.mean([one.accuracy for one in pair[1]]))
    figure = Figure(figsize=(7.6, 0.9 + 0.36 * len(ordered)), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    for row, (_, each) in enumerate(ordered):
        shares = [one.accuracy for one in each]
        low, high = wilson(round(float(np.mean(shares)) * each[0].n), each[0].n)
        axis.plot([100 * low, 100 * high], [row, row], color="#cfe3f1", lw=9, solid_capstyle="butt", zorder=1)
        axis.plot(100 * np.array(shares), np.full(len(shares), row), "o", color=BLUE, ms=5, zorder=2)
        axis.annotate(
            f"{100 * np.mean(shares):.1f}", (100 * high, row), (5, 0), textcoords="offset points", va="center",
            color=INK, fontsize=9,
        )  # fmt: skip
    axis.set_yticks(range(len(ordered)), [name for name, _ in ordered])
    axis.set_xlim(right=min(axis.get_xlim()[1] + 2.0, 104.0))
    axis.set_ylim(-0.6, len(ordered) - 0.4)
    axis.tick_params(colors=INK, length=0)
    axis.set_xlabel("recordings decided rightly, %", color=INK)
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.grid(axis="x", color="#e9ecf1", linewidth=0.8)
    axis.set_axisbelow(True)
    return figure
