"""What the package ships: folders to start from (`neuro new`) and files of the pages (`neuro example`)."""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable


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


def about(network: Traversable) -> str:
    """What a network says of itself in its first line, a comment."""
    return network.read_text("utf-8").partition("\n")[0].removeprefix("# ").removesuffix(".")
