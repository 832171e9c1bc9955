"""Files of networks that are published or missing. The command line imports this module before anything heavy."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from neuro.core.errors import ModelError, Where, nearest


def published() -> dict[str, Path]:
    """Return the files of the published networks by name. Without the package `neuro_models` there are none."""
    spec = find_spec("neuro_models")
    folders = (spec and spec.submodule_search_locations) or ()
    return {file.stem: file for folder in folders for file in sorted(Path(folder).glob("*.yaml"))}


def refuse_name(path: Path) -> None:
    """Raise an error if the name of a published network was given instead of a file.

    Raises:
        ModelError: the hint is the call that loads the published network.
    """
    if path == Path(path.name) and path.suffix in ("", ".yaml") and path.stem in published() and not path.exists():
        hint = f"the published network is neuro.load(neuro_models.path('{path.stem}'))"
        raise ModelError("no such file", where=Where(str(path)), hint=hint)


def missing(path: Path) -> ModelError:
    """Return the error of a missing YAML file, with the most similar name in its folder."""
    names = [file.name for file in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
    return ModelError("no such file", where=Where(str(path)), hint=nearest(path.name, names) if names else "")
