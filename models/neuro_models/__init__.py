"""Published networks, one file each with its source.

Some are YAML: `path("remus")` is a file for `neuro.load`, `names()` lists them. `motion`, `delays`, `orders`,
`hedonists` and `areas` are modules that build one, since their delays, inputs or rewards
follow from a formula or from what the network does. `worlds` has the environments of those with a `world`.
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
