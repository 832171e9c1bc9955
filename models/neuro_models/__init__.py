"""Published networks, one file each with its source.

Networks in YAML have a name: `path("remus")` is a file for `neuro.load`, and `names()` lists the names. The modules
`motion`, `delays`, `orders`, `hedonists` and `areas` build a network each, because delays, inputs or rewards follow
from a formula or from the network's activity. `worlds` has the environments of the networks with a `world`.
"""

from __future__ import annotations

from pathlib import Path

from neuro import ModelError

__all__ = ["names", "path"]

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """Return the names of the networks in YAML."""
    return sorted(file.stem for file in _FOLDER.glob("*.yaml"))


def path(name: str) -> Path:
    """Return the YAML file of a network.

    Args:
        name: one of `names`.

    Raises:
        ModelError: the name is unknown.
    """
    if name not in names():
        raise ModelError(f"unknown network '{name}': expected one of {', '.join(names())}")
    return _FOLDER / f"{name}.yaml"
