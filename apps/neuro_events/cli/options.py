"""Options that the commands for event files share."""

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
    """Width and height, such as 346x260."""
    found = re.fullmatch(r"([1-9]\d{0,4})[x×]([1-9]\d{0,4})", text)
    if found is None:
        raise typer.BadParameter(f"'{text}': expected WIDTHxHEIGHT in px, such as 346x260")
    return int(found[1]), int(found[2])


def count(text: str) -> int:
    """A whole number >= 1."""
    return whole(text, 1)


def microseconds(ms: float, option: str) -> int:
    """A time in us; a part of one is refused."""
    us = ms * 1000.0
    if abs(us - round(us)) > 1e-6 or round(us) < 1:
        raise typer.BadParameter(f"'{ms:g}': expected a whole number of us, such as 0.001 or 40 ms", param_hint=option)
    return round(us)


In = Annotated[str, typer.Argument(metavar="IN", help="A recording, - for standard input.")]
Out = Annotated[str, typer.Argument(metavar="OUT", help="The file to write, - for standard output.")]
From = Annotated[str | None, typer.Option("--from", metavar="FORMAT", help="What IN is, where it does not tell.")]
To = Annotated[str | None, typer.Option("--to", metavar="FORMAT", help="What to write, where OUT does not tell.")]
Lenient = Annotated[bool, typer.Option("--lenient", help="Take what is whole of a damaged file.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what stands at OUT.")]
Sensor = Annotated[
    Any, typer.Option("--sensor", metavar="WxH", parser=sensor, help="Sensor, where the file does not tell it.")
]


def spare(source: str | Path, target: str | Path, kind: Kind, force: bool) -> None:
    """Refuse to write over the recording itself, or over what is not ours unless that is wanted; or into no folder."""
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


def chosen(text: str, registry: Mapping[str, Any], what: str, hint: str) -> tuple[Any, dict[str, Any]]:
    """A part of a registry and values of its parameters, written as any choice in a network is.

    Args:
        text: what was given.
        registry: where names are looked up.
        what: a part is called, for messages.
        hint: the argument or option.
    """
    import yaml

    from neuro.apps import options, unknown

    hint = f"'{hint}'" if hint.startswith("-") else hint
    try:
        given = yaml.safe_load(text)
    except yaml.YAMLError:
        raise typer.BadParameter(f"'{text}': is not YAML", param_hint=hint) from None
    given = {given: {}} if isinstance(given, str) else given
    if not isinstance(given, dict) or len(given) != 1 or not isinstance(next(iter(given.values())), dict):
        raise typer.BadParameter(f"'{text}': expected a name, or 'name: {{parameter: value}}'", param_hint=hint)
    name, values = next(iter(given.items()))
    if name not in registry:
        raise unknown(what, str(name), registry)
    known = parameters_of(registry[name])
    for key in values:
        if key not in known:
            raise unknown(f"parameter of {what} '{name}'", str(key), known)
    if any(word.split()[0] == key and key not in values for key, word in known.items()):
        raise typer.BadParameter(f"'{text}': expected all of {', '.join(known.values())}", param_hint=hint)
    return registry[name], {key: options.number(value) for key, value in values.items()}


def parameters_of(part: Any) -> dict[str, str]:
    """Each parameter behind the first, with its default, and its unit where its name does not tell it."""
    from dataclasses import fields, is_dataclass

    own = fields(part) if is_dataclass(part) else ()
    units = {f.name: f.metadata["quantity"].unit for f in own if "quantity" in f.metadata}
    units |= dict(getattr(part, "units", {}))
    _, *others = inspect.signature(part).parameters.values()
    words = {p.name: p.name if p.default is p.empty else f"{p.name}={p.default}" for p in others}
    return {name: f"{text} {units.get(name, '')}".rstrip() for name, text in words.items() if name not in _OF_PROGRAMS}


_OF_PROGRAMS = ("segments", "as_torch", "dtype")
"""Parameters that only programs have a use for."""


def list_parts(**registries: Mapping[str, Any]) -> None:
    """Print all parts of some kinds with their parameters, and leave."""
    from neuro.apps import console, table

    for what, registry in registries.items():
        rows = [
            (name, ", ".join(parameters_of(part).values()), (part.__doc__ or "").partition("\n")[0])
            for name, part in registry.items()
        ]
        console().print(table((what, "parameters", "what it does"), rows))
    raise typer.Exit


def named(source: str) -> str:
    """What to call what is made of a recording, in the current folder: the name of its file."""
    return "events" if source == "-" else Path(source).name


@contextmanager
def going(left: str) -> Iterator[Bar]:
    """A bar; Ctrl-C takes it away and says what is left.

    Args:
        left: what to say.
    """
    with stoppable(left) as bar:
        bar.say("reading")
        yield bar


def events_so_far(bar: Bar) -> Callable[[int], None]:
    """A report that shows how many events are done."""
    return lambda done: bar.say(f"{done:,} events")


def watched(parts: Iterable[Events], bar: Bar) -> Iterator[Events]:
    """Parts of a recording, with the bar showing how many events were taken."""
    done = 0
    for part in parts:
        yield part
        done += len(part)
        bar.say(f"{done:,} events")
