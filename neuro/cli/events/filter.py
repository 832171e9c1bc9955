"""`neuro events filter`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Out, Sensor, To, events_so_far, going, named_part, spare

if TYPE_CHECKING:
    from neuro.events import Events
    from neuro.events.filters import Chain

Filters = Annotated[
    list[str], typer.Argument(metavar="FILTER...", help="A name, or 'name: {parameter: value}'; see --list.")
]


def filter(
    source: In,
    target: Out,
    filters: Filters,
    from_format: From = None,
    to_format: To = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
    list_all: Annotated[
        bool, typer.Option("--list", callback=lambda given: _list(given), help="List all filters.")
    ] = False,
) -> None:
    """Write a recording through filters, one after the other: 'tar: {tau: 0.08}' 'crop: {x: [0, 300]}'."""
    from neuro.events.convert import read, write
    from neuro.events.files import RECORDING

    spare(source, target, RECORDING, force)
    chosen = [_parsed(text) for text in filters]
    seen = 0

    def through() -> Iterator[Events]:
        nonlocal seen
        made: Chain | None = None
        for part in read(source, from_format, sensor, not lenient):
            made = made or _chain(part.sensor_size, chosen)
            seen += len(part)
            yield made(part)
        if made is not None:
            yield made.finish()

    with going(f"{target} is not written") as bar:
        done = write(through(), target, to_format, events_so_far(bar), force)
    typer.echo(f"{target}: {done:,} of {seen:,} events", err=target == "-")


def _parsed(text: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters of a filter, written as any choice in a network is."""
    from neuro.core.errors import ModelError, unknown
    from neuro.events.filters import FILTERS

    name, values = named_part(text, FILTERS, "filter", "FILTER")
    if name == "hot" and not values.get("pixels"):
        example = "such as 'hot: {pixels: [[8, 1], [205, 59]]}'"
        raise ModelError("filter 'hot': expected pixels", hint=f"{example}; 'neuro events info' lists the hot ones")
    known = _parameters(FILTERS[name])
    for key in values:
        if key not in known:
            raise unknown(f"parameter of filter '{name}'", str(key), known)
    if any(told.split()[0] == key and key not in values for key, told in known.items()):
        raise ModelError(f"filter '{name}': expected all of {', '.join(known)}")
    return name, values


def _parameters(kind: Any) -> dict[str, str]:
    """Each parameter of a filter with what it is if not given, and its unit where its name does not tell it."""
    from dataclasses import MISSING, fields

    own = [f for f in fields(kind) if f.init and f.name != "sensor_size"]
    told = {f.name: f.name if f.default is MISSING else f"{f.name}={f.default}" for f in own}
    return {name: f"{text} {kind.units[name]}" if name in kind.units else text for name, text in told.items()}


def _chain(size: tuple[int, int], chosen: Sequence[tuple[str, dict[str, Any]]]) -> Chain:
    from neuro.events.filters import FILTERS, Filter, chain

    made: list[Filter] = []
    for name, values in chosen:
        made.append(FILTERS[name](size, **values))
        size = made[-1].out_size
    return chain(*made)


def _list(given: bool) -> None:
    if not given:
        return
    from neuro.core.tables import console, table
    from neuro.events.filters import FILTERS

    rows = [
        (name, ", ".join(_parameters(kind).values()), (kind.__doc__ or "").partition("\n")[0])
        for name, kind in FILTERS.items()
    ]
    console().print(table(("filter", "parameters", "what it does"), rows))
    raise typer.Exit
