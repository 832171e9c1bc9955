"""Published networks, one file each with its source.

Most are YAML: `path("remus")` is a file for `neuro.load`, `names()` lists them. `motion`, `delays`, `orders` and
`hedonists` are modules that build one, since delays, inputs or rewards follow from a formula.
"""

from __future__ import annotations

from pathlib import Path

from neuro import ModelError

__all__ = ["names", "path"]

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """The networks there are as YAML."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def path(name: str) -> Path:
    """The YAML file of a network.

    Args:
        name: one of `names`.

    Raises:
        ModelError: there is none of that name.
    """
    if name not in names():
        raise ModelError(f"unknown network '{name}': expected one of {', '.join(names())}")
    return _FOLDER / f"{name}.yaml"
