"""Registries: parts of this package, of installed packages (entry points) and of a running program, by name.

Each kind of part has one registry, in the module that defines the kind. YAML, the command line and reports look names
up in the registry, so third-party parts behave like built-in ones.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Collection, ItemsView, Iterable, Iterator, Mapping, ValuesView
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from neuro.core.errors import ModelError, here
from neuro.core.lazy import missing, taken_away

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

T = TypeVar("T")
R = TypeVar("R")

_REGISTRIES: list[Registry[Any]] = []
_REGISTRY_MODULES = (
    "neuro.model.neurons",
    "neuro.model.synapses",
    "neuro.model.rules",
    "neuro.model.distributions",
    "neuro.model.space",
    "neuro.model.signals",
    "neuro.program.backend",
    "neuro.chips.known",
    "neuro_events.filters",
    "neuro_events.formats",
    "neuro_events.representations",
    "neuro_events.segmentation",
    "neuro.coding.codes",
    "neuro.coding.world",
    "neuro_sweeps.function",
)
"""Modules that define registries; some packages may be missing. The module of a class imports its registry, but the
module of a plain function may not."""


class Registry(Mapping[str, T], Generic[T]):
    """All parts of one kind, by name, built-in parts first.

    Args:
        kind: name of the kind in messages, e.g. "synapse model".
        own: parts of this package, or the module of each part by name, which is imported at the first use of the part.
        takes: function that returns whether an object is of this kind; None for kinds of plain functions, whose kind
            is an argument of `register`.
        group: group of entry points of installed packages.
        name: function that returns the name of a part.
        complete: function that returns a third-party part, or raises `TypeError` if the part lacks a needed function.
            The registry calls `complete` at the first use of the part, because a decorator registers a class before
            the rest of its module is defined.
    """

    def __init__(
        self,
        kind: str,
        own: Iterable[T] | Mapping[str, str],
        *,
        takes: Callable[[object], bool] | None = None,
        group: str = "",
        name: Callable[[Any], str] = lambda part: str(
            part.called() if hasattr(part, "called") else getattr(part, "__name__", "")
        ),
        complete: Callable[[Any], Any] = lambda part: part,
    ) -> None:
        self.kind, self.takes, self._group, self._name, self._complete = kind, takes, group, name, complete
        self._homes: Mapping[str, str] = own if isinstance(own, Mapping) else {}
        self._parts: dict[str, T] = {} if isinstance(own, Mapping) else {name(part): part for part in own}
        self._registered: dict[str, T] = {}
        self._checked_parts: dict[int, T] = {id(part): part for part in self._parts.values()}
        self._closed_by = ""
        self._own, self._told = frozenset((*self._homes, *self._parts)), set[str]()
        _REGISTRIES.append(self)

    def add(self, part: T) -> None:
        """Register a part.

        Raises:
            ModelError: another part has the name, or the registry is closed already.
        """
        name = self._name(part)
        if self._closed_by:
            message = f"{self.kind} '{name}' is registered too late: {self._closed_by}"
            hint = "register it earlier; in Python an instance works without registration"
            raise ModelError(message, where=here(), hint=hint)
        if name in self:
            raise ModelError(f"{self.kind} '{name}' is registered twice", where=here(), hint="give it another name")
        self._registered[name] = part

    def check(self, part: T) -> None:
        """Raise an error if a part, registered or not, lacks a needed function.

        Raises:
            ModelError: a function is missing; the message names it.
        """
        ours = id(part) in self._checked_parts or self._homes.get(self._name(part)) == part.__module__
        if not ours:
            self._completed(part)

    def close(self, reason: str) -> None:
        """Refuse further parts; messages contain the reason."""
        self._closed_by = self._closed_by or reason

    def __getitem__(self, name: str) -> T:
        if name not in self._parts:
            if name in self._homes:
                self._parts[name] = getattr(import_module(self._homes[name]), name)
            elif name in self._registered:
                self._parts[name] = self._completed(self._registered[name])
            elif name in self._entries():
                entry = installed(self._group)[name]
                if package := taken_away(entry):
                    raise ModelError(f"{self.kind} '{name}' {missing(package)}")
                message = f"{self.kind} '{name}' cannot be loaded from {entry.value}"
                try:
                    part = entry.load()
                except Exception as error:
                    hint = "install the package with this part again"
                    raise ModelError(f"{message}: {type(error).__name__}: {error}", hint=hint) from error
                if self.takes is not None and not self.takes(part):
                    raise ModelError(f"{message}: found {part!r:.60}: expected a {self.kind}")
                if self._name(part) != name:
                    raise ModelError(f"{message}: found a part named '{self._name(part)}': expected the same name")
                self._parts[name] = self._completed(part)
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        """Yield all names. Names of installed packages come last, so a search for built-in parts skips entry points."""
        local_names = dict.fromkeys((*self._homes, *self._parts, *self._registered))
        yield from local_names
        yield from (name for name in sorted(self._present()) if name not in local_names)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        ours = name in self._own or name in self._parts
        return ours or name in self._registered or name in self._entries()

    def values(self) -> ValuesView[T]:
        """Return all parts. Parts of installed packages that cannot be loaded are left out."""
        return _Values(self)

    def items(self) -> ItemsView[str, T]:
        """Return all parts with their names. Parts of installed packages that cannot be loaded are left out."""
        return _Items(self)

    def _usable_items(self) -> Iterator[tuple[str, T]]:
        for name in self:
            try:
                part = self[name]
            except ModelError as error:
                if name in self._registered:
                    raise
                self._tell(name, str(error))
            else:
                yield name, part
        for name in self._entries() & {*self._own, *self._registered}:
            origin = installed(self._group)[name].value
            self._tell(name, f"{self.kind} '{name}' of {origin} is not used: the name is taken")

    def _tell(self, name: str, problem: str) -> None:
        """Warn once about an unusable part of an installed package."""
        if name not in self._told:
            self._told.add(name)
            warnings.warn(problem, stacklevel=2)

    def _entries(self) -> set[str]:
        return installed(self._group).names if self._group else set()

    def _present(self) -> set[str]:
        """Return the names of entry points, without those of deleted packages of this distribution."""
        entries = installed(self._group) if self._group else ()
        return {entry.name for entry in entries if not taken_away(entry)}

    def _completed(self, part: T) -> T:
        try:
            complete: T = self._complete(part)
        except TypeError as error:
            raise ModelError(str(error)) from None
        self._checked_parts[id(part)] = part
        return complete


class _Values(ValuesView[T]):
    """The parts of a registry. Each part is loaded when the iteration reaches it."""

    _mapping: Registry[T]

    def __iter__(self) -> Iterator[T]:
        return (part for _, part in self._mapping._usable_items())


class _Items(ItemsView[str, T]):
    """The parts of a registry with their names, see `_Values`."""

    _mapping: Registry[T]

    def __iter__(self) -> Iterator[tuple[str, T]]:
        return self._mapping._usable_items()


@cache
def installed(group: str) -> EntryPoints:
    """Return the entry points of a group, of all installed packages."""
    entry_points: EntryPoints = _installed().select(group=group)
    return entry_points


@cache
def _installed() -> Any:
    from importlib.metadata import entry_points  # importing this module takes as long as importing all models

    return entry_points()


@overload
def register(thing: R, *, kind: str = "") -> R: ...
@overload
def register(*, kind: str) -> Callable[[R], R]: ...
def register(thing: Any = None, *, kind: str = "") -> Any:
    """Make a part known by its name: in YAML, Python, on the command line, in `neuro models` and `neuro schema`.

    The function is also a decorator. Neurons, generators, synapses, rules, distributions, filters, event formats, chips
    and backends are recognised by their class. A plain function needs the argument `kind`.

    Args:
        thing: the part.
        kind: kind of a function, e.g. `@neuro.register(kind="segmenter")`.

    Returns:
        The part itself.

    Raises:
        ModelError: the part has no known kind or a name in use, or is registered too late.
    """
    if thing is None:
        return lambda function: register(function, kind=kind)
    _registry_of(thing, kind).add(thing)
    return thing


def _registry_of(thing: object, kind: str) -> Registry[Any]:
    registry_of_kind = next((registry for registry in _REGISTRIES if _is_of(registry, thing, kind)), None)
    if registry_of_kind is None:
        for module in _REGISTRY_MODULES:
            if find_spec(module.partition(".")[0]) is not None:
                import_module(module)
        registry_of_kind = next((registry for registry in _REGISTRIES if _is_of(registry, thing, kind)), None)
    if registry_of_kind is not None:
        return registry_of_kind
    kinds = ", ".join(sorted(registry.kind for registry in _REGISTRIES))
    hint = "write neuro.register(kind=...) above a function" if callable(thing) and not kind else ""
    if any(registry.kind == kind for registry in _REGISTRIES):
        raise ModelError(f"neuro.register: found {thing!r:.60}: expected a {kind}", where=here())
    problem = f"kind = {kind!r}" if kind else f"found {thing!r:.60}"
    raise ModelError(f"neuro.register: {problem}: expected one of these: {kinds}", where=here(), hint=hint)


def _is_of(registry: Registry[Any], thing: object, kind: str) -> bool:
    if kind:
        return registry.kind == kind and (registry.takes or callable)(thing)
    return registry.takes is not None and registry.takes(thing)


def registered() -> int:
    """Return the number of parts registered so far."""
    return sum(len(registry._registered) for registry in _REGISTRIES)


class OfModule:
    """Descriptor of the class attribute `arithmetic`: the nearest class or module that defines a model's functions.

    Functions in the body of a class have no `self`, because the caller writes `model.arithmetic.step(...)`. A subclass
    without functions inherits the functions of the base class. Functions may also be in the module of the class.

    Args:
        functions: names of the functions; at least one must be defined.
    """

    def __init__(self, functions: Collection[str]) -> None:
        self._functions = functions

    def __get__(self, model: object, kind: type[Any]) -> Any:
        for base in kind.__mro__:
            if any(isinstance(vars(base).get(name), FunctionType) for name in self._functions):
                return kind
            module = sys.modules.get(base.__module__)
            if module is not None and any(hasattr(module, name) for name in self._functions):
                return module
        return sys.modules[kind.__module__]
