"""Options and outputs that `neuro sweep` and `neuro tune` share."""

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

from neuro.apps import at_least, group, input_file, stoppable

On = Annotated[
    str,
    typer.Option(
        metavar="WHERE",
        help="Where runs are computed: cores (processes), here (this process), or tcp://HOST:PORT or file of Dask.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", parser=at_least(1), help="Number of processes; default: the number of cores."),
]
TableFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="File .csv or .parquet; default: print as CSV.")
]
Pictures = Annotated[
    Path | None,
    typer.Option("--out", metavar="FOLDER", help="Folder for the pictures; default: the folder of the runs."),
]


class Texts(NamedTuple):
    """Help texts and functions for the commands of one group: `neuro sweep` or `neuro tune`.

    Attributes:
        what: "sweep" or "search".
        out: name of the default folder.
        run, status, page: help of these commands.
        share: help of the option --share.
        table_of: function that returns the table in a folder.
        title: function that returns the description of a table; `status` prints it before the counts of runs.
        details: function that prints the best trials and the errors of a table.
    """

    what: str
    out: str
    run: str
    status: str
    page: str
    share: str
    table_of: Callable[[Path], Any]
    title: Callable[[Any], str]
    details: Callable[[Any], None]


def commands_of(name: str, about: str, texts: Texts) -> tuple[typer.Typer, Any]:
    """Return the commands run, status and page of a sweep or a search, and the argument FOLDER for further commands.

    Args:
        name: name of the group, "sweep" or "tune".
        about: help of the group.
        texts: texts and functions of this group.
    """
    commands = group(name, about)
    definition = typer.Argument(
        metavar=texts.what.upper(), callback=input_file(), help=f"Definition of the {texts.what}, as YAML."
    )
    folder_argument = typer.Argument(metavar="FOLDER", help=f"Folder of 'neuro {name} run'.")
    page_file = typer.Option("--out", metavar="FILE", help=f"HTML file; default: {name}.html in FOLDER.")
    out_folder = typer.Option(metavar="FOLDER", help="Folder for the runs; runs in it are not repeated.")
    one_share = typer.Option("--share", metavar="I/N", help=texts.share)
    repeat = typer.Option("--retry-failed", help="Repeat failed runs.")

    @commands.command("run", help=texts.run)
    def run(
        file: Annotated[Path, definition],
        out: Annotated[Path, out_folder] = Path(texts.out),
        on: On = "cores",
        workers: Workers = None,
        share: Annotated[str | None, one_share] = None,
        retry_failed: Annotated[bool, repeat] = False,
    ) -> None:
        from neuro_sweeps.definition import load_runs
        from neuro_sweeps.execute import execute
        from neuro_sweeps.executors import executor_of
        from neuro_sweeps.folder import KINDS, Folder
        from neuro_sweeps.page import write_page
        from neuro_sweeps.table import as_text

        executor, kind = executor_of(on, workers, share), KINDS[name]
        runs = load_runs(file, kind)
        with stoppable(f"finished runs are kept in {out}; run the same command again to continue") as bar:
            counts = execute(runs, Folder(out, kind), executor, retry=retry_failed, bar=bar)
        table = texts.table_of(out)
        typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
        texts.details(table)
        if not table.counts()["left"]:
            typer.echo(f"{write_page(table)}: written")
        path = shlex.quote(str(out))
        test = f", or neuro tune test {path}" if getattr(runs.points, "folds", 0) else ""
        typer.echo(f"next: neuro {name} table {path}, or neuro {name} plot {path}{test}")

    @commands.command("status", help=texts.status)
    def status(folder: Annotated[Path, folder_argument]) -> None:
        table = texts.table_of(folder)
        counts = ", ".join(f"{n:,} {word}" for word, n in table.counts().items())
        typer.echo(f"{table.name}: {texts.title(table)}: {counts}")
        texts.details(table)

    @commands.command("page", help=texts.page)
    def page(folder: Annotated[Path, folder_argument], out: Annotated[Path | None, page_file] = None) -> None:
        from neuro_sweeps.page import write_page

        typer.echo(f"{write_page(texts.table_of(folder), out)}: written")

    return commands, folder_argument


def echo_failures(path: Path, keys: Sequence[str]) -> None:
    """Print the five most frequent errors, with the number of runs and the first run of each."""
    from neuro_sweeps.folder import Folder
    from neuro_sweeps.table import failures_by_reason

    groups = failures_by_reason(Folder(path).outcomes(keys))
    for runs in groups[:5]:
        first = runs[0].error.partition("\n")[0]
        similar = ", and similar errors" if any(run.error != runs[0].error for run in runs) else ""
        typer.echo(f"failed {len(runs):,} x: {first}{similar} (first: {runs[0].key[:10]})")
    if len(groups) > 5:
        typer.echo(f"and {len(groups) - 5} more errors, see the table")


def write_table(table: Any, out: Path | None, times: bool) -> None:
    """Write a table to a file, or print it as CSV."""
    if out is None:
        typer.echo(table.csv(times), nl=False)
        return
    table.save(out, times)
    typer.echo(f"{out}: {len(table):,} rows")
