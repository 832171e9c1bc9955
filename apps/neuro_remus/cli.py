"""Learn to recognise objects from event-camera recordings (ReMuS).

Recordings are a folder or zip of class folders with event files of any format, or an HDF5 file of `neuro events
tohdf5`; of one with folders Train and Test the right half is taken.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.apps import TARGETS, Backend, Seed, Set, Target, assignments, whole

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
SettingsName = Annotated[str, typer.Option("--settings", metavar="NAME", help="thesis or best.")]


@app.command()
def train(
    data: Data,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The model to write.")] = Path("model.h5"),
    settings: SettingsName = "best",
    epochs: Epochs = None,
    seed: Seed = 0,
    backend: Backend = "event",
    set: Set = [],  # noqa: B006
) -> None:
    """Train on recordings; after a kill the same command goes on where it was."""
    from neuro_remus.features import c1_spikes
    from neuro_remus.report import Bar, learnt, named
    from neuro_remus.train import train as teach

    values = assignments(set) | ({} if epochs is None else {"epochs": epochs})
    chosen = named(settings).changed(values)
    spikes = c1_spikes(_recordings(data, "Train"), chosen.front)
    try:
        with Bar() as bar:
            model = teach(spikes, chosen, seed=seed, backend=backend, out=out, report=bar.show)
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on after the last whole epoch", err=True)
        raise typer.Exit(130) from None
    typer.echo(f"{out}: {learnt(model)}")


@app.command("test")
def try_model(
    model: ModelFile,
    data: Data,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Write a picture there.")] = None,
    backend: Backend = "event",
) -> None:
    """Test a model on recordings: accuracy, its 95 % interval, and the confusion of the classes."""
    from neuro_remus.model import Model
    from neuro_remus.report import figures, show, write_confusion
    from neuro_remus.tried import try_out

    trained = Model.load(model)
    tried = try_out(trained, _recordings(data, "Test", trained.classes), backend)
    if out is not None:
        write_confusion(trained, tried, out)
    if json:
        typer.echo(figures(trained, tried))
    else:
        show(trained, tried)


@app.command()
def energy(
    model: ModelFile,
    data: Data,
    target: Target = TARGETS,
    json: Annotated[bool, typer.Option("--json", help="Print the bills as JSON.")] = False,
    backend: Backend = "event",
) -> None:
    """Show recordings to a model and print what one of them takes on chips: joules, time, and the sources."""
    from neuro_remus.energy import bills, show, words
    from neuro_remus.model import Model
    from neuro_remus.tried import try_out

    trained = Model.load(model)
    sim = trained.simulation(backend)
    for name in target:
        sim.energy(name)  # what cannot be priced is told before anything is run
    tried = try_out(trained, _recordings(data, "Test", trained.classes), sim)
    priced = bills(tried, target)
    if json:
        typer.echo(words(trained, tried, priced))
    else:
        show(trained, tried, priced)


@app.command()
def show(
    model: ModelFile,
    out: Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Write pictures there.")] = None,
) -> None:
    """Show what a model was trained with; with --out draw what it has learnt."""
    from neuro_remus.model import Model
    from neuro_remus.report import describe, write_pictures

    trained = Model.load(model)
    describe(trained)
    if out is not None:
        write_pictures(trained, out)


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


def _recordings(path: Path, part: str, classes: tuple[str, ...] | None = None) -> Recordings:
    from neuro import ModelError
    from neuro.events import recordings

    found = recordings(path, part=part, classes=classes)
    if found.layout == "recording":
        raise ModelError(f"{path}: is one recording of unknown class, expected a folder, zip or HDF5 file")
    return found
