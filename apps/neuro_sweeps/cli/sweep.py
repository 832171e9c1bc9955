"""Run something at many points and with many seeds, on this machine or many; tell, table and draw what came."""

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
    going,
    put_table,
)


class SweepPicture(StrEnum):
    """Kinds of pictures of a sweep."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep, as YAML.")]
SweepShare = Annotated[
    str | None, typer.Option("--share", metavar="I/N", help="The I-th of each N runs, for array jobs.")
]
Swept = Annotated[Path, typer.Argument(metavar="FOLDER", help="A sweep, as 'neuro sweep run' writes it.")]
RunTimes = Annotated[bool, typer.Option("--times", help="Also how long each took, and how often it was begun.")]
SweepPage = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page; sweep.html in FOLDER if not given.")
]
Metric = Annotated[list[str], typer.Option("--metric", metavar="NAME", help="Only this metric; repeatable.")]
Of = Annotated[list[str], typer.Option("--of", metavar="NAME", help="Only these parameters, in order; repeatable.")]
SweepAs = Annotated[
    SweepPicture,
    typer.Option("--kind", metavar="WORD", help="lines, map (of two parameters) or parallel; what fits if not given."),
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
    """Do all runs of a sweep that the folder does not have; the same command goes on where it was."""
    from neuro_sweeps.definition import load_sweep
    from neuro_sweeps.execute import execute
    from neuro_sweeps.executors import place_of
    from neuro_sweeps.folder import SWEEP, Folder
    from neuro_sweeps.table import as_text, table_of

    place = place_of(on, workers, share)
    made, folder = load_sweep(file), Folder(out, SWEEP)
    with going(out) as bar:
        counts = execute(made, folder, place, retry=retry_failed, bar=bar)
    found = table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_failures(folder, found.keys)
    echo_next(found, "sweep", found.counts()["left"])


@sweep.command("status")
def sweep_status(folder: Swept) -> None:
    """Tell how many runs are done, failed, under way and left, and why what failed did."""
    from neuro_sweeps.folder import Folder
    from neuro_sweeps.table import table_of

    found = table_of(folder)
    typer.echo(f"{found.name}: {len(found):,} runs: {all_counts(found.counts())}")
    echo_failures(Folder(folder), found.keys)


@sweep.command("table")
def sweep_table(folder: Swept, out: TableFile = None, times: RunTimes = False) -> None:
    """Print or write a row for each run: outcome, parameters, seed, metrics and error."""
    from neuro_sweeps.table import table_of

    put_table(table_of(folder), out, times)


@sweep.command("plot")
def sweep_plot(
    folder: Swept,
    metric: Metric = [],  # noqa: B006
    of: Of = [],  # noqa: B006
    kind: SweepAs = SweepPicture.auto,
    out: Pictures = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw metrics over parameters: lines with a band over the seeds, a map of two, or parallel coordinates."""
    from neuro_sweeps.pictures import pictures
    from neuro_sweeps.table import table_of

    drawn = pictures(table_of(folder), metric, of, kind.value)
    write_pictures(drawn.items(), folder if out is None else out, format)


@sweep.command("page")
def sweep_page(folder: Swept, out: SweepPage = None) -> None:
    """Write one page that shows a sweep so far: metrics over parameters, all runs, what failed and why."""
    from neuro_sweeps.page import write_page
    from neuro_sweeps.table import table_of

    typer.echo(f"{write_page(table_of(folder), out)}: written")
