"""Learn to follow a ball or a line with an event camera on a drone."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import PRICED, Backend, Chips, Seed, Sources, at_least, input_file

if TYPE_CHECKING:
    from neuro_drone.model import Model

app = typer.Typer(
    name="drone", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


def errors(text: str) -> tuple[float, ...]:
    """Parse numbers separated by commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"'{text}': expected numbers separated by commas, e.g. 20,-10") from None


ModelFile = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL", callback=input_file("a neuro drone model 2"), help="Model file written by 'train'."
    ),
]
MaybeModel = Annotated[
    Path | None,
    typer.Argument(
        metavar="[MODEL]",
        callback=input_file("a neuro drone model 2"),
        help="Model file written by 'train'.",
        show_default=False,
    ),
]
ScenarioName = Annotated[
    str, typer.Option("--scenario", metavar="NAME", help="Name (see 'neuro drone scenarios') or YAML file.")
]
Steps = Annotated[int, typer.Option("--steps", metavar="N", parser=at_least(1), help="Control steps of training.")]
Scenario = Annotated[
    str | None,
    typer.Option(
        "--scenario",
        metavar="NAME",
        help="Name (see 'neuro drone scenarios') or YAML file; default: the model's.",
        show_default=False,
    ),
]
Untrained = Annotated[
    str | None,
    typer.Option(
        "--controller", metavar="NAME", help="Controller that does not learn, instead of a model, e.g. oracle."
    ),
]
Set = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Setting of the scenario, e.g. camera.tilt=30, or of the new controller, e.g. eta=1e-3; repeatable.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]
Grid = Annotated[int, typer.Option("--starts", metavar="N", parser=at_least(1), help="N x N starts on a grid.")]
PathKind = Annotated[
    str,
    typer.Option(
        "--path",
        metavar="varied|fixed",
        help="varied: another path for each lap; fixed: the scenario's path, which a blind flight can complete.",
    ),
]
PathSeed = Annotated[int, typer.Option("--seed", metavar="N", parser=at_least(0), help="Seed of the varied paths.")]


@app.command()
def train(
    scenario: ScenarioName = "B60",
    controller: Annotated[
        str, typer.Option("--controller", metavar="NAME", help="Name of a controller, see 'neuro drone controllers'.")
    ] = "snn",
    steps: Steps = 60_000,
    seed: Seed = 0,
    repeats: Annotated[
        int,
        typer.Option(
            "--repeats",
            metavar="N",
            parser=at_least(1),
            help="Number of parallel trainings; seeds from --seed up; a file for each seed, e.g. model-0.h5.",
        ),
    ] = 1,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Model file to write.")] = Path("model.h5"),
    set: Set = [],  # noqa: B006
) -> None:
    """Train a controller from random starts and write its model. Run the same command again to resume."""
    from neuro_drone.report import Bars, describe_training
    from neuro_drone.train import TrainingJob, apply_changes, side_by_side

    world, settings = apply_changes(scenario, controller, set)
    files = [out] if repeats == 1 else [out.with_name(f"{out.stem}-{seed + k}{out.suffix}") for k in range(repeats)]
    jobs = [
        TrainingJob(world, controller, steps, seed=seed + k, settings=settings, out=file)
        for k, file in enumerate(files)
    ]
    try:
        with Bars() as bars:
            models = side_by_side(jobs, report=bars.training)
    except KeyboardInterrupt:
        typer.echo("interrupted: run the same command again to resume", err=True)
        raise typer.Exit(130) from None
    for file, model in zip(files, models, strict=True):
        typer.echo(f"{file}: {describe_training(model)}")
    if models[0].steps:
        name = shlex.quote(str(files[0]))
        typer.echo(f"next: neuro drone test {name} flies whole laps with frozen weights")


@app.command("test")
def try_model(
    model: MaybeModel = None,
    scenario: Scenario = None,
    controller: Untrained = None,
    starts: Grid = 5,
    path: PathKind = "varied",
    seed: PathSeed = 0,
    learning: Annotated[
        bool, typer.Option("--learning", help="Keep learning during the test; dopamine then also affects the flight.")
    ] = False,
    json: Json = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Folder for pictures.")] = None,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Fly laps from a grid of starts, with frozen weights and without dopamine; print errors and complete laps."""
    from neuro_drone.evaluate import grid, try_out
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, figures, show, write_pictures

    if learning and backend != "event":
        raise typer.BadParameter("--learning uses the backend of the training", param_hint="'--backend'")
    course, pilot = FlightCourse(path, seed), _pilot(model, scenario, controller, set)
    places = grid(pilot.scenario, starts, course=course)
    with Bars() as bars:
        results = try_out(pilot, starts=places, backend=backend, learning=learning, report=bars.laps(len(places)))
    for file in [] if out is None else write_pictures(pilot, results, out):
        typer.echo(file, err=json)
    if json:
        typer.echo(figures(pilot, results, course))
    else:
        show(pilot, results, course)


def _page_maker(no_browser: bool) -> Callable[[Any, Any], Any]:
    """Return a function that makes a page, prints its address and opens it."""
    from neuro.apps import announce, app as package

    live = package("neuro_live", "the page")

    def page(sim: Any, figures: Any) -> Any:
        open_page = live.Page(sim, figures=figures)
        announce(open_page, no_browser, err=True)  # stdout is for the figures
        return open_page

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
        float, typer.Option("--speed", metavar="X", min=0.01, help="Factor on real time; 2 is twice as fast.")
    ] = 1.0,
    backend: Backend = "event",
    json: Json = False,
    set: Set = [],  # noqa: B006
    page: Annotated[bool, typer.Option("--page", help="Show the controller's network in the browser.")] = False,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Only print the address of the page.")] = False,
) -> None:
    """Print errors and latency of laps in real time, beside the same laps offline.

    The world runs in another process and sends its events over the loopback interface.
    """
    from neuro_drone.evaluate import grid, try_out
    from neuro_drone.live import fly_live
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, live_figures, show, show_live

    course, pilot = FlightCourse(path, seed), _pilot(model, scenario, controller, set)
    places = grid(pilot.scenario, starts, course=course)
    with Bars() as bars:
        make_page, report = _page_maker(no_browser) if page else None, bars.laps(len(places))
        laps = fly_live(pilot, places, backend=backend, speed=speed, report=report, page=make_page)
        offline = try_out(pilot, starts=places, backend=backend)
    if json:
        typer.echo(live_figures(pilot, laps, offline, course))
    else:
        show(pilot, laps.test, course)
        show_live(laps, offline)


@app.command()
def compare(
    scenario: ScenarioName = "B60",
    steps: Steps = 60_000,
    repeats: Annotated[
        int,
        typer.Option(
            "--repeats", metavar="N", parser=at_least(1), help="Number of trainings per row; seeds count from --seed."
        ),
    ] = 5,
    seed: Seed = 0,
    starts: Grid = 5,
    path: PathKind = "varied",
    test_seed: Annotated[
        int, typer.Option("--test-seed", metavar="N", parser=at_least(0), help="Seed of the varied paths.")
    ] = 0,
    row: Annotated[
        list[str],
        typer.Option("--row", metavar="ROW", help="Only these rows: 'snn', 'dqn steps=150000 drone.v_max=0.5'."),
    ] = [],  # noqa: B006
    more: Annotated[list[str], typer.Option("--also", metavar="ROW", help="Additional rows, e.g. dqn.")] = [],  # noqa: B006
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Folder of models and results.")] = None,
    json: Json = False,
    set: Set = [],  # noqa: B006
) -> None:
    """Print a table of controllers, each trained and tested. Results in the folder are reused.

    Default rows: do nothing, the oracle, the centroid of the events, fixed weights, LMS, the network, and the network
    without dopamine and with dopamine of the wrong sign. --set changes the scenario of all rows.
    """
    from neuro_drone.compare import ROWS, ComparisonRow, run
    from neuro_drone.paths import FlightCourse
    from neuro_drone.report import Bars, comparison, show_comparison, write_comparison

    course, all_seeds = FlightCourse(path, test_seed), range(seed, seed + repeats)
    rows = tuple(ComparisonRow.of(text, scenario, steps, all_seeds, set) for text in [*(row or ROWS), *more])
    folder = out or Path(f"compare-{rows[0].scenario.name}")
    try:
        with Bars(lines=1) as bars:
            table = run(rows, starts, course, folder, lambda job: bars.at(job.what, job.done, job.total, job.text))
    except KeyboardInterrupt:
        typer.echo("interrupted: run the same command again to resume", err=True)
        raise typer.Exit(130) from None
    write_comparison(table, folder / "table.md")
    if json:
        typer.echo(comparison(table))
    else:
        show_comparison(table)


@app.command()
def energy(
    model: ModelFile,
    chips: Chips = PRICED,
    sources: Sources = False,
    json: Annotated[bool, typer.Option("--json", help="Print the bills as JSON.")] = False,
) -> None:
    """Print energy and time per control step of a lap on chips, and whether each chip is in time."""
    from neuro_drone.energy import compute_bills, show, words
    from neuro_drone.model import Model

    bills = compute_bills(Model.load(model), chips)
    if json:
        typer.echo(words(bills))
    else:
        show(bills, sources)


@app.command()
def watch(
    model: MaybeModel = None,
    scenario: Scenario = None,
    controller: Untrained = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="HTML page to write.")] = Path("lap.html"),
    error: Annotated[
        Any,
        typer.Option(
            "--error",
            metavar="A,B[,C]",
            parser=errors,
            help="Initial error on each axis. Ball: px, px and px of the ball's height. Line: px, degrees.",
            show_default=False,
        ),
    ] = None,
    path: PathKind = "varied",
    seed: PathSeed = 0,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Write a lap as a web page: the world, the camera's events, spikes and actions side by side."""
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
    """Load the model from a file, or make the model of a controller that does not learn."""
    from neuro_drone.train import pilot

    if (model is None) == (controller is None):
        raise typer.BadParameter("expected a model or --controller NAME", param_hint="'MODEL'")
    return pilot(model, scenario, controller, set)
