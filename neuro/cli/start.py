"""What the package ships: folders to start from (`neuro new`) and files of the pages (`neuro example`)."""

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


def shipped(what: str) -> dict[str, Traversable]:
    """What there is of a kind, by name.

    Args:
        what: "templates", which are folders, or "examples", which are files.
    """
    return by_name(files("neuro.cli").joinpath(what))


def by_name(folder: Traversable) -> dict[str, Traversable]:
    """What lies in a folder, but for what Python leaves there."""
    entries = sorted(folder.iterdir(), key=lambda entry: entry.name)
    return {entry.name: entry for entry in entries if entry.name != "__pycache__"}


def about(file: Traversable) -> str:
    """What a network says of itself in its first line, a comment, or a script in its docstring."""
    first = file.read_text("utf-8").partition("\n")[0]
    return first.removeprefix("# ").removeprefix('"""').partition(". ")[0].removesuffix(".")


RECORDINGS = {
    "shapes.zip": "36 short recordings of a cross, a ring and a square before an event camera, a data set",
    "walk.dat": "a figure walks past an event camera: 1 s, 64 x 48 px",
}
"""What examples are that cannot say it themselves, as networks do in their first line."""

Names = Annotated[list[str], typer.Argument(metavar="NAME...", help="The files to write.")]
ListExamples = Annotated[bool, typer.Option("--list", help="List the files that there are.")]


def example(names: Names = [], list_all: ListExamples = False) -> None:  # noqa: B006
    """Write files that the pages use to the current folder; what stands there is never replaced."""
    from neuro.core.errors import ModelError, unknown
    from neuro.core.outputs import Kind, output
    from neuro.core.tables import console, table

    known = shipped("examples")
    if list_all:
        rows = [(name, RECORDINGS[name] if name in RECORDINGS else about(file)) for name, file in known.items()]
        console().print(table(("example", "is"), rows))
        return
    if not names:
        raise ModelError("which example? expected the names of files", hint="neuro example net.yaml, or --list")
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
    """Refuse the place of another file.

    Raises:
        ModelError: a file of that name has other content.
    """
    from neuro.core.errors import ModelError

    if path.is_symlink() or (path.exists() and not (path.is_file() and path.read_bytes() == content)):
        raise ModelError(f"{path}: exists and is not the example", hint="go to an empty folder: mkdir try && cd try")


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
  neuro recognise watch model.h5 RECORDING     # a page on which it decides while events arrive
""",
    "train.py": """\
next:
  cd {}
  python train.py
  python -m pytest     # needs pytest: pip install pytest
  neuro agent watch agent.h5 world:Room --out episode.html
""",
}
"""What to do with a template, by the file that says what it is."""
_FIRST = "balanced-network"
_RECORDINGS = {"classifier": "shapes.zip", "event-camera": "walk.dat"}
"""The example that a template needs beside its own files."""
_NAME = re.compile(r"[A-Za-z][\w.-]*", re.ASCII)

Folder = Annotated[Path | None, typer.Argument(metavar="NAME", help="The folder to make.")]
Template = Annotated[
    str | None, typer.Option(metavar="NAME", help="What to begin with: see --list.", show_default="that of NAME")
]
ListTemplates = Annotated[bool, typer.Option("--list", help="List the templates.")]


def new(name: Folder = None, template: Template = None, list_all: ListTemplates = False) -> None:
    """Write a folder to start from: a network with comments, a script that runs it, and a test of it.

    A folder that is called as a template, as by 'neuro new classifier', is made from it, others from balanced-network.
    """
    from neuro.core.errors import ModelError, unknown
    from neuro.core.hints import alike
    from neuro.core.tables import console, table

    known = shipped("templates")
    if list_all:
        rows = [(word, about(folder / _head(folder))) for word, folder in known.items()]
        console().print(table(("template", "is"), rows))
        return
    if name is None:
        raise ModelError("which folder? expected the name of one to make", hint="neuro new my-network, or --list")
    close = [] if template or name.name in known else alike(name.name, list(known))
    template = template or (name.name if name.name in known else _FIRST)
    if template not in known:
        raise unknown("template", template, known)
    check_name(name)
    contents = by_name(known[template])
    if template in _RECORDINGS:
        contents[_RECORDINGS[template]] = shipped("examples")[_RECORDINGS[template]]
    with filled(name) as part:
        for file, content in contents.items():
            (part / file).write_bytes(content.read_bytes())
    meant = f"; did you mean 'neuro new {close[0]}'?" if close else ""
    typer.echo(f"{name}: made from {template}{meant}")
    typer.echo(f"files: {', '.join(contents)}")
    world = " --with world.py" if {NETWORK, "world.py"} <= set(contents) else ""
    typer.echo(NEXT[_head(known[template])].format(shlex.quote(str(name)), world), nl=False)


def _head(template: Traversable) -> str:
    """The file that says what a template is."""
    return next(name for name in NEXT if (template / name).is_file())


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
