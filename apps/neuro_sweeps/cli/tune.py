"""Search for the best parameters with Optuna: one objective, or the front of several, such as accuracy and joules."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import Bar, InFormat, PictureFormat, group, write_pictures
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

if TYPE_CHECKING:
    from neuro_sweeps.trials import TuneTable


class TuningPicture(StrEnum):
    """Kinds of pictures of a tuning."""

    auto = "auto"
    history = "history"
    front = "front"
    importance = "importance"
    parallel = "parallel"


SearchFile = Annotated[Path, typer.Argument(metavar="SEARCH", help="Definition of the search, as YAML.")]
SearchShare = Annotated[
    str | None,
    typer.Option("--share", metavar="I/N", help="Do only the I-th of N shares of the trials, for array jobs."),
]
TuningFolder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of 'neuro tune run'.")]
TrialTimes = Annotated[bool, typer.Option("--times", help="Add the total duration of each trial in s.")]
EachRun = Annotated[bool, typer.Option("--runs", help="A row per run (seed and fold) instead of a row per trial.")]
TunePage = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="HTML file; default: tune.html in FOLDER.")
]
TuneAs = Annotated[
    list[TuningPicture],
    typer.Option(
        "--kind",
        metavar="WORD",
        help="history, front (of two objectives), importance or parallel; default: all; repeatable.",
    ),
]

tune = group("tune", __doc__)


@tune.command("run")
def run_search(
    file: SearchFile,
    out: Out = Path("tuned"),
    on: On = "cores",
    workers: Workers = None,
    share: SearchShare = None,
    retry_failed: Retry = False,
) -> None:
    """Run trials up to the number in the file. Run the same command again to continue an interrupted search."""
    from neuro_sweeps.definition import load_runs
    from neuro_sweeps.execute import execute
    from neuro_sweeps.executors import executor_of
    from neuro_sweeps.folder import TUNING, Folder
    from neuro_sweeps.table import as_text
    from neuro_sweeps.trials import tune_table_of

    executor = executor_of(on, workers, share)
    runs, folder = load_runs(file, TUNING), Folder(out, TUNING)
    with progress_bar(out) as bar:
        counts = execute(runs, folder, executor, retry=retry_failed, bar=bar)
    table = tune_table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_best_and_failures(table)
    test_command = f", or neuro tune test {shlex.quote(str(out))}" * bool(table.plan.folds)
    echo_next(table, "tune", counts["left"], test_command)


def echo_best_and_failures(table: TuneTable) -> None:
    """Print the best trials, the errors of failed trials, and the number of runs without a trial."""
    from neuro_sweeps.folder import Folder

    best, units = table.best(), Folder(table.path).read().get("units", {})
    for each in best[:10]:
        values = dict(zip(table.plan.objectives, each.values or (), strict=True))
        typer.echo(f"best: {_values_text(values, units)} at {_values_text(each.point, units)} (trial {each.number})")
    if len(best) > 10:
        typer.echo(f"and {len(best) - 10} more of the front, see the table")
    trials = table.trials()
    echo_failures(Folder(table.path), [item.key for trial in trials for item in trial.items])
    for each in [trial for trial in trials if trial.has_no_value][:5]:
        typer.echo(f"failed trial {each.number}: {each.error}")
    if strays := table.strays():
        typer.echo(
            f"{strays:,} runs have no trial, since the journal was cut; later trials of the same points use them"
        )


def _values_text(values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    from neuro_sweeps.table import with_unit

    return ", ".join(f"{name} {with_unit(value, units.get(name, ''))}" for name, value in values.items())


@tune.command("status")
def search_status(folder: TuningFolder) -> None:
    """Print the numbers of trials that are done, failed, pruned and left, the best so far, and errors."""
    from neuro_sweeps.trials import tune_table_of

    table = tune_table_of(folder)
    typer.echo(f"{table.name}: {table.plan.most:,} trials by {table.plan.sampler}: {all_counts(table.counts())}")
    echo_best_and_failures(table)


@tune.command("table")
def search_table(folder: TuningFolder, out: TableFile = None, times: TrialTimes = False, runs: EachRun = False) -> None:
    """Print or write a table with a row per trial: outcome, parameters, mean metrics, and whether it is a best one."""
    from neuro_sweeps.trials import tune_table_of

    table = tune_table_of(folder)
    write_table(table.runs() if runs else table, out, times)


@tune.command("plot")
def search_plot(
    folder: TuningFolder,
    kind: TuneAs = [],  # noqa: B006
    out: Pictures = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw a search: the best value so far, the front, the importance of parameters, and parallel axes."""
    from neuro_sweeps.pictures import search_pictures
    from neuro_sweeps.trials import tune_table_of

    kinds = [each.value for each in kind if each != TuningPicture.auto]
    figures = search_pictures(tune_table_of(folder), kinds)
    write_pictures(figures.items(), folder if out is None else out, format)


@tune.command("page")
def search_page(folder: TuningFolder, out: TunePage = None) -> None:
    """Write an HTML page about a search so far: best trials, front, all trials, and errors."""
    from neuro_sweeps.page import write_page
    from neuro_sweeps.trials import tune_table_of

    typer.echo(f"{write_page(tune_table_of(folder), out)}: written")


@tune.command("test")
def evaluate_best(folder: TuningFolder, on: On = "cores", workers: Workers = None) -> None:
    """Test the best trials on the data that is held out from all folds, and print their objectives."""
    from neuro import ModelError
    from neuro_sweeps.execute import hold_out
    from neuro_sweeps.executors import executor_of
    from neuro_sweeps.table import text
    from neuro_sweeps.trials import tune_table_of

    table = tune_table_of(folder)
    if not table.plan.folds:
        message = f"{folder}: the trials have no folds, so no data is held out"
        raise ModelError(message, hint="set 'folds: 3' in the file, and use a function with parameters fold and folds")
    best = table.best()
    if not best:
        raise ModelError(f"{folder}: no trial is done yet: nothing to test")
    with Bar() as bar:
        hold_out(table, executor_of(on, workers), bar)
    rows = {row["trial"]: row for row in table.rows()}
    for each in best:
        row = rows[each.number]
        objectives = [(name, text(row[name]), text(row.get(f"test.{name}"))) for name in table.plan.objectives]
        values = "; ".join(f"{name} {in_folds} in folds, {test} held out" for name, in_folds, test in objectives)
        typer.echo(f"trial {each.number}: {values}")
