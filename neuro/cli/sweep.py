"""`neuro sweep`, many runs over a space, and `neuro tune`, its best points: run, status, table, pictures, page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.options import at_least, group, stoppable
from neuro.cli.run import Format, PictureFormat, write_pictures
from neuro.core.progress import Bar

if TYPE_CHECKING:
    from neuro.sweeps.folder import Folder
    from neuro.sweeps.table import RunRows, SweepTable
    from neuro.sweeps.trials import TuneTable


class SweepPicture(StrEnum):
    """Kinds of pictures of a sweep."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


class TuningPicture(StrEnum):
    """Kinds of pictures of a tuning."""

    auto = "auto"
    history = "history"
    front = "front"
    importance = "importance"
    parallel = "parallel"


SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP", help="A sweep, as YAML.")]
SweepShare = Annotated[
    str | None, typer.Option("--share", metavar="I/N", help="The I-th of each N runs, for array jobs.")
]
Swept = Annotated[Path, typer.Argument(metavar="FOLDER", help="A sweep, as 'neuro sweep run' writes it.")]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Where runs are kept; what is there is not done again.")]
On = Annotated[
    str, typer.Option(metavar="WHERE", help="cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.")
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", parser=at_least(1), help="Processes; as many as there are cores if not given."),
]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Do again what failed.")]
TableFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="A file .csv or .parquet; printed as CSV if not given.")
]
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
Pictures = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; into FOLDER if not given.")]
SearchFile = Annotated[Path, typer.Argument(metavar="SEARCH", help="What is tuned, as YAML.")]
SearchShare = Annotated[
    str | None,
    typer.Option("--share", metavar="I/N", help="The trials of one of N processes that ask one journal."),
]
Tuned = Annotated[Path, typer.Argument(metavar="FOLDER", help="A tuning, as 'neuro tune run' writes it.")]
TrialTimes = Annotated[bool, typer.Option("--times", help="Also how long the runs of each took together.")]
EachRun = Annotated[bool, typer.Option("--runs", help="A row for each run of a trial, each seed and fold, instead.")]
TunePage = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page; tune.html in FOLDER if not given.")
]
TuneAs = Annotated[
    list[TuningPicture],
    typer.Option(
        "--kind", metavar="WORD", help="history, front (of two objectives), importance or parallel; repeatable."
    ),
]

sweep = group(
    "sweep",
    "Run something at many points and with many seeds, on this machine or many; tell, table and draw what came.",
)
tune = group(
    "tune",
    "Look for the best parameters, by Optuna: one objective, or the front of several, such as accuracy and joules.",
)


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
    from neuro.sweeps.definition import load_sweep
    from neuro.sweeps.execute import execute
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import SWEEP, Folder
    from neuro.sweeps.table import as_text, table_of

    place = place_of(on, workers, share)
    made, folder = load_sweep(file), Folder(out, SWEEP)
    with going(out) as bar:
        counts = execute(made, folder, place, retry=retry_failed, bar=bar)
    found = table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_failures(folder, found.keys)
    echo_next(found, "sweep", found.counts()["left"])


@tune.command("run")
def run_search(
    file: SearchFile,
    out: Out = Path("tuned"),
    on: On = "cores",
    workers: Workers = None,
    share: SearchShare = None,
    retry_failed: Retry = False,
) -> None:
    """Ask for trials and run them until there are as many as the file says; the same command goes on where it was."""
    from neuro.sweeps.definition import load_search
    from neuro.sweeps.execute import execute_search
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.table import as_text
    from neuro.sweeps.trials import tune_table_of

    place = place_of(on, workers, share)
    made, folder = load_search(file), Folder(out, TUNING)
    with going(out) as bar:
        counts = execute_search(made, folder, place, retry=retry_failed, bar=bar)
    found = tune_table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_best_and_failures(found)
    echo_next(found, "tune", counts["left"], f", or neuro tune test {shlex.quote(str(out))}" * bool(made.plan.folds))


def going(out: Path) -> AbstractContextManager[Bar]:
    """A bar while runs are done; an interrupt is answered with how to go on."""
    return stoppable(f"{out} keeps what is done; the same command goes on")


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


def echo_next(found: SweepTable | TuneTable, command: str, left: int, more: str = "") -> None:
    """Write the page when all is done, and print what to do next."""
    from neuro.sweeps.page import write_page

    if not left:
        typer.echo(f"{write_page(found)}: written")
    name = shlex.quote(str(found.path))
    typer.echo(f"next: neuro {command} table {name}, or neuro {command} plot {name}{more}")


def echo_best_and_failures(found: TuneTable) -> None:
    """Print the best trials, why others failed, and how many runs the journal does not know."""
    from neuro.sweeps.folder import Folder

    best, units = found.best(), Folder(found.path).read().get("units", {})
    for each in best[:10]:
        values = dict(zip(found.plan.objectives, each.values or (), strict=True))
        typer.echo(f"best: {_named(values, units)} at {_named(each.point, units)} (trial {each.number})")
    if len(best) > 10:
        typer.echo(f"and {len(best) - 10} more of the front, see the table")
    trials = found.trials()
    echo_failures(Folder(found.path), [item.key for trial in trials for item in trial.items])
    for each in [trial for trial in trials if trial.has_no_value][:5]:
        typer.echo(f"failed trial {each.number}: {each.error}")
    if strays := found.strays():
        why = "are of no trial: the journal was cut; they are found when they are asked for again"
        typer.echo(f"{strays:,} runs {why}")


def _named(values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    from neuro.sweeps.table import measured

    return ", ".join(f"{name} {measured(value, units.get(name, ''))}" for name, value in values.items())


@sweep.command("status")
def sweep_status(folder: Swept) -> None:
    """Tell how many runs are done, failed, under way and left, and why what failed did."""
    from neuro.sweeps.folder import Folder
    from neuro.sweeps.table import table_of

    found = table_of(folder)
    typer.echo(f"{found.name}: {len(found):,} runs: {all_counts(found.counts())}")
    echo_failures(Folder(folder), found.keys)


@tune.command("status")
def search_status(folder: Tuned) -> None:
    """Tell how many trials are done, failed, pruned and left, which is the best so far, and why what failed did."""
    from neuro.sweeps.trials import tune_table_of

    found = tune_table_of(folder)
    typer.echo(f"{found.name}: {found.plan.most:,} trials by {found.plan.sampler}: {all_counts(found.counts())}")
    echo_best_and_failures(found)


def all_counts(counts: Mapping[str, int]) -> str:
    """How many came to what, also none."""
    return ", ".join(f"{n:,} {word}" for word, n in counts.items())


@sweep.command("table")
def sweep_table(folder: Swept, out: TableFile = None, times: RunTimes = False) -> None:
    """Print or write a row for each run: outcome, parameters, seed, metrics and error."""
    from neuro.sweeps.table import table_of

    put_table(table_of(folder), out, times)


@tune.command("table")
def search_table(folder: Tuned, out: TableFile = None, times: TrialTimes = False, runs: EachRun = False) -> None:
    """Print or write a row for each trial: outcome, parameters, means of the metrics, whether no other beats it."""
    from neuro.sweeps.trials import tune_table_of

    found = tune_table_of(folder)
    put_table(found.runs() if runs else found, out, times)


def put_table(found: RunRows, out: Path | None, times: bool) -> None:
    """Write a table to a file, or print it as CSV."""
    if out is None:
        typer.echo(found.csv(times), nl=False)
        return
    found.save(out, times)
    typer.echo(f"{out}: {len(found):,} rows")


@sweep.command("plot")
def sweep_plot(
    folder: Swept,
    metric: Metric = [],  # noqa: B006
    of: Of = [],  # noqa: B006
    kind: SweepAs = SweepPicture.auto,
    out: Pictures = None,
    format: PictureFormat = Format.png,
) -> None:
    """Draw metrics over parameters: lines with a band over the seeds, a map of two, or parallel coordinates."""
    from neuro.sweeps.pictures import pictures
    from neuro.sweeps.table import table_of

    drawn = pictures(table_of(folder), metric, of, kind.value)
    write_pictures(drawn.items(), folder if out is None else out, format)


@tune.command("plot")
def search_plot(
    folder: Tuned,
    kind: TuneAs = [],  # noqa: B006
    out: Pictures = None,
    format: PictureFormat = Format.png,
) -> None:
    """Draw a tuning: the best value so far, the front, how much each parameter matters, parallel coordinates."""
    from neuro.sweeps.pictures import search_pictures
    from neuro.sweeps.trials import tune_table_of

    kinds = [each.value for each in kind if each != TuningPicture.auto]
    drawn = search_pictures(tune_table_of(folder), kinds)
    write_pictures(drawn.items(), folder if out is None else out, format)


@sweep.command("page")
def sweep_page(folder: Swept, out: SweepPage = None) -> None:
    """Write one page that shows a sweep so far: metrics over parameters, all runs, what failed and why."""
    from neuro.sweeps.page import write_page
    from neuro.sweeps.table import table_of

    typer.echo(f"{write_page(table_of(folder), out)}: written")


@tune.command("page")
def search_page(folder: Tuned, out: TunePage = None) -> None:
    """Write one page that shows a tuning so far: best, front, all trials, what failed and why."""
    from neuro.sweeps.page import write_page
    from neuro.sweeps.trials import tune_table_of

    typer.echo(f"{write_page(tune_table_of(folder), out)}: written")


@tune.command("test")
def held_out(folder: Tuned, on: On = "cores", workers: Workers = None) -> None:
    """Run the best trials on what is held out from all folds, and tell what they are worth there."""
    from neuro.core.errors import ModelError
    from neuro.sweeps.definition import search_of
    from neuro.sweeps.execute import hold_out
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.table import text
    from neuro.sweeps.trials import tune_table_of

    found = tune_table_of(folder)
    if not found.plan.folds:
        lack = f"{folder}: its trials have no folds, so nothing is held out from them"
        raise ModelError(lack, hint="'folds: 3' in the file, and a function that takes fold and folds")
    best = found.best()
    if not best:
        raise ModelError(f"{folder}: no trial is done yet: nothing to test")
    points = [each.point for each in best]
    with Bar() as bar:
        hold_out(search_of(Folder(folder, TUNING)), Folder(folder, TUNING), points, place_of(on, workers), bar)
    rows = {row["trial"]: row for row in found.rows()}
    for each in best:
        row = rows[each.number]
        aims = [(aim, text(row[aim]), text(row.get(f"test.{aim}"))) for aim in found.plan.objectives]
        values = "; ".join(f"{aim} {inside} in folds, {outside} held out" for aim, inside, outside in aims)
        typer.echo(f"trial {each.number}: {values}")
