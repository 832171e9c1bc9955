"""`neuro tune test`."""

from __future__ import annotations

import typer

from neuro.cli.sweep.options import On, Workers
from neuro.cli.tune.options import Tuned


def held_out(folder: Tuned, on: On = "cores", workers: Workers = None) -> None:
    """Run the best trials on what is held out from all folds, and tell what they are worth there."""
    from neuro.core.errors import ModelError
    from neuro.core.progress import Bar
    from neuro.sweeps.folder import TUNING, Folder
    from neuro.sweeps.place import place_of
    from neuro.sweeps.rows import text
    from neuro.sweeps.tuning.execute import hold_out
    from neuro.sweeps.tuning.search import search_of
    from neuro.sweeps.tuning.table import tune_table_of

    table = tune_table_of(folder)
    if not table.plan.folds:
        lack = f"{folder}: its trials have no folds, so nothing is held out from them"
        raise ModelError(lack, hint="'folds: 3' in the file, and a function that takes fold and folds")
    best = table.best()
    if not best:
        raise ModelError(f"{folder}: no trial is done yet: nothing to test")
    points = [each.point for each in best]
    with Bar() as bar:
        hold_out(search_of(Folder(folder, TUNING)), Folder(folder, TUNING), points, place_of(on, workers), bar)
    rows = {row["trial"]: row for row in table.rows()}
    for each in best:
        row = rows[each.number]
        aims = [(aim, text(row[aim]), text(row.get(f"test.{aim}"))) for aim in table.plan.objectives]
        told = "; ".join(f"{aim} {inside} in folds, {outside} held out" for aim, inside, outside in aims)
        typer.echo(f"trial {each.number}: {told}")
