"""`neuro sweep`: many runs over a space; their status, table, pictures and page. `neuro tune` shares its options."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import whole
from neuro.cli.pictures import Format, write_pictures
from neuro.core.progress import Bar

if TYPE_CHECKING:
    from neuro.sweeps.folder import Folder
    from neuro.sweeps.rows import RunRows


def workers(text: str) -> int:
    """A whole number >= 1."""
    return whole(text, 1)


class SweepPicture(StrEnum):
    """Kinds of pictures."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


File = Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep, as YAML.")]
Part = Annotated[str | None, typer.Option(metavar="I/N", help="Only the I-th of each N runs, for array jobs.")]
Runs = Annotated[Path, typer.Argument(metavar="FOLDER", help="A sweep, as 'neuro sweep run' writes it.")]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Where runs are kept; what is there is not done again.")]
On = Annotated[
    str, typer.Option(metavar="WHERE", help="cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.")
]
Workers = Annotated[
    int | None, typer.Option(metavar="N", parser=workers, help="Processes; as many as there are cores if not given.")
]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Do again what failed.")]
TableFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="A file .csv or .parquet; printed as CSV if not given.")
]
Times = Annotated[bool, typer.Option("--times", help="Also how long each took, and how often it was begun.")]
PageFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page; sweep.html in FOLDER if not given.")
]
Metric = Annotated[list[str], typer.Option("--metric", metavar="NAME", help="Only this metric; repeatable.")]
Of = Annotated[list[str], typer.Option("--of", metavar="NAME", help="Only these parameters, in order; repeatable.")]
As = Annotated[
    SweepPicture, typer.Option("--as", help="lines, map (of two parameters) or parallel; what fits if not given.")
]
Pictures = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; into FOLDER if not given.")]
Form = Annotated[Format, typer.Option("--format", help="Of the pictures.")]

app = typer.Typer(name="sweep", add_completion=False, pretty_exceptions_enable=False)


@app.callback(invoke_without_command=True)
def sweep(context: typer.Context) -> None:
    """Run something at many points and with many seeds, on this machine or many; tell, table and draw what came."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def run(
    file: File,
    out: Out = Path("runs"),
    on: On = "cores",
    workers: Workers = None,
    part: Part = None,
    retry_failed: Retry = False,
) -> None:
    """Do all runs of a sweep that the folder does not have; the same command goes on where it was."""
    from neuro.sweeps.definition import load_sweep
    from neuro.sweeps.execute import execute
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import SWEEP, Folder
    from neuro.sweeps.page import write_page
    from neuro.sweeps.table import table_of

    place = place_of(on, workers, part)
    made, folder = load_sweep(file), Folder(out, SWEEP)
    with going(out) as bar:
        count = execute(made, folder, place, retry=retry_failed, bar=bar)
    typer.echo(f"{out}: {f'part {part}: ' if part else ''}{count}")
    found = table_of(out)
    echo_failures(folder, found.keys)
    if not found.counts()["left"]:
        typer.echo(f"{write_page(found)}: written")
    name = shlex.quote(str(out))
    typer.echo(f"next: neuro sweep table {name}, or neuro sweep plot {name}")


@contextmanager
def going(out: Path) -> Iterator[Bar]:
    """A bar while runs are done; an interrupt is answered with how to go on."""
    with Bar() as bar:
        try:
            yield bar
        except KeyboardInterrupt:
            bar.stop()
            typer.echo(f"interrupted: {out} keeps what is done; the same command goes on", err=True)
            raise typer.Exit(130) from None


def echo_failures(folder: Folder, keys: Sequence[str]) -> None:
    """Print why runs failed, each of the first five reasons once, with how often and where."""
    from neuro.sweeps.table import reasons

    failed = reasons(folder.outcomes(keys))
    for those in failed[:5]:
        first = those[0].error.partition("\n")[0]
        alike = ", and others like it" if any(each.error != those[0].error for each in those) else ""
        typer.echo(f"failed {len(those):,} x: {first}{alike} (first: {those[0].key[:10]})")
    if len(failed) > 5:
        typer.echo(f"and {len(failed) - 5} more reasons, see the table")


@app.command()
def status(folder: Runs) -> None:
    """Tell how many runs are done, failed, under way and left, and why what failed did."""
    from neuro.sweeps.folder import Folder
    from neuro.sweeps.table import table_of

    found = table_of(folder)
    counts = ", ".join(f"{n:,} {word}" for word, n in found.counts().items())
    typer.echo(f"{found.name}: {len(found):,} runs: {counts}")
    echo_failures(Folder(folder), found.keys)


@app.command()
def table(folder: Runs, out: TableFile = None, times: Times = False) -> None:
    """Print or write a row for each run: outcome, parameters, seed, metrics and error."""
    from neuro.sweeps.table import table_of

    put_table(table_of(folder), out, times)


def put_table(found: RunRows, out: Path | None, times: bool) -> None:
    """Write a table to a file, or print it as CSV."""
    if out is None:
        typer.echo(found.csv(times), nl=False)
        return
    found.save(out, times)
    typer.echo(f"{out}: {len(found):,} rows")


@app.command()
def plot(
    folder: Runs,
    metric: Metric = [],  # noqa: B006
    of: Of = [],  # noqa: B006
    kind: As = SweepPicture.auto,
    out: Pictures = None,
    format: Form = Format.png,
) -> None:
    """Draw metrics over parameters: lines with the spread of seeds, a map of two, or all as parallel coordinates."""
    from neuro.sweeps.pictures import pictures
    from neuro.sweeps.table import table_of

    drawn = pictures(table_of(folder), metric, of, kind.value)
    write_pictures(drawn.items(), folder if out is None else out, format)


@app.command()
def page(folder: Runs, out: PageFile = None) -> None:
    """Write one page that shows a sweep so far: metrics over parameters, all runs, what failed and why."""
    from neuro.sweeps.page import write_page
    from neuro.sweeps.table import table_of

    typer.echo(f"{write_page(table_of(folder), out)}: written")


__all__ = ["app"]
