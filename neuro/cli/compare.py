"""`neuro compare`."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import NetworkFile, Seed, Set, Threads, assignments, milliseconds

if TYPE_CHECKING:
    from neuro.compare.result import Comparison

Duration = Annotated[float, typer.Option("--for", metavar="MS", parser=milliseconds, help="How long, in ms.")]
Backends = Annotated[str, typer.Option(metavar="A,B,...", help="What to run on; others are compared with the first.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
JsonOut = Annotated[Path | None, typer.Option("--json-out", metavar="FILE", help="Write the JSON to a file, too.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with pictures, too.")]


def compare(
    file: NetworkFile,
    backends: Backends = "event,loihi,spinnaker",
    duration: Duration = 1000.0,
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    as_json: Json = False,
    json_out: JsonOut = None,
    html: Html = None,
) -> None:
    """Run a network on several backends and compare spikes, weights, counts and joules with the first."""
    from neuro.compare import compare as run
    from neuro.compare.report import PAGE
    from neuro.compare.result import JSON
    from neuro.core.clock import Clock
    from neuro.core.outputs import output
    from neuro.core.progress import Bar
    from neuro.model.language import load
    from neuro.run.progress import advance

    net = load(file, params=assignments(set))
    names = [name.strip() for name in backends.split(",") if name.strip()]
    Clock(net.resolution).step(duration, "--for")
    _check_apart(html, json_out)
    with Bar() as bar, ExitStack() as files:
        page_part = files.enter_context(output(html, PAGE)) if html else None
        json_part = files.enter_context(output(json_out, JSON)) if json_out else None
        bar.say("preparing")
        try:
            found = run(net, names, duration, seed, threads=threads, advance=lambda sim, n: advance(sim, n, bar))
        except KeyboardInterrupt:
            bar.stop()
            typer.echo("interrupted: nothing is compared", err=True)
            raise typer.Exit(130) from None
        write(found, page_part, json_part)
    tell(found, as_json, [out for out in (json_out, html) if out])


def write(found: Comparison, page_part: Path | None, json_part: Path | None) -> None:
    """Write the files that are asked for."""
    from neuro.compare.report import PAGE, page
    from neuro.compare.result import JSON

    if page_part:
        page_part.write_text(PAGE.seal(page(found)), "utf-8")
    if json_part:
        told = {**found.as_dict(), "provenance": dict(found.record)}
        json_part.write_text(JSON.seal(json.dumps(told, indent=2) + "\n"), "utf-8")


def plain(found: Comparison) -> str:
    """A comparison as JSON."""
    return json.dumps(found.as_dict(), indent=2)


def tell(found: Comparison, as_json: bool, written: list[Path]) -> None:
    """Print a comparison, and which files there are."""
    from neuro.compare.table import show
    from neuro.core.tables import console

    if as_json:
        typer.echo(plain(found))
        return
    show(found, console())
    for out in written:
        typer.echo(f"{out}: written")


def _check_apart(html: Path | None, json_out: Path | None) -> None:
    """Refuse to write two things to one file."""
    if html is not None and json_out is not None and html.resolve() == json_out.resolve():
        raise typer.BadParameter(f"'{json_out}' is the page already: expected another name", param_hint="'--json-out'")
