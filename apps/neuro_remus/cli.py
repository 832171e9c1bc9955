"""Demonstrate ReMuS, a method of 'neuro recognise': train it on digits from event-camera recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from neuro.apps import Seed, resumable

app = typer.Typer(name="remus", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)


@app.callback()
def remus() -> None:
    """Train on digits from event-camera recordings (ReMuS). 'neuro recognise' has all other commands."""


@app.command()
def demo(
    data: Annotated[
        Path | None, typer.Option("--data", metavar="FOLDER", help="Folder of recordings.", show_default="generated")
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Folder for all results.")] = Path("demo"),
    seed: Seed = 0,
) -> None:
    """Make recordings, train, test on unseen ones, and write pictures and energy on chips."""
    from neuro_remus.demo import run

    with resumable():
        run(data, out, seed)
