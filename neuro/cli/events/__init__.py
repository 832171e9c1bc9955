"""`neuro events`: files of event cameras looked at, converted, filtered, cut, drawn and gathered; streams of events."""

from __future__ import annotations

from neuro.cli.events.looking import formats, gif, info, view
from neuro.cli.events.making import convert, filter, frames, split, tohdf5
from neuro.cli.events.streaming import listen, send
from neuro.cli.options import group

COMMANDS = (info, formats, convert, filter, split, frames, gif, view, tohdf5, listen, send)

app = group("events", "Look at, convert, filter, cut, draw, gather, receive and send the events of cameras.")
for command in COMMANDS:
    app.command()(command)
