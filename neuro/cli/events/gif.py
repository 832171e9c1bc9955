"""`neuro events gif`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Sensor, count, going, microseconds, named, spare, watched
from neuro.cli.options import milliseconds

Fps = Annotated[float, typer.Option("--fps", metavar="N", help="Frames per second, 0.1 to 50.")]
Window = Annotated[
    Any,
    typer.Option(
        "--window", metavar="MS", parser=milliseconds, help="Of a frame; 40 ms, or less for 25 frames at least."
    ),
]
Scale = Annotated[Any, typer.Option("--scale", metavar="N", parser=count, help="Size of a pixel; else 240 px or more.")]
Colours = Annotated[
    str, typer.Option("--colours", metavar="ON,OFF,BACK", help="Of ON, OFF and the background: names or #rrggbb.")
]


def gif(
    source: In,
    out: Annotated[str | None, typer.Argument(metavar="OUT", help="The GIF; IN.gif in the current folder.")] = None,
    fps: Fps = 25.0,
    window: Window = None,
    colours: Colours = "#0072B2,#D55E00,#FFFFFF",
    scale: Scale = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Draw a recording as a GIF; with --window 40 and --fps 25 time runs as it did, save long pauses, left out."""
    from neuro.events.convert import read
    from neuro.events.pictures import GIF, gif as draw

    names = colours.split(",")
    if len(names) != 3:
        raise typer.BadParameter(f"'{colours}': expected three colours, ON,OFF,BACK", param_hint="'--colours'")
    window_us = None if window is None else microseconds(window, "'--window'")
    target = f"{named(source)}.gif" if out is None else out
    if not target.lower().endswith(".gif"):
        raise typer.BadParameter(f"'{target}': expected a name that ends in .gif", param_hint="OUT")
    spare(source, target, GIF, force)
    with going(f"{target} is not written") as bar:
        parts = watched(read(source, from_format, sensor, not lenient), bar)
        made = draw(
            parts,
            target,
            fps=fps,
            window_us=window_us,
            colours=(names[0], names[1], names[2]),
            scale=scale,
            name=source,
            replace=force,
        )
    speed = made.window_us * made.fps / 1e6
    told = "as fast as it was" if abs(speed - 1) < 0.005 else f"{speed:.3g} times as fast as it was"
    frames = "1 frame" if made.frames == 1 else f"{made.frames:,} frames"
    without = f"; {made.left_out:,} still frames left out" if made.left_out else ""
    typer.echo(f"{target}: {frames} of {made.size[0]}x{made.size[1]} px, {made.fps:.4g} a second, {told}{without}")
