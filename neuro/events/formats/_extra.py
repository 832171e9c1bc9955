"""Packages that only some formats need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from neuro.core.extras import install
from neuro.events.formats._format import Damage

EXTRA = "events"
"""The extra of this package that installs them."""


def extra(module: str, what: str) -> ModuleType:
    """Import a module of an optional package.

    Args:
        module: its name.
        what: for what it is needed.

    Raises:
        Damage: it is not installed; says the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise Damage(f"{what} needs the package {package}: {install(EXTRA)}", None) from None
