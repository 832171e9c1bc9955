"""`neuro events gif`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Sensor, count, going, microseconds, spare
from neuro.cli.options import milliseconds

Fps = Annotated[float, typer.Option("--fps", metavar="N", help="Frames per second, up to 50.")]
Window = Annotated[float, typer.Option("--window", metavar="MS", parser=milliseconds, help="Time of a frame, in ms.")]
Scale = Annotated[Any, typer.Option("--scale", metavar="N", parser=count, help="Size of a pixel; else 240 px or more.")]
Colours = Annotated[
    str, typer.Option("--colours", metavar="ON,OFF,BACK", help="Of ON, OFF and the background: names or #rrggbb.")
]


def gif(
    source: In,
    target: Annotated[str, typer.Argument(metavar="OUT", help="The GIF to write.")],
    fps: Fps = 25.0,
    window: Window = 40.0,
    colours: Colours = "#0072B2,#D55E00,#FFFFFF",
    scale: Scale = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Draw a recording as a GIF; with --window 40 and --fps 25 time runs as it did."""
    from neuro.events.convert import read
    from neuro.events.pictures import gif as draw

    names = colours.split(",")
    if len(names) != 3:
        raise typer.BadParameter(f"'{colours}': expected three colours, ON,OFF,BACK", param_hint="'--colours'")
    window_us = microseconds(window, "'--window'")
    spare(source, target, force)
    with going(f"{target} is not written") as bar:
        bar.say("drawing")
        parts = read(source, from_format, sensor, not lenient)
        made = draw(parts, target, fps=fps, window_us=window_us, colours=(names[0], names[1], names[2]), scale=scale)
    speed = window_us * made.fps / 1e6
    told = "as fast as it was" if abs(speed - 1) < 0.005 else f"{speed:.3g} times as fast as it was"
    typer.echo(f"{target}: {made.frames} frames of {made.size[0]}x{made.size[1]} px, {made.fps:.4g} a second, {told}")
