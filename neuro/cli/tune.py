"""`neuro tune`: the best points of a space; their status, table, pictures, page and test on what is held out."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.pictures import Format, write_pictures
from neuro.cli.sweep import Form, On, Out, Pictures, Retry, TableFile, Workers, echo_failures, going, put_table

if TYPE_CHECKING:
    from neuro.sweeps.tuning.table import TuneTable


class TuningPicture(StrEnum):
    """Kinds of pictures."""

    auto = "auto"
    history = "history"
    front = "front"
    importance = "importance"
    parallel = "parallel"


File = Annotated[Path, typer.Argument(metavar="SEARCH", help="What is tuned, as YAML.")]
Part = Annotated[
    str | None, typer.Option(metavar="I/N", help="One of N processes that ask one journal: its share of the trials.")
]
Tuned = Annotated[Path, typer.Argument(metavar="FOLDER", help="A tuning, as 'neuro tune run' writes it.")]
Times = Annotated[bool, typer.Option("--times", help="Also how long the runs of each took together.")]
Runs = Annotated[bool, typer.Option("--runs", help="A row for each run of a trial, each seed and fold, instead.")]
PageFile = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The page; tune.html in FOLDER if not given.")
]
As = Annotated[
    list[TuningPicture],
    typer.Option("--as", help="history, front (of two objectives), importance or parallel; repeatable."),
]

app = typer.Typer(name="tune", add_completion=False, pretty_exceptions_enable=False)


@app.callback(invoke_without_command=True)
def tune(context: typer.Context) -> None:
    """Look for the best parameters, by Optuna: one objective, or the front of several, such as accuracy and joules."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def run(
    file: File,
    out: Out = Path("tuned"),
    on: On = "cores",
    workers: Workers = None,
    part: Part = None,
    retry_failed: Retry = False,
) -> None:
    """Ask for trials and run them until there are as many as the file says; the same command goes on where it was."""
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.tuning.execute import as_text, execute
    from neuro.sweeps.tuning.page import write_page
    from neuro.sweeps.tuning.search import load_search
    from neuro.sweeps.tuning.table import tune_table_of

    place = place_of(on, workers, part)
    made, folder = load_search(file), Folder(out, TUNING)
    with going(out) as bar:
        counts = execute(made, folder, place, retry=retry_failed, bar=bar)
    found = tune_table_of(out)
    typer.echo(f"{out}: {f'part {part}: ' if part else ''}{as_text(counts)}")
    echo_best_and_failures(found)
    if not counts["left"]:
        typer.echo(f"{write_page(found)}: written")
    name = shlex.quote(str(out))
    test = f", or neuro tune test {name}" if made.plan.folds else ""
    typer.echo(f"next: neuro tune table {name}, or neuro tune plot {name}{test}")


def echo_best_and_failures(found: TuneTable) -> None:
    """Print the best trials, why others failed, and how many runs the journal does not know."""
    from neuro.sweeps.folder import Folder

    best = found.best()
    for each in best[:10]:
        values = dict(zip(found.plan.objectives, each.values or (), strict=True))
        typer.echo(f"best: {_named(values)} at {_named(each.point)} (trial {each.number})")
    if len(best) > 10:
        typer.echo(f"and {len(best) - 10} more of the front, see the table")
    trials = found.trials()
    echo_failures(Folder(found.path), [item.key for trial in trials for item in trial.items])
    for each in [trial for trial in trials if trial.has_no_value][:5]:
        typer.echo(f"failed trial {each.number}: {each.error}")
    if strays := found.strays():
        why = "are of no trial: the journal was cut; they are found when they are asked for again"
        typer.echo(f"{strays:,} runs {why}")


def _named(values: Mapping[str, Any]) -> str:
    from neuro.sweeps.rows import text

    return ", ".join(f"{name} {text(value)}" for name, value in values.items())


@app.command()
def status(folder: Tuned) -> None:
    """Tell how many trials are done, failed, pruned and left, which is the best so far, and why what failed did."""
    from neuro.sweeps.tuning.table import tune_table_of

    found = tune_table_of(folder)
    counts = ", ".join(f"{n:,} {word}" for word, n in found.counts().items())
    typer.echo(f"{found.name}: {found.plan.most:,} trials by {found.plan.sampler}: {counts}")
    echo_best_and_failures(found)


@app.command()
def table(folder: Tuned, out: TableFile = None, times: Times = False, runs: Runs = False) -> None:
    """Print or write a row for each trial: outcome, parameters, means of the metrics, whether no other beats it."""
    from neuro.sweeps.tuning.table import tune_table_of

    found = tune_table_of(folder)
    put_table(found.runs() if runs else found, out, times)


@app.command()
def plot(
    folder: Tuned,
    kind: As = [],  # noqa: B006
    out: Pictures = None,
    format: Form = Format.png,
) -> None:
    """Draw a tuning: the best value so far, the front, how much each parameter matters, parallel coordinates."""
    from neuro.sweeps.tuning.pictures import pictures
    from neuro.sweeps.tuning.table import tune_table_of

    kinds = [each.value for each in kind if each != TuningPicture.auto]
    drawn = pictures(tune_table_of(folder), kinds)
    write_pictures(drawn.items(), folder if out is None else out, format)


@app.command()
def page(folder: Tuned, out: PageFile = None) -> None:
    """Write one page that shows a tuning so far: best, front, all trials, what failed and why."""
    from neuro.sweeps.tuning.page import write_page
    from neuro.sweeps.tuning.table import tune_table_of

    typer.echo(f"{write_page(tune_table_of(folder), out)}: written")


@app.command("test")
def held_out(folder: Tuned, on: On = "cores", workers: Workers = None) -> None:
    """Run the best trials on what is held out from all folds, and tell what they are worth there."""
    from neuro.core.errors import ModelError
    from neuro.core.progress import Bar
    from neuro.sweeps.executors import place_of
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.rows import text
    from neuro.sweeps.tuning.execute import hold_out
    from neuro.sweeps.tuning.search import search_of
    from neuro.sweeps.tuning.table import tune_table_of

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


__all__ = ["app"]
