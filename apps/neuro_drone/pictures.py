"""Pictures of what was learnt and flown, as the thesis has them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro.apps import literal
from neuro_drone.controllers import Learner
from neuro_drone.evaluate import FlightTest
from neuro_drone.geometry import AIM
from neuro_drone.model import Model
from neuro_drone.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["density", "motors", "training", "weight_maps", "weights"]

INK, SOFT, BLUE, RED, GREEN = "#1c1f24", "#8a919c", "#0072b2", "#d55e00", "#009e73"
DPI = 150
WINDOW = 25
"""Episodes of the running median."""

NAMES = {
    "ball": ("right", "left", "backwards", "forward", "up", "down"),
    "line": ("right", "left", "turn right", "turn left"),
}
"""What a spike of each motor asks for: the positive and the negative one of each axis."""


def motors(scenario: Scenario) -> tuple[str, ...]:
    """The names of the motors, see `NAMES`.

    Args:
        scenario: that is flown.
    """
    return NAMES[scenario.kind][: 2 * scenario.axes]


def density(model: Model, tried: FlightTest) -> Figure:
    """Where the target was in the picture, with the marginal distributions; of a line column and angle.

    Args:
        model: that was tried.
        tried: its laps.

    Source: thesis, figures 77 (ball) and 80 (line; the angle of an upright line is 90 degrees).
    """
    from matplotlib.colors import LogNorm

    line = model.scenario.kind == "line"
    track = np.concatenate([one.track for one in tried.each])
    x, y = AIM + track[:, 0], (90.0 - track[:, 1] if line else AIM + track[:, 1])
    edges = np.arange(-0.5, 128.0, 1.0), np.linspace(0.0, 180.0, 121) if line else np.arange(-0.5, 128.0, 1.0)
    seen, _, _ = np.histogram2d(x, y, bins=edges)
    fig = _figure(6.2, 6.75)
    place = {"left": 0.11, "right": 0.985, "bottom": 0.08, "top": 0.905}
    grid = fig.add_gridspec(2, 2, width_ratios=(6, 1), height_ratios=(1, 6), wspace=0.03, hspace=0.03, **place)
    main = fig.add_subplot(grid[1, 0])
    share = np.ma.masked_equal(seen.T / len(track), 0.0)
    main.pcolormesh(*edges, share, cmap="YlGnBu", norm=LogNorm(0.3 / len(track), 1.0), rasterized=True)
    main.axvline(AIM, color=SOFT, lw=0.6, ls=":")
    main.axhline(90.0 if line else AIM, color=SOFT, lw=0.6, ls=":")
    main.set_xlabel("column, px")
    main.set_ylabel("angle, degrees" if line else "row, px")
    if not line:
        main.invert_yaxis()
    above, right = fig.add_subplot(grid[0, 0], sharex=main), fig.add_subplot(grid[1, 1], sharey=main)
    above.stairs(seen.sum(1), edges[0], fill=True, color=BLUE, alpha=0.75)
    right.stairs(seen.sum(0), edges[1], fill=True, color=BLUE, alpha=0.75, orientation="horizontal")
    above.axis("off")
    right.axis("off")
    what = "column and angle of the line" if line else "position of the ball"
    error = f"mean distance {tried.error_px:.2f} px"
    if line:
        error = f"mean absolute error {tried.absolute[0]:.1f} px and {tried.absolute[1]:.1f} degrees"
    fig.suptitle(literal(f"{model.controller} in {model.scenario.name}: {what}"), x=0.02, ha="left", fontsize=12)
    fig.text(0.02, 0.93, f"{error} · {tried.laps} of {tried.starts} laps · all steps, log shade", color=SOFT)
    return fig


def training(model: Model) -> Figure:
    """Steps and error of each episode of a training, with learning on, and the error of frozen weights along it.

    Args:
        model: that was trained.

    Source: thesis, figures 78 and 79; it has no frozen weights.
    """
    steps, error = model.history["steps"], model.history["error_px"]
    lost, number = model.history["lost"].astype(bool), np.arange(1, len(steps) + 1)
    fig = _figure(7.4, 5.2)
    above, below = fig.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (1, 1.6), "hspace": 0.08})
    above.axhline(model.episode, color=RED, lw=0.8)
    above.annotate("whole", (1.0, model.episode), xycoords=("axes fraction", "data"), xytext=(4, -3),
                   textcoords="offset points", color=RED, fontsize=9)  # fmt: skip
    for axes, values in ((above, steps), (below, error)):
        axes.plot(number[~lost], values[~lost], ".", ms=5, color=BLUE, alpha=0.5, mew=0)
        axes.plot(number[lost], values[lost], "x", ms=4, color=RED, alpha=0.8)
        axes.plot(number, _running(values), color=INK, lw=1.2)
    if len(model.curve.get("steps", ())):
        at = np.searchsorted(np.cumsum(steps), model.curve["steps"]) + 1
        tested, fell = model.curve["error_px"], model.curve["lost"] > 0
        below.plot(at, tested, "o-", ms=3.5, lw=1.6, color=GREEN, label="weights frozen, short flights")
        below.plot(at[fell], tested[fell], "x", ms=7, color=GREEN)
        below.legend(loc="upper right", frameon=False)
    for axes in (above, below):
        axes.set_ylim(bottom=0.0)
    above.set_ylabel("steps")
    below.set_ylabel("mean error, px")
    below.set_xlabel(f"episode ({int(steps.sum()):,} steps in all)")
    fig.suptitle(literal(f"{model.controller} in {model.scenario.name}, seed {model.seed}: training"), x=0.02,
                 ha="left", fontsize=12)  # fmt: skip
    fig.text(0.02, 0.915, f"each episode, learning on · running median of {WINDOW} · crosses: target lost", color=SOFT)
    return fig


def _running(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    return np.array([np.median(values[max(0, k + 1 - WINDOW) : k + 1]) for k in range(len(values))])


def weight_maps(model: Model) -> dict[str, npt.NDArray[np.float64]]:
    """The weights of each motor, where its fields are in the picture.

    Args:
        model: any; only a spiking network between 64 cells and its motors, or a read-out of 64 fields, has maps.

    Returns:
        (8, 8) by name, empty if there are none: of a network by what the motor asks for, of LMS by axis.
    """
    pilot = model.learner()
    learnt = pilot.learnt() if isinstance(pilot, Learner) else {}
    names = motors(model.scenario)
    if "cells_motors" in learnt and learnt["cells_motors"].size == 64 * len(names):
        maps = np.asarray(learnt["cells_motors"], float).reshape(64, -1).T
        return {name: one.reshape(8, 8) for name, one in zip(names, maps, strict=True)}
    if model.controller == "lms":
        return {name: one.reshape(8, 8) for name, one in zip(names[::2], learnt["weights"], strict=True)}
    return {}


def weights(model: Model) -> Figure:
    """The maps of `weight_maps`.

    Args:
        model: one that has maps.
    """
    maps = weight_maps(model)
    low, high = min(one.min() for one in maps.values()), max(one.max() for one in maps.values())
    width = 2.3 * len(maps) + 1.5
    fig = _figure(width, 3.2)
    place = {"left": 0.5 / width, "right": 1.0 - 1.1 / width, "top": 0.8, "bottom": 0.09}
    every = fig.subplots(1, len(maps), gridspec_kw=place)
    for axes, (name, one) in zip(every, maps.items(), strict=True):
        shown = axes.imshow(one, cmap="viridis", vmin=low, vmax=high, extent=(-0.5, 127.5, 127.5, -0.5))
        axes.plot(AIM, AIM, "+", color="white", ms=9)
        axes.set_title(name, fontsize=10)
        axes.set_xticks((0, 63, 127))
        axes.set_yticks((0, 63, 127) if axes is every[0] else ())
    unit = "weight" if model.controller == "lms" else "weight, pA"
    box = every[-1].get_position()
    fig.colorbar(shown, cax=fig.add_axes((1.0 - 0.95 / width, box.y0, 0.12 / width, box.height)), label=unit)
    title = f"{model.controller} in {model.scenario.name}, seed {model.seed}: what speaks for which action"
    fig.suptitle(literal(title), x=0.02, ha="left", fontsize=12)
    return fig


def _figure(width: float, height: float) -> Figure:
    """An empty figure that no window and no global state knows of."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI)
