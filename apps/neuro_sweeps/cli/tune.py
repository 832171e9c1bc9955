"""Look for the best parameters, by Optuna: one objective, or the front of several, such as accuracy and joules."""

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
    going,
    put_table,
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
    """Ask for trials and run them until there are as many as the file says; the same command goes on where it was."""
    from neuro_sweeps.definition import load_search
    from neuro_sweeps.execute import execute_search
    from neuro_sweeps.executors import place_of
    from neuro_sweeps.folder import TUNING, Folder
    from neuro_sweeps.table import as_text
    from neuro_sweeps.trials import tune_table_of

    place = place_of(on, workers, share)
    made, folder = load_search(file), Folder(out, TUNING)
    with going(out) as bar:
        counts = execute_search(made, folder, place, retry=retry_failed, bar=bar)
    found = tune_table_of(out)
    typer.echo(f"{out}: {f'share {share}: ' if share else ''}{as_text(counts)}")
    echo_best_and_failures(found)
    echo_next(found, "tune", counts["left"], f", or neuro tune test {shlex.quote(str(out))}" * bool(made.plan.folds))


def echo_best_and_failures(found: TuneTable) -> None:
    """Print the best trials, why others failed, and how many runs the journal does not know."""
    from neuro_sweeps.folder import Folder

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
    from neuro_sweeps.table import measured

    return ", ".join(f"{name} {measured(value, units.get(name, ''))}" for name, value in values.items())


@tune.command("status")
def search_status(folder: Tuned) -> None:
    """Tell how many trials are done, failed, pruned and left, which is the best so far, and why what failed did."""
    from neuro_sweeps.trials import tune_table_of

    found = tune_table_of(folder)
    typer.echo(f"{found.name}: {found.plan.most:,} trials by {found.plan.sampler}: {all_counts(found.counts())}")
    echo_best_and_failures(found)


@tune.command("table")
def search_table(folder: Tuned, out: TableFile = None, times: TrialTimes = False, runs: EachRun = False) -> None:
    """Print or write a row for each trial: outcome, parameters, means of the metrics, whether no other beats it."""
    from neuro_sweeps.trials import tune_table_of

    found = tune_table_of(folder)
    put_table(found.runs() if runs else found, out, times)


@tune.command("plot")
def search_plot(
    folder: Tuned,
    kind: TuneAs = [],  # noqa: B006
    out: Pictures = None,
    format: InFormat = PictureFormat.png,
) -> None:
    """Draw a tuning: the best value so far, the front, how much each parameter matters, parallel coordinates."""
    from neuro_sweeps.pictures import search_pictures
    from neuro_sweeps.trials import tune_table_of

    kinds = [each.value for each in kind if each != TuningPicture.auto]
    drawn = search_pictures(tune_table_of(folder), kinds)
    write_pictures(drawn.items(), folder if out is None else out, format)


@tune.command("page")
def search_page(folder: Tuned, out: TunePage = None) -> None:
    """Write one page that shows a tuning so far: best, front, all trials, what failed and why."""
    from neuro_sweeps.page import write_page
    from neuro_sweeps.trials import tune_table_of

    typer.echo(f"{write_page(tune_table_of(folder), out)}: written")


@tune.command("test")
def held_out(folder: Tuned, on: On = "cores", workers: Workers = None) -> None:
    """Run the best trials on what is held out from all folds, and tell what they are worth there."""
    from neuro import ModelError
    from neuro_sweeps.definition import search_of
    from neuro_sweeps.execute import hold_out
    from neuro_sweeps.executors import place_of
    from neuro_sweeps.folder import TUNING, Folder
    from neuro_sweeps.table import text
    from neuro_sweeps.trials import tune_table_of

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
