"""What the commands tell: tables, JSON and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import console, make_folder, sealed, table, write_picture, write_text
from neuro_drone.compare import Summary
from neuro_drone.controllers import CONTROLLERS
from neuro_drone.evaluate import FlightTest
from neuro_drone.model import Model
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import NAMES, Ball, Scenario, load

MARK = "<!-- neuro drone compare -->"
TABLE = sealed("a table of 'neuro drone compare'", MARK, "<!-- digest {} -->")
AXES = {"ball": ("right, px", "down, px", "taller, px"), "line": ("right, px", "lean, degrees")}
"""What the error on each axis is; the third of a ball where the drone climbs."""


def named(model: Model) -> str:
    """Controller and scenario in a few words."""
    learnt = f", {model.steps:,} steps, seed {model.seed}" if model.steps else ""
    return f"{model.controller} in {model.scenario.name}{learnt}"


def learnt(model: Model) -> str:
    """One line about a training."""
    if not model.steps:
        return f"{model.controller} does not learn; it is kept as it is"
    errors, lost = model.history["error_px"], model.history["lost"]
    last = max(1, len(errors) // 10)
    return (
        f"{named(model)}: in the last tenth of {len(errors):,} episodes {np.mean(errors[-last:]):.1f} px "
        f"and {np.mean(lost[-last:]):.0%} lost, with learning on"
    )


def figures(model: Model, tried: FlightTest, course: FlightCourse) -> str:
    """All figures of a test as JSON."""
    words = tried.as_words() | {"path": course.path, "test_seed": course.seed}
    about = {"controller": model.controller, "scenario": model.scenario.name, "steps": model.steps, "seed": model.seed}
    each = words.pop("each")
    return json.dumps({**words, **about, "axes": list(axes(model.scenario)), "per_start": each}, indent=1)


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
        rows.append(
            (
                ", ".join(f"{e:g}" for e in one.start.error),
                *way,
                one.steps,
                *(f"{e:.2f}" for e in (one.error_px, *one.absolute)),
                came,
            )
        )
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
        on = one.mean("learning_on")
        rows.append(
            (
                one.row.text,
                f"{one.row.steps:,}" if one.row.steps else "-",
                str(len(one.each)),
                f"{one.mean('error_px'):.2f}{spread}",
                f"{one.total('laps')} of {one.total('starts')}",
                ", ".join(f"{value:.2f}" for value in one.mean("absolute")),
                ", ".join(f"{value:+.2f}" for value in one.mean("signed")),
                "-" if on is None else f"{on:.2f}",
            )
        )
    return columns, rows


def show_comparison(summaries: Sequence[Summary]) -> None:
    """Print the table of a comparison."""
    columns, rows = columns_of(summaries)
    out = console()
    out.print(table(columns, rows, title=_about(summaries)))
    told = " and ".join(axes(summaries[0].row.scenario))
    out.print(
        f"absolute and signed: mean errors ({told}); signed as the thesis prints them, where errors of both signs "
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
        row = (
            name,
            world.kind,
            str(world.axes),
            f"{world.step:g}",
            f"{world.camera.tilt:g}",
            size,
            f"{task.speed:g}",
            ground,
            shake,
        )
        rows.append((*row, in_flight(world), world.drone.physics))
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
        given = (one.name for one in fields(kind.settings) if "fixed" not in one.metadata)
        own = (word for word in given if not isinstance(getattr(kind.settings, word), Mapping))
        told = ", ".join(f"{word} {_short(getattr(kind.settings, word))}" for word in own)
        source = "the reward" if kind.rewarded else "the error" if kind.learns else "-"
        rows.append((name, kind.what, source, told))
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
