"""Learn to recognise digits from event-camera recordings (ReMuS): the demonstration; 'neuro recognise' has the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import Seed, resumable

app = typer.Typer(name="remus", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


@app.callback()
def remus() -> None:
    """Learn to recognise digits from event-camera recordings (ReMuS); 'neuro recognise' has all other commands."""


@app.command()
def demo(
    data: Annotated[
        Path | None, typer.Option("--data", metavar="FOLDER", help="Recordings; made here if not given.")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where everything goes.")] = Path("demo"),
    seed: Seed = 0,
) -> None:
    """Make recordings, learn, test on unseen ones, draw, price."""
    from neuro_remus.demo import run

    with resumable():
        run(data, out, seed)
