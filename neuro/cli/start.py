"""Templates of folders (`neuro new`) and the example files of the documentation (`neuro example`)."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated

import typer


def shipped(kind: str) -> dict[str, Traversable]:
    """Return the templates or the examples of this package by name.

    Args:
        kind: "templates", which are folders, or "examples", which are files.
    """
    return by_name(files("neuro.cli").joinpath(kind))


def by_name(folder: Traversable) -> dict[str, Traversable]:
    """Return the files and folders in a folder by name, except `__pycache__`."""
    entries = sorted(folder.iterdir(), key=lambda entry: entry.name)
    return {entry.name: entry for entry in entries if entry.name != "__pycache__"}


def about(file: Traversable) -> str:
    """Return the first sentence of the comment at the top of a network, or of the docstring of a script."""
    line = file.read_text("utf-8").partition("\n")[0]
    return line.removeprefix("# ").removeprefix('"""').partition(". ")[0].removesuffix(".")


RECORDINGS = {
    "shapes.zip": "36 short event-camera recordings of a cross, a ring and a square, in class folders",
    "walk.dat": "event-camera recording of a walking figure: 1 s, 64 x 48 px",
}
"""Descriptions of the binary examples. Other examples have a description in their first line."""

Names = Annotated[list[str], typer.Argument(metavar="NAME...", help="Names of example files; see --list.")]
ListExamples = Annotated[bool, typer.Option("--list", help="List all example files.")]


def example(names: Names = [], list_all: ListExamples = False) -> None:  # noqa: B006
    """Copy example files of the documentation to the current folder, without replacing existing files."""
    from neuro.core.errors import ModelError, unknown
    from neuro.core.outputs import Kind, output
    from neuro.core.tables import console, table

    known = shipped("examples")
    if list_all:
        rows = [(name, RECORDINGS[name] if name in RECORDINGS else about(file)) for name, file in known.items()]
        console().print(table(("example", "description"), rows))
        return
    if not names:
        raise ModelError("no example named: expected the names of files", hint="neuro example net.yaml, or --list")
    for name in names:
        if name not in known:
            raise unknown("example", name, known)
    contents = {name: known[name].read_bytes() for name in names}
    for name, content in contents.items():
        check_free(Path(name), content)
    for name, content in contents.items():
        if not Path(name).exists():
            with output(Path(name), Kind("an example")) as part:
                part.write_bytes(content)
        typer.echo(name)


def check_free(path: Path, content: bytes) -> None:
    """Raise an error if the content would replace another file.

    Raises:
        ModelError: the path exists with different content.
    """
    from neuro.core.errors import ModelError

    if path.is_symlink() or (path.exists() and not (path.is_file() and path.read_bytes() == content)):
        raise ModelError(f"{path}: exists with different content", hint="use an empty folder: mkdir try && cd try")


NETWORK = "network.yaml"
NEXT = {
    NETWORK: """\
next:
  cd {}
  python run.py
  python -m pytest     # needs pytest: pip install pytest
  neuro run network.yaml{} --out out.h5
""",
    "learn.py": """\
next:
  cd {}
  python learn.py
  python -m pytest     # needs pytest: pip install pytest
  neuro recognise watch model.h5 RECORDING     # a page with the decision as events arrive
""",
    "train.py": """\
next:
  cd {}
  python train.py
  python -m pytest     # needs pytest: pip install pytest
  neuro agent watch agent.h5 world:Room --out episode.html
""",
}
"""Commands that a user may run next in the new folder, by the name of the template's main file, see `_head`."""
_FIRST = "balanced-network"
_RECORDINGS = {"classifier": "shapes.zip", "event-camera": "walk.dat"}
"""Examples that are copied into the new folder, by template."""

_NAME = re.compile(r"[A-Za-z][\w.-]*", re.ASCII)

Folder = Annotated[Path | None, typer.Argument(metavar="NAME", help="Folder to create.")]
Template = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Template of the folder; see --list.",
        show_default="the folder's name if a template has it, or else balanced-network",
    ),
]
ListTemplates = Annotated[bool, typer.Option("--list", help="List the templates.")]


def new(name: Folder = None, template: Template = None, list_all: ListTemplates = False) -> None:
    """Create a starting folder: a commented network, a script that runs the network, and a test.

    'neuro new classifier' uses the template 'classifier': a folder's name selects the template of that name.
    """
    from neuro.core.errors import ModelError, unknown
    from neuro.core.hints import close_names
    from neuro.core.tables import console, table

    templates = shipped("templates")
    if list_all:
        rows = [(word, about(folder / _head(folder))) for word, folder in templates.items()]
        console().print(table(("template", "description"), rows))
        return
    if name is None:
        raise ModelError("no folder named: expected the name of a new folder", hint="neuro new my-network, or --list")
    similar = [] if template or name.name in templates else close_names(name.name, list(templates))
    template = template or (name.name if name.name in templates else _FIRST)
    if template not in templates:
        raise unknown("template", template, templates)
    check_name(name)
    contents = by_name(templates[template])
    if template in _RECORDINGS:
        contents[_RECORDINGS[template]] = shipped("examples")[_RECORDINGS[template]]
    with filled(name) as part:
        for file, content in contents.items():
            (part / file).write_bytes(content.read_bytes())
    question = f"; did you mean 'neuro new {similar[0]}'?" if similar else ""
    typer.echo(f"{name}: made from {template}{question}")
    typer.echo(f"files: {', '.join(contents)}")
    world = " --with world.py" if {NETWORK, "world.py"} <= set(contents) else ""
    typer.echo(NEXT[_head(templates[template])].format(shlex.quote(str(name)), world), nl=False)


def _head(template: Traversable) -> str:
    """Return the name of the template's main file, whose first line describes the template."""
    return next(name for name in NEXT if (template / name).is_file())


def check_name(path: Path) -> None:
    """Raise an error if a folder's name needs quotes in a shell, or looks like an option.

    Raises:
        ModelError: the name has a character other than letters, digits, `_`, `-` and `.`, or begins with no letter.
    """
    from neuro.core.errors import ModelError

    if not _NAME.fullmatch(path.name):
        better = re.sub(r"[^\w.-]+", "-", path.name, flags=re.ASCII).strip("-.")
        raise ModelError(
            f"'{path}': expected a name of letters, digits, '_', '-' and '.' that begins with a letter",
            hint=f"neuro new {path.with_name(better)}" if _NAME.fullmatch(better) else "neuro new my-network",
        )


@contextmanager
def filled(folder: Path) -> Iterator[Path]:
    """Provide a temporary folder. After a block without an error the folder is renamed to `folder`, otherwise deleted.

    Raises:
        Unwritable: the path exists and is not an empty folder, or cannot be written.
    """
    from neuro.core.outputs import Unwritable, make_folder

    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise Unwritable(folder, "is no folder: expected a new name")
    if folder.is_dir() and any(folder.iterdir()):
        raise Unwritable(folder, "is a folder with files: expected a new name, or an empty folder")
    make_folder(folder.parent)
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    make_folder(part)
    try:
        yield part
        part.replace(folder)  # fails if the folder is no longer empty
    except OSError as error:
        raise Unwritable(folder, f"cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
