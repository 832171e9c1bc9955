"""Running a network in real time: `neuro live`."""

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
"""Number of control steps of a run in a world without a time limit."""


class Late(StrEnum):
    """Reaction to a missed deadline; see `neuro.realtime.LATE`."""

    catch_up = "catch_up"
    skip = "skip"
    stop = "stop"


_LONG = {"min": 60_000.0, "h": 3_600_000.0}


def long_time(text: str) -> float:
    """Parse a time > 0, such as "20" (ms), "10 s", "5 min" or "1 h"; return ms."""
    for unit, ms in _LONG.items():
        if text.endswith(unit):
            return ms * milliseconds(text.removesuffix(unit).strip())
    return milliseconds(text)


def times_real_time(text: str) -> float:
    """Parse a speed > 0 as a multiple of real time; "inf" is as fast as possible."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number > 0:
        raise typer.BadParameter(f"'{text}': expected a number > 0, or inf")
    return number


Tick = Annotated[
    float,
    typer.Option(
        "--tick", metavar="MS", parser=milliseconds, help="Interval in ms at which events are read and actions are due."
    ),
]
Long = Annotated[
    float | None,
    typer.Option(
        "--for",
        metavar="MS",
        parser=long_time,
        help="Duration in ms, or e.g. 10 s, 5 min, 1 h; by default 10 s, or no end if the page controls the speed.",
    ),
]
Input = Annotated[
    list[str],
    typer.Option(
        "--input",
        metavar="NAME=FROM",
        help="Events for the event camera NAME: received at udp://HOST:PORT, from the server tcp://HOST:PORT, or from "
        "a recording, which is played in real time; repeatable.",
    ),
]
From = Annotated[
    str | None, typer.Option("--from", metavar="FORMAT", help="Format of UDP events: spif, faery8, faery13, raw-evt3.")
]
WhenLate = Annotated[
    Late,
    typer.Option(
        "--late",
        metavar="catch_up|skip|stop",
        help="After a late action: catch up, skip the ticks that are past, or stop.",
    ),
]
LiveOut = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="HDF5 file of the results and the input; by default none.")
]
ShowPage = Annotated[
    bool,
    typer.Option(
        "--page",
        help="Show the run in the browser, which sets the speed if no --input, --out or stream is used.",
    ),
]
Host = Annotated[str, typer.Option("--host", metavar="NAME", help="Name or address at which the page listens.")]
Port = Annotated[
    int, typer.Option("--port", metavar="N", parser=at_least(0), help="Port of the page; 0 for any free port.")
]
Speed = Annotated[
    float | None,
    typer.Option(
        "--speed",
        metavar="X",
        parser=times_real_time,
        help="Speed with --page, as a multiple of real time or inf; by default 1.",
    ),
]

REPORT_S = 10.0
"""Interval between two printed lines, s."""
STREAM_TICK = 10.0
"""Interval between two reads of a stream that is only displayed, ms."""


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
    """Run a network in real time on live events; report latencies, missed deadlines and dropped events."""
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
            raise ModelError(message, hint="neuro run writes the results of a network with a world")
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
        live_page = None
        if page:
            from neuro_live import Page

            options = {"speed": speed or 1.0, "restart": simulation} if paced else {"figures": lambda: lines.figures}
            live_page = stack.enter_context(Page(sim, host, port, **options))
            announce(live_page, no_browser)
        if live_page is not None and paced:
            with stoppable(lambda: f"at {live_page.sim.time:g} ms"):
                live_page.run(math.inf if duration is None else duration)
            return
        inputs = sources(sim, streams, input, from_format, stack)
        watch = None if live_page is None else live_page.tick
        loop = Loop(sim, tick=tick, inputs=inputs, late=late.value, watch=watch)
        run = loop.run(duration or 10_000.0, out=out, record=record, threads=threads, report=lines)
    typer.echo(str(run))
    if out is not None:
        typer.echo(f"{out}: {sim.time:g} ms; neuro rerun {out} repeats the run")
    if run.ended:
        typer.echo(f"ended early: {run.ended}", err=True)
        raise typer.Exit(130 if run.ended == "interrupted" else 1)


def _show_world(
    net: Network, host: str, port: int, speed: float, no_browser: bool, duration: float | None, **words: Any
) -> None:
    """Run a network and the world with learning, as a single block of `closed_loop`, and show the run on a page."""
    from neuro import closed_loop
    from neuro_live import Page
    from neuro_live.page import KEPT_MS

    loop = closed_loop(net, record=True, block=MOST_STEPS, **words)
    pages: list[Page] = []

    def figures() -> dict[str, str]:
        return {"episodes": f"{len(loop.log):,}", "mean return of the last 100": f"{loop.log.mean(100):.5g}"}

    def watch() -> None:
        if not pages:  # the block's simulation exists only after the block has begun
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
    """Print the address of a page, to stderr if `err`, and open the page unless `no_browser`."""
    typer.echo(f"page: {page.url}", err=err)
    if not no_browser:
        page.open()


def show_stream(stream: Listener, ms: float, no_browser: bool) -> None:
    """Show the events of a stream on a page for `ms` milliseconds or until Ctrl-C.

    A network of one camera population without synapses receives the events.
    """
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
    """Return whether the page controls the speed, i.e. no option in `real_time` needs real time.

    Raises:
        ModelError: there is a speed without a page that controls it.
    """
    names = [name for name, value in real_time.items() if value]
    if speed is not None and (names or not page):
        expected = f"no {names[0]}, which runs in real time" if names else "--page, which keeps the speed"
        raise ModelError(f"--speed {speed:g}: expected {expected}")
    return page and not names


def streamed(net: Network, stack: ExitStack) -> dict[str, Source]:
    """Open the streams named by the cameras of a network and return them by camera; the stack closes them.

    The cameras are replaced by cameras without a stream, because the loop reads the streams.
    """
    from neuro import event_camera
    from neuro.apps import AUTO

    streams: dict[str, Source] = {}
    for name, part in net.populations.items():
        model = part.model
        if isinstance(model, event_camera) and model.stream is not None:
            stream = stack.enter_context(_listen(model.stream, format=model.format, sensor=model.sensor))
            streams[name] = stream
            shape = model.visible_shape(stream.sensor_size) if AUTO in part.shape else part.shape
            model = replace(model, stream=None, format=None, sensor=None)
            net.populations[name] = replace(part, model=model, shape=shape)
    return streams


def sources(
    sim: Simulation, streams: Mapping[str, Source], texts: list[str], format: str | None, stack: ExitStack
) -> dict[str, Source]:
    """Open the sources of the texts NAME=FROM and return all sources by camera; the stack closes them.

    Args:
        sim: the simulation with the cameras.
        streams: sources that are already open.
        texts: values of `--input`.
        format: format of UDP events; None for the default.
        stack: context that closes the sources.
    """
    from neuro.apps import CameraInput

    inputs = dict(streams)
    for text in texts:
        name, equals, origin = text.partition("=")
        if not equals or not name or not origin:
            raise typer.BadParameter(f"'{text}': expected NAME=FILE or NAME=udp://HOST:PORT", param_hint="'--input'")
        if name in inputs:
            raise typer.BadParameter(f"'{text}': '{name}' has an input already", param_hint="'--input'")
        camera = sim.handles.neurons(name).part.stream
        if "://" not in origin:
            inputs[name] = app("neuro_events.player", "--input: the reader of recordings").Player(origin)
        else:
            size = camera.sensor_size if isinstance(camera, CameraInput) and origin.startswith("udp") else None
            inputs[name] = stack.enter_context(_listen(origin, format=format, sensor=size))
    return inputs


def _listen(url: str, **words: Any) -> Any:
    return app("neuro_events", "the receiver of streams").listen(url, **words)


class _Lines:
    """Printer of a line about a live run to stderr, every 10 s. A moving progress bar would delay the ticks."""

    def __init__(self) -> None:
        self._next_s = 0.0
        self.figures: dict[str, str] = {}

    def __call__(self, run: LiveRun) -> None:
        self.figures = dict(_figures(run))
        seconds = (run.ticks + run.skipped) * run.tick_ms / 1000.0
        if seconds >= self._next_s + REPORT_S:
            self._next_s = seconds
            times = f"event to action p99 {run.latency.texts[1]} ms, empty loop {run.empty.texts[1]} ms"
            typer.echo(f"{seconds:,.0f} s: {times}, {run.misses:,} missed, {run.drops:,} drops", err=True)


def _figures(run: LiveRun) -> Iterator[tuple[str, str]]:
    """Yield the figures of a live run for its page, as pairs of name and text."""
    for name, times in (("event to action", run.latency), ("tick to action", run.response), ("empty loop", run.empty)):
        yield f"{name}: p50, p99, largest", f"{', '.join(times.texts)} ms"
    yield "ticks missed", f"{run.misses:,} of {run.ticks:,}"
    yield "events dropped", f"{run.drops:,}"
    yield "lost by sources", f"{run.losses:,}"
