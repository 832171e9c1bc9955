"""The published networks that come with the package, by name."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from neuro.core.errors import ModelError, Where


def published() -> dict[str, Path]:
    """Their files; none where they are not installed."""
    found = find_spec("neuro_models")
    folders = (found and found.submodule_search_locations) or ()
    return {file.stem: file for folder in folders for file in sorted(Path(folder).glob("*.yaml"))}


def refuse_name(path: Path) -> None:
    """Refuse a name of one where a file is expected, and there is none of that name.

    Raises:
        ModelError: it says how the published network is read.
    """
    if path == Path(path.name) and path.suffix in ("", ".yaml") and path.stem in published() and not path.exists():
        hint = f"the published network is neuro.load(neuro_models.path('{path.stem}'))"
        raise ModelError("no such file", where=Where(str(path)), hint=hint)
