"""`neuro tune plot`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.pictures import Format, write_pictures
from neuro.cli.tune.options import Tuned


class Kind(StrEnum):
    """Kinds of pictures."""

    auto = "auto"
    history = "history"
    front = "front"
    importance = "importance"
    parallel = "parallel"


As = Annotated[
    list[Kind], typer.Option("--as", help="history, front (of two objectives), importance or parallel; repeatable.")
]
Out = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; into FOLDER if not given.")]
Form = Annotated[Format, typer.Option("--format", help="Of the pictures.")]


def plot(
    folder: Tuned,
    kind: As = [],  # noqa: B006
    out: Out = None,
    format: Form = Format.png,
) -> None:
    """Draw a tuning: the best value so far, the front, how much each parameter matters, parallel coordinates."""
    from neuro.sweeps.tuning.pictures import pictures
    from neuro.sweeps.tuning.table import tune_table_of

    kinds = [each.value for each in kind if each != Kind.auto]
    drawn = pictures(tune_table_of(folder), kinds)
    write_pictures(drawn.items(), folder if out is None else out, format)
