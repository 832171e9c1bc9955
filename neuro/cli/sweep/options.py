"""Arguments that commands of `neuro sweep` share, some with those of `neuro tune`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.options import whole


def workers(text: str) -> int:
    """A whole number >= 1."""
    return whole(text, 1)


Runs = Annotated[Path, typer.Argument(metavar="FOLDER", help="A sweep, as 'neuro sweep run' writes it.")]
Out = Annotated[Path, typer.Option(metavar="FOLDER", help="Where runs are kept; what is there is not done again.")]
On = Annotated[
    str, typer.Option(metavar="WHERE", help="cores, here (this process), or a Dask scheduler: tcp://HOST:PORT, a file.")
]
Workers = Annotated[
    int | None, typer.Option(metavar="N", parser=workers, help="Processes; as many as there are cores if not given.")
]
Retry = Annotated[bool, typer.Option("--retry-failed", help="Do again what failed.")]
