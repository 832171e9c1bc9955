"""`neuro events`: files of event cameras looked at, converted, filtered, cut, drawn and gathered."""

from __future__ import annotations

from neuro.cli.events.looking import formats, gif, info, view
from neuro.cli.events.making import convert, filter, frames, split, tohdf5
from neuro.cli.options import group

COMMANDS = (info, formats, convert, filter, split, frames, gif, view, tohdf5)

app = group("events", "Look at, convert, filter, cut, draw and gather the files of event cameras.")
for command in COMMANDS:
    app.command()(command)
