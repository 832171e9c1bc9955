"""What the package ships: folders to start from (`neuro new`), files of the pages (`neuro example`), networks."""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable
from importlib.util import find_spec
from pathlib import Path


def shipped(what: str) -> dict[str, Traversable]:
    """What there is of a kind, by name.

    Args:
        what: "templates", which are folders, or "examples", which are files.
    """
    return by_name(files("neuro.cli").joinpath(what))


def published() -> dict[str, Path]:
    """The files of the published networks, by name; none where they are not installed."""
    found = find_spec("neuro_models")
    folders = (found and found.submodule_search_locations) or ()
    return {file.stem: file for folder in folders for file in sorted(Path(folder).glob("*.yaml"))}


def by_name(folder: Traversable) -> dict[str, Traversable]:
    """What lies in a folder, but for what Python leaves there."""
    entries = sorted(folder.iterdir(), key=lambda entry: entry.name)
    return {entry.name: entry for entry in entries if entry.name != "__pycache__"}


def about(network: Traversable) -> str:
    """What a network says of itself in its first line, a comment."""
    return network.read_text("utf-8").partition("\n")[0].removeprefix("# ").removesuffix(".")
