"""Search for the best parameters with Optuna: one objective, or the Pareto front of several, e.g. accuracy, joules."""

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.apps import Bar, InFormat, PictureFormat, write_pictures
from neuro_sweeps.cli.shared import On, Pictures, TableFile, Texts, Workers, commands_of, echo_failures, write_table


class TuningPicture(StrEnum):
    """Kinds of pictures of a tuning."""

    auto = "auto"
    history = "history"
    front = "front"
    importance = "importance"
    parallel = "parallel"


def _table_of(path: Path) -> Any:
    from neuro_sweeps.trials import tune_table_of

    return tune_table_of(path)


def _details(table: Any) -> None:
    """Print the best trials, the errors of failed trials, and the number of runs without a trial."""
    from neuro_sweeps.folder import Folder

    front, units = table.best(), Folder(table.path).read().get("units", {})
    for trial in front[:10]:
        values = dict(zip(table.plan.objectives, trial.values or (), strict=True))
        typer.echo(f"best: {_values_text(values, units)} at {_values_text(trial.point, units)} (trial {trial.number})")
    if len(front) > 10:
        typer.echo(f"and {len(front) - 10} more of the front, see the table")
    trials = table.trials()
    echo_failures(table.path, [item.key for trial in trials for item in trial.items])
    for failed in [trial for trial in trials if trial.has_no_value][:5]:
        typer.echo(f"failed trial {failed.number}: {failed.error}")
    if strays := table.strays():
        typer.echo(
            f"{strays:,} runs have no trial, since the journal was cut; later trials of the same points use them"
        )


def _values_text(values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    from neuro_sweeps.table import with_unit

    return ", ".join(f"{name} {with_unit(value, units.get(name, ''))}" for name, value in values.items())


tune, _folder = commands_of(
    "tune",
    __doc__,
    Texts(
        "search",
        "tuned",
        "Do all missing trials of a search. Run the same command again to continue an interrupted search.",
        "Print the numbers of trials that are done, failed, pruned and left, the best so far, and errors.",
        "Write an HTML page about a search so far: best trials, front, all trials, and errors.",
        "Trials of one array job: the I-th of N equal shares, I from 1 to N (0 means N).",
        _table_of,
        lambda table: f"{table.plan.most:,} trials by {table.plan.sampler}",
        _details,
    ),
)
TuningFolder = Annotated[Path, _folder]
TrialTimes = Annotated[bool, typer.Option("--times", help="Add the total duration of each trial in s.")]
EachRun = Annotated[bool, typer.Option("--runs", help="A row per run (seed and fold) instead of a row per trial.")]
TuneAs = Annotated[
    list[TuningPicture],
    typer.Option(
        "--kind",
        metavar="WORD",
        help="history, front (of two objectives), importance or parallel; default: all; repeatable.",
    ),
]


@tune.command("table")
def search_table(folder: TuningFolder, out: TableFile = None, times: TrialTimes = False, runs: EachRun = False) -> None:
    """Print or write a table with a row per trial: outcome, parameters, mean metrics, and whether it is a best one."""
    table = _table_of(folder)
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

    kinds = [picture.value for picture in kind if picture != TuningPicture.auto]
    write_pictures(search_pictures(_table_of(folder), kinds).items(), out or folder, format)


@tune.command("test")
def evaluate_best(folder: TuningFolder, on: On = "cores", workers: Workers = None) -> None:
    """Test the best trials on the data that is held out from all folds, and print their objectives."""
    from neuro import ModelError
    from neuro_sweeps.execute import hold_out
    from neuro_sweeps.executors import executor_of
    from neuro_sweeps.table import text

    table = _table_of(folder)
    if not table.plan.folds:
        message = f"{folder}: the trials have no folds, so no data is held out"
        raise ModelError(message, hint="set 'folds: 3' in the file, and use a function with parameters fold and folds")
    best_trials = table.best()
    if not best_trials:
        raise ModelError(f"{folder}: no trial is done yet: nothing to test")
    with Bar() as bar:
        hold_out(table, executor_of(on, workers), bar)
    rows = {row["trial"]: row for row in table.rows()}
    for trial in best_trials:
        row = rows[trial.number]
        objectives = [(name, text(row[name]), text(row.get(f"test.{name}"))) for name in table.plan.objectives]
        values = "; ".join(f"{name} {in_folds} in folds, {test} held out" for name, in_folds, test in objectives)
        typer.echo(f"trial {trial.number}: {values}")
