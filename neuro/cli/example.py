"""`neuro example`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

RECORDINGS = {
    "shapes.zip": "36 short recordings of a cross, a ring and a square before an event camera, a data set",
    "walk.dat": "a figure walks past an event camera: 1 s, 64 x 48 px",
}
"""What examples are that cannot say it themselves, as networks do in their first line."""

Names = Annotated[list[str], typer.Argument(metavar="NAME...", help="The files to write.")]
List = Annotated[bool, typer.Option("--list", help="List the files that there are.")]


def example(names: Names = [], list_all: List = False) -> None:  # noqa: B006
    """Write files that the pages use to the current folder; what stands there is never replaced."""
    from neuro.cli.shipped import about, shipped
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
