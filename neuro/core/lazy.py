"""Public names that are imported when they are first asked for, so that a start pays only for what it uses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module


def lazily(
    module: str, homes: Mapping[str, Sequence[str]], more: Callable[[str], object] = lambda name: None
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """A `__getattr__` and a `__dir__` for a public module.

    Args:
        module: its name.
        homes: the names by the modules that define them; a module without names is public itself, by its last word.
        more: finds what is known only while running, None where there is no such name.
    """
    home = {name: where for where, names in homes.items() for name in names}
    modules = {where.rpartition(".")[2]: where for where, names in homes.items() if not names}

    def getattribute(name: str) -> object:
        if name in modules:
            return import_module(modules[name])
        if name not in home:
            if not name.startswith("_") and (found := more(name)) is not None:
                return found
            from neuro.core.hints import near

            hint = "" if name.startswith("_") else near(name, [*home, *modules])
            raise AttributeError(f"module '{module}' has no attribute '{name}'{hint and f': {hint}'}")
        value = getattr(import_module(home[name]), name)
        setattr(sys.modules[module], name, value)
        return value

    return getattribute, lambda: sorted([*home, *modules])
