"""Import of public names on first use. `import neuro` then loads few modules."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from os.path import dirname
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

DISTRIBUTION = "neuro-snn"
"""Name of this package in package indexes, where `neuro` is another package."""

PACKAGES = {"neuro.events": "neuro_events", "neuro.live": "neuro_live", "neuro.sweeps": "neuro_sweeps"}
"""Package of each public module of `neuro` that is a separate package in `apps`."""


def public_names(
    module: str, file: str, more: Callable[[str], object] = lambda name: None
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` for a public module.

    The block `if TYPE_CHECKING:` of the module lists the names, as `from home import name as name`. A line
    `from home import *` adds the names that `home` imports in the same form. Type checkers read the same lines, so
    each name is listed once.

    Args:
        module: name of the module.
        file: path of the source of the module.
        more: function that returns parts registered while the program runs, or None for an unknown name.
    """
    homes = homes_in(file, "if TYPE_CHECKING:\n")

    def getattribute(name: str) -> object:
        if name not in homes:
            if not name.startswith("_") and (part := more(name)) is not None:
                return part
            from neuro.core.hints import near

            hint = "" if name.startswith("_") else near(name, list(homes))
            raise AttributeError(f"module '{module}' has no attribute '{name}'{hint and f': {hint}'}")
        try:
            home = import_module(homes[name])
            # For a submodule, getattr of the module itself would call this function again.
            is_submodule = homes[name] == module or not hasattr(home, name)
            value = import_module(f"{homes[name]}.{name}") if is_submodule else getattr(home, name)
        except ModuleNotFoundError as error:
            package = PACKAGES.get(f"{module}.{name}", homes[name].partition(".")[0])
            if error.name not in (package, f"{module}.{name}"):
                raise
            raise AttributeError(f"{module}.{name} {missing(package)}") from None
        setattr(sys.modules[module], name, value)
        return value

    return getattribute, lambda: sorted(homes), sorted(homes)


def missing(package: str) -> str:
    """Return the end of a message about a missing package of `apps`."""
    return f"is in the package {package}, which is not installed: it comes with {DISTRIBUTION}"


def taken_away(entry: EntryPoint) -> str:
    """Return the missing package of one of this distribution's own entry points, e.g. a command; "" if none is missing.

    A missing package of another distribution is an error of that distribution.
    """
    from importlib.util import find_spec

    package = entry.module.partition(".")[0]
    if find_spec(package) is not None:
        return ""
    return package if entry.dist is not None and entry.dist.name == DISTRIBUTION else ""


class PublicModules:
    """Import finder for the public modules of `neuro` in separate packages, e.g. `neuro.events`, and their submodules.

    `neuro.events.filters` and `neuro_events.filters` are one module, imported on first use of either name.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a public module; None for all others.

        Raises:
            ModuleNotFoundError: the package is not installed.
        """
        public = ".".join(fullname.split(".")[:2])
        if public not in PACKAGES:
            return None
        name = PACKAGES[public] + fullname.removeprefix(public)
        try:
            module = import_module(name)
        except ModuleNotFoundError as error:
            if error.name != PACKAGES[public]:
                raise
            raise ModuleNotFoundError(f"{fullname} {missing(PACKAGES[public])}", name=fullname) from None
        loader: Any = self  # the base class would need a slow import
        state = (module, module.__spec__)
        return ModuleSpec(fullname, loader, loader_state=state, is_package=hasattr(module, "__path__"))

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module under its own name."""
        module: ModuleType = spec.loader_state[0]
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the module's own spec. The import by the public name has replaced it."""
        spec = module.__spec__
        if spec is not None:
            module.__spec__ = spec.loader_state[1]


def homes_in(file: str, block: str = "") -> dict[str, str]:
    """Return the home module of each name in lines `from home import name as name`.

    Args:
        file: path of the source file.
        block: line that opens the block to search; "" for the whole file.
    """
    homes: dict[str, str] = {}
    home, is_in_block = "", not block
    # The file is split into words, since importing `ast`, `re` or `pathlib` would take half as long as `import neuro`.
    with open(file, encoding="utf-8") as source:
        for line in source:
            if block and line.strip() and not line.startswith(" "):
                is_in_block = line == block
            elif is_in_block:
                words = line.replace("(", " ").replace(")", " ").replace(",", " ").split()
                if words[:1] == ["from"]:
                    home, words = words[1], words[3:]
                if words[:1] == ["*"]:
                    homes |= homes_in(f"{dirname(dirname(__file__))}/{home.partition('.')[2].replace('.', '/')}.py")
                names = zip(words[::3], words[2::3], strict=False)  # `name as name`, three words each
                homes |= {name: home for name, alias in names if name == alias}
    return homes
