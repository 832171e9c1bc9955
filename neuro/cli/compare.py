"""`neuro compare`."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from neuro.cli.options import NetworkFile, Seed, Set, Threads, assignments, milliseconds

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
    import neuro
    from neuro.aside import aside
    from neuro.cli.progress import Bar, advance
    from neuro.cli.tables import console
    from neuro.clock import Clock
    from neuro.compare import compare as run
    from neuro.compare.report import page
    from neuro.compare.table import show

    net = neuro.load(file, params=assignments(set))
    names = [name.strip() for name in backends.split(",") if name.strip()]
    Clock(net.resolution).step(duration, "--for")
    for out in (html, json_out):
        spare(file, out)
    if html is not None and html == json_out:
        raise typer.BadParameter(f"'{html}' is the page already: expected another name", param_hint="'--json-out'")
    with Bar() as bar, ExitStack() as files:
        pages = files.enter_context(aside(html)) if html else None
        plain = files.enter_context(aside(json_out)) if json_out else None
        bar.say("preparing")
        try:
            found = run(net, names, duration, seed, threads=threads, advance=lambda sim, n: advance(sim, n, bar))
        except KeyboardInterrupt:
            bar.stop()
            typer.echo("interrupted: nothing is compared", err=True)
            raise typer.Exit(130) from None
        text = json.dumps(found.as_dict(), indent=2)
        if pages:
            pages.write_text(page(found), "utf-8")
        if plain:
            plain.write_text(text + "\n", "utf-8")
    if as_json:
        typer.echo(text)
        return
    show(found, console())
    for out in (json_out, html):
        if out:
            typer.echo(f"{out}: written")


def spare(file: Path, out: Path | None) -> None:
    """Refuse to write over the network."""
    from neuro.errors import ModelError

    if out is not None and out.exists() and out.resolve() == file.resolve():
        raise ModelError(f"{out}: this is the network itself: expected another name")
