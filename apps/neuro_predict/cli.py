"""The command `neuro predict`: the class of each recording, decided by a network."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import Backends, NetworkFile, Seed, Set, assignments, milliseconds, stoppable

if TYPE_CHECKING:
    from neuro.apps import Bar
    from neuro_predict.predict import Predictions

Asked = Annotated[
    list[Path], typer.Argument(metavar="REC", help="Recordings, folders or zips of class folders, HDF5 data sets.")
]
Input = Annotated[str | None, typer.Option("--input", metavar="NAME", help="Population that receives the recordings.")]
Output = Annotated[str | None, typer.Option("--output", metavar="NAME", help="Population with a neuron per class.")]
Decide = Annotated[str | None, typer.Option("--decide", metavar="WORD", help="Rule: counts, potential or first.")]
Classes = Annotated[str | None, typer.Option("--classes", metavar="A,B,...", help="Names of the output's neurons.")]
Duration = Annotated[
    float | None,
    typer.Option("--for", metavar="MS", parser=milliseconds, help="Duration per recording; default: to its end."),
]
Labels = Annotated[bool, typer.Option("--labels", help="Report the accuracy, with class folders as the truth.")]
Part = Annotated[str | None, typer.Option("--part", metavar="NAME", help="Part of a data set; default: all.")]
Picture = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw the output for the first 24 recordings: .png, .pdf or .svg.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def predict(
    file: NetworkFile,
    recordings: Asked,
    input: Input = None,
    output: Output = None,
    decide: Decide = None,
    classes: Classes = None,
    duration: Duration = None,
    labels: Labels = False,
    part: Part = None,
    backends: Backends = "event",
    picture: Picture = None,
    as_json: Json = False,
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
) -> None:
    """Show recordings to a network and print the class that it decides for each, with scores and energy.

    If --input, --output, --decide, --classes or --for is left out, the section 'readout' of the file determines it, or
    else the network. With --labels the command prints accuracy and confusion instead of a row for each recording.
    """
    from neuro import ModelError, load
    from neuro.apps import check_picture, find_backend, write_picture
    from neuro_predict import tables
    from neuro_predict.asked import gather, readout_of, with_classes
    from neuro_predict.predict import ask, check_recordings

    _check_network(file, recordings)
    net = load(file, params=assignments(set))
    names = None if classes is None else [name.strip() for name in classes.split(",")]
    options = {"input": input, "output": output, "decide": decide, "classes": names, "duration": duration}
    try:
        readout = readout_of(net, **options)
    except ModelError as error:
        raise error.but(where=None) from None
    for name in backends:
        find_backend(name)
    if picture is not None:
        check_picture(picture)
    samples = gather(recordings, part, labels)
    if labels:
        has_names = names is not None or (net.readout_section is not None and net.readout_section.classes is not None)
        readout = with_classes(readout, has_names, samples.classes)
    predictions: list[Predictions] = []
    with stoppable("nothing is reported") as bar:
        bar.say("reading recordings")
        check_recordings(samples.samples, readout, net)
        for name in backends:
            n_pictures = 0 if picture is None or predictions else tables.MOST
            options_of_run: dict[str, Any] = {
                "labels": samples.labels,
                "seed": seed,
                "keep": n_pictures,
                "report": _bar_report(bar, name),
            }
            predictions.append(ask(net, samples.samples, readout, name, **options_of_run))
    if picture is not None:
        write_picture(picture, tables.draw(predictions[0]))
    if as_json:
        typer.echo(json.dumps(tables.as_dict(net.name, predictions), indent=1))
        return
    tables.show(predictions)
    if picture is not None:
        typer.echo(f"{picture}: written")


def _bar_report(bar: Bar, backend: str) -> Callable[[int, int], None]:
    return lambda count, total: bar.show(count, total, f"{backend}: showing recordings")


def _check_network(file: Path, recordings: list[Path]) -> None:
    """Raise an error for a graph of NIR or a recogniser; the hint is the command for such a file."""
    from neuro import ModelError
    from neuro.apps import hdf5

    if file.suffix == ".nir":
        command = shlex.join(["neuro", "convert", str(file), str(file.with_suffix(".yaml")), "--resolution", "1"])
        raise ModelError(f"{file}: found a graph of NIR: expected a network as YAML", hint=f"convert it: {command}")
    if file.is_file():
        with file.open("rb") as stream:
            if hdf5.is_hdf5(stream.read(hdf5.FRONT)):
                command = shlex.join(["neuro", "recognise", "predict", str(file), *map(str, recordings)])
                message = f"{file}: found an HDF5 file: expected a network as YAML"
                raise ModelError(message, hint=f"for a recogniser: {command}")
