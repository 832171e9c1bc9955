"""Run a function or a network at many points and seeds, on one machine or many; show, tabulate and plot the results."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.apps import InFormat, PictureFormat, write_pictures
from neuro_sweeps.cli.shared import Pictures, TableFile, Texts, commands_of, echo_failures, write_table


class SweepPicture(StrEnum):
    """Kinds of pictures of a sweep."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


def _table_of(path: Path) -> Any:
    from neuro_sweeps.table import table_of

    return table_of(path)


sweep, _folder = commands_of(
    "sweep",
    __doc__,
    Texts(
        "sweep",
        "runs",
        "Do all missing runs of a sweep. Run the same command again to continue an interrupted sweep.",
        "Print the numbers of runs that are done, failed, under way and left, and the errors of failed runs.",
        "Write an HTML page about a sweep so far: metrics over parameters, all runs, and errors.",
        "Runs of one array job: the I-th of N equal shares, I from 1 to N (0 means N).",
        _table_of,
        lambda table: f"{len(table):,} runs",
        lambda table: echo_failures(table.path, table.keys),
    ),
)
SweepFolder = Annotated[Path, _folder]
RunTimes = Annotated[bool, typer.Option("--times", help="Add duration in s and number of attempts.")]
Metric = Annotated[
    list[str], typer.Option("--metric", metavar="NAME", help="Metric to draw; default: all; repeatable.")
]
Of = Annotated[
    list[str],
    typer.Option("--of", metavar="NAME", help="Parameter of an axis; default: all that vary; repeatable, in order."),
]
SweepAs = Annotated[
    SweepPicture,
    typer.Option(
        "--kind", metavar="WORD", help="lines, map (of two parameters) or parallel; default: chosen by the data."
    ),
]


@sweep.command("table")
def sweep_table(folder: SweepFolder, out: TableFile = None, times: RunTimes = False) -> None:
    """Print or write a table with a row per run: outcome, parameters, seed, metrics and error."""
    write_table(_table_of(folder), out, times)


@sweep.command("plot")
def sweep_plot(
    folder: SweepFolder,
    metric: Metric = [],  # noqa: B006
    of: Of = [],  # noqa: B006
    kind: SweepAs = SweepPicture.auto,
    out: Pictures = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw metrics over parameters: lines with a band over the seeds, a map of two parameters, or parallel axes."""
    from neuro_sweeps.pictures import pictures

    write_pictures(pictures(_table_of(folder), metric, of, kind.value).items(), out or folder, format)
