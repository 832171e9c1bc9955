"""Learn to recognise objects from event-camera recordings (ReMuS): 'neuro recognise' with this method.

Recordings are a folder or zip of class folders in any readable format, or an HDF5 data set; of one with folders Train
and Test the right half is taken.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import TARGETS, Backend, Seed, Set, Sources, Target, assignments, whole

if TYPE_CHECKING:
    from neuro.events import Recordings

app = typer.Typer(
    name="remus", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


def epochs(text: str) -> int:
    """A whole number >= 1."""
    return whole(text, 1)


Data = Annotated[Path, typer.Option("--data", metavar="FOLDER", help="Recordings: a folder, zip or HDF5.")]
ModelFile = Annotated[Path, typer.Argument(metavar="MODEL", help="A model, as 'train' writes it.")]
Epochs = Annotated[int | None, typer.Option("--epochs", metavar="N", parser=epochs, help="Instead of the settings'.")]
SettingsName = Annotated[str, typer.Option("--settings", metavar="NAME", help="best, thesis or poker.")]
Json = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


@app.command()
def train(
    data: Data,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The model to write.")] = Path("model.h5"),
    settings: SettingsName = "best",
    epochs: Epochs = None,
    seed: Seed = 0,
    backend: Backend = "event",
    force: Annotated[bool, typer.Option("--force", help="Replace a model of another training.")] = False,
    set: Set = [],  # noqa: B006
) -> None:
    """Train on recordings; after a kill the same command goes on where it was."""
    from neuro_recognise.recogniser import fit, method_of
    from neuro_recognise.telling.bars import Bar
    from neuro_recognise.telling.report import learnt

    values = _present_names(assignments(set)) | ({} if epochs is None else {"epochs": epochs})
    method = method_of("remus", settings, values)
    found = _recordings(data, "Train")
    try:
        with Bar() as bar:
            made = fit(found, method, seed=seed, backend=backend, out=out, replace=force, report=bar.show)
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on after the last whole epoch", err=True)
        raise typer.Exit(130) from None
    typer.echo(f"{out}: {learnt(made)}")


@app.command("test")
def try_model(
    model: ModelFile,
    data: Data,
    json: Json = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Write a picture there.")] = None,
    backend: Backend = "event",
) -> None:
    """Test a model on recordings: accuracy, its 95 % interval, and the confusion of the classes."""
    from neuro_recognise.telling import report
    from neuro_recognise.telling.tried import try_out
    from neuro_remus.stored import load

    trained = load(model)
    tried = try_out(trained, _recordings(data, "Test", trained.classes), backend)
    if out is not None:
        report.write_confusion(tried, out)
    if json:
        typer.echo(report.figures(trained, tried))
    else:
        report.show(trained, tried)


@app.command()
def energy(
    model: ModelFile,
    data: Data,
    target: Target = TARGETS,
    sources: Sources = False,
    json: Json = False,
    backend: Backend = "event",
) -> None:
    """Show recordings to a model and print what one of them takes on chips: joules and time, the sums last."""
    from neuro_recognise.telling import energy
    from neuro_recognise.telling.tried import try_out
    from neuro_remus.stored import load

    trained = load(model)
    energy.check_targets(trained, target)
    tried = try_out(trained, _recordings(data, "Test", trained.classes), backend)
    priced = energy.bills(tried, target)
    if json:
        typer.echo(energy.words(trained, tried, priced))
    else:
        energy.show(trained, tried, priced, sources)


@app.command()
def show(
    model: ModelFile,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Write pictures there.")] = None,
) -> None:
    """Show what a model was trained with; with --out draw what it has learnt."""
    from neuro_recognise.telling import report
    from neuro_remus.stored import load

    trained = load(model)
    report.describe(trained)
    if out is not None:
        report.write_pictures(trained, out)


@app.command()
def demo(
    data: Annotated[
        Path | None, typer.Option("--data", metavar="FOLDER", help="Recordings; made here if not given.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where everything goes.")] = Path("demo"),
    seed: Seed = 0,
) -> None:
    """Learn to recognise digits from nothing: make recordings, train, test on unseen ones, draw, price."""
    from neuro_remus.demo import run

    try:
        run(data, out, seed)
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on where it was", err=True)
        raise typer.Exit(130) from None


def _present_names(values: dict[str, Any]) -> dict[str, Any]:
    """The values, unless one has a name of version 0.1.0."""
    from neuro import ModelError
    from neuro_remus.stored import RENAMED

    for name in values:
        if name in RENAMED:
            raise ModelError(f"unknown setting '{name}'", hint=f"it is called '{RENAMED[name]}' now")
    return values


def _recordings(path: Path, part: str, classes: tuple[str, ...] | None = None) -> Recordings:
    from neuro import ModelError
    from neuro.events import recordings

    found = recordings(path, part=part, classes=classes)
    if found.layout == "recording":
        raise ModelError(f"{path}: is one recording of unknown class, expected a folder, zip or HDF5 file")
    return found
