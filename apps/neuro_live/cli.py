"""A network in real time: `neuro live`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro import ModelError
from neuro.apps import (
    Backend,
    NetworkFile,
    NoBrowser,
    Record,
    Seed,
    Set,
    Threads,
    app,
    assignments,
    at_least,
    keep_spikes,
    milliseconds,
    refuse_unused,
    stoppable,
)

if TYPE_CHECKING:
    from neuro import Network, Simulation
    from neuro.realtime import LiveRun, Source
    from neuro_events import Listener
    from neuro_live import Page


MOST_STEPS = 2**31 - 1
"""Control steps of a run in a world that ends by Ctrl-C."""


class Late(StrEnum):
    """What to do when an action comes too late, as of `neuro.realtime.LATE`."""

    catch_up = "catch_up"
    skip = "skip"
    stop = "stop"


_LONG = {"min": 60_000.0, "h": 3_600_000.0}


def long_time(text: str) -> float:
    """A time > 0 ms: a number, or one with its unit, also minutes and hours."""
    for unit, ms in _LONG.items():
        if text.endswith(unit):
            return ms * milliseconds(text.removesuffix(unit).strip())
    return milliseconds(text)


def times_real_time(text: str) -> float:
    """A number > 0, "inf" as fast as possible."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number > 0:
        raise typer.BadParameter(f"'{text}': expected a number > 0, or inf")
    return number


Tick = Annotated[float, typer.Option("--tick", metavar="MS", parser=milliseconds, help="The length of a tick, in ms.")]
Long = Annotated[
    float | None,
    typer.Option(
        "--for",
        metavar="MS",
        parser=long_time,
        help="How long: in ms, or 10 s, 5 min, 1 h; 10 s if not given, for ever where a page keeps time.",
    ),
]
Input = Annotated[
    list[str],
    typer.Option(
        "--input",
        metavar="NAME=FROM",
        help="What an event camera sees: what comes to udp://HOST:PORT, or from tcp://HOST:PORT, or a file, which is "
        "played at its own pace; repeatable.",
    ),
]
From = Annotated[
    str | None, typer.Option("--from", metavar="FORMAT", help="What comes by UDP: spif, faery8, faery13 or raw-evt3.")
]
WhenLate = Annotated[
    Late, typer.Option("--late", metavar="catch_up|skip|stop", help="What to do when an action comes too late.")
]
LiveOut = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The HDF5 file to write; none if not given.")
]
ShowPage = Annotated[
    bool, typer.Option("--page", help="Show the run in the browser; without --input and --out the page keeps time.")
]
Host = Annotated[str, typer.Option("--host", metavar="NAME", help="Where the page listens.")]
Port = Annotated[int, typer.Option("--port", metavar="N", parser=at_least(0), help="Of the page; 0: any free one.")]
Speed = Annotated[
    float | None,
    typer.Option("--speed", metavar="X", parser=times_real_time, help="With --page: times real time, or inf."),
]

REPORT_S = 10.0
STREAM_TICK = 10.0
"""ms between two looks at a stream that is shown only."""


def live(
    context: typer.Context,
    file: NetworkFile,
    tick: Tick = 1.0,
    duration: Long = None,
    input: Input = [],  # noqa: B006
    from_format: From = None,
    late: WhenLate = Late.catch_up,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    record: Record = [],  # noqa: B006
    out: LiveOut = None,
    page: ShowPage = False,
    host: Host = "127.0.0.1",
    port: Port = 0,
    speed: Speed = None,
    no_browser: NoBrowser = False,
) -> None:
    """Run a network in real time on live events; report latencies, misses and drops, and keep what it saw."""
    from neuro import compile as compiled, load
    from neuro.apps import KIND, check_output
    from neuro.realtime import Loop

    if not any("=udp://" in text for text in input):
        refuse_unused(context, "an --input from udp://", "from_format")
    if not page:
        refuse_unused(context, "--page", "host", "port", "no_browser")
        if out is None:
            refuse_unused(context, "--out or --page", "record")
    net = load(file, params=assignments(set))
    keep_spikes(net, record)
    if out is not None:
        check_output(out, KIND)

    if net.world_section is not None:
        if not page or input or out is not None:
            message = f"{file}: the network has a world: expected --page, and neither --input nor --out"
            raise ModelError(message, hint="neuro run writes what it does there")
        _show_world(net, host, port, speed or 1.0, no_browser, duration, backend=backend, seed=seed, threads=threads)
        return

    def simulation(seed: int) -> Simulation:
        return compiled(net, backend=backend, seed=seed, threads=threads)

    lines = _Lines()
    with ExitStack() as stack:
        streams = streamed(net, stack)
        paced = _is_paced(page, speed, {"--input": input, "--out": out, "stream": streams})
        if paced:
            refuse_unused(context, "--input, --out or a stream", "tick", "late")
        sim = simulation(seed)
        shown = None
        if page:
            from neuro_live import Page

            words = {"speed": speed or 1.0, "restart": simulation} if paced else {"figures": lambda: lines.figures}
            shown = stack.enter_context(Page(sim, host, port, **words))
            announce(shown, no_browser)
        if shown is not None and paced:
            with stoppable(lambda: f"at {shown.sim.time:g} ms"):
                shown.run(math.inf if duration is None else duration)
            return
        inputs = sources(sim, streams, input, from_format, stack)
        watch = None if shown is None else shown.tick
        loop = Loop(sim, tick=tick, inputs=inputs, late=late.value, watch=watch)
        run = loop.run(duration or 10_000.0, out=out, record=record, threads=threads, report=lines)
    typer.echo(str(run))
    if out is not None:
        typer.echo(f"{out}: {sim.time:g} ms; neuro rerun {out} makes it again")
    if run.ended:
        typer.echo(f"ended early: {run.ended}", err=True)
        raise typer.Exit(130 if run.ended == "interrupted" else 1)


def _show_world(
    net: Network, host: str, port: int, speed: float, no_browser: bool, duration: float | None, **words: Any
) -> None:
    """Let a network act and learn in its world, in one block, and show it on a page at a pace."""
    from neuro import closed_loop
    from neuro_live import Page
    from neuro_live.page import KEPT_MS

    loop = closed_loop(net, record=True, block=MOST_STEPS, **words)
    pages: list[Page] = []

    def figures() -> dict[str, str]:
        return {"episodes": f"{len(loop.log):,}", "mean return of the last 100": f"{loop.log.mean(100):.5g}"}

    def watch() -> None:
        if not pages:  # the simulation of the block is there once it has begun
            pages.append(stack.enter_context(Page(loop.sim, host, port, speed=speed, figures=figures)))
            announce(pages[0], no_browser)
        pages[0].tick()
        loop.sim.forget(max(loop.sim.held, loop.sim.time - KEPT_MS))
        loop.actions.clear()
        loop.rewards.clear()

    loop.watch = watch
    with ExitStack() as stack, stoppable(lambda: f"{loop.steps:,} control steps, {len(loop.log):,} episodes"):
        loop.run(**({"steps": MOST_STEPS} if duration is None else {"ms": duration}))


def announce(page: Page, no_browser: bool, err: bool = False) -> None:
    """Print the address of a page, on stderr if asked, and open it."""
    typer.echo(f"page: {page.url}", err=err)
    if not no_browser:
        page.open()


def show_stream(stream: Listener, ms: float, no_browser: bool) -> None:
    """Show the events of a stream on a page, as those of a camera that drives nothing, for so long or until Ctrl-C."""
    from neuro import Network, compile as compiled, event_camera
    from neuro.realtime import Loop
    from neuro_live import Page

    width, height = stream.sensor_size
    net = Network("stream", resolution=1.0)
    net.population("camera", (2, height, width), event_camera())
    sim, lines = compiled(net), _Lines()
    with Page(sim, figures=lambda: lines.figures) as page:
        announce(page, no_browser)
        loop = Loop(sim, tick=STREAM_TICK, inputs={"camera": stream}, watch=page.tick)
        loop.run(math.ceil(ms / STREAM_TICK) * STREAM_TICK, report=lines)


def _is_paced(page: bool, speed: float | None, real_time: Mapping[str, object]) -> bool:
    """Whether a page keeps the time, as nothing else does."""
    others = [word for word, given in real_time.items() if given]
    if speed is not None and (others or not page):
        expected = f"no {others[0]}, which runs in real time" if others else "--page, which keeps the speed"
        raise ModelError(f"--speed {speed:g}: expected {expected}")
    return page and not others


def streamed(net: Network, stack: ExitStack) -> dict[str, Source]:
    """The streams that cameras of a network name, which become inputs of its loop; the stack closes them."""
    from neuro import event_camera
    from neuro.apps import AUTO

    made: dict[str, Source] = {}
    for name, part in net.populations.items():
        model = part.model
        if isinstance(model, event_camera) and model.stream is not None:
            found = stack.enter_context(_listen(model.stream, format=model.format, sensor=model.sensor))
            made[name] = found
            shape = model.visible_shape(found.sensor_size) if AUTO in part.shape else part.shape
            model = replace(model, stream=None, format=None, sensor=None)
            net.populations[name] = replace(part, model=model, shape=shape)
    return made


def sources(
    sim: Simulation, streams: Mapping[str, Source], texts: list[str], format: str | None, stack: ExitStack
) -> dict[str, Source]:
    """The streams and the sources of NAME=FROM, by the names of cameras; the stack closes those that are open."""
    from neuro.apps import CameraInput

    made = dict(streams)
    for text in texts:
        name, equals, what = text.partition("=")
        if not equals or not name or not what:
            raise typer.BadParameter(f"'{text}': expected NAME=FILE or NAME=udp://HOST:PORT", param_hint="'--input'")
        if name in made:
            raise typer.BadParameter(f"'{text}': '{name}' has an input already", param_hint="'--input'")
        camera = sim.handles.neurons(name).part.stream
        if "://" not in what:
            made[name] = app("neuro_events.player", "--input: the reader of recordings").Player(what)
        else:
            size = camera.sensor_size if isinstance(camera, CameraInput) and what.startswith("udp") else None
            made[name] = stack.enter_context(_listen(what, format=format, sensor=size))
    return made


def _listen(url: str, **words: Any) -> Any:
    return app("neuro_events", "the receiver of streams").listen(url, **words)


class _Lines:
    """A line about a live run now and then, on stderr: a bar that moves would take time from the ticks."""

    def __init__(self) -> None:
        self._next = 0.0
        self.figures: dict[str, str] = {}

    def __call__(self, run: LiveRun) -> None:
        self.figures = dict(_figures(run))
        seconds = (run.ticks + run.skipped) * run.tick_ms / 1000.0
        if seconds >= self._next + REPORT_S:
            self._next = seconds
            times = f"event to action p99 {run.latency.texts[1]} ms, empty loop {run.empty.texts[1]} ms"
            typer.echo(f"{seconds:,.0f} s: {times}, {run.misses:,} missed, {run.drops:,} drops", err=True)


def _figures(run: LiveRun) -> Iterator[tuple[str, str]]:
    """What a page shows of a live run."""
    for name, found in (("event to action", run.latency), ("tick to action", run.response), ("empty loop", run.empty)):
        yield f"{name}: p50, p99, largest", f"{', '.join(found.texts)} ms"
    yield "ticks missed", f"{run.misses:,} of {run.ticks:,}"
    yield "events dropped", f"{run.drops:,}"
    yield "lost by sources", f"{run.losses:,}"
