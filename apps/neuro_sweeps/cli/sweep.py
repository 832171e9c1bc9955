"""Run a function or a network at many points and seeds, on one machine or many; show, tabulate and plot the results."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import InFormat, PictureFormat, group, write_pictures
from neuro_sweeps.cli.shared import (
    On,
    Out,
    Pictures,
    Retry,
    TableFile,
    Workers,
    all_counts,
    echo_failures,
    echo_next,
    progress_bar,
    write_table,
)


class SweepPicture(StrEnum):
    """Kinds of pictures of a sweep."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP", help="Definition of the sweep, as YAML.")]
SweepShare = Annotated[
    str | None, typer.Option("--share", metavar="I/N", help="Do only the I-th of every N runs, for array jobs.")
]
SweepFolder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of 'neuro sweep run'.")]
RunTimes = Annotated[bool, typer.Option("--times", help="Add duration in s and number of attempts.")]
SweepPage = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="HTML file; default: sweep.html in FOLDER.")
]
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

sweep = group("sweep", __doc__)


@sweep.command("run")
def run_sweep(
    file: SweepFile,
    out: Out = Path("runs"),
    on: On = "cores",
    workers: Workers = None,
    share: SweepShare = None,
    retry_failed: Retry = False,
) -> None:
    """Do all missing runs of a sweep. Run the same command again to continue an interrupted sweep."""
    from neuro_sweeps.definition import load_runs
    from neuro_sweeps.execute import execute
    from neuro_sweeps.executors import executor_of
    from neuro_sweeps.folder import SWEEP, Folder
    from neuro_sweeps.table import as_text, table_of

    executor = executor_of(on, workers, share)
    runs, folder = load_runs(file, SWEEP), Folder(out, SWEEP)
    with progress_bar(out) as bar:
        counts = execute(runs, folder, executor, retry=retry_failed, bar=bar)
    table = table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_failures(folder, table.keys)
    echo_next(table, "sweep", table.counts()["left"])


@sweep.command("status")
def sweep_status(folder: SweepFolder) -> None:
    """Print the numbers of runs that are done, failed, under way and left, and the errors of failed runs."""
    from neuro_sweeps.folder import Folder
    from neuro_sweeps.table import table_of

    table = table_of(folder)
    typer.echo(f"{table.name}: {len(table):,} runs: {all_counts(table.counts())}")
    echo_failures(Folder(folder), table.keys)


@sweep.command("table")
def sweep_table(folder: SweepFolder, out: TableFile = None, times: RunTimes = False) -> None:
    """Print or write a table with a row per run: outcome, parameters, seed, metrics and error."""
    from neuro_sweeps.table import table_of

    write_table(table_of(folder), out, times)


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
    from neuro_sweeps.table import table_of

    figures = pictures(table_of(folder), metric, of, kind.value)
    write_pictures(figures.items(), folder if out is None else out, format)


@sweep.command("page")
def sweep_page(folder: SweepFolder, out: SweepPage = None) -> None:
    """Write an HTML page about a sweep so far: metrics over parameters, all runs, and errors."""
    from neuro_sweeps.page import write_page
    from neuro_sweeps.table import table_of

    typer.echo(f"{write_page(table_of(folder), out)}: written")
