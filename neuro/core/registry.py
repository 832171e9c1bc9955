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
_ROOMS = (
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
"""Where registries are made, some in packages that may be missing. A class or an instance brings its own along; a
plain function does not."""


class Registry(Mapping[str, T], Generic[T]):
    """All parts of one kind, by name, ours first.

    Args:
        kind: what one is, for messages, e.g. "synapse model".
        own: those of this package, or by name the module of each, which is imported when the part is asked for.
        takes: whether a thing is of this kind; a kind of plain functions is said to `register`.
        group: the entry points of installed packages.
        name: how a part is called.
        complete: returns a third-party part if it has all that is relied on, and raises `TypeError` if not. It is
            asked when the part is first used: a decorator sees a class before the functions below it.
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
        self._whole: dict[int, T] = {id(part): part for part in self._parts.values()}
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
            hint = "register it first; an instance of it works in Python without being registered"
            raise ModelError(message, where=here(), hint=hint)
        if name in self:
            raise ModelError(f"{self.kind} '{name}' is registered twice", where=here(), hint="give it another name")
        self._registered[name] = part

    def check(self, part: T) -> None:
        """Refuse a part, registered or not, that lacks what is relied on.

        Raises:
            ModelError: it says what.
        """
        ours = id(part) in self._whole or self._homes.get(self._name(part)) == part.__module__
        if not ours:
            self._completed(part)

    def close(self, reason: str) -> None:
        """Take no more parts from now on, since `reason`."""
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
                    hint = "install again the package that brings it"
                    raise ModelError(f"{message}: {type(error).__name__}: {error}", hint=hint) from error
                if self.takes is not None and not self.takes(part):
                    raise ModelError(f"{message}: found {part!r:.60}: expected a {self.kind}")
                if self._name(part) != name:
                    raise ModelError(f"{message}: it is called '{self._name(part)}': expected the same name")
                self._parts[name] = self._completed(part)
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        """Yield names, those of installed packages last, so that built-in parts need no look at entry points."""
        here = dict.fromkeys((*self._homes, *self._parts, *self._registered))
        yield from here
        yield from (name for name in sorted(self._present()) if name not in here)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        ours = name in self._own or name in self._parts
        return ours or name in self._registered or name in self._entries()

    def values(self) -> ValuesView[T]:
        """All parts; of installed packages those that can be loaded."""
        return _Values(self)

    def items(self) -> ItemsView[str, T]:
        """All parts with their names; of installed packages those that can be loaded."""
        return _Items(self)

    def _whole_ones(self) -> Iterator[tuple[str, T]]:
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
            where = installed(self._group)[name].value
            self._tell(name, f"{self.kind} '{name}' of {where} is not used: there is one of that name")

    def _tell(self, name: str, what: str) -> None:
        """Warn once of a part that an installed package brings in vain: its name was not asked for."""
        if name not in self._told:
            self._told.add(name)
            warnings.warn(what, stacklevel=2)

    def _entries(self) -> set[str]:
        return installed(self._group).names if self._group else set()

    def _present(self) -> set[str]:
        """The names of entry points without those of packages of ours that were deleted."""
        entries = installed(self._group) if self._group else ()
        return {entry.name for entry in entries if not taken_away(entry)}

    def _completed(self, part: T) -> T:
        try:
            complete: T = self._complete(part)
        except TypeError as error:
            raise ModelError(str(error)) from None
        self._whole[id(part)] = part
        return complete


class _Values(ValuesView[T]):
    """The parts of a registry. Each is loaded when it is asked for: to find one of ours needs no look at packages."""

    _mapping: Registry[T]

    def __iter__(self) -> Iterator[T]:
        return (part for _, part in self._mapping._whole_ones())


class _Items(ItemsView[str, T]):
    """The parts of a registry with their names, loaded likewise."""

    _mapping: Registry[T]

    def __iter__(self) -> Iterator[tuple[str, T]]:
        return self._mapping._whole_ones()


@cache
def installed(group: str) -> EntryPoints:
    """The entry points of one group of all installed packages."""
    entry_points: EntryPoints = _installed().select(group=group)
    return entry_points


@cache
def _installed() -> Any:
    from importlib.metadata import entry_points  # it takes as long as all models

    return entry_points()


@overload
def register(thing: R, *, kind: str = "") -> R: ...
@overload
def register(*, kind: str) -> Callable[[R], R]: ...
def register(thing: Any = None, *, kind: str = "") -> Any:
    """Make a part known by its name: in YAML, Python, on the command line, in `neuro models` and `neuro schema`.

    Also a decorator. A class of neurons, generators, synapses, rules, distributions or filters, an event format, a
    chip and a backend are recognised by their class; a plain function says what it is by `kind`.

    Args:
        thing: the part.
        kind: of a function, e.g. `@neuro.register(kind="segmenter")`.

    Returns:
        The part itself.

    Raises:
        ModelError: it is of no known kind, its name is taken, or it comes too late.
    """
    if thing is None:
        return lambda function: register(function, kind=kind)
    _registry_of(thing, kind).add(thing)
    return thing


def _registry_of(thing: object, kind: str) -> Registry[Any]:
    registry_of_kind = next((registry for registry in _REGISTRIES if _is_of(registry, thing, kind)), None)
    if registry_of_kind is None:
        for room in _ROOMS:
            if find_spec(room.partition(".")[0]) is not None:
                import_module(room)
        registry_of_kind = next((registry for registry in _REGISTRIES if _is_of(registry, thing, kind)), None)
    if registry_of_kind is not None:
        return registry_of_kind
    kinds = ", ".join(sorted(registry.kind for registry in _REGISTRIES))
    hint = "write neuro.register(kind=...) above a function" if callable(thing) and not kind else ""
    if any(registry.kind == kind for registry in _REGISTRIES):
        raise ModelError(f"neuro.register: found {thing!r:.60}: expected a {kind}", where=here())
    what = f"kind = {kind!r}" if kind else f"found {thing!r:.60}"
    raise ModelError(f"neuro.register: {what}: expected one of these: {kinds}", where=here(), hint=hint)


def _is_of(registry: Registry[Any], thing: object, kind: str) -> bool:
    if kind:
        return registry.kind == kind and (registry.takes or callable)(thing)
    return registry.takes is not None and registry.takes(thing)


def registered() -> int:
    """Return the number of parts registered so far."""
    return sum(len(registry._registered) for registry in _REGISTRIES)


class OfModule:
    """The class attribute `arithmetic`: the nearest class or module that defines one of a model's functions.

    Functions in the body of a class have no `self`, because the caller writes `model.arithmetic.step(...)`. A subclass
    without functions inherits the functions of the base class. Functions may also be in the module of the class.

    Args:
        functions: names of the functions, one of which must be defined.
    """

    def __init__(self, functions: Collection[str]) -> None:
        self._functions = functions

    def __get__(self, model: object, kind: type[Any]) -> Any:
        for each in kind.__mro__:
            if any(isinstance(vars(each).get(name), FunctionType) for name in self._functions):
                return kind
            module = sys.modules.get(each.__module__)
            if module is not None and any(hasattr(module, name) for name in self._functions):
                return module
        return sys.modules[kind.__module__]
