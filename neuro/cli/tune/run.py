"""`neuro tune run`."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.sweep.options import On, Out, Retry, Workers

if TYPE_CHECKING:
    from neuro.sweeps.tuning.table import TuneTable

File = Annotated[Path, typer.Argument(metavar="SEARCH", help="What is tuned, as YAML.")]
Part = Annotated[
    str | None, typer.Option(metavar="I/N", help="One of N processes that ask one journal: its share of the trials.")
]


def run(
    file: File,
    out: Out = Path("tuned"),
    on: On = "cores",
    workers: Workers = None,
    part: Part = None,
    retry_failed: Retry = False,
) -> None:
    """Ask for trials and run them until there are as many as the file says; the same command goes on where it was."""
    from neuro.cli.sweep.going import going
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.place import place_of
    from neuro.sweeps.tuning.execute import as_text, execute
    from neuro.sweeps.tuning.search import load_search
    from neuro.sweeps.tuning.table import tune_table_of

    place = place_of(on, workers, part)
    made, folder = load_search(file), Folder(out, TUNING)
    with going(out) as bar:
        counts = execute(made, folder, place, retry=retry_failed, bar=bar)
    table = tune_table_of(out)
    typer.echo(f"{out}: {f'part {part}: ' if part else ''}{as_text(counts)}")
    for line in told(table):
        typer.echo(line)
    if not counts["left"]:
        from neuro.sweeps.tuning.page import write_page

        typer.echo(f"{write_page(table)}: written")
    name = shlex.quote(str(out))
    test = f", or neuro tune test {name}" if made.plan.folds else ""
    typer.echo(f"next: neuro tune table {name}, or neuro tune plot {name}{test}")


def told(table: TuneTable) -> list[str]:
    """The best trials, why others failed, and what the journal does not know."""
    from neuro.cli.sweep.going import failures
    from neuro.sweeps.folder import Folder

    best = table.best()
    lines = [
        f"best: {_named(dict(zip(table.plan.objectives, each.values or (), strict=True)))} "
        f"at {_named(each.point)} (trial {each.number})"
        for each in best[:10]
    ]
    if len(best) > 10:
        lines.append(f"and {len(best) - 10} more of the front, see the table")
    trials = table.trials()
    lines += failures(Folder(table.path), [item.key for trial in trials for item in trial.items])
    lines += [f"failed trial {each.number}: {each.error}" for each in trials if each.error.startswith("objective")][:5]
    if strays := table.strays():
        told = "are of no trial: the journal was cut; they are found when they are asked for again"
        lines.append(f"{strays:,} runs {told}")
    return lines


def _named(values: Mapping[str, Any]) -> str:
    from neuro.sweeps.rows import text

    return ", ".join(f"{name} {text(value)}" for name, value in values.items())
