"""`neuro events convert`."""

from __future__ import annotations

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Out, Sensor, To, events_so_far, going, spare


def convert(
    source: In,
    target: Out,
    from_format: From = None,
    to_format: To = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
) -> None:
    """Write a recording in another format, which the ending of OUT tells."""
    from neuro.events.convert import convert as write
    from neuro.events.files import RECORDING

    spare(source, target, RECORDING, force)
    with going(f"{target} is not written") as bar:
        done = write(
            source, target, from_format=from_format, to_format=to_format, sensor_size=sensor, strict=not lenient,
            report=events_so_far(bar), replace=force,
        )  # fmt: skip
    typer.echo(f"{target}: {done:,} events", err=target == "-")
