"""`neuro sweep page`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.sweep.options import Runs

Out = Annotated[Path | None, typer.Option(metavar="FILE", help="The page; sweep.html in FOLDER if not given.")]


def page(folder: Runs, out: Out = None) -> None:
    """Write one page that shows a sweep so far: metrics over parameters, all runs, what failed and why."""
    from neuro.sweeps.page import write_page
    from neuro.sweeps.table import table_of

    typer.echo(f"{write_page(table_of(folder), out)}: written")
