"""Pictures of what was learnt and of how it decides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from neuro.apps import literal
from neuro_recognise.evaluate import Evaluation, wilson
from neuro_recognise.shown import Floats

INK, PAPER, TILE, GREY, BLUE, ORANGE = "#17263c", "#ffffff", "#f6f7f9", "#8a94a3", "#0072B2", "#D55E00"
BARS = ("#0072B2", "#009E73", "#D55E00", "#7B4FA3")
SHADES = LinearSegmentedColormap.from_list("blue", (PAPER, "#cfe3f1", BLUE, "#08304f"))
SIGNED = LinearSegmentedColormap.from_list(
    "orange to blue", ("#5a2700", ORANGE, "#f5d9c6", PAPER, "#cfe3f1", BLUE, "#08304f")
)
FAINTEST = 0.08
MOST_COLUMNS = 10
TILE_IN, HEAD_IN, HEADED_IN, LEAST_IN = 1.3, 0.95, 0.25, 4.4


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
    axis.set_xticks(range(len(names)), [literal(name) for name in names])
    axis.set_yticks(range(len(evaluation.classes)), [literal(name) for name in evaluation.classes])
    axis.set_xticks(np.arange(len(names) + 1) - 0.5, minor=True)
    axis.set_yticks(np.arange(len(evaluation.classes) + 1) - 0.5, minor=True)
    axis.grid(which="minor", color="#e4e8ee", linewidth=0.8)
    axis.tick_params(which="both", length=0, colors=INK)
    axis.spines[:].set_visible(False)
    axis.set_xlabel("decided", color=INK)
    axis.set_ylabel("shown", color=INK)
    low, high = evaluation.interval
    message = f" by {literal(by)}" if by else ""
    axis.set_title(
        f"{evaluation.accuracy:.1%} of {evaluation.n} right{message}\n", loc="left", fontsize=12.5, color=INK, pad=8
    )
    axis.text(0, 1.02, f"95 % interval {low:.1%} to {high:.1%}", transform=axis.transAxes, fontsize=9.5, color=GREY)
    return figure


class Rated(Protocol):
    """What an accuracy is: an `Evaluation`, or less."""

    @property
    def accuracy(self) -> float:
        """Share of right decisions."""

    @property
    def n(self) -> int:
        """Of so many."""


def accuracies(found: Sequence[tuple[str, Sequence[Rated]]]) -> Figure:
    """Accuracy of each method, a dot a seed, over the 95 % interval of the mean; the best at the top.

    Args:
        found: names with an accuracy for each seed.
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
            f"{100 * np.mean(shares):.1f}", (100 * max(high, *shares), row), (6, 0), textcoords="offset points",
            va="center", color=INK, fontsize=9,
        )  # fmt: skip
    axis.set_yticks(range(len(ordered)), [literal(name) for name, _ in ordered])
    axis.set_xlim(right=min(axis.get_xlim()[1] + 2.0, 104.0))
    axis.set_ylim(-0.6, len(ordered) - 0.4)
    axis.tick_params(colors=INK, length=0)
    axis.set_xlabel("recordings decided rightly, %", color=INK)
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.grid(axis="x", color="#e9ecf1", linewidth=0.8)
    axis.set_axisbelow(True)
    return figure


def prototypes(kernels: Floats, classes: Sequence[str], orientations: Sequence[float]) -> Figure:
    """The learnt grids, one column a class: at each place of the kernel a bar for each orientation.

    A bar runs as its Gabor filter prefers it, and its opacity is the weight; colours tell orientations apart.

    Args:
        kernels: (maps, orientations, rows, columns) weights; each class has equally many maps, one after the other.
        classes: names.
        orientations: degrees.

    Source: thesis figures 50-52.
    """
    per_class = len(kernels) // len(classes)
    across = min(len(classes), MOST_COLUMNS)
    about = f"{per_class} a class; the opacity of a bar is the weight of its orientation at its place"
    down = -(-len(classes) // across) * per_class
    figure, tiles = _tiled(across, down, "What the grids have learnt", about)
    for k, kernel in enumerate(kernels):
        label, version = divmod(k, per_class)
        axis = tiles[label // across * per_class + version, label % across]
        _bars(axis, kernel, orientations)
        if version == 0:
            axis.set_title(literal(classes[label]), fontsize=15, color=INK, pad=4)
    return figure


def images(drawn: Floats, heads: Sequence[str], title: str, about: str, across: int = MOST_COLUMNS) -> Figure:
    """Pictures beside each other, the darker the larger; each up to its own largest value, negative ones orange.

    Args:
        drawn: (pictures, rows, columns).
        heads: what stands over each; "" for nothing.
        title: of all.
        about: under it, what is seen.
        across: pictures in a row.
    """
    across = min(len(drawn), across)
    figure, tiles = _tiled(across, -(-len(drawn) // across), title, about, HEADED_IN if any(heads) else 0.0)
    axes: list[Axes] = tiles.ravel().tolist()
    for axis, image, head in zip(axes, drawn, heads, strict=False):
        largest = max(float(np.abs(image).max()), 1e-12)
        axis.imshow(image, cmap=SIGNED, vmin=-largest, vmax=largest, interpolation="nearest")
        axis.add_patch(Rectangle((0, 0), 1, 1, transform=axis.transAxes, fill=False, edgecolor="#e4e8ee", lw=0.8))
        axis.set_title(literal(head), fontsize=10, color=INK, pad=3)
    return figure


def _tiled(across: int, down: int, title: str, about: str, between: float = 0.0) -> tuple[Figure, NDArray[np.object_]]:
    """A figure with a title, and its square axes (down, across), `between` inches apart one above the other."""
    high = TILE_IN + between
    figure = Figure(figsize=(max(0.1 + TILE_IN * across, LEAST_IN), HEAD_IN + high * down), dpi=120, facecolor=PAPER)
    width, height = figure.get_size_inches()
    figure.text(0.1 / width, 1 - 0.22 / height, literal(title), fontsize=14, color=INK, va="center")
    figure.text(0.1 / width, 1 - 0.46 / height, literal(about), fontsize=9, color=GREY, va="center")
    tiles = figure.subplots(
        down, across, squeeze=False,
        gridspec_kw={"left": 0.1 / width, "right": (0.1 + TILE_IN * across - 0.08) / width, "wspace": 0.06,
                     "top": 1 - HEAD_IN / height, "bottom": 0.1 / height, "hspace": 0.06 + between / TILE_IN},
    )  # fmt: skip
    for axis in tiles.flat:
        axis.set_axis_off()
    return figure, tiles


def _bars(axis: Axes, kernel: Floats, orientations: Sequence[float]) -> None:
    """One kernel, (orientations, rows, columns), as oriented bars; angle 0 is vertical, y points down."""
    rows, columns = kernel.shape[1:]
    y, x = (c.ravel() for c in np.mgrid[:rows, :columns])
    for weight, angle, colour in zip(kernel, np.deg2rad(orientations), _colours(len(kernel)), strict=True):
        reach = 0.48 * np.array([-np.sin(angle), np.cos(angle)])
        middle = np.stack([x, y], axis=1)
        seen = weight.ravel() >= FAINTEST
        ends = np.stack([middle - reach, middle + reach], axis=1)[seen]
        shades = [(*to_rgb(colour), opacity) for opacity in np.clip(weight.ravel()[seen], 0.0, 1.0)]
        axis.add_collection(LineCollection(list(ends), colors=shades, linewidths=1.5, capstyle="round"))
    axis.set(xlim=(-0.9, columns - 0.1), ylim=(rows - 0.1, -0.9), aspect="equal")
    axis.add_patch(Rectangle((0, 0), 1, 1, transform=axis.transAxes, color=TILE, zorder=-1))


def _colours(n: int) -> list[str]:
    return [BARS[k % len(BARS)] for k in range(n)]


def history(shares: Floats, classes: int) -> Figure:
    """Share of frames decided rightly while learning, epoch by epoch."""
    epochs = np.arange(1, len(shares) + 1)
    figure = Figure(figsize=(5.6, 3.3), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    axis.plot(epochs, 100 * shares, "o-", color=BLUE, lw=2, ms=5)
    axis.axhline(100 / classes, color=GREY, lw=1, ls=(0, (4, 3)))
    axis.text(epochs[-1], 100 / classes + 1.5, "chance", color=GREY, ha="right", fontsize=9)
    axis.annotate(
        f"{shares[-1]:.1%}", (epochs[-1], 100 * shares[-1]), (0, 7), textcoords="offset points",
        ha="center", color=INK, fontsize=9.5,
    )  # fmt: skip
    axis.set(ylim=(0, 105), xlabel="epoch", xticks=epochs[:: -(-len(epochs) // 12)])
    axis.set_title("Frames decided rightly while learning (%)", loc="left", fontsize=11.5, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    axis.grid(axis="y", color="#e9ecf1", linewidth=0.8)
    return figure
