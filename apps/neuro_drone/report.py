"""What the commands tell: how far they are, tables, JSON and pictures."""

from __future__ import annotations

import json
import sys
from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import typer

from neuro.apps import console, make_folder, sealed, table, write_picture, write_text
from neuro_drone.compare import Summary
from neuro_drone.controllers import CONTROLLERS
from neuro_drone.evaluate import FlightTest, Lap
from neuro_drone.live import LiveTest
from neuro_drone.model import Model
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import NAMES, Ball, Scenario, load
from neuro_drone.train import TrainingProgress

MARK = "<!-- neuro drone compare -->"
TABLE = sealed("a table of 'neuro drone compare'", MARK, "<!-- digest {} -->")
LAST = 20
"""Episodes of which the mean error is shown."""

LINES = 10
"""Lines of each training where there is no terminal."""
AXES = {"ball": ("right, px", "down, px", "taller, px"), "line": ("right, px", "lean, degrees")}
"""What the error on each axis is; the third of a ball where the drone climbs."""


class Bars:
    """One bar for each thing that is under way.

    Args:
        lines: that are printed of each where there is no terminal.
    """

    def __init__(self, lines: int = LINES) -> None:
        self._lines = lines

    def __enter__(self) -> Bars:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._screen = sys.stderr.isatty()
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        where = Console(stderr=True, highlight=False)
        self._bar = Progress(*columns, console=where, transient=True, disable=not self._screen)
        self._tasks: dict[str, Any] = {}
        self._said: dict[str, int] = {}
        self._errors: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=LAST))
        self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.stop()

    def training(self, progress: TrainingProgress) -> None:
        """Show how far a training is, and its error of late."""
        what = f"seed {progress.seed}"
        errors = self._errors[what]
        errors.append(progress.error_px)
        frozen = "" if np.isnan(progress.frozen_px) else f"{progress.frozen_px:.1f} px frozen, from afar; "
        learning = f"{sum(errors) / len(errors):.1f} px while it learns"
        message = f"{progress.step:,} of {progress.steps:,} steps, {frozen}{learning}"
        self.at(what, progress.step, progress.steps, message)

    def laps(self, total: int) -> Callable[[Lap], None]:
        """What shows how many laps of so many are flown; only on a terminal."""
        flown: list[float] = []

        def show(lap: Lap) -> None:
            flown.append(lap.error_px)
            if self._screen:
                self.at("laps", len(flown), total, f"{len(flown)} of {total}, {sum(flown) / len(flown):.1f} px")

        return show

    def at(self, what: str, done: int, total: int, message: str) -> None:
        """Show how far something is; elsewhere than on a terminal some lines are printed."""
        text, part = f"{what}: {message}", done * self._lines // total
        if what not in self._tasks:
            self._tasks[what] = self._bar.add_task("", total=total)
            self._said[what] = 0
        self._bar.update(self._tasks[what], description=text, completed=done, total=total)
        if not self._screen and part > self._said[what]:
            typer.echo(text, err=True)
        self._said[what] = part
        if done >= total:
            self._bar.update(self._tasks[what], visible=len(self._tasks) == 1)


def named(model: Model) -> str:
    """Controller and scenario in a few words."""
    learnt = f", {model.steps:,} steps, seed {model.seed}" if model.steps else ""
    return f"{model.controller} in {model.scenario.name}{learnt}"


def learnt(model: Model) -> str:
    """What came of a training: of frozen weights first, since learning disturbs the flight."""
    if not model.steps:
        return f"{model.controller} does not learn; it is kept as it is"
    errors, lost = model.history["error_px"], model.history["lost"]
    last = max(1, len(errors) // 10)
    tested = model.curve.get("error_px", np.zeros(0))
    frozen = f"{tested[-1]:.1f} px with frozen weights in short flights from afar; " if len(tested) else ""
    return (
        f"{named(model)}: {frozen}{np.mean(errors[-last:]):.1f} px and {np.mean(lost[-last:]):.0%} lost in the last "
        f"tenth of {len(errors):,} episodes, in which it explores and dopamine steers"
    )


def figures(model: Model, tried: FlightTest, course: FlightCourse) -> str:
    """All figures of a test as JSON."""
    words = tried.as_words() | {"path": course.path, "test_seed": course.seed}
    about = {"controller": model.controller, "scenario": model.scenario.name, "steps": model.steps, "seed": model.seed}
    each = words.pop("each")
    return json.dumps({**words, **about, "axes": list(axes(model.scenario)), "per_start": each}, indent=1)


def live_figures(model: Model, live: LiveTest, offline: FlightTest, course: FlightCourse) -> str:
    """All figures of laps in real time as JSON, beside those of the same laps offline."""
    words = json.loads(figures(model, live.tried, course))
    latency = {"p50": live.latency.ms(0.5), "p99": live.latency.ms(0.99), "largest": live.latency.largest_ms}
    counts = {"flown": live.steps, "missed": live.missed, "events_lost": live.lost}
    beside = {"error_px": offline.error_px, "laps": offline.laps}
    return json.dumps(words | {"offline": beside, "latency_ms": latency} | counts, indent=1)


def show_live(live: LiveTest, offline: FlightTest) -> None:
    """Print what real time added."""
    lines = (
        f"offline the same laps: {offline.laps} of {offline.starts}, {offline.error_px:.2f} px",
        f"events to action: {live.latency}",
        f"{live.missed:,} of {live.steps:,} steps without an action in time, {live.lost:,} events lost",
    )
    for line in lines:
        typer.echo(line)


def axes(scenario: Scenario) -> tuple[str, ...]:
    """What the error on each axis is, with its unit."""
    return AXES[scenario.kind][: scenario.axes]


def show(model: Model, tried: FlightTest, course: FlightCourse) -> None:
    """Print a row for each start, and the means."""
    names = axes(model.scenario)
    line = model.scenario.kind == "line"
    columns = ("start", *(("way",) if line else ()), ">steps", ">error, px", *(f">|{name}|" for name in names), "lap")
    rows: list[tuple[object, ...]] = []
    for one in tried.each:
        way = (("left" if one.start.direction > 0 else "right"),) if line else ()
        came = "yes" if one.lap else "lost" if one.lost else "no"
        errors = (f"{error:.2f}" for error in (one.error_px, *one.absolute))
        rows.append((", ".join(f"{error:g}" for error in one.start.error), *way, one.steps, *errors, came))
    mean = (f"{e:.2f}" for e in (tried.error_px, *tried.absolute))
    steps = round(sum(one.steps for one in tried.each) / tried.starts)
    rows.append(("mean", *(("",) if line else ()), steps, *mean, f"{tried.laps} of {tried.starts}"))
    out = console()
    out.print(table(columns, rows, title=f"{named(model)}; {_how(tried)}; {course}"))
    signed = ", ".join(f"{name} {value:.2f}" for name, value in zip(names, tried.signed, strict=True))
    out.print(
        f"{tried.laps} of {tried.starts} laps, {tried.error_px:.2f} px; signed means, which hide errors of both signs: "
        f"{signed}"
    )


def _how(tried: FlightTest) -> str:
    return "learning goes on, dopamine steers" if tried.learning else "weights frozen, no dopamine"


def columns_of(summaries: Sequence[Summary]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns and rows of the table of a comparison."""
    columns = ("controller", ">steps", ">seeds", ">error, px", ">laps", ">absolute", ">signed", ">learning on, px")
    rows: list[tuple[str, ...]] = []
    for one in summaries:
        spread = "" if one.sd is None else f" ± {one.sd:.2f}"
        on, steps = one.mean("learning_on"), f"{one.row.steps:,}" if one.row.steps else "-"
        error, laps = f"{one.mean('error_px'):.2f}{spread}", f"{one.total('laps')} of {one.total('starts')}"
        absolute = ", ".join(f"{value:.2f}" for value in one.mean("absolute"))
        signed = ", ".join(f"{value:+.2f}" for value in one.mean("signed"))
        row = (one.row.text, steps, str(len(one.each)), error, laps, absolute, signed)
        rows.append((*row, "-" if on is None else f"{on:.2f}"))
    return columns, rows


def show_comparison(summaries: Sequence[Summary]) -> None:
    """Print the table of a comparison."""
    columns, rows = columns_of(summaries)
    out = console()
    out.print(table(columns, rows, title=_about(summaries)))
    names = " and ".join(axes(summaries[0].row.scenario))
    out.print(
        f"absolute and signed: mean errors ({names}); signed as the thesis prints them, where errors of both signs "
        "cancel.\nlearning on: dopamine itself steers, so that this figure is not what was learnt."
    )


def _about(summaries: Sequence[Summary]) -> str:
    one = summaries[0]
    return f"{one.row.scenario.name}, {one.course}: weights frozen, no dopamine; mean ± sd over seeds"


def write_comparison(summaries: Sequence[Summary], file: Path) -> None:
    """Write the table of a comparison as Markdown."""
    columns, rows = columns_of(summaries)
    heads = [name.lstrip(">") for name in columns]
    lines = [heads, ["---:" if name.startswith(">") else "---" for name in columns], *rows]
    text = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    write_text(file, f"{MARK}\n{text}\n{_about(summaries)}\n", TABLE)


def comparison(summaries: Sequence[Summary]) -> str:
    """All figures of a comparison as JSON."""
    name, course = summaries[0].row.scenario.name, summaries[0].course
    about = {"scenario": name, "path": course.path, "test_seed": course.seed}
    return json.dumps(about | {"rows": [one.as_words() for one in summaries]}, indent=1)


def list_scenarios() -> None:
    """Print the scenarios that come along."""
    rows = []
    for name in NAMES:
        world = load(name)
        task = world.task
        size = f"lap {task.lap:g} m" if isinstance(task, Ball) else f"sides {task.side:g} m"
        ground = f"texture {world.ground.texture:g}" if world.ground.texture else "plain"
        shake = f"{world.camera.shake:g}" if world.camera.shake else "-"
        numbers = (f"{number:g}" for number in (world.axes, world.step, world.camera.tilt))
        seen = (size, f"{task.speed:g}", ground, shake)
        rows.append((name, world.kind, *numbers, *seen, in_flight(world), world.drone.physics))
    columns = ("name", "task", ">axes", ">step, ms", ">tilt, degrees", ">size", ">speed, m/s", "ground", ">shake")
    console().print(table((*columns, "in flight", "physics"), rows))


def in_flight(world: Scenario) -> str:
    """What changes during a lap, by the scenario's words."""
    there: dict[str, float] = {"wind": world.wind.speed or world.wind.gust, "load": world.load.mass}
    there["spin"] = world.drone.spin
    if isinstance(world.task, Ball):
        there |= {word: getattr(world.task, word) for word in ("rise", "bounce", "swell")}
    return ", ".join(word for word, value in there.items() if value) or "-"


def list_controllers() -> None:
    """Print the controllers, and the settings of each."""
    rows = []
    for name, kind in CONTROLLERS.items():
        own = {word: getattr(kind.settings, word) for word in kind.settings.own()}
        numbers = ", ".join(f"{word} {_short(v)}" for word, v in own.items() if not isinstance(v, Mapping))
        source = "the reward" if kind.rewarded else "the error" if kind.learns else "-"
        rows.append((name, kind.what, source, numbers))
    console().print(table(("name", "what", "learns from", "settings"), rows))


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def write_pictures(model: Model, tried: FlightTest, folder: Path) -> list[Path]:
    """Draw where the target was and, of a trained model, how the training went and the weights; gives the files."""
    from neuro_drone import pictures

    figures = {"density.png": pictures.density(model, tried)}
    if len(model.history.get("steps", ())):
        figures["training.png"] = pictures.training(model)
    if pictures.weight_maps(model):
        figures["weights.png"] = pictures.weights(model)
    make_folder(folder)
    for name, figure in figures.items():
        write_picture(folder / name, figure)
    return [folder / name for name in figures]
