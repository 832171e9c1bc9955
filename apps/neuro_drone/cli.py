"""Learn to follow a ball or a line with an event camera on a drone."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import PRICED, Backend, Chips, Seed, Set, Sources, at_least

if TYPE_CHECKING:
    from neuro_drone.model import Model

app = typer.Typer(
    name="drone", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


def errors(text: str) -> tuple[float, ...]:
    """Numbers with commas between them."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"'{text}': expected numbers with commas between them, say 20,-10") from None


ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="A model, as 'train' writes it.")]
MaybeModel = Annotated[
    Path | None, typer.Argument(metavar="[MODEL]", help="A model, as 'train' writes it.", show_default=False)
]
ScenarioName = Annotated[
    str, typer.Option("--scenario", metavar="NAME", help="See 'neuro drone scenarios', or a YAML file.")
]
Steps = Annotated[int, typer.Option("--steps", metavar="N", parser=at_least(1), help="Steps of control.")]
Scenario = Annotated[
    str | None,
    typer.Option("--scenario", metavar="NAME", help="See 'neuro drone scenarios', or a YAML file.", show_default=False),
]
Untrained = Annotated[
    str | None,
    typer.Option("--controller", metavar="NAME", help="Instead of a model one that does not learn, say oracle."),
]
Json = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]
Grid = Annotated[int, typer.Option("--starts", metavar="N", parser=at_least(1), help="From a grid of N x N starts.")]
PathKind = Annotated[
    str,
    typer.Option(
        "--path",
        metavar="varied|fixed",
        help="Laps with a path of their own each, or the scenario's in all, which a recorded flight can fly blindly.",
    ),
]
PathSeed = Annotated[int, typer.Option("--seed", metavar="N", parser=at_least(0), help="Of the varied paths.")]


@app.command()
def train(
    scenario: ScenarioName = "B60",
    controller: Annotated[
        str, typer.Option("--controller", metavar="NAME", help="See 'neuro drone controllers'.")
    ] = "snn",
    steps: Steps = 60_000,
    seed: Seed = 0,
    repeats: Annotated[
        int,
        typer.Option("--repeats", metavar="N", parser=at_least(1), help="Trainings, each from its seed, on all cores."),
    ] = 1,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The model to write.")] = Path("model.h5"),
    set: Set = [],  # noqa: B006
) -> None:
    """Train a controller from random starts; after a kill the same command goes on where it was.

    --set changes the scenario (camera.tilt=30) or the controller (eta=1e-3). Several trainings write model-0.h5, ...
    """
    from neuro_drone.report import Bars, learnt
    from neuro_drone.train import TrainingJob, chosen, side_by_side

    world, settings = chosen(scenario, controller, set)
    files = [out] if repeats == 1 else [out.with_name(f"{out.stem}-{seed + k}{out.suffix}") for k in range(repeats)]
    jobs = [
        TrainingJob(world, controller, steps, seed=seed + k, settings=settings, out=file)
        for k, file in enumerate(files)
    ]
    try:
        with Bars() as bars:
            models = side_by_side(jobs, report=bars.training)
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on where it was", err=True)
        raise typer.Exit(130) from None
    for file, model in zip(files, models, strict=True):
        typer.echo(f"{file}: {learnt(model)}")
    if models[0].steps:
        name = shlex.quote(str(files[0]))
        typer.echo(f"next: neuro drone test {name} flies whole laps, which show what was learnt")


@app.command("test")
def try_model(
    model: MaybeModel = None,
    scenario: Scenario = None,
    controller: Untrained = None,
    starts: Grid = 5,
    path: PathKind = "varied",
    seed: PathSeed = 0,
    learning: Annotated[
        bool, typer.Option("--learning", help="Go on learning; dopamine then steers by itself: not what was learnt.")
    ] = False,
    json: Json = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Write pictures there.")] = None,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Fly a lap from each of a grid of starts, with frozen weights and without dopamine."""
    from neuro_drone.evaluate import grid, try_out
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, figures, show, write_pictures

    if learning and backend != "event":
        raise typer.BadParameter("a network goes on learning on what it learnt on", param_hint="'--backend'")
    course, pilot = FlightCourse(path, seed), _pilot(model, scenario, controller, set)
    places = grid(pilot.scenario, starts, course=course)
    with Bars() as bars:
        tried = try_out(pilot, starts=places, backend=backend, learning=learning, report=bars.laps(len(places)))
    for file in [] if out is None else write_pictures(pilot, tried, out):
        typer.echo(file, err=json)
    if json:
        typer.echo(figures(pilot, tried, course))
    else:
        show(pilot, tried, course)


def _announced(no_browser: bool) -> Callable[[Any, Any], Any]:
    """What makes a page, prints its address and opens it."""
    from neuro.apps import announce, app as package

    live = package("neuro_live", "the page")

    def page(sim: Any, figures: Any) -> Any:
        shown = live.Page(sim, figures=figures)
        announce(shown, no_browser, err=True)  # stdout has the figures, as JSON if asked
        return shown

    return page


@app.command()
def live(
    model: MaybeModel = None,
    scenario: Scenario = None,
    controller: Untrained = None,
    starts: Grid = 1,
    path: PathKind = "varied",
    seed: PathSeed = 0,
    speed: Annotated[
        float, typer.Option("--speed", metavar="X", min=0.01, help="So many times as fast as in real time.")
    ] = 1.0,
    backend: Backend = "event",
    json: Json = False,
    set: Set = [],  # noqa: B006
    page: Annotated[bool, typer.Option("--page", help="Show the controller's network in the browser.")] = False,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address of the page only.")] = False,
) -> None:
    """Fly laps in real time, the world in another process, events over the loopback; beside the same laps offline."""
    from neuro_drone.evaluate import grid, try_out
    from neuro_drone.live import fly_live
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, live_figures, show, show_live

    course, pilot = FlightCourse(path, seed), _pilot(model, scenario, controller, set)
    places = grid(pilot.scenario, starts, course=course)
    with Bars() as bars:
        shown, report = _announced(no_browser) if page else None, bars.laps(len(places))
        flown = fly_live(pilot, places, backend=backend, speed=speed, report=report, page=shown)
        offline = try_out(pilot, starts=places, backend=backend)
    if json:
        typer.echo(live_figures(pilot, flown, offline, course))
    else:
        show(pilot, flown.tried, course)
        show_live(flown, offline)


@app.command()
def compare(
    scenario: ScenarioName = "B60",
    steps: Steps = 60_000,
    repeats: Annotated[
        int, typer.Option("--repeats", metavar="N", parser=at_least(1), help="Trainings of each, each from its seed.")
    ] = 5,
    seed: Seed = 0,
    starts: Grid = 5,
    path: PathKind = "varied",
    test_seed: Annotated[
        int, typer.Option("--test-seed", metavar="N", parser=at_least(0), help="Of the varied paths.")
    ] = 0,
    row: Annotated[
        list[str],
        typer.Option("--row", metavar="ROW", help="Only these, e.g. 'snn' or 'dqn steps=150000 drone.v_max=0.5'."),
    ] = [],  # noqa: B006
    more: Annotated[list[str], typer.Option("--also", metavar="ROW", help="These as well, e.g. dqn.")] = [],  # noqa: B006
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Where models and results are kept.")
    ] = None,
    json: Json = False,
    set: Set = [],  # noqa: B006
) -> None:
    """Train and test controllers side by side and print the table; what the folder has is not done again.

    Always there: do nothing, the oracle, the centroid of the events, fixed weights, LMS, the network without
    dopamine and with dopamine of the wrong sign. --set changes the scenario of all.
    """
    from neuro_drone.compare import ROWS, ComparisonRow, run
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, comparison, show_comparison, write_comparison

    course, all_seeds = FlightCourse(path, test_seed), range(seed, seed + repeats)
    rows = tuple(ComparisonRow.of(text, scenario, steps, all_seeds, set) for text in [*(row or ROWS), *more])
    folder = out or Path(f"compare-{rows[0].scenario.name}")
    try:
        with Bars(lines=1) as bars:
            found = run(rows, starts, course, folder, lambda said: bars.at(said.what, said.done, said.total, said.told))
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on where it was", err=True)
        raise typer.Exit(130) from None
    write_comparison(found, folder / "table.md")
    if json:
        typer.echo(comparison(found))
    else:
        show_comparison(found)


@app.command()
def energy(
    model: ModelFile,
    chips: Chips = PRICED,
    sources: Sources = False,
    json: Annotated[bool, typer.Option("--json", help="Print the bills as JSON.")] = False,
) -> None:
    """Fly a lap and print what a control step takes on chips: joules, time, and whether it is in time."""
    from neuro_drone.energy import priced, show, words
    from neuro_drone.model import Model

    bills = priced(Model.load(model), chips)
    if json:
        typer.echo(words(bills))
    else:
        show(bills, sources)


@app.command()
def watch(
    model: MaybeModel = None,
    scenario: Scenario = None,
    controller: Untrained = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The page to write.")] = Path("lap.html"),
    error: Annotated[
        Any,
        typer.Option(
            "--error",
            metavar="A,B[,C]",
            parser=errors,
            help="Error on each axis at the beginning: px, px and px of the ball's height; of a line px, degrees.",
            show_default=False,
        ),
    ] = None,
    path: PathKind = "varied",
    seed: PathSeed = 0,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Write a lap as one page for a browser: the world, the camera's events, spikes and actions side by side."""
    from neuro_drone.paths import FlightCourse
    from neuro_drone.watch import watch as write

    course = FlightCourse(path, seed)
    summary = write(_pilot(model, scenario, controller, set), out, error, backend, course)
    typer.echo(f"{out}: {summary}")


@app.command()
def scenarios() -> None:
    """List the scenarios."""
    from neuro_drone.report import list_scenarios

    list_scenarios()


@app.command()
def controllers() -> None:
    """List the controllers and their settings."""
    from neuro_drone.report import list_controllers

    list_controllers()


def _pilot(model: Path | None, scenario: str | None, controller: str | None, set: list[str]) -> Model:
    """The model that a command is about: a file's, or that of a controller that does not learn."""
    from neuro_drone.train import pilot

    if (model is None) == (controller is None):
        raise typer.BadParameter("expected a model or --controller NAME", param_hint="'MODEL'")
    return pilot(model, scenario, controller, set)
