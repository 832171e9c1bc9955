"""Generated code as a module: it stands in `sys.modules`, and its text can be looked at as that of any other."""

from __future__ import annotations

import hashlib
import linecache
import sys
from types import ModuleType

NAMES = "neuro_equations_"
"""How the names of generated modules begin."""


def module(text: str) -> ModuleType:
    """The module of a text; one text has one module.

    Args:
        text: of a generated module: it was written here from checked trees, never by users.
    """
    name = NAMES + hashlib.sha256(text.encode()).hexdigest()[:16]
    if name not in sys.modules:
        file = f"<{name}>"
        made = ModuleType(name)
        made.__file__ = file
        linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
        exec(compile(text, file, "exec"), made.__dict__)
        sys.modules[name] = made
    return sys.modules[name]


def text_of(module: ModuleType) -> str:
    """The text of a generated module."""
    return "".join(linecache.cache[module.__file__ or ""][2])  # type: ignore[misc]
