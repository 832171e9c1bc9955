"""Pictures of learnt weights and of decisions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.signal import convolve

from neuro.apps import Evaluation, literal, wilson
from neuro_events import Events, representations
from neuro_recognise.detection.boxes import COLOURS, UNKNOWN, Boxes
from neuro_recognise.shown import Floats


def reconstructed(kernels: Floats, filters: Floats, side: int) -> Floats:
    """Draw kernels as the sum of all filters times their weights, rectified and smoothed by half a cell.

    Args:
        kernels: (features, orientations, rows, columns) weights of cells; negative weights are ignored.
        filters: (orientations, height, width) filters of the cells, with odd sides.
        side: side of a cell, px; its filter is centred in the cell.

    Returns:
        (features, rows * side, columns * side) images.

    Source: Masquelier and Thorpe, PLoS Comput. Biol. 3:e31, 2007, figure 3.
    """
    n, orientations, rows, columns = kernels.shape
    impulses = np.zeros((n, orientations, rows * side, columns * side))
    impulses[:, :, side // 2 :: side, side // 2 :: side] = np.maximum(kernels, 0.0)
    sums = sum(convolve(impulses[:, k], filters[k][None], mode="same") for k in range(orientations))
    smooth: Floats = gaussian_filter(np.maximum(np.asarray(sums), 0.0), (0.0, side / 2, side / 2), mode="constant")
    return smooth


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
    """Draw the confusion matrix: shades are shares of a class, and each cell shows its number of recordings."""
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
    """An accuracy over a number of recordings, e.g. an `Evaluation`."""

    @property
    def accuracy(self) -> float:
        """Share of right decisions."""

    @property
    def n(self) -> int:
        """Number of recordings."""


def accuracies(results: Sequence[tuple[str, Sequence[Rated]]]) -> Figure:
    """Plot the accuracy of each method as a dot per seed, over the 95 % interval of the mean. The best is at the top.

    Args:
        results: names with an accuracy for each seed.
    """
    ordered = sorted(results, key=lambda pair: np.mean([evaluation.accuracy for evaluation in pair[1]]))
    figure = Figure(figsize=(7.6, 0.9 + 0.36 * len(ordered)), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    for row, (_, evaluations) in enumerate(ordered):
        shares = [evaluation.accuracy for evaluation in evaluations]
        low, high = wilson(round(float(np.mean(shares)) * evaluations[0].n), evaluations[0].n)
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
    """Draw the learnt kernels in one column per class. Each cell has a bar for each orientation.

    A bar has the direction that its Gabor filter prefers. Its opacity is the weight, its colour the orientation.

    Args:
        kernels: (maps, orientations, rows, columns) weights; each class has equally many maps, one after the other.
        classes: names of the classes.
        orientations: (orientations,) angles of the bars, degrees; 0 is vertical.

    Source: thesis figures 50-52.
    """
    per_class = len(kernels) // len(classes)
    columns = min(len(classes), MOST_COLUMNS)
    caption = f"{per_class} per class; the opacity of a bar is the weight of its orientation at its place"
    down = -(-len(classes) // columns) * per_class
    figure, tiles = _tiled(columns, down, "Learnt kernels", caption)
    _key(figure, orientations)
    for k, kernel in enumerate(kernels):
        label, version = divmod(k, per_class)
        axis = tiles[label // columns * per_class + version, label % columns]
        _bars(axis, kernel, orientations)
        if version == 0:
            axis.set_title(literal(classes[label]), fontsize=15, color=INK, pad=4)
    return figure


def images(pictures: Floats, heads: Sequence[str], title: str, about: str, columns: int = MOST_COLUMNS) -> Figure:
    """Draw images side by side. Larger values are darker, negative ones orange, and each image has its own scale.

    Args:
        pictures: (images, rows, columns).
        heads: heading of each image; "" for none.
        title: title of the figure.
        about: line below the title.
        columns: number of images in a row.
    """
    columns = min(len(pictures), columns)
    figure, tiles = _tiled(columns, -(-len(pictures) // columns), title, about, HEADED_IN if any(heads) else 0.0)
    axes: list[Axes] = tiles.ravel().tolist()
    for axis, image, head in zip(axes, pictures, heads, strict=False):
        largest = max(float(np.abs(image).max()), 1e-12)
        axis.imshow(image, cmap=SIGNED, vmin=-largest, vmax=largest, interpolation="nearest")
        axis.add_patch(Rectangle((0, 0), 1, 1, transform=axis.transAxes, fill=False, edgecolor="#e4e8ee", lw=0.8))
        axis.set_title(literal(head), fontsize=10, color=INK, pad=3)
    return figure


def _tiled(columns: int, rows: int, title: str, caption: str, gap: float = 0.0) -> tuple[Figure, NDArray[np.object_]]:
    """Create a figure with a title and square axes (rows, columns), with `gap` inches of vertical space."""
    high = TILE_IN + gap
    figure = Figure(figsize=(max(0.1 + TILE_IN * columns, LEAST_IN), HEAD_IN + high * rows), dpi=120, facecolor=PAPER)
    width, height = figure.get_size_inches()
    figure.text(0.1 / width, 1 - 0.22 / height, literal(title), fontsize=14, color=INK, va="center")
    figure.text(0.1 / width, 1 - 0.46 / height, literal(caption), fontsize=9, color=GREY, va="center")
    tiles = figure.subplots(
        rows, columns, squeeze=False,
        gridspec_kw={"left": 0.1 / width, "right": (0.1 + TILE_IN * columns - 0.08) / width, "wspace": 0.06,
                     "top": 1 - HEAD_IN / height, "bottom": 0.1 / height, "hspace": 0.06 + gap / TILE_IN},
    )  # fmt: skip
    for axis in tiles.flat:
        axis.set_axis_off()
    return figure, tiles


def _key(figure: Figure, orientations: Sequence[float]) -> None:
    """Draw the colour key of the orientations, as bars in the upper right corner."""
    width, height = figure.get_size_inches()
    high, each = 0.2, 0.62
    axis = figure.add_axes((1 - (0.1 + each * len(orientations)) / width, 1 - 0.34 / height,
                            each * len(orientations) / width, high / height))  # fmt: skip
    axis.set(xlim=(0.0, each * len(orientations)), ylim=(high, 0.0), aspect="equal")
    axis.set_axis_off()
    for k, (angle, colour) in enumerate(zip(orientations, cycle(BARS), strict=False)):
        reach, middle = 0.09 * np.array([-np.sin(np.deg2rad(angle)), np.cos(np.deg2rad(angle))]), k * each + 0.12
        axis.plot(*zip((middle - reach[0], 0.1 - reach[1]), (middle + reach[0], 0.1 + reach[1]), strict=True),
                  color=colour, lw=2, solid_capstyle="round")  # fmt: skip
        axis.text(middle + 0.12, 0.1, f"{angle:g}°", fontsize=8.5, color=INK, va="center")


def _bars(axis: Axes, kernel: Floats, orientations: Sequence[float]) -> None:
    """Draw one kernel, (orientations, rows, columns), as oriented bars; angle 0 is vertical, y points down."""
    rows, columns = kernel.shape[1:]
    y, x = (c.ravel() for c in np.mgrid[:rows, :columns])
    for weight, angle, colour in zip(kernel, np.deg2rad(orientations), cycle(BARS), strict=False):
        reach = 0.48 * np.array([-np.sin(angle), np.cos(angle)])
        middle = np.stack([x, y], axis=1)
        visible = weight.ravel() >= FAINTEST
        ends = np.stack([middle - reach, middle + reach], axis=1)[visible]
        shades = [(*to_rgb(colour), opacity) for opacity in np.clip(weight.ravel()[visible], 0.0, 1.0)]
        axis.add_collection(LineCollection(list(ends), colors=shades, linewidths=1.5, capstyle="round"))
    axis.set(xlim=(-0.9, columns - 0.1), ylim=(rows - 0.1, -0.9), aspect="equal")
    axis.add_patch(Rectangle((0, 0), 1, 1, transform=axis.transAxes, color=TILE, zorder=-1))


def history(shares: Floats, classes: int) -> Figure:
    """Plot the share of frames that were decided rightly during learning, by epoch."""
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


LINES = ("#0072B2", "#56B4E9", "#8a94a3", "#D55E00", "#009E73", "#7B4FA3", "#17263c")


def relearnt(accuracies: Mapping[str, Floats], before: int, classes: int) -> Figure:
    """Plot mean and range over seeds of accuracy by epoch, for methods whose labels are permuted after some epochs.

    Args:
        accuracies: (seeds, epochs) accuracies, by the name of the method.
        before: number of epochs before the permutation.
        classes: number of classes.
    """
    figure = Figure(figsize=(7.6, 3.9), dpi=140, layout="constrained", facecolor=PAPER)
    axis = figure.subplots()
    for (name, shares), colour in zip(accuracies.items(), cycle(LINES)):
        epochs = np.arange(1, shares.shape[1] + 1)
        axis.fill_between(
            epochs, *(100 * end(shares, axis=0) for end in (np.min, np.max)), color=colour, alpha=0.15, lw=0
        )
        axis.plot(epochs, 100 * shares.mean(axis=0), "o-", color=colour, lw=1.8, ms=3.5, label=literal(name))
    axis.axvline(before + 0.5, color=INK, lw=1, ls=(0, (4, 3)))
    axis.text(before + 0.6, 103, "labels permuted", color=INK, fontsize=9)
    axis.axhline(100 / classes, color=GREY, lw=1, ls=(0, (1, 3)))
    axis.set(ylim=(0, 110), xlabel="epoch", xticks=epochs[:: -(-len(epochs) // 20)])
    axis.set_title("Held-out recordings decided rightly (%)", loc="left", fontsize=11.5, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    axis.grid(axis="y", color="#e9ecf1", linewidth=0.8)
    figure.legend(loc="outside right upper", frameon=False, fontsize=9)
    return figure


MOST_FRAMES = 9
"""Largest number of frames in a picture. More frames are subsampled evenly."""
GREYS = ("#dde3ea", "#b6c2cf", "#8fa0b3", "#66788e")
"""Colours of pixels with 1, 2, 3 and more events."""


def boxes_on_frames(events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> Figure:
    """Draw some frames with their boxes, in the order of time.

    Args:
        events: events of the recording.
        boxes: detected boxes.
        classes: names of the classes.
        title: title of the picture.
    """
    spans = boxes.spans()
    spans = spans[np.unique(np.linspace(0, len(spans) - 1, min(MOST_FRAMES, len(spans))).round().astype(int))]
    columns = max(1, min(3, len(spans)))
    rows = max(1, -(-len(spans) // columns))
    width, height = events.sensor_size
    figure = Figure(
        figsize=(3.4 * columns, (3.4 * height / width + 0.35) * rows + 0.4), dpi=140, layout="constrained",
        facecolor=PAPER,
    )  # fmt: skip
    figure.suptitle(literal(title), x=0.01, ha="left", fontsize=11, color=INK)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    shades = np.array([to_rgb(colour) for colour in (PAPER, *GREYS)])  # darker for more events
    for axis in axes[len(spans) :]:
        axis.set_visible(False)
    for axis, (start, stop) in zip(axes, spans.tolist(), strict=False):
        counts = np.asarray(representations.event_frame(events.between(start, stop), polarity="ignored"))
        axis.imshow(shades[np.minimum(counts, len(GREYS))], interpolation="nearest")
        for k in np.flatnonzero((boxes.start == start) & (boxes.stop == stop)):
            left, top, right, bottom = boxes.box[k] - 0.5
            colour = COLOURS[int(boxes.identity[k]) % len(COLOURS)]
            axis.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, edgecolor=colour, lw=1.6))
            name = "?" if boxes.label[k] == UNKNOWN else classes[boxes.label[k]]
            above, text = top > 7, f"{literal(name)}  #{boxes.identity[k]}"
            axis.text(left, top - 0.6 if above else bottom + 0.6, text, color=colour, fontsize=8, fontweight="bold",
                      va="bottom" if above else "top", clip_on=True)  # fmt: skip
        axis.set_title(f"{start / 1000:.0f} to {stop / 1000:.0f} ms", loc="left", fontsize=8, color=INK)
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_color("#e4e8ee")
    return figure
