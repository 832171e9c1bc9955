"""Options that several commands have, and the parsers of their values."""

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
def stoppable(outcome: str | Callable[[], str]) -> Iterator[Bar]:
    """Show a progress bar during the block. Ctrl-C removes the bar, prints the outcome and exits with status 130.

    Args:
        outcome: text about the files after an interrupt, such as "out.h5 is not written", or a function that returns
            the text. If the exception has notes, they are printed instead.
    """
    with Bar() as bar:
        try:
            yield bar
        except KeyboardInterrupt as error:
            bar.stop()
            notes = getattr(error, "__notes__", ())
            text = "; ".join(notes) or (outcome if isinstance(outcome, str) else outcome())
            typer.echo(f"interrupted: {text}", err=True)
            raise typer.Exit(130) from None


def refuse_unused(context: typer.Context, needs: str, *names: str) -> None:
    """Raise an error if one of the named options, which have no effect without `needs`, is on the command line.

    Example: ``refuse_unused(context, "a network with a world", "steps")`` refuses `--steps` for other networks.
    """
    from neuro.core.errors import ModelError

    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name == "COMMANDLINE":
            raise ModelError(f"{parameter.opts[0]}: has no effect without {needs}")


def group(name: str, about: str) -> typer.Typer:
    """Return a command with subcommands. Without a subcommand, the command prints its help."""
    app = typer.Typer(name=name, add_completion=False, pretty_exceptions_enable=False)

    @app.callback(invoke_without_command=True, help=about)
    def show(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            typer.echo(context.get_help())

    return app


def with_settings(command: Callable[..., Any]) -> Callable[..., Any]:
    """Replace each argument of a command that is a dataclass of settings by an option for each field.

    ``def train(file: Path, plan: TrainingPlan)`` gets an option for each field of `TrainingPlan` that was made by
    `setting` with ``option=``, or by `option`. The option has the placeholder, the description and the default of the
    field. The command receives all arguments by name.
    """
    settings: dict[str, type[Any]] = {}
    parameters: list[inspect.Parameter] = []
    hints = get_type_hints(command, include_extras=True)
    for argument in inspect.signature(command).parameters.values():
        kind = hints[argument.name]
        if isinstance(kind, type) and is_dataclass(kind):
            settings[argument.name] = kind
            parameters += _options_of(kind)
        else:
            parameters.append(argument.replace(kind=argument.KEYWORD_ONLY, annotation=kind))

    @wraps(command)
    def wrapper(**values: Any) -> Any:
        for name, kind in settings.items():
            values[name] = kind(**{option.name: values.pop(option.name) for option in _options_of(kind)})
        return command(**values)

    wrapper.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return wrapper


def option(
    words: str,
    doc: str,
    default: Any = None,
    parser: Callable[[str], Any] | None = None,
    panel: str | None = None,
    **metadata: Any,
) -> Any:
    """Return a field of a dataclass that `with_settings` replaces by an option.

    Args:
        words: name and placeholder of the option, such as "--for MS". A flag only has a name.
        doc: help of the option.
        default: value without the option.
        parser: function that converts the text of the value.
        panel: heading of the group in the command's help; None for "Options".
        metadata: other metadata of the field.
    """
    name, *metavar = words.split()
    made = typer.Option(name, metavar=metavar[0] if metavar else None, parser=parser, help=doc, rich_help_panel=panel)
    return field(default=default, metadata={"typer": made, "name": name, **metadata})


def _options_of(kind: type[Any]) -> list[inspect.Parameter]:
    """Return the parameters of a command for those fields of the settings that have an option."""
    types, parameters = get_type_hints(kind), []
    for entry in fields(kind):
        value_type: Any = list[str] if isinstance(entry.default, tuple) else types[entry.name]
        option_info = entry.metadata.get("typer")
        if text := entry.metadata.get("option"):
            *names, metavar = text.split()
            doc = entry.metadata["quantity"].doc
            option_info = typer.Option(*names, metavar=metavar, help=f"{doc[0].upper()}{doc[1:]}.")
        if option_info is not None:
            annotation: Any = Annotated[value_type, option_info]
            keyword_only = inspect.Parameter.KEYWORD_ONLY
            parameters.append(inspect.Parameter(entry.name, keyword_only, default=entry.default, annotation=annotation))
    return parameters


def milliseconds(text: str) -> float:
    """Return the time > 0 of a text such as "20" (ms) or "0.5 s", ms."""
    from neuro.core.errors import ModelError
    from neuro.core.units import converted, is_measure

    try:
        ms = converted(text, "ms") if is_measure(text) else float(text)
    except ModelError as error:
        hint = "expected a time, such as 20 ms or 0.5 s" if error.hint.startswith("known") else error.hint
        reason = error.message + (f"; {hint}" if hint else "")
        raise typer.BadParameter(f"'{text}': {reason}") from None
    except ValueError:
        ms = math.nan
    if not 0 < ms < math.inf:
        raise typer.BadParameter(f"'{text}': expected a time > 0 ms")
    return ms


def moment(text: str) -> float:
    """Return the point in time of a text such as "20" (ms) or "0.5 s", ms."""
    from neuro.core.errors import ModelError
    from neuro.core.quantities import in_ms

    try:
        return float(in_ms(text, "--between"))
    except ModelError:
        raise
    except ValueError:
        raise ModelError(f"--between: found '{text}': expected a time in ms") from None


def whole(text: str, lowest: int) -> int:
    """Parse a whole number >= `lowest`."""
    try:
        number = int(text)
    except ValueError:
        number = lowest - 1
    if number < lowest:
        raise typer.BadParameter(f"'{text}': expected a whole number >= {lowest}")
    return number


@contextmanager
def resumable() -> Iterator[None]:
    """On Ctrl-C in the block, print how to resume the command, and exit with status 130."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: run the same command again to resume", err=True)
        raise typer.Exit(130) from None


def name_list(text: str) -> list[str]:
    """Parse a list of different names, separated by commas."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise typer.BadParameter(f"'{text}': expected different names with commas between them")
    return names


def at_least(lowest: int) -> Callable[[str], int]:
    """Return a parser of whole numbers >= `lowest`."""
    return lambda text: whole(text, lowest)


def seeds(text: str) -> tuple[int, ...]:
    """Parse a list of whole numbers >= 0, separated by commas."""
    return tuple(whole(part, 0) for part in text.split(","))


def assignments(texts: list[str]) -> dict[str, Any]:
    """Parse texts `name=value` into parameters. Values are read as in a network file.

    Example: ``["w=1e-3", "delay=2 ms"]`` gives ``{"w": 0.001, "delay": "2 ms"}``.
    """
    import yaml

    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise typer.BadParameter(f"'{text}': expected NAME=VALUE", param_hint="'--set'")
        try:
            values[name] = number(yaml.safe_load(value))
        except yaml.YAMLError:
            raise typer.BadParameter(f"'{text}': expected a value in YAML", param_hint="'--set'") from None
    return values


def number(value: Any) -> Any:
    """Convert a text such as "1e-3", which YAML 1.1 does not read as a number. Return other values unchanged."""
    try:
        return float(value) if isinstance(value, str) and value[-1:].isdigit() else value
    except ValueError:
        return value


def network(path: Path) -> Path:
    """Return the path of a network file or of a published network. An existing file of the name has precedence.

    Raises:
        ModelError: there is no such file. The error is raised before the slow imports for reading a network.
    """
    from neuro.core.hints import near
    from neuro.model.language.published import missing, published, refuse_name

    if path.exists():
        return path
    text, files = str(path), {} if path.suffix else published()
    if text in files:
        return files[text]
    if hint := near(text, files):
        raise typer.BadParameter(f"'{text}': no such file, and no published network of that name: {hint}")
    refuse_name(path)
    raise missing(path)


def input_file(expected: str = "", or_folder: bool = False) -> Callable[[Path | None], Path | None]:
    """Return the callback of an argument that names a file to read.

    The callback refuses a missing file before the slow imports for reading it. The value None of an omitted argument
    is returned unchanged.

    Args:
        expected: noun for the message, as in `existing`.
        or_folder: accept a folder in place of a file.
    """

    def callback(path: Path | None) -> Path | None:
        from neuro.core.inputs import existing

        return path if path is None or (or_folder and path.is_dir()) else existing(path, expected)

    return callback


NetworkFile = Annotated[
    Path, typer.Argument(metavar="FILE", callback=network, help="Network file (YAML), or name of a published network.")
]
Set = Annotated[
    list[str],
    typer.Option(
        "--set", metavar="NAME=VALUE", help="Parameter of the network, instead of the file's value; repeatable."
    ),
]
Backend = Annotated[
    str, typer.Option("--backend", metavar="NAME", help="Simulator or chip (see 'neuro backends'), or YAML of a chip.")
]
Backends = Annotated[
    Any,
    typer.Option(
        "--backends", metavar="A,B,...", parser=name_list, help="Simulators and chips to run on, the reference first."
    ),
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", parser=at_least(0), help="Seed of all random numbers.")]
Duration = Annotated[float, typer.Option("--for", metavar="MS", parser=milliseconds, help="Simulated time in ms.")]
Steps = Annotated[
    int | None, typer.Option(metavar="N", parser=at_least(1), help="Largest number of control steps in the world.")
]
Until = Annotated[
    float | None,
    typer.Option(metavar="R", help="Goal that ends the run: mean reward per episode, of the last 100 episodes."),
]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the address of the page without opening it.")]
Threads = Annotated[int, typer.Option("--threads", metavar="N", parser=at_least(1), help="Number of threads.")]
