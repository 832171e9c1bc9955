"""`neuro new`."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

NETWORK = "network.yaml"
NEXT = """\
next:
  cd {}
  python run.py
  python -m pytest     # needs pytest: pip install pytest
  neuro run network.yaml --out out.h5
"""
_FIRST = "balanced-network"
_RECORDINGS = {"event-camera": "walk.dat"}
"""The example that a template needs beside its own files."""
_NAME = re.compile(r"[A-Za-z][\w.-]*", re.ASCII)

Folder = Annotated[Path | None, typer.Argument(metavar="NAME", help="The folder to make.")]
Template = Annotated[str, typer.Option(metavar="NAME", help="What to begin with: see --list.")]
List = Annotated[bool, typer.Option("--list", help="List the templates.")]


def new(name: Folder = None, template: Template = _FIRST, list_all: List = False) -> None:
    """Write a folder to start from: a network with comments, a script that runs it, and a test of it."""
    from neuro.cli.shipped import about, by_name, shipped
    from neuro.core.errors import ModelError, unknown
    from neuro.core.tables import console, table

    known = shipped("templates")
    if list_all:
        rows = [(word, about(folder / NETWORK)) for word, folder in known.items()]
        console().print(table(("template", "is"), rows))
        return
    if name is None:
        raise ModelError("which folder? expected the name of one to make", hint="neuro new my-network, or --list")
    if template not in known:
        raise unknown("template", template, known)
    check_name(name)
    contents = by_name(known[template])
    if template in _RECORDINGS:
        contents[_RECORDINGS[template]] = shipped("examples")[_RECORDINGS[template]]
    with filled(name) as part:
        for file, content in contents.items():
            (part / file).write_bytes(content.read_bytes())
    typer.echo(f"{name}: {', '.join(contents)}")
    typer.echo(NEXT.format(shlex.quote(str(name))), nl=False)


def check_name(path: Path) -> None:
    """Refuse a name that a shell, a script or a later option would stumble over.

    Raises:
        ModelError: the folder's own name has other than letters, digits, `_`, `-` and `.`, or begins with no letter.
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
    """A folder to fill, which takes its name when the block ends well; nothing is left where it does not.

    Raises:
        Unwritable: something that is not an empty folder has its name, or it cannot be made.
    """
    from neuro.core.outputs import Unwritable, make_folder

    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise Unwritable(folder, "is no folder: expected a new name")
    if folder.is_dir() and any(folder.iterdir()):
        raise Unwritable(folder, "is a folder with files in it: expected a new name, or an empty folder")
    make_folder(folder.parent)
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    make_folder(part)
    try:
        yield part
        part.replace(folder)  # an empty folder gives way, one that was filled meanwhile does not
    except OSError as error:
        raise Unwritable(folder, f"cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
