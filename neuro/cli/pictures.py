"""Pictures and the page of a run: `neuro plot` and `neuro report`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import milliseconds, moment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from neuro.files.parts import Trace
    from neuro.model.views import View


class Format(StrEnum):
    """Formats of pictures."""

    png = "png"
    pdf = "pdf"
    svg = "svg"


File = Annotated[Path, typer.Argument(metavar="FILE", help="Results that 'neuro run' wrote.")]
Folder = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; beside FILE if not given.")]
Window = Annotated[
    tuple[str, str] | None, typer.Option("--window", metavar="BEGIN END", help="Only this stretch, in ms.")
]
Of = Annotated[
    list[str],
    typer.Option(
        "--of",
        "--population",
        metavar="NAME",
        help="Only this population, or some of its neurons: 'exc[:100]', 'grid[2:4, :]', 'exc[[3, 7]]'; repeatable.",
    ),
]
Bin = Annotated[float | None, typer.Option("--bin", metavar="MS", parser=milliseconds, help="Bins of the rates.")]
As = Annotated[Format, typer.Option("--format", help="Of the pictures.")]


def plot(
    file: File,
    out: Folder = None,
    window: Window = None,
    of: Of = [],  # noqa: B006
    bin: Bin = None,
    format: As = Format.png,
) -> None:
    """Draw the spikes, rates and traces of a run as pictures."""
    from neuro import plots
    from neuro.core.errors import ModelError
    from neuro.files.results import read
    from neuro.model.views import View, on_a_line

    results = read(file)
    stretch = None if window is None else tuple(moment(text) for text in window)
    laid = {name: results.laid(name) for name in results.populations}
    asked = [on_a_line(text, laid) for text in of]
    shown = [part if isinstance(part, View) else part.name for part in asked] or None
    whole = {part.name for part in asked if not isinstance(part, View)}
    views = [part for part in asked if isinstance(part, View) and part.population.name not in whole]
    named = {*whole, *(view.population.name for view in views)}
    probes = [
        name for name, trace in results.traces.items() if not of or (trace.population in named and _seen(trace, views))
    ]
    draw: dict[str, Callable[[], Figure]] = {}
    if of or any(train.recorded for train in results.populations.values()):
        draw["raster"] = lambda: plots.raster(results, shown, window=stretch)
        draw["rates"] = lambda: plots.rate(results, shown, bin=bin, window=stretch)
    if probes:
        draw["traces"] = lambda: plots.trace(results, probes, of=views, window=stretch)
    if not draw:
        raise ModelError(f"{file}: holds neither spikes nor traces", hint="'neuro run --record NAME' keeps spikes")
    drawn = ((f"{file.stem}-{what}", picture()) for what, picture in draw.items())
    write_pictures(drawn, file.parent if out is None else out, format)


def write_pictures(pictures: Iterable[tuple[str, Figure]], folder: Path, format: Format) -> None:
    """Write pictures by their names into a folder, which is made if it is not there, and report each."""
    from neuro.core.outputs import make_folder, write_picture

    make_folder(folder)
    for name, picture in pictures:
        path = folder / f"{name}.{format.value}"
        write_picture(path, picture)
        typer.echo(path)


def _seen(trace: Trace, views: Sequence[View]) -> bool:
    """Whether a trace has neurons of the views of its population, if there are any."""
    mine = [view for view in views if view.population.name == trace.population]
    if not mine or trace.single or trace.ids is None:
        return True
    return bool(set(trace.ids.tolist()) & {neuron for view in mine for neuron in view.ids.tolist()})


Out = Annotated[Path | None, typer.Option(metavar="FILE", help="The page to write; FILE with .html if not given.")]
Target = Annotated[str, typer.Option("--target", metavar="NAME", help="The chip, or a table's file, of the bill.")]

ENDINGS = (".html", ".htm")


def report(file: File, out: Out = None, target: Target = "loihi") -> None:
    """Write one page that shows a run: spikes, rates, traces, weights, counts and what a chip would take."""
    from neuro.chips.known import chip
    from neuro.core.errors import ModelError
    from neuro.core.outputs import check_output, output
    from neuro.files.results import read
    from neuro.report.page import PAGE, page

    path = file.with_suffix(".html") if out is None else out
    check_output(path, PAGE)
    if path.suffix.lower() not in ENDINGS:
        raise ModelError(f"--out {path}: a report is a page of HTML: expected a name ending in .html")
    chip(target)
    results = read(file)
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(results, file, target)), "utf-8")
    typer.echo(f"{path}: written")
