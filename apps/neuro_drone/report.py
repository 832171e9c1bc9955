"""Output of the commands: progress, tables, JSON and pictures."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import typer

import neuro
from neuro.apps import console, literal, make_folder, sealed, table, write_picture, write_text
from neuro_drone.compare import Summary
from neuro_drone.controllers import CONTROLLERS
from neuro_drone.evaluate import FlightTest, Lap
from neuro_drone.geometry import AIM
from neuro_drone.live import LiveTest
from neuro_drone.model import Model, unpack_network
from neuro_drone.parts import Ball
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import NAMES, Scenario, load
from neuro_drone.train import FLIGHTS, TrainingProgress

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MARK = "<!-- neuro drone compare -->"
TABLE = sealed("a table of 'neuro drone compare'", MARK, "<!-- digest {} -->")
LINES = 10
"""Progress lines per training without a terminal."""
AXES = {"ball": ("right, px", "down, px", "taller, px"), "line": ("right, px", "lean, degrees")}
"""Name and unit of the error on each axis. A ball has the third axis only if the drone climbs."""


class Bars:
    """Progress bars, one per running task.

    Args:
        lines: progress lines printed per task without a terminal.
    """

    def __init__(self, lines: int = LINES) -> None:
        self._lines = lines

    def __enter__(self) -> Bars:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._screen = sys.stderr.isatty()
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        console = Console(stderr=True, highlight=False)
        self._bar = Progress(*columns, console=console, transient=True, disable=not self._screen)
        self._tasks: dict[str, Any] = {}
        self._printed: dict[str, int] = {}
        self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.stop()

    def training(self, progress: TrainingProgress) -> None:
        """Show the progress of a training."""
        self.at(f"seed {progress.seed}", progress.step, progress.steps, progress.text)

    def laps(self, total: int) -> Callable[[Lap], None]:
        """Return a function that shows the number of completed laps and their mean error, on a terminal only."""
        errors: list[float] = []

        def show(lap: Lap) -> None:
            errors.append(lap.error_px)
            if self._screen:
                self.at("laps", len(errors), total, f"{len(errors)} of {total}, {sum(errors) / len(errors):.1f} px")

        return show

    def at(self, task: str, done: int, total: int, message: str) -> None:
        """Show the progress of a task: a bar on a terminal, else up to `lines` lines.

        Args:
            task: name of the task.
            done: completed work.
            total: all work, in the same unit.
            message: the progress as text.
        """
        text, part = f"{task}: {message}", done * self._lines // total
        if task not in self._tasks:
            self._tasks[task] = self._bar.add_task("", total=total)
            self._printed[task] = 0
        self._bar.update(self._tasks[task], description=text, completed=done, total=total)
        if not self._screen and part > self._printed[task]:
            typer.echo(text, err=True)
        self._printed[task] = part
        if done >= total:
            self._bar.update(self._tasks[task], visible=len(self._tasks) == 1)


def describe_model(model: Model) -> str:
    """Return controller, scenario and training as text, e.g. "snn in B60, 60,000 steps, seed 0"."""
    training = f", {model.steps:,} steps, seed {model.seed}" if model.steps else ""
    return f"{model.controller} in {model.scenario.name}{training}"


BODY = ", as the camera rolls and pitches with the drone (camera.mount=body): try a gain of at most 0.25"
"""Advice for a training whose last test lost the target. Source of the gain: docs/how-to/drone.md, B60."""


def describe_training(model: Model) -> str:
    """Describe the result of a training. The error with frozen weights comes first: learning disturbs the flight."""
    if not model.steps:
        return f"{model.controller} does not learn; stored without training"
    returns, lengths = model.history["returns"], model.history["lengths"]
    window = max(1, len(lengths) // 10)
    errors = model.curve.get("error_px", np.zeros(0))
    tests = f"{errors[-1]:.1f} px with frozen weights in short flights from far starts; " if len(errors) else ""
    if lost := int(model.curve["lost"][-1]) if len(errors) else 0:
        tests += f"the target was lost in {lost} of the last {FLIGHTS} of them"
        tests += f"{BODY if model.scenario.camera.mount == 'body' else ''}; "
    reward = returns[-window:].sum() / lengths[-window:].sum() if len(lengths) else np.nan
    return (
        f"{describe_model(model)}: {tests}mean reward {reward:.3f} in the last tenth of {len(lengths):,} episodes, "
        "with learning on, where exploration or the teacher also steers"
    )


def figures(model: Model, test: FlightTest, course: FlightCourse) -> str:
    """Return all figures of a test as JSON."""
    values = test.as_words() | {"path": course.path, "test_seed": course.seed}
    facts = {"controller": model.controller, "scenario": model.scenario.name, "steps": model.steps, "seed": model.seed}
    results = values.pop("each")
    return json.dumps({**values, **facts, "axes": list(axes(model.scenario)), "per_start": results}, indent=1)


def live_figures(model: Model, live: LiveTest, offline: FlightTest, course: FlightCourse) -> str:
    """Return all figures of laps in real time as JSON, beside those of the same laps offline."""
    values = json.loads(figures(model, live.test, course))
    latency = {"p50": live.latency.ms(0.5), "p99": live.latency.ms(0.99), "largest": live.latency.largest_ms}
    counts = {"flown": live.steps, "missed": live.missed, "events_lost": live.lost}
    offline_figures = {"error_px": offline.error_px, "laps": offline.laps}
    return json.dumps(values | {"offline": offline_figures, "latency_ms": latency} | counts, indent=1)


def show_live(live: LiveTest, offline: FlightTest) -> None:
    """Print the same laps offline, latency, missed steps and lost events."""
    lines = (
        f"the same laps offline: {offline.laps} of {offline.starts}, {offline.error_px:.2f} px",
        f"events to action: {live.latency}",
        f"{live.missed:,} of {live.steps:,} steps without an action in time, {live.lost:,} events lost",
    )
    for line in lines:
        typer.echo(line)


def axes(scenario: Scenario) -> tuple[str, ...]:
    """Return name and unit of the error on each axis."""
    return AXES[scenario.kind][: scenario.axes]


def show(model: Model, test: FlightTest, course: FlightCourse) -> None:
    """Print a row for each start, and the means."""
    names = axes(model.scenario)
    line = model.scenario.kind == "line"
    columns = ("start", *(("way",) if line else ()), ">steps", ">error, px", *(f">|{name}|" for name in names), "lap")
    rows: list[tuple[object, ...]] = []
    for lap in test.each:
        direction = (("left" if lap.start.direction > 0 else "right"),) if line else ()
        result = "yes" if lap.lap else "lost" if lap.lost else "no"
        errors = (f"{error:.2f}" for error in (lap.error_px, *lap.absolute))
        rows.append((", ".join(f"{error:g}" for error in lap.start.error), *direction, lap.steps, *errors, result))
    mean = (f"{e:.2f}" for e in (test.error_px, *test.absolute))
    steps = round(sum(lap.steps for lap in test.each) / test.starts)
    rows.append(("mean", *(("",) if line else ()), steps, *mean, f"{test.laps} of {test.starts}"))
    out = console()
    condition = "learning on, the teacher also steers" if test.learning else "weights frozen, no dopamine"
    out.print(table(columns, rows, title=f"{describe_model(model)}; {condition}; {course}"))
    signed = ", ".join(f"{name} {value:.2f}" for name, value in zip(names, test.signed, strict=True))
    out.print(
        f"{test.laps} of {test.starts} laps, {test.error_px:.2f} px; signed means, in which opposite signs cancel: "
        f"{signed}"
    )


def columns_of(summaries: Sequence[Summary]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return columns and rows of the table of a comparison."""
    columns = ("controller", ">steps", ">seeds", ">error, px", ">laps", ">absolute", ">signed", ">learning on, px")
    rows: list[tuple[str, ...]] = []
    for summary in summaries:
        spread = "" if summary.sd is None else f" ± {summary.sd:.2f}"
        learning_on, steps = summary.mean("learning_on"), f"{summary.row.steps:,}" if summary.row.steps else "-"
        error, laps = f"{summary.mean('error_px'):.2f}{spread}", f"{summary.total('laps')} of {summary.total('starts')}"
        absolute = ", ".join(f"{value:.2f}" for value in summary.mean("absolute"))
        signed = ", ".join(f"{value:+.2f}" for value in summary.mean("signed"))
        row = (summary.row.text, steps, str(len(summary.each)), error, laps, absolute, signed)
        rows.append((*row, "-" if learning_on is None else f"{learning_on:.2f}"))
    return columns, rows


def show_comparison(summaries: Sequence[Summary]) -> None:
    """Print the table of a comparison."""
    columns, rows = columns_of(summaries)
    out = console()
    out.print(table(columns, rows, title=_about(summaries)))
    names = " and ".join(axes(summaries[0].row.scenario))
    out.print(
        f"absolute and signed: mean errors ({names}); signed as in the thesis, where opposite signs cancel.\n"
        "learning on: the dopamine also steers, so this is not the error of the learnt weights."
    )


def _about(summaries: Sequence[Summary]) -> str:
    summary = summaries[0]
    return f"{summary.row.scenario.name}, {summary.course}: weights frozen, no dopamine; mean ± sd over seeds"


def write_comparison(summaries: Sequence[Summary], file: Path) -> None:
    """Write the table of a comparison as Markdown."""
    columns, rows = columns_of(summaries)
    heads = [name.lstrip(">") for name in columns]
    lines = [heads, ["---:" if name.startswith(">") else "---" for name in columns], *rows]
    text = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    write_text(file, f"{MARK}\n{text}\n{_about(summaries)}\n", TABLE)


def comparison(summaries: Sequence[Summary]) -> str:
    """Return all figures of a comparison as JSON."""
    name, course = summaries[0].row.scenario.name, summaries[0].course
    facts = {"scenario": name, "path": course.path, "test_seed": course.seed}
    return json.dumps(facts | {"rows": [summary.as_words() for summary in summaries]}, indent=1)


def list_scenarios() -> None:
    """Print the scenarios of this package."""
    rows = []
    for name in NAMES:
        world = load(name)
        task = world.task
        size = f"lap {task.lap:g} m" if isinstance(task, Ball) else f"sides {task.side:g} m"
        ground = f"texture {world.ground.texture:g}" if world.ground.texture else "plain"
        shake = f"{world.camera.shake:g}" if world.camera.shake else "-"
        figures = (f"{number:g}" for number in (world.axes, world.step, world.camera.tilt))
        rows.append(
            (name, world.kind, *figures, size, f"{task.speed:g}", ground, shake, in_flight(world), world.drone.physics)
        )
    columns = ("name", "task", ">axes", ">step, ms", ">tilt, degrees", ">size", ">speed, m/s", "ground", ">shake")
    console().print(table((*columns, "in flight", "physics"), rows))


def in_flight(world: Scenario) -> str:
    """Return the names of the settings that disturb a lap, e.g. "wind, rise"; "-" for none."""
    disturbances: dict[str, float] = {"wind": world.wind.speed or world.wind.gust, "load": world.load.mass}
    disturbances["spin"] = world.drone.spin
    if isinstance(world.task, Ball):
        disturbances |= {word: getattr(world.task, word) for word in ("rise", "bounce", "swell")}
    return ", ".join(word for word, value in disturbances.items() if value) or "-"


def list_controllers() -> None:
    """Print the controllers and their settings."""
    rows = []
    for name, kind in CONTROLLERS.items():
        raw = {word: getattr(kind.settings, word) for word in kind.settings.own()}
        texts = {word: f"{v:g}" if isinstance(v, float) else v for word, v in raw.items() if not isinstance(v, Mapping)}
        numbers = ", ".join(f"{word} {value}" for word, value in texts.items())
        rows.append((name, kind.what, kind.taught, numbers))
    console().print(table(("name", "what", "learns from", "settings"), rows))


def write_pictures(model: Model, test: FlightTest, folder: Path) -> list[Path]:
    """Draw the positions of the target, and for a trained model also training and weights. Return the files."""
    figures = {"density.png": density(model, test)}
    if len(model.history.get("returns", ())):
        figures["training.png"] = training(model)
    if weight_maps(model):
        figures["weights.png"] = weights(model)
    make_folder(folder)
    for name, figure in figures.items():
        write_picture(folder / name, figure)
    return [folder / name for name in figures]


INK, SOFT, BLUE, RED, GREEN = "#1c1f24", "#8a919c", "#0072b2", "#d55e00", "#009e73"
DPI = 150
WINDOW = 25
"""Episodes of the running median."""

MOTORS = {
    "ball": ("right", "left", "backwards", "forward", "up", "down"),
    "line": ("right", "left", "turn right", "turn left"),
}
"""Direction of each motor: the positive and the negative motor of each axis."""


def motors(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of a scenario's motors, see `MOTORS`."""
    return MOTORS[scenario.kind][: 2 * scenario.axes]


def density(model: Model, test: FlightTest) -> Figure:
    """Draw the target's positions in the picture (of a line: column and angle) with their marginal distributions.

    Args:
        model: the tested model.
        test: results of its laps.

    Source: thesis, figures 77 (ball) and 80 (line; the angle of an upright line is 90 degrees).
    """
    from matplotlib.colors import LogNorm

    line = model.scenario.kind == "line"
    track = np.concatenate([lap.track for lap in test.each])
    x, y = AIM + track[:, 0], (90.0 - track[:, 1] if line else AIM + track[:, 1])
    edges = np.arange(-0.5, 128.0, 1.0), np.linspace(0.0, 180.0, 121) if line else np.arange(-0.5, 128.0, 1.0)
    visits, _, _ = np.histogram2d(x, y, bins=edges)
    fig = _figure(6.2, 6.75)
    margins = {"left": 0.11, "right": 0.985, "bottom": 0.08, "top": 0.905}
    grid = fig.add_gridspec(2, 2, width_ratios=(6, 1), height_ratios=(1, 6), wspace=0.03, hspace=0.03, **margins)
    main = fig.add_subplot(grid[1, 0])
    share = np.ma.masked_equal(visits.T / len(track), 0.0)
    main.pcolormesh(*edges, share, cmap="YlGnBu", norm=LogNorm(0.3 / len(track), 1.0), rasterized=True)
    main.axvline(AIM, color=SOFT, lw=0.6, ls=":")
    main.axhline(90.0 if line else AIM, color=SOFT, lw=0.6, ls=":")
    main.set_xlabel("column, px")
    main.set_ylabel("angle, degrees" if line else "row, px")
    if not line:
        main.invert_yaxis()
    above, right = fig.add_subplot(grid[0, 0], sharex=main), fig.add_subplot(grid[1, 1], sharey=main)
    above.stairs(visits.sum(1), edges[0], fill=True, color=BLUE, alpha=0.75)
    right.stairs(visits.sum(0), edges[1], fill=True, color=BLUE, alpha=0.75, orientation="horizontal")
    above.axis("off")
    right.axis("off")
    subject = "column and angle of the line" if line else "position of the ball"
    error = f"mean distance {test.error_px:.2f} px"
    if line:
        error = f"mean absolute error {test.absolute[0]:.1f} px and {test.absolute[1]:.1f} degrees"
    fig.suptitle(literal(f"{model.controller} in {model.scenario.name}: {subject}"), x=0.02, ha="left", fontsize=12)
    fig.text(0.02, 0.93, f"{error} · {test.laps} of {test.starts} laps · all steps, log shade", color=SOFT)
    return fig


def training(model: Model) -> Figure:
    """Draw a training: steps and mean reward of each episode, and the error in tests with frozen weights.

    Args:
        model: the trained model.

    Source: thesis, figures 78 and 79, without the error of frozen weights.
    """
    ends, steps = model.history["steps"], model.history["lengths"]
    reward, ended_early = model.history["returns"] / steps, steps < model.episode
    fig = _figure(7.4, 5.6)
    panels = fig.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (1, 1.2, 1.2), "hspace": 0.1})
    panels[0].axhline(model.episode, color=RED, lw=0.8)
    panels[0].annotate("whole", (1.0, model.episode), xycoords=("axes fraction", "data"), xytext=(4, -3),
                       textcoords="offset points", color=RED, fontsize=9)  # fmt: skip
    for axes, values in zip(panels, (steps, reward), strict=False):
        axes.plot(ends[~ended_early], values[~ended_early], ".", ms=5, color=BLUE, alpha=0.5, mew=0)
        axes.plot(ends[ended_early], values[ended_early], "x", ms=4, color=RED, alpha=0.8)
        medians = [np.median(values[max(0, k + 1 - WINDOW) : k + 1]) for k in range(len(values))]
        axes.plot(ends, medians, color=INK, lw=1.2)
    if len(model.curve.get("steps", ())):
        curve, has_losses = model.curve, model.curve["lost"] > 0
        panels[2].plot(curve["steps"], curve["error_px"], "o-", ms=3.5, lw=1.6, color=GREEN)
        panels[2].plot(curve["steps"][has_losses], curve["error_px"][has_losses], "x", ms=7, color=GREEN)
    for axes, name in zip(panels, ("steps", "reward per step", "error, px"), strict=True):
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(name)
    panels[2].set_xlabel(f"steps ({len(ends):,} episodes)")
    fig.suptitle(literal(f"{model.controller} in {model.scenario.name}, seed {model.seed}: training"), x=0.02,
                 ha="left", fontsize=12)  # fmt: skip
    caption = f"above: episodes, learning on, running median of {WINDOW}, crosses: ended early · below: weights frozen"
    fig.text(0.02, 0.925, caption, color=SOFT)
    return fig


def weight_maps(model: Model) -> dict[str, npt.NDArray[np.float64]]:
    """Return the weights of each motor as maps of the fields.

    Args:
        model: any model. Maps exist for a spiking network with a projection from 64 cells to its motors, and for the
            LMS readout.

    Returns:
        (8, 8) maps by name: one per motor of a network, one per axis of LMS; empty for other models.
    """
    arrays, names = dict(model.learnt), motors(model.scenario)
    if model.network and not arrays:
        sim = neuro.compile(unpack_network(model.network))
        arrays = {part.name: sim.get(part.name, "weight") for part in sim.program.projections}
    if "cells_motors" in arrays and arrays["cells_motors"].size == 64 * len(names):
        maps = np.asarray(arrays["cells_motors"], float).reshape(64, -1).T
        return {name: weight.reshape(8, 8) for name, weight in zip(names, maps, strict=True)}
    if model.controller == "lms":
        return {name: weight.reshape(8, 8) for name, weight in zip(names[::2], arrays["weights"], strict=True)}
    return {}


def weights(model: Model) -> Figure:
    """Draw the maps of `weight_maps`.

    Args:
        model: a model that has maps.
    """
    maps = weight_maps(model)
    low, high = min(values.min() for values in maps.values()), max(values.max() for values in maps.values())
    width = 2.3 * len(maps) + 1.5
    fig = _figure(width, 3.2)
    margins = {"left": 0.5 / width, "right": 1.0 - 1.1 / width, "top": 0.8, "bottom": 0.09}
    panels = fig.subplots(1, len(maps), gridspec_kw=margins)
    for axes, (name, values) in zip(panels, maps.items(), strict=True):
        image = axes.imshow(values, cmap="viridis", vmin=low, vmax=high, extent=(-0.5, 127.5, 127.5, -0.5))
        axes.plot(AIM, AIM, "+", color="white", ms=9)
        axes.set_title(name, fontsize=10)
        axes.set_xticks((0, 63, 127))
        axes.set_yticks((0, 63, 127) if axes is panels[0] else ())
    unit = "weight" if model.controller == "lms" else "weight, pA"
    box = panels[-1].get_position()
    fig.colorbar(image, cax=fig.add_axes((1.0 - 0.95 / width, box.y0, 0.12 / width, box.height)), label=unit)
    title = f"{model.controller} in {model.scenario.name}, seed {model.seed}: weights from the fields to each action"
    fig.suptitle(literal(title), x=0.02, ha="left", fontsize=12)
    return fig


def _figure(width: float, height: float) -> Figure:
    """Return an empty figure outside pyplot's global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=DPI)
