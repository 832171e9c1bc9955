"""`neuro tune page`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.tune.options import Tuned

Out = Annotated[Path | None, typer.Option(metavar="FILE", help="The page; tune.html in FOLDER if not given.")]


def page(folder: Tuned, out: Out = None) -> None:
    """Write one page that shows a tuning so far: best, front, all trials, what failed and why."""
    from neuro.sweeps.tuning.page import write_page
    from neuro.sweeps.tuning.table import tune_table_of

    typer.echo(f"{write_page(tune_table_of(folder), out)}: written")
