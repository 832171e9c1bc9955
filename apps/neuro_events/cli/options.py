"""Options and helpers shared by the commands for event files."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from neuro.apps import Bar, stoppable, whole

if TYPE_CHECKING:
    from neuro.apps import Kind
    from neuro_events import Events


def sensor(text: str) -> tuple[int, int]:
    """Parse a width and height such as 346x260."""
    sides = re.fullmatch(r"([1-9]\d{0,4})[x×]([1-9]\d{0,4})", text)
    if sides is None:
        raise typer.BadParameter(f"'{text}': expected WIDTHxHEIGHT in px, such as 346x260")
    return int(sides[1]), int(sides[2])


def count(text: str) -> int:
    """Parse a whole number >= 1."""
    return whole(text, 1)


def microseconds(ms: float, option: str) -> int:
    """Convert ms to whole us. A fraction of a microsecond is an error."""
    us = ms * 1000.0
    if abs(us - round(us)) > 1e-6 or round(us) < 1:
        raise typer.BadParameter(f"'{ms:g}': expected a whole number of us, such as 0.001 or 40 ms", param_hint=option)
    return round(us)


In = Annotated[str, typer.Argument(metavar="IN", help="Recording to read; - for standard input.")]
Out = Annotated[str, typer.Argument(metavar="OUT", help="File to write; - for standard output.")]
From = Annotated[
    str | None,
    typer.Option("--from", metavar="FORMAT", help="Format of IN, of 'neuro events formats'. Default: detected."),
]
To = Annotated[str | None, typer.Option("--to", metavar="FORMAT", help="Format of OUT. Default: by its ending.")]
Lenient = Annotated[bool, typer.Option("--lenient", help="Read a damaged file up to the damage.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing OUT.")]
Sensor = Annotated[
    Any,
    typer.Option(
        "--sensor",
        metavar="WxH",
        parser=sensor,
        help="Sensor size in px. Default: that of the file, else the smallest that contains all events.",
    ),
]


def check_target(source: str | Path, target: str | Path, kind: Kind, force: bool) -> None:
    """Check that the output may be written.

    Raises:
        ModelError: the folder is missing, the target is the source itself, or the target exists and `force` is not set.
    """
    from dataclasses import replace

    from neuro import ModelError
    from neuro.apps import check_output, file_path

    if str(target) == "-":
        return
    path = file_path(target, "OUT")
    if not path.parent.is_dir():
        raise ModelError(f"{target}: there is no folder {path.parent}")
    if str(source) != "-" and path.exists() and os.path.exists(source) and path.samefile(source):
        raise ModelError(f"{target}: this is the recording itself: expected a new name")
    check_output(path, replace(kind, ask="--force"), force)


def parse_choice(text: str, registry: Mapping[str, Any], what: str, hint: str) -> tuple[Any, dict[str, Any]]:
    """Parse the choice of a part, such as 'crop: {x: [0, 300]}', to the registered part and its parameters.

    Args:
        text: the user's text, a name or a YAML mapping from a name to its parameters.
        registry: the parts by name.
        what: noun for the parts, for messages.
        hint: the argument or option, for messages.
    """
    import yaml

    from neuro.apps import options, unknown

    hint = f"'{hint}'" if hint.startswith("-") else hint
    try:
        choice = yaml.safe_load(text)
    except yaml.YAMLError:
        raise typer.BadParameter(f"'{text}': is not YAML", param_hint=hint) from None
    choice = {choice: {}} if isinstance(choice, str) else choice
    if not isinstance(choice, dict) or len(choice) != 1 or not isinstance(next(iter(choice.values())), dict):
        raise typer.BadParameter(f"'{text}': expected a name, or 'name: {{parameter: value}}'", param_hint=hint)
    name, values = next(iter(choice.items()))
    if name not in registry:
        raise unknown(what, str(name), registry)
    signature = parameters_of(registry[name])
    for key in values:
        if key not in signature:
            raise unknown(f"parameter of {what} '{name}'", str(key), signature)
    if any(word.split()[0] == key and key not in values for key, word in signature.items()):
        raise typer.BadParameter(f"'{text}': expected all of {', '.join(signature.values())}", param_hint=hint)
    return registry[name], {key: options.number(value) for key, value in values.items()}


def parameters_of(part: Any) -> dict[str, str]:
    """Return the parameters by name, without the first one, as text with default and unit, e.g. "tau=0.08 s"."""
    from dataclasses import fields, is_dataclass

    names = fields(part) if is_dataclass(part) else ()
    units = {f.name: f.metadata["quantity"].unit for f in names if "quantity" in f.metadata}
    units |= dict(getattr(part, "units", {}))
    _, *options = inspect.signature(part).parameters.values()
    texts = {p.name: p.name if p.default is p.empty else f"{p.name}={p.default}" for p in options}
    documented = {name: text for name, text in texts.items() if name not in _ONLY_IN_PYTHON}
    return {name: f"{text} {units.get(name, '')}".rstrip() for name, text in documented.items()}


_ONLY_IN_PYTHON = ("segments", "as_torch", "dtype")
"""Parameters of the Python functions that have no use on the command line."""


def list_parts(**registries: Mapping[str, Any]) -> None:
    """Print the parts of each registry with their parameters, and exit."""
    from neuro.apps import console, table

    for kind, registry in registries.items():
        rows = [
            (name, ", ".join(parameters_of(part).values()), (part.__doc__ or "").partition("\n")[0])
            for name, part in registry.items()
        ]
        console().print(table((kind, "parameters", "what it does"), rows))
    raise typer.Exit


def base_name(source: str) -> str:
    """Return the base name of the output: the name of the recording's file, or "events" for standard input."""
    return "events" if source == "-" else Path(source).name


@contextmanager
def progress(on_interrupt: str) -> Iterator[Bar]:
    """Show a progress bar. Ctrl-C removes the bar and prints a message.

    Args:
        on_interrupt: the message for Ctrl-C, such as "out.h5 is not written".
    """
    with stoppable(on_interrupt) as bar:
        bar.say("reading")
        yield bar


def events_so_far(bar: Bar) -> Callable[[int], None]:
    """Return a report function that shows the number of events on the bar."""
    return lambda n_events: bar.say(f"{n_events:,} events")


def with_progress(parts: Iterable[Events], bar: Bar) -> Iterator[Events]:
    """Yield the parts of a recording, with the number of events so far on the bar."""
    n_events = 0
    for part in parts:
        yield part
        n_events += len(part)
        bar.say(f"{n_events:,} events")
