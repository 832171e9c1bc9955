"""`neuro report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

File = Annotated[Path, typer.Argument(metavar="FILE", help="Results that 'neuro run' wrote.")]
Out = Annotated[Path | None, typer.Option(metavar="FILE", help="The page to write; FILE with .html if not given.")]
Target = Annotated[str, typer.Option("--target", metavar="NAME", help="The chip, or a table's file, of the bill.")]

ENDINGS = (".html", ".htm")


def report(file: File, out: Out = None, target: Target = "loihi") -> None:
    """Write one page that shows a run: spikes, rates, traces, weights, counts and what a chip would take."""
    from neuro.chips.known import chip
    from neuro.core.errors import ModelError
    from neuro.core.outputs import check_output, output
    from neuro.files.results import read
    from neuro.report.page import PAGE, page

    path = file.with_suffix(".html") if out is None else out
    check_output(path, PAGE)
    if path.suffix.lower() not in ENDINGS:
        raise ModelError(f"--out {path}: a report is a page of HTML: expected a name ending in .html")
    chip(target)
    results = read(file)
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(results, file, target)), "utf-8")
    typer.echo(f"{path}: written")
