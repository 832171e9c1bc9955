"""The commands `neuro events listen` and `send`, which receive and send events over the network."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro import ModelError
from neuro.apps import NoBrowser, app, ending_by, milliseconds, refuse_unused
from neuro_events.cli.options import (
    Force,
    From,
    In,
    Lenient,
    Sensor,
    To,
    check_target,
    count,
    events_so_far,
    progress,
    sensor,
)

if TYPE_CHECKING:
    from neuro.apps import Bar, NoBrowser, app
    from neuro_events import Events, Listener

_STREAMED = "spif, spif-timed, faery13, faery8 or raw-evt3; aedat4 for tcp://."
Received = Annotated[str | None, typer.Option("--from", metavar="FORMAT", help=f"Format of the stream: {_STREAMED}")]
Sent = Annotated[str | None, typer.Option("--to", metavar="FORMAT", help=f"Format of the stream: {_STREAMED}")]
ListenAt = Annotated[
    str,
    typer.Argument(metavar="URL", help="udp://HOST:PORT of this machine, or tcp://HOST:PORT of an AEDAT 4 sender."),
]
SendTo = Annotated[
    str,
    typer.Argument(
        metavar="URL", help="udp://HOST:PORT of a receiver, or tcp://HOST:PORT of this machine to serve AEDAT 4."
    ),
]
StreamSensor = Annotated[
    Any, typer.Option("--sensor", metavar="WxH", parser=sensor, help="Sensor size, px. Required for udp://.")
]
OutFile = Annotated[
    str | None,
    typer.Argument(metavar="OUT", help="The recording to write, - for standard output. Default: only counts."),
]
TIME = {"metavar": "MS", "parser": milliseconds}
Silent = Annotated[
    Any, typer.Option("--until-silent", help="Longest silence after the first data, ms; then the command ends.", **TIME)
]
First = Annotated[
    Any, typer.Option("--first-within", help="Longest wait for the first data, ms; then the command ends.", **TIME)
]
For = Annotated[Any, typer.Option("--for", help="Duration, ms. Default: until Ctrl-C.", **TIME)]

ShowStream = Annotated[bool, typer.Option("--page", help="Show the events in the browser instead of writing a file.")]
FOR_EVER = 1e11
"""Duration of a page without --for, ms, which ends at Ctrl-C."""


def listen(
    context: typer.Context,
    url: ListenAt,
    target: OutFile = None,
    from_format: Received = None,
    sensor: StreamSensor = None,
    until_silent: Silent = None,
    first_within: First = None,
    duration: For = None,
    to_format: To = None,
    force: Force = False,
    page: ShowStream = False,
    no_browser: NoBrowser = False,
) -> None:
    """Receive events from the network, count them, and write a file. Ctrl-C or SIGTERM completes the file."""
    from neuro_events import listen as open_stream
    from neuro_events.convert import write
    from neuro_events.files import RECORDING

    ends = {"until_silent": until_silent, "first_within": first_within}
    seconds = {word: ms / 1000.0 for word, ms in ends.items() if ms is not None}
    if page and (target is not None or seconds):
        message = "--page: expected neither OUT nor --until-silent nor --first-within"
        raise ModelError(message, hint="neuro live --page --out FILE also writes the events")
    if not page:
        refuse_unused(context, "--page", "no_browser")
    if target is not None:
        check_target("-", target, RECORDING, force)
    else:
        refuse_unused(context, "OUT", "to_format", "force")
    with (
        open_stream(url, format=from_format, sensor=sensor, **seconds) as stream,
        progress("nothing is written") as bar,
    ):
        if stream.url != url:
            typer.echo(f"listening at {stream.url}", err=True)
        begin = time.monotonic()
        if page:
            app("neuro_live.cli", "the page").show_stream(
                stream, FOR_EVER if duration is None else duration, no_browser
            )
            _print_counts(stream, time.monotonic() - begin, err=False)
            return
        stopped = threading.Event()
        dropped: list[int] = []

        def left_out(count: int) -> None:
            if not dropped:
                problem = "cannot store the time or position of an event; such events are dropped and counted"
                typer.echo(f"{target}: the format {problem}. .aedat4 and .h5 have wider ranges", err=True)
            dropped.append(count)

        parts = _received_parts(stopped, stream, math.inf if duration is None else begin + duration / 1000.0, bar)
        with ending_by(stopped.set):
            if target is None:
                for _ in parts:
                    pass
            else:
                write(parts, target, to_format, replace=force, keep=True, left_out=left_out)
        _print_counts(stream, time.monotonic() - begin, target == "-", sum(dropped))


def _received_parts(stopped: threading.Event, stream: Listener, end: float, bar: Bar) -> Iterator[Events]:
    """Yield the parts of a stream, at least one, until the stop signal, the end time or the end of the stream."""
    report = events_so_far(bar)
    yield stream.take()
    while not stream.ended and not stopped.is_set() and (remaining_s := end - time.monotonic()) > 0:
        if stream.wait(min(remaining_s, 0.1)):
            yield stream.take()
            report(stream.counts.events)
            stopped.wait(0.01)
    stream.close()
    yield stream.take()


def _print_counts(stream: Listener, seconds: float, err: bool, no_room: int = 0) -> None:
    """Print the numbers of received and lost events. The format of OUT could not store `no_room` events."""
    counts = stream.counts
    pieces = "pieces" if stream.format == "aedat4" else "datagrams"
    received = f"{counts.events:,} events in {counts.datagrams:,} {pieces}, {seconds:.1f} s"
    lost_counts = counts.lost | ({"no_room": no_room} if no_room else {})
    losses = "".join(f"; {name.replace('_', ' ')}: {count:,}" for name, count in lost_counts.items())
    typer.echo(f"{stream.url}: {received}{losses}", err=err)


Speed = Annotated[
    float, typer.Option("--speed", metavar="X", help="Speed relative to real time; inf: as fast as possible.")
]
Bytes = Annotated[
    Any,
    typer.Option(
        "--datagram",
        metavar="BYTES",
        parser=count,
        help="Largest size of a datagram, bytes. Default: 512 for SPIF, else 1400.",
    ),
]


def send(
    source: In,
    url: SendTo,
    to_format: Sent = None,
    speed: Speed = 1.0,
    datagram: Bytes = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
) -> None:
    """Send a recording over the network in real time."""
    from neuro_events import send as send_events
    from neuro_events.convert import read

    with progress("the rest is not sent") as bar:
        parts = read(source, from_format, sensor, not lenient)
        counts = send_events(url, parts, format=to_format, speed=speed, datagram=datagram, report=events_so_far(bar))
    delay = f", at most {counts.latest_ms:.1f} ms late" if counts.latest_ms else ""
    typer.echo(f"{url}: {counts.events:,} events in {counts.datagrams:,} datagrams, {counts.seconds:.1f} s{delay}")
