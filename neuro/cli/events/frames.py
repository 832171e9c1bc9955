"""`neuro events frames`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.cli.events.options import Force, From, In, Lenient, Sensor, named_part, spare

if TYPE_CHECKING:
    from neuro.events import Events

Target = Annotated[Path, typer.Argument(metavar="OUT.npz", help="The arrays: 'frames' and 'bounds'.")]
Kind = Annotated[str, typer.Option("--as", metavar="NAME", help="A representation, or 'name: {parameter: value}'.")]
Cut = Annotated[
    str | None, typer.Option("--cut", metavar="NAME", help="A segmenter, likewise; the whole if not given.")
]


def frames(
    source: In,
    target: Target,
    representation: Kind = "event_frame",
    cut: Cut = None,
    from_format: From = None,
    sensor: Sensor = None,
    lenient: Lenient = False,
    force: Force = False,
    list_all: Annotated[
        bool, typer.Option("--list", callback=lambda given: _list(given), is_eager=True, help="List what there is.")
    ] = False,
) -> None:
    """Make arrays of a recording, one of each segment: --cut 'count_segments: {count: 5000}' --as hats."""
    import numpy as np

    from neuro.core.errors import ModelError
    from neuro.core.outputs import output
    from neuro.events import load
    from neuro.events.representations import REPRESENTATIONS
    from neuro.events.segmentation import SEGMENTERS

    make, values = _chosen(representation, REPRESENTATIONS, "representation", "--as")
    cutter = None if cut is None else _chosen(cut, SEGMENTERS, "segmenter", "--cut")
    if target.suffix != ".npz":
        raise typer.BadParameter(f"'{target}': expected a name that ends in .npz", param_hint="OUT.npz")
    spare(source, target, _kind(), force)
    events: Events = load(source, format=from_format, sensor_size=sensor, strict=not lenient)
    bounds = np.array([0, len(events)]) if cutter is None else np.asarray(cutter[0](events.t, **cutter[1]))
    if len(bounds) < 2:
        raise ModelError(f"{source}: '{cut}' finds no segment in {len(events):,} events")
    arrays = np.stack([np.asarray(make(events[a:b], **values)) for a, b in pairwise(bounds)])
    with output(target, _kind(), force) as part, part.open("wb") as file:
        np.savez_compressed(file, frames=arrays, bounds=bounds)
    typer.echo(f"{target}: {len(arrays):,} of {representation}, {list(arrays.shape[1:])} {arrays.dtype}")


def _kind() -> Any:
    from neuro.core.outputs import Kind

    return Kind("arrays of frames", ask="--force")


def _chosen(
    text: str, registry: Mapping[str, Any], what: str, option: str
) -> tuple[Callable[..., Any], dict[str, Any]]:
    """A function of a registry and the values of its parameters, which it has."""
    from neuro.core.errors import unknown

    name, values = named_part(text, registry, what, option)
    known = _parameters(registry[name])
    for key in values:
        if key not in known:
            raise unknown(f"parameter of {what} '{name}'", str(key), known)
    for key, shown in known.items():
        if shown == key and key not in values:
            raise typer.BadParameter(f"'{text}': expected all of {', '.join(known.values())}", param_hint=f"'{option}'")
    return registry[name], values


def _parameters(function: Callable[..., Any]) -> dict[str, str]:
    """Each parameter behind the first, with its default; not those that only programs have a use for."""
    _, *others = inspect.signature(function).parameters.values()
    return {
        p.name: p.name if p.default is p.empty else f"{p.name}={p.default}"
        for p in others
        if p.name not in ("segments", "as_torch", "dtype")
    }


def _list(given: bool) -> None:
    if not given:
        return
    from neuro.core.tables import console, table
    from neuro.events.representations import REPRESENTATIONS
    from neuro.events.segmentation import SEGMENTERS

    for what, registry in (("representation", REPRESENTATIONS), ("segmenter", SEGMENTERS)):
        rows = [
            (name, ", ".join(_parameters(each).values()), (each.__doc__ or "").partition("\n")[0])
            for name, each in registry.items()
        ]
        console().print(table((what, "parameters", "what it does"), rows))
    raise typer.Exit
