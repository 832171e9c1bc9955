"""A network that runs beside the clock on the wall, with a page that shows and steers it: `neuro live`."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from neuro.cli.options import Backend, NetworkFile, Seed, Set, Threads, assignments, milliseconds, stoppable, whole


def speed(text: str) -> float:
    """A number > 0, "inf" as fast as possible."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number > 0:
        raise typer.BadParameter(f"'{text}': expected a number > 0, times real time, or inf")
    return number


ShowPage = Annotated[bool, typer.Option("--page", help="Serve a page that shows and steers the run.")]
Port = Annotated[
    int,
    typer.Option("--port", metavar="N", parser=lambda text: whole(text, 0), help="Of the page; any free one if 0."),
]
Host = Annotated[str, typer.Option("--host", metavar="NAME", help="Where the page can be reached.")]
Speed = Annotated[float, typer.Option("--speed", metavar="X", parser=speed, help="Times real time, or inf.")]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the address of the page, and open no browser.")]
Until = Annotated[float, typer.Option("--for", metavar="MS", parser=milliseconds, help="How long, in ms.")]


def live(
    file: NetworkFile,
    page: ShowPage = False,
    host: Host = "127.0.0.1",
    port: Port = 0,
    speed: Speed = 1.0,
    duration: Until = math.inf,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    no_browser: NoBrowser = False,
) -> None:
    """Run a network in real time, with a page in the browser that shows and steers it."""
    import webbrowser

    from neuro.core.errors import ModelError
    from neuro.live.page import Page
    from neuro.model.language import load
    from neuro.run.compiled import compile as compiled

    if not page:
        raise ModelError("neuro live: expected --page, which shows the run", hint="neuro run writes results")
    net = load(file, params=assignments(set))
    words: dict[str, Any] = {"backend": backend, "threads": threads}
    sim = compiled(net, seed=seed, **words)
    shown = Page(sim, host, port, speed=speed, restart=lambda seed: compiled(net, seed=seed, **words))
    with shown, stoppable(lambda: f"after {shown.sim.time:g} ms"):
        typer.echo(f"page: {shown.url}")
        if not no_browser:
            webbrowser.open(shown.url)
        shown.run(duration)
