"""`neuro verify`."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from neuro.verify.verify import Result

Folder = Annotated[Path, typer.Argument(metavar="FOLDER", help="Golden traces: NAME.json and NAME.npz of each case.")]
Chosen = Annotated[
    str | None,
    typer.Option("--backend", metavar="NAME", help="What to run on; if not given, the chip of the traces, or event."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def verify(folder: Folder, backend: Chosen = None, as_json: Json = False) -> None:
    """Compare a backend with golden traces; the exit status is 1 if a value is wrong."""
    from neuro.core.progress import Bar
    from neuro.program.backend import find_backend
    from neuro.verify.verify import verify as compare

    with Bar() as bar:
        results = compare(folder, find_backend(backend) if backend else None, progress=bar.say)
    if as_json:
        typer.echo(json.dumps([plain(result) for result in results], indent=2))
    else:
        tell(results)
    if not all(result.ok for result in results):
        raise typer.Exit(1)


def plain(result: Result) -> dict[str, Any]:
    """A result for JSON, which has no infinity: there the error is null."""
    return asdict(result) | ({} if math.isfinite(result.error) else {"error": None})


def tell(results: list[Result]) -> None:
    """Print a row for each quantity of each case, and the sum of it."""
    from neuro.core.tables import console, table

    columns = ("case", "quantity", ">deviation", ">accepted", "", "")
    rows = [
        (r.case, r.quantity, f"{r.error:.3g}", f"{r.limit:g}", "ok" if r.ok else "WRONG", r.message) for r in results
    ]
    console().print(table(columns, rows))
    cases = {result.case for result in results}
    wrong = {result.case for result in results if not result.ok}
    typer.echo(f"{len(cases) - len(wrong)} of {len(cases)} cases agree")
