"""A network in real time: `neuro live`."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from neuro.cli.options import Backend, NetworkFile, Seed, Set, Threads, assignments, milliseconds
from neuro.cli.run import Record, keep_spikes

if TYPE_CHECKING:
    from neuro.model.network import Network
    from neuro.realtime import LiveRun, Source
    from neuro.run.simulation import Simulation


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


Tick = Annotated[float, typer.Option("--tick", metavar="MS", parser=milliseconds, help="The length of a tick, in ms.")]
Long = Annotated[
    float, typer.Option("--for", metavar="MS", parser=long_time, help="How long: in ms, or 10 s, 5 min, 1 h.")
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
Format = Annotated[str | None, typer.Option("--format", metavar="NAME", help="Of what comes by UDP: 'spif', for one.")]
WhenLate = Annotated[Late, typer.Option("--late", help="What to do when an action comes too late.")]
LiveOut = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="The HDF5 file to write; none if not given.")
]

REPORT_S = 10.0


def live(
    file: NetworkFile,
    tick: Tick = 1.0,
    duration: Long = 10_000.0,
    input: Input = [],  # noqa: B006
    format: Format = None,
    late: WhenLate = Late.catch_up,
    backend: Backend = "event",
    seed: Seed = 0,
    threads: Threads = 1,
    set: Set = [],  # noqa: B006
    record: Record = [],  # noqa: B006
    out: LiveOut = None,
) -> None:
    """Run a network in real time on live events; report latencies, misses and drops, and keep what it saw."""
    from neuro.core.outputs import check_output
    from neuro.files.results import KIND
    from neuro.model.language import load
    from neuro.realtime import Loop
    from neuro.run.compiled import compile as compiled

    net = load(file, params=assignments(set))
    keep_spikes(net, record)
    if out is not None:
        check_output(out, KIND)
    with ExitStack() as stack:
        streams = streamed(net, stack)
        sim = compiled(net, backend=backend, seed=seed, threads=threads)
        inputs = streams | sources(sim, input, format, stack)
        loop = Loop(sim, tick=tick, inputs=inputs, late=late.value)
        run = loop.run(duration, out=out, record=record, threads=threads, report=_Lines())
    typer.echo(str(run))
    if out is not None:
        typer.echo(f"{out}: {sim.time:g} ms; neuro rerun {out} makes it again")
    if run.ended:
        typer.echo(f"ended early: {run.ended}", err=True)
        raise typer.Exit(130 if run.ended == "interrupted" else 1)


def streamed(net: Network, stack: ExitStack) -> dict[str, Source]:
    """The streams that cameras of a network name, which become inputs of its loop; the stack closes them."""
    from neuro.events import listen
    from neuro.model.neurons import event_camera
    from neuro.model.parts import AUTO

    made: dict[str, Source] = {}
    for name, part in net.populations.items():
        model = part.model
        if isinstance(model, event_camera) and model.stream is not None:
            found = stack.enter_context(listen(model.stream, format=model.format, sensor=model.sensor))
            made[name] = found
            shape = model.seen(found.sensor_size) if AUTO in part.shape else part.shape
            model = replace(model, stream=None, format=None, sensor=None)
            net.populations[name] = replace(part, model=model, shape=shape)
    return made


def sources(sim: Simulation, texts: list[str], format: str | None, stack: ExitStack) -> dict[str, Source]:
    """Sources by the names of cameras, of NAME=FROM; the stack closes those that are open."""
    from neuro.compiler.cameras import CameraInput
    from neuro.events import listen
    from neuro.realtime import Player

    made: dict[str, Source] = {}
    for text in texts:
        name, equals, what = text.partition("=")
        if not equals or not name or not what:
            raise typer.BadParameter(f"'{text}': expected NAME=FILE or NAME=udp://HOST:PORT", param_hint="'--input'")
        camera = sim.handles.neurons(name).part.stream
        if "://" not in what:
            made[name] = Player(what)
        else:
            size = camera.sensor_size if isinstance(camera, CameraInput) and what.startswith("udp") else None
            made[name] = stack.enter_context(listen(what, format=format, sensor=size))
    return made


class _Lines:
    """A line about a live run now and then, on stderr: a bar that moves would take time from the ticks."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, run: LiveRun) -> None:
        seconds = (run.ticks + run.skipped) * run.tick_ms / 1000.0
        if seconds >= self._next + REPORT_S:
            self._next = seconds
            times = f"event to action p99 {run.latency.ms(0.99):.3f} ms, empty loop {run.empty.ms(0.99):.3f} ms"
            typer.echo(f"{seconds:,.0f} s: {times}, {run.misses:,} missed, {run.drops:,} drops", err=True)
