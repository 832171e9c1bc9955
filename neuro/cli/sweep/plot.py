"""`neuro sweep plot`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.pictures import Format, write_pictures
from neuro.cli.sweep.options import Runs


class Kind(StrEnum):
    """Kinds of pictures."""

    auto = "auto"
    lines = "lines"
    map = "map"
    parallel = "parallel"


Metric = Annotated[list[str], typer.Option("--metric", metavar="NAME", help="Only this metric; repeatable.")]
Of = Annotated[list[str], typer.Option("--of", metavar="NAME", help="Only these parameters, in order; repeatable.")]
As = Annotated[Kind, typer.Option("--as", help="lines, map (of two parameters) or parallel; what fits if not given.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="FOLDER", help="Where to; into FOLDER if not given.")]
Form = Annotated[Format, typer.Option("--format", help="Of the pictures.")]


def plot(
    folder: Runs,
    metric: Metric = [],  # noqa: B006
    of: Of = [],  # noqa: B006
    kind: As = Kind.auto,
    out: Out = None,
    format: Form = Format.png,
) -> None:
    """Draw metrics over parameters: lines with the spread of seeds, a map of two, or all as parallel coordinates."""
    from neuro.sweeps.pictures import pictures
    from neuro.sweeps.table import table_of

    drawn = pictures(table_of(folder), metric, of, kind.value)
    write_pictures(drawn.items(), folder if out is None else out, format)
