"""The command `neuro` with all its commands, and with the commands of apps (entry points of `neuro.commands`)."""

from __future__ import annotations

import ast
import inspect
import re
import warnings
from functools import cache, cached_property
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

PANELS = {
    "Describe a network": ("new", "example", "models", "schema", "show", "check", "doctor", "convert"),
    "Run a network": ("run", "live", "predict", "rerun"),
    "Look at results": ("plot", "report"),
    "Backends and chips": ("backends", "compare", "fit", "energy", "verify"),
    "Learn": ("train", "agent", "recognise", "remus", "drone", "bench"),
    "Event cameras": ("events",),
    "Many runs": ("sweep", "tune"),
}
"""Names of the commands in each group of the help, in the order of the help."""

OTHERS = "Commands of other packages"
"""Group of the commands that are not in `PANELS`."""

ORDER = [name for names in PANELS.values() for name in names]


class Commands(TyperGroup):
    """The group of all commands.

    The apps are not imported to list the commands, so a slow or broken app only affects its own command.
    """

    @cached_property
    def apps(self) -> dict[str, EntryPoint]:
        """Entry points of the apps' commands by name. A look-up reads all installed packages, so it is made once."""
        return apps()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands: the commands of `PANELS` in their order, then other commands by name."""
        names = {*super().list_commands(ctx), *self.apps}
        return [name for name in ORDER if name in names] + sorted(names - {*ORDER})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a name with its group in the help, or None if no command has the name."""
        entry = self.apps.get(cmd_name)
        command = super().get_command(ctx, cmd_name)
        item = with_extensions(command) if command else placeholder(entry) if entry else None
        if item is not None:
            item.rich_help_panel = next((panel for panel, names in PANELS.items() if cmd_name in names), OTHERS)
        return item

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Import the command that the first argument names. Return its name, the command and the other arguments.

        Raises:
            ModelError: the command is unknown, or its app cannot be imported.
        """
        name, command = args[0], super().get_command(ctx, args[0])
        if command is not None:
            return name, with_extensions(command), args[1:]  # no search for apps is needed
        if name not in self.apps:
            for entry in entry_points(group=GROUP):
                if entry.name == name and (package := taken_away(entry)):
                    raise ModelError(f"command '{name}' {missing(package)}")
            raise unknown("command", name, self.list_commands(ctx))
        return name, with_extensions(load(self.apps[name])), args[1:]

    def invoke(self, ctx: Any) -> None:
        """Run the command and discard its return value, which is not an exit status."""
        super().invoke(ctx)

    def get_params(self, ctx: Any) -> list[Any]:
        """Return all parameters, including `--help`. Flags have no type."""
        return [without_type(parameter) for parameter in super().get_params(ctx)]


def apps() -> dict[str, EntryPoint]:
    """Return the entry points of the apps' commands by name, except those of deleted packages."""
    return {entry.name: entry for entry in entry_points(group=GROUP) if not taken_away(entry)}


def load(entry: EntryPoint) -> Any:
    """Import the command of an app.

    Raises:
        ModelError: the import fails.
    """
    try:
        command = typer.main.get_command(as_app(entry.load()))
    except Exception as error:
        raise ModelError(
            f"command '{entry.name}' cannot be loaded from {entry.value}: {type(error).__name__}: {error}",
            hint="reinstall the package of this command",
        ) from error
    command.name = entry.name
    return command


def as_app(command: Any) -> typer.Typer:
    """Return the typer app of an entry point. A function becomes an app with one command."""
    if isinstance(command, typer.Typer):
        return command
    app = typer.Typer(add_completion=False)
    app.command()(command)
    return app


def placeholder(entry: EntryPoint) -> TyperCommand:
    """Return a command that only appears in the list of commands, with the line of `summary` as its help."""
    return TyperCommand(entry.name, help=summary(entry.module, entry.attr))


def summary(module: str, name: str = "") -> str:
    """Return the first line of a function's docstring, read from the source file without an import.

    Args:
        module: name of the module, such as "neuro_sweeps.cli".
        name: name of the function. Without such a function, the module's docstring is read.

    Returns:
        The line, or "" if the file has no docstring or cannot be read.
    """
    package, *submodules = module.split(".")
    try:
        spec = find_spec(package)  # finding the spec of a submodule would import the package
        assert spec is not None
        folder = spec.submodule_search_locations
        file = Path(next(iter(folder))).joinpath(*submodules) if folder else Path(spec.origin or "")
        file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
        tree = ast.parse(file.read_text("utf-8"))
        function = next((part for part in tree.body if isinstance(part, ast.FunctionDef) and part.name == name), tree)
        return (ast.get_docstring(function) or "").partition("\n")[0]
    except Exception:
        return ""


def with_extensions(command: Any) -> Any:
    """Add `--with` to a command, or to all commands of a group, and join the lines of each paragraph of the help.

    Typer joins the lines of the first paragraph only, so later paragraphs would break in the middle of sentences.
    """
    for inner in getattr(command, "commands", {}).values():
        with_extensions(inner)
    if command.help:
        command.help = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(command.help))
    for parameter in command.get_params(typer.Context(command)):
        without_type(parameter)
    if not hasattr(command, "commands") and not any("--with" in p.opts for p in command.params):
        command.params.append(_option())
    return command


def without_type(parameter: Any) -> Any:
    """Return the parameter. The type `<bool>` of a flag is removed from the help."""
    if getattr(parameter, "is_flag", False):
        parameter.metavar = ""
    return parameter


@cache
def _option() -> Any:
    """Return the eager option `--with`. The files run first, because other options may name parts from the files."""
    app = typer.Typer(add_completion=False)
    app.command()(_with_option)
    return next(p for p in typer.main.get_command(app).params if "--with" in p.opts)


def _run_extensions(context: typer.Context, files: list[Path]) -> list[Path]:
    from neuro.core.extension import extensions, run_extension
    from neuro.core.system import speaks

    for file in files or []:
        if speaks() and str(file.resolve()) not in extensions():
            typer.echo(f"neuro: running {file} (--with)", err=True)
        with warnings.catch_warnings():
            if context.info_name == "rerun":  # the file may define only a function that the record calls
                warnings.filterwarnings("ignore", message=".*registers nothing")
            run_extension(file)
    return files


def _with_option(
    files: Annotated[
        list[Path],
        typer.Option(
            "--with",
            metavar="FILE.py",
            is_eager=True,
            expose_value=False,
            callback=_run_extensions,
            help="Python file of your own models, filters or other parts, run before the command; repeatable.",
        ),
    ] = [],  # noqa: B006
) -> None:
    """Declare the option `--with` for `_option`."""


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
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Describe a spiking network once; run it on a fast simulator or on emulated chips."""
    if version:
        typer.echo(f"neuro {VERSION}")
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())
