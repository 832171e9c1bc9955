"""Options that several commands share, and what their text may be."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import field, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from neuro.core.progress import Bar


@contextmanager
def stoppable(left: str | Callable[[], str]) -> Iterator[Bar]:
    """A bar; Ctrl-C takes it away, reports what is left of the work, and ends with status 130."""
    with Bar() as bar:
        try:
            yield bar
        except KeyboardInterrupt as error:
            bar.stop()
            notes = getattr(error, "__notes__", ())
            typer.echo(f"interrupted: {'; '.join(notes) or (left if isinstance(left, str) else left())}", err=True)
            raise typer.Exit(130) from None


def refuse_unused(context: typer.Context, needs: str, *names: str) -> None:
    """Refuse options and arguments of these names that were given, since they do nothing without what they need."""
    from neuro.core.errors import ModelError

    for each in context.command.params:
        source = context.get_parameter_source(each.name or "")
        if each.name in names and source is not None and source.name == "COMMANDLINE":
            raise ModelError(f"{each.opts[0]}: expected {needs} as well")


def group(name: str, about: str) -> typer.Typer:
    """A command that has commands of its own, and without one of them prints its help."""
    app = typer.Typer(name=name, add_completion=False, pretty_exceptions_enable=False)

    @app.callback(invoke_without_command=True, help=about)
    def show(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            typer.echo(context.get_help())

    return app


def with_settings(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command options for the fields of the settings that it takes, and call it with the settings.

    ``def train(file: Path, plan: TrainingPlan)`` gets an option for each field of `TrainingPlan` that `setting` made
    with ``option=``: its value on the command line, its help from the meaning, its default. Other
    dataclasses make their fields by `option`. All are passed by name.
    """
    settings: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    hints = get_type_hints(command, include_extras=True)
    for each in inspect.signature(command).parameters.values():
        kind = hints[each.name]
        if isinstance(kind, type) and is_dataclass(kind):
            settings[each.name] = kind
            parameters += _options_of(kind)
        else:
            parameters.append(each.replace(kind=each.KEYWORD_ONLY, annotation=kind))

    @wraps(command)
    def called(**values: Any) -> Any:
        for name, kind in settings.items():
            values[name] = kind(**{option.name: values.pop(option.name) for option in _options_of(kind)})
        return command(**values)

    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {each.name: each.annotation for each in parameters}
    return called


def option(
    words: str,
    doc: str,
    default: Any = None,
    parser: Callable[[str], Any] | None = None,
    panel: str | None = None,
    **more: Any,
) -> Any:
    """Make a field of a dataclass that `with_settings` gives an option.

    Args:
        words: name and placeholder of the option, such as "--for MS"; the name alone of a flag.
        doc: its help.
        default: its value if it is not given.
        parser: makes a value of its text.
        panel: heading of the group in the command's help; None for "Options".
        more: other metadata of the field.
    """
    name, *metavar = words.split()
    made = typer.Option(name, metavar=metavar[0] if metavar else None, parser=parser, help=doc, rich_help_panel=panel)
    return field(default=default, metadata={"typer": made, "name": name, **more})


def _options_of(kind: type[Any]) -> list[inspect.Parameter]:
    """Return the options of settings: a parameter of a command for each field that has an option."""
    types, options = get_type_hints(kind), []
    for one in fields(kind):
        value: Any = list[str] if isinstance(one.default, tuple) else types[one.name]
        words = one.metadata.get("typer")
        if text := one.metadata.get("option"):
            *names, metavar = text.split()
            doc = one.metadata["quantity"].doc
            words = typer.Option(*names, metavar=metavar, help=f"{doc[0].upper()}{doc[1:]}.")
        if words is not None:
            annotation: Any = Annotated[value, words]
            parameter = inspect.Parameter
            options.append(parameter(one.name, parameter.KEYWORD_ONLY, default=one.default, annotation=annotation))
    return options


def milliseconds(text: str) -> float:
    """A time > 0 ms: a number, or one with its unit."""
    from neuro.core.errors import ModelError
    from neuro.core.units import converted, is_measure

    try:
        ms = converted(text, "ms") if is_measure(text) else float(text)
    except ModelError as error:
        reason = error.message + (f"; {error.hint}" if error.hint else "")
        raise typer.BadParameter(f"'{text}': {reason}") from None
    except ValueError:
        ms = math.nan
    if not 0 < ms < math.inf:
        raise typer.BadParameter(f"'{text}': expected a time > 0 ms")
    return ms


def moment(text: str) -> float:
    """A point in time in ms: a number, or one with its unit."""
    from neuro.core.errors import ModelError
    from neuro.core.quantities import in_ms

    try:
        return float(in_ms(text, "--between"))
    except ModelError:
        raise
    except ValueError:
        raise ModelError(f"--between: found '{text}': expected a time in ms") from None


def whole(text: str, least: int) -> int:
    """A whole number >= least."""
    try:
        number = int(text)
    except ValueError:
        number = least - 1
    if number < least:
        raise typer.BadParameter(f"'{text}': expected a whole number >= {least}")
    return number


@contextmanager
def resumable() -> Iterator[None]:
    """Say where work is interrupted that it is kept, and leave with status 130."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: the same command goes on where it was", err=True)
        raise typer.Exit(130) from None


def listed(text: str) -> list[str]:
    """Names with commas between them, each once."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise typer.BadParameter(f"'{text}': expected names with commas between them, each once")
    return names


def at_least(least: int) -> Callable[[str], int]:
    """Return a parser of whole numbers that are not less."""
    return lambda text: whole(text, least)


def seeds(text: str) -> tuple[int, ...]:
    """Whole numbers >= 0 with commas between them."""
    return tuple(whole(part, 0) for part in text.split(","))


def assignments(texts: list[str]) -> dict[str, Any]:
    """Parameters from `name=value` texts; a value is read as in the YAML file."""
    import yaml

    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise typer.BadParameter(f"'{text}': expected NAME=VALUE", param_hint="'--set'")
        try:
            values[name] = number(yaml.safe_load(value))
        except yaml.YAMLError:
            raise typer.BadParameter(f"'{text}': its value is not YAML", param_hint="'--set'") from None
    return values


def number(value: Any) -> Any:
    """The number that a word such as 1e-3 is everywhere but in YAML 1.1; anything else as it is."""
    try:
        return float(value) if isinstance(value, str) and value[-1:].isdigit() else value
    except ValueError:
        return value


def network(text: str) -> Path:
    """A file, or that of a published network by its name; a file of that name comes first."""
    from neuro.core.hints import near
    from neuro.model.language.including import published

    path = Path(text)
    if path.suffix or path.exists():
        return path
    known = published()
    if text not in known and (hint := near(text, known)):
        raise typer.BadParameter(f"'{text}': no such file, and no published network of that name: {hint}")
    return known.get(text, path)


NetworkFile = Annotated[
    Path, typer.Argument(metavar="FILE", parser=network, help="A network, as YAML, or the name of a published one.")
]
Set = Annotated[list[str], typer.Option("--set", metavar="NAME=VALUE", help="Override a parameter; repeatable.")]
Backend = Annotated[
    str, typer.Option("--backend", metavar="NAME", help="What to run on: see 'neuro backends'; or a chip's table.")
]
Backends = Annotated[
    Any,
    typer.Option(
        "--backends", metavar="A,B,...", parser=listed, help="What to run on; others are compared with the first."
    ),
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", parser=at_least(0), help="Seed of everything random.")]
Duration = Annotated[float, typer.Option("--for", metavar="MS", parser=milliseconds, help="How long, in ms.")]
Steps = Annotated[int | None, typer.Option(metavar="N", parser=at_least(1), help="Control steps in its world.")]
Until = Annotated[float | None, typer.Option(metavar="R", help="Mean return of 100 episodes to stop at.")]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the address of the page, and open no browser.")]
Threads = Annotated[int, typer.Option("--threads", metavar="N", parser=at_least(1), help="Threads to compute with.")]
