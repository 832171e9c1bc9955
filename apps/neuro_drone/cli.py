"""Learn to follow a ball or a line with an event camera on a drone."""

from __future__ import annotations

import typer

app = typer.Typer(
    name="drone", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


@app.callback()
def drone() -> None:
    """Learn to follow a ball or a line with an event camera on a drone."""
