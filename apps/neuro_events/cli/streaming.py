"""`neuro events listen` and `send`: streams by the network."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro import ModelError
from neuro.apps import NoBrowser, app, ending_by, milliseconds, refuse_unused
from neuro_events.cli.options import Force, From, In, Lenient, Sensor, To, count, events_so_far, going, spare

if TYPE_CHECKING:
    from neuro.apps import Bar, NoBrowser, app
    from neuro_events import Events, Listener

_STREAMED = "spif, spif-timed, faery13, faery8, raw-evt3; by tcp:// aedat4."
Received = Annotated[str | None, typer.Option("--from", metavar="FORMAT", help=f"What comes: {_STREAMED}")]
Sent = Annotated[str | None, typer.Option("--to", metavar="FORMAT", help=f"What is sent: {_STREAMED}")]
ListenAt = Annotated[
    str,
    typer.Argument(metavar="URL", help="udp://HOST:PORT of this machine, or tcp://HOST:PORT of a sender of AEDAT 4."),
]
SendTo = Annotated[
    str,
    typer.Argument(metavar="URL", help="udp://HOST:PORT of a receiver, or tcp://HOST:PORT to serve AEDAT 4 at."),
]
OutFile = Annotated[
    str | None, typer.Argument(metavar="OUT", help="The recording to write, - for standard output; none: only counts.")
]
TIME = {"metavar": "MS", "parser": milliseconds}
Silent = Annotated[
    Any, typer.Option("--until-silent", help="End when nothing came for so long after something.", **TIME)
]
First = Annotated[Any, typer.Option("--first-within", help="End when nothing at all came for so long.", **TIME)]
For = Annotated[Any, typer.Option("--for", help="End after so long.", **TIME)]

ShowStream = Annotated[bool, typer.Option("--page", help="Show the events in the browser, and write none.")]
FOR_EVER = 1e11
"""ms of a stream that is shown until Ctrl-C."""


def listen(
    context: typer.Context,
    url: ListenAt,
    target: OutFile = None,
    from_format: Received = None,
    sensor: Sensor = None,
    until_silent: Silent = None,
    first_within: First = None,
    duration: For = None,
    to_format: To = None,
    force: Force = False,
    page: ShowStream = False,
    no_browser: NoBrowser = False,
) -> None:
    """Receive events from the network, count them, and write them to a file; Ctrl-C or a kill ends and keeps it."""
    from neuro_events import listen as open_stream
    from neuro_events.convert import write
    from neuro_events.files import RECORDING

    ends = {"until_silent": until_silent, "first_within": first_within}
    seconds = {word: ms / 1000.0 for word, ms in ends.items() if ms is not None}
    if page and (target is not None or seconds):
        message = "--page: expected neither OUT nor --until-silent nor --first-within"
        raise ModelError(message, hint="neuro live --page --out FILE keeps events")
    if not page:
        refuse_unused(context, "--page", "no_browser")
    if target is not None:
        spare("-", target, RECORDING, force)
    else:
        refuse_unused(context, "OUT", "to_format", "force")
    with (
        open_stream(url, format=from_format, sensor=sensor, **seconds) as stream,
        going("nothing is written") as bar,
    ):
        if stream.url != url:
            typer.echo(f"listening at {stream.url}", err=True)
        begin = time.monotonic()
        if page:
            app("neuro_live.cli", "the page").show_stream(
                stream, FOR_EVER if duration is None else duration, no_browser
            )
            _tell(stream, time.monotonic() - begin, err=False)
            return
        stopped = threading.Event()
        no_room: list[int] = []

        def left_out(count: int) -> None:
            if not no_room:
                what = "has no room for the time or place of an event: such events are left out and counted"
                typer.echo(f"{target}: the format {what}; .aedat4 and .h5 have more room", err=True)
            no_room.append(count)

        parts = _until(stopped, stream, math.inf if duration is None else begin + duration / 1000.0, bar)
        with ending_by(stopped.set):
            if target is None:
                for _ in parts:
                    pass
            else:
                write(parts, target, to_format, replace=force, keep=True, left_out=left_out)
        _tell(stream, time.monotonic() - begin, target == "-", sum(no_room))


def _until(stopped: threading.Event, stream: Listener, end: float, bar: Bar) -> Iterator[Events]:
    """Parts of a stream, one at least, until it is stopped, a time, or its end."""
    say = events_so_far(bar)
    yield stream.take()
    while not stream.ended and not stopped.is_set() and (left := end - time.monotonic()) > 0:
        if stream.wait(min(left, 0.1)):
            yield stream.take()
            say(stream.counts.events)
            stopped.wait(0.01)
    yield stream.take()


def _tell(stream: Listener, seconds: float, err: bool, no_room: int = 0) -> None:
    counts = stream.counts
    pieces = "pieces" if stream.format == "aedat4" else "datagrams"
    found = f"{counts.events:,} events in {counts.datagrams:,} {pieces}, {seconds:.1f} s"
    lost_counts = counts.lost | ({"no_room": no_room} if no_room else {})
    lost = "".join(f"; {name.replace('_', ' ')}: {count:,}" for name, count in lost_counts.items())
    typer.echo(f"{stream.url}: {found}{lost}", err=err)


Speed = Annotated[
    float, typer.Option("--speed", metavar="X", help="Times as fast as it was recorded; inf: as fast as it goes.")
]
Bytes = Annotated[
    Any,
    typer.Option("--datagram", metavar="BYTES", parser=count, help="Of a datagram, at most; 512 for SPIF, else 1400."),
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
    """Send a recording by the network, each event at its time."""
    from neuro_events import send as send_events
    from neuro_events.convert import read

    with going("the rest is not sent") as bar:
        parts = read(source, from_format, sensor, not lenient)
        sent = send_events(url, parts, format=to_format, speed=speed, datagram=datagram, report=events_so_far(bar))
    late = f", at most {sent.latest_ms:.1f} ms late" if sent.latest_ms else ""
    typer.echo(f"{url}: {sent.events:,} events in {sent.datagrams:,} datagrams, {sent.seconds:.1f} s{late}")
