"""All commands: ours, and those of apps (entry points of `neuro.commands`), each with `--with FILE`."""

from __future__ import annotations

import ast
import inspect
import re
import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from neuro.cli.catalogue import backends, models, schema
from neuro.cli.chips import check, energy, fit, show
from neuro.cli.compare import compare, verify
from neuro.cli.run import plot, report, run
from neuro.cli.start import example, new
from neuro.core.errors import ModelError, unknown
from neuro.core.lazy import missing, taken_away
from neuro.core.version import VERSION

GROUP = "neuro.commands"

ORDER = (
    *("new", "example", "run", "live", "rerun", "plot", "report", "compare", "predict", "convert", "check", "doctor"),
    *("show", "fit", "energy", "schema", "verify", "models", "backends", "events", "sweep", "tune"),
)
"""Commands as help lists them, wherever they are defined; those of further apps follow by name."""


class Commands(TyperGroup):
    """Lists apps without importing them, so that a slow or broken one affects only its own command."""

    def list_commands(self, ctx: Any) -> list[str]:
        """All commands: those of `ORDER` as they stand there, then those of other apps."""
        names = {*super().list_commands(ctx), *apps()}
        return [name for name in ORDER if name in names] + sorted(names - {*ORDER})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command as help shows it; None if there is none of that name."""
        entry = apps().get(cmd_name)
        ours = super().get_command(ctx, cmd_name)
        return with_extensions(ours) if ours else placeholder(entry) if entry else None

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command to run, which is imported now.

        Raises:
            ModelError: there is none of that name, or its app cannot be imported.
        """
        name, known = args[0], self.list_commands(ctx)
        if name not in known:
            for entry in entry_points(group=GROUP):
                if entry.name == name and (package := taken_away(entry)):
                    raise ModelError(f"command '{name}' {missing(package)}")
            raise unknown("command", name, known)
        command = super().get_command(ctx, name) or load(apps()[name])
        return name, with_extensions(command), args[1:]

    def invoke(self, ctx: Any) -> None:
        """Run; what a command returns is not an exit status."""
        super().invoke(ctx)

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, `--help` among them; flags show no type."""
        return [without_type(each) for each in super().get_params(ctx)]


def apps() -> dict[str, EntryPoint]:
    """The commands of apps by name, without those whose package was deleted."""
    return {entry.name: entry for entry in entry_points(group=GROUP) if not taken_away(entry)}


def load(entry: EntryPoint) -> Any:
    """Import the command of an app.

    Raises:
        ModelError: its import fails.
    """
    try:
        command = typer.main.get_command(as_app(entry.load()))
    except Exception as error:
        raise ModelError(
            f"command '{entry.name}' cannot be loaded from {entry.value}: {type(error).__name__}: {error}",
            hint="install again the package that brings it",
        ) from error
    command.name = entry.name
    return command


def as_app(command: Any) -> typer.Typer:
    """Commands of an entry point: an app of typer, or a function that is one command."""
    if isinstance(command, typer.Typer):
        return command
    app = typer.Typer(add_completion=False)
    app.command()(command)
    return app


def placeholder(entry: EntryPoint) -> TyperCommand:
    """A command that can only be listed, with one line of help, see `summary`."""
    return TyperCommand(entry.name, help=summary(entry.module, entry.attr))


def summary(module: str, name: str = "") -> str:
    """The first line of the docstring of a function, or of its module where it is none, read without running either.

    Args:
        module: its name.
        name: of the function.

    Returns:
        "" if it cannot be had.
    """
    package, *inside = module.split(".")
    try:
        spec = find_spec(package)  # that of a module inside would run the package
        assert spec is not None
        folder = spec.submodule_search_locations
        file = Path(next(iter(folder))).joinpath(*inside) if folder else Path(spec.origin or "")
        file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
        tree = ast.parse(file.read_text("utf-8"))
        function = next((part for part in tree.body if isinstance(part, ast.FunctionDef) and part.name == name), tree)
        return (ast.get_docstring(function) or "").partition("\n")[0]
    except Exception:
        return ""


def with_extensions(command: Any) -> Any:
    """Return a command, or a group with all its commands, that takes `--with`, and whose help wraps as the screen does.

    Paragraphs after the first one keep the line breaks of their docstring in typer's help, in the middle of sentences.
    """
    for inner in getattr(command, "commands", {}).values():
        with_extensions(inner)
    if command.help:
        command.help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(command.help))
    for each in command.get_params(typer.Context(command)):
        without_type(each)
    if not hasattr(command, "commands") and not any("--with" in one.opts for one in command.params):
        command.params.append(_option())
    return command


def without_type(parameter: Any) -> Any:
    """Return a parameter; if it is a flag, help shows no `<bool>` behind it."""
    if getattr(parameter, "is_flag", False):
        parameter.metavar = ""
    return parameter


@cache
def _option() -> Any:
    """The option, as typer makes it: eager, so that it comes before all that may name a part."""
    app = typer.Typer(add_completion=False)
    app.command()(_declared)
    return next(one for one in typer.main.get_command(app).params if "--with" in one.opts)


def _run(context: typer.Context, files: list[Path]) -> list[Path]:
    from neuro.core.extension import extensions, run_extension
    from neuro.core.system import speaks

    for file in files or []:
        if speaks() and str(file.resolve()) not in extensions():
            typer.echo(f"neuro: running {file} (--with)", err=True)
        with warnings.catch_warnings():
            if context.info_name == "rerun":  # it names a function that a record calls, which needs no registration
                warnings.filterwarnings("ignore", message=".*registers nothing")
            run_extension(file)
    return files


def _declared(
    files: Annotated[
        list[Path],
        typer.Option(
            "--with",
            metavar="FILE.py",
            is_eager=True,
            expose_value=False,
            callback=_run,
            help="Run a Python file first, whose parts are registered; repeatable.",
        ),
    ] = [],  # noqa: B006
) -> None:
    """Declare it."""


COMMANDS = (
    new,
    example,
    run,
    plot,
    report,
    compare,
    check,
    show,
    fit,
    energy,
    schema,
    verify,
    models,
    backends,
)

app = typer.Typer(cls=Commands, name="neuro", add_completion=False, pretty_exceptions_enable=False)
for command in COMMANDS:
    app.command()(command)


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and leave.")] = False,
) -> None:
    """Describe a spiking network once; run it on a fast simulator or on an emulated chip."""
    if version:
        typer.echo(f"neuro {VERSION}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
