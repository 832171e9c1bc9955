"""The code that computes, as a digest: what was kept of other code is not used."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator
from dataclasses import fields
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

from neuro.apps import Settings

OURS = ("neuro", "neuro_event", "neuro_models", "neuro_recognise", "neuro_torch", "neuro_train")
"""Packages that compute what is observed and learnt; another backend is a setting."""
ONLY_TELL = {
    ("neuro", "cli"),
    ("neuro_recognise", "telling"),
    ("neuro_recognise", "cli.py"),
    ("neuro_train", "telling.py"),
    ("neuro_train", "cli.py"),
}
"""Rooms in which nothing is computed that is kept."""
PLAIN = (bool, int, float, str)


def code_of(method: Settings) -> str:
    """A digest of the sources that a method and its parts come from: equal for equal code.

    Of this package all that computes counts; of a third-party class its file, and the files beside it or of its package
    that it takes names from. What was typed into a notebook counts by its functions.
    """
    classes = dict.fromkeys(_classes(method))
    digest = hashlib.sha256(_ours().encode())
    for name, module in sorted(_with_neighbours(cls.__module__ for cls in classes).items()):
        held = vars(module).values() if module else [cls for cls in classes if cls.__module__ == name]
        file = getattr(module, "__file__", None)
        digest.update(f"\0{name}\0".encode() + (_text(Path(file)) if file else repr([*_told(held, name)]).encode()))
    return digest.hexdigest()[:32]


def _classes(settings: Settings) -> Iterator[type]:
    """The classes of settings and of the parts in them, with all that they inherit from."""
    yield from type(settings).__mro__
    for one in fields(settings):
        value = getattr(settings, one.name)
        if isinstance(value, Settings):
            yield from _classes(value)


@cache
def _ours() -> str:
    """The digest of our own sources; read once, as it is the code that runs which counts."""
    digest = hashlib.sha256()
    for folder in _folders():
        for file in sorted(folder.rglob("*")):
            inside = file.relative_to(folder)
            if file.suffix in (".py", ".yaml") and (folder.name, inside.parts[0]) not in ONLY_TELL:
                digest.update(f"\0{folder.name}/{inside.as_posix()}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def _folders() -> list[Path]:
    specs = [find_spec(name) for name in OURS]
    return [Path(spec.submodule_search_locations[0]) for spec in specs if spec and spec.submodule_search_locations]


def _with_neighbours(names: Iterable[str]) -> dict[str, ModuleType | None]:
    """The third-party modules of some names, and those of the same place that they have names of."""
    found: dict[str, ModuleType | None] = {}
    waiting = [*names]
    while waiting:
        name = waiting.pop()
        first = name.partition(".")[0]
        if name not in found and first not in OURS and (first == "__main__" or first not in sys.stdlib_module_names):
            found[name] = module = sys.modules.get(name)
            held = vars(module).values() if module else ()
            others = {one.__name__ if isinstance(one, ModuleType) else getattr(one, "__module__", "") for one in held}
            waiting += [other for other in others if isinstance(other, str) and _together(name, other)]
    return found


def _together(name: str, other: str) -> bool:
    """Whether two modules are of one package, or files of one folder."""
    if "." in name or "." in other:
        return name.partition(".")[0] == other.partition(".")[0]
    here, there = (getattr(sys.modules.get(each), "__file__", None) for each in (name, other))
    return bool(here and there and Path(here).parent == Path(there).parent)


@cache
def _text(file: Path) -> bytes:
    """The source of a module, likewise read once."""
    return file.read_bytes() if file.is_file() else b""


def _told(things: Iterable[object], module: str) -> Iterator[object]:
    """What the functions and classes do that were defined in a module."""
    for thing in things:
        inner = getattr(thing, "fget", None) or getattr(thing, "__func__", thing)  # of properties and class methods
        if getattr(inner, "__module__", None) == module:
            if isinstance(inner, type):
                yield from _told([*vars(inner).values()], module)
            elif isinstance(inner, FunctionType):
                known = inner.__globals__
                plain = {name: known[name] for name in inner.__code__.co_names if isinstance(known.get(name), PLAIN)}
                yield _instructions(inner.__code__), plain


def _instructions(code: CodeType) -> tuple[object, ...]:
    """What a function does, without where it stands."""
    inner = (_instructions(one) if isinstance(one, CodeType) else one for one in code.co_consts)
    return code.co_code, code.co_names, [sorted(one, key=repr) if isinstance(one, frozenset) else one for one in inner]
