"""Inspect, convert, filter, cut, draw, pack, receive and send recordings of event cameras."""

from __future__ import annotations

from neuro.apps import group
from neuro_events.cli.looking import formats, gif, info, view
from neuro_events.cli.making import convert, filter, frames, split, tohdf5
from neuro_events.cli.streaming import listen, send

COMMANDS = (info, formats, convert, filter, split, frames, gif, view, tohdf5, listen, send)

app = group("events", str(__doc__))
for command in COMMANDS:
    app.command()(command)
