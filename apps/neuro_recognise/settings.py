"""Settings as data: frozen dataclasses whose fields know unit, bounds, meaning and source; parts by name.

A method consists of numbers and of parts. A part (a segmenter, a readout) is one of those that its `Registry` knows.
A value is changed by its own name where only one part has it, else by the name of its part and a dot:
``segmenter.tau``. The name of a part alone puts another in its place: ``readout=rbf``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, ClassVar, Self

from neuro import ModelError
from neuro.apps import Quantity, Registry, check, unknown

SPLITS = "chosen on splits of N-MNIST's training recordings, which its accuracies are of, too"
"""Source of a value that was chosen by what was reported afterwards, not on recordings apart."""


def setting(default: Any, unit: str = "", doc: str = "", source: str = "", **more: Any) -> Any:
    """A field for a value, or a tuple of such, within bounds.

    Args:
        default: a tuple takes lists of values; None may stay None.
        unit: physical unit.
        doc: what it means.
        source: where its default comes from.
        more: bounds and words of `neuro.apps.Quantity`; its `kind` follows from the default if not given.
    """
    example = default[0] if isinstance(default, tuple) else default
    kinds = {bool: "boolean", int: "integer", str: "word"}
    more.setdefault("kind", kinds.get(type(example), "number"))
    metadata = {"quantity": Quantity(unit=unit, doc=doc, optional=default is None, **more), "source": source}
    return field(default=default, metadata=metadata)


def part(kind: type[Part], default: Part) -> Any:
    """A field for a part of a kind."""
    return field(default=default, metadata={"part": kind})


@dataclass(frozen=True, slots=True)
class Row:
    """A value among settings: its full name, itself, and what is known of it."""

    name: str
    value: Any
    unit: str
    doc: str
    source: str


@dataclass(frozen=True)
class Settings:
    """Base of methods and parts: values that are checked when it is made.

    Class attributes:
        known_as: the name by which it is asked for, where that is not the name of its class in small letters.
    """

    known_as: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for one in fields(self):
            if "quantity" in one.metadata:
                object.__setattr__(self, one.name, _checked(one, getattr(self, one.name), self.place()))

    @classmethod
    def called(cls) -> str:
        """The name by which it is asked for: `known_as`, or that of its class in small letters."""
        return cls.known_as or cls.__name__.lower()

    @classmethod
    def place(cls) -> str:
        """What stands before the names of its values in messages."""
        return cls.called()

    def rows(self, before: str = "") -> Iterator[Row]:
        """All values, those of parts with the part's name before them."""
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, Part):
                yield Row(before + one.name, value.called(), "", value.about(), value.source)
                yield from value.rows(f"{before}{one.name}.")
            elif "quantity" in one.metadata:
                q = one.metadata["quantity"]
                yield Row(before + one.name, value, q.unit, q.doc, one.metadata["source"])

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Settings with some values changed.

        Args:
            values: by name; a part by the name of another, or its values by ``part.value``. The name of a part's value
                is enough where no other has it.

        Raises:
            ModelError: a name is unknown or could mean several, or a value is out of its bounds.
        """
        own = {one.name: one for one in fields(self)}
        new = {
            name: self._part_of(own[name], values[name]) for name in values if name in own and _holds_part(own[name])
        }
        new |= {name: values[name] for name in values if name in own and name not in new}
        whole = replace(self, **new)
        inner: dict[str, dict[str, Any]] = {}
        for name in values:
            if name not in own:
                holder, word = whole._holder(name)
                inner.setdefault(holder, {})[word] = values[name]
        return replace(whole, **{name: getattr(whole, name).changed(given) for name, given in inner.items()})

    def _part_of(self, one: Field[Any], value: Any) -> Part:
        """The part that a word names; the present one keeps its values."""
        kind: type[Part] = one.metadata["part"]
        if isinstance(value, kind):
            return value
        if value == getattr(self, one.name).called():
            present: Part = getattr(self, one.name)
            return present
        return kind.named(value)

    def _holder(self, name: str) -> tuple[str, str]:
        """The part and the value in it that a name means."""
        parts = {one.name: getattr(self, one.name) for one in fields(self) if _holds_part(one)}
        first, dot, rest = name.partition(".")
        if dot and first in parts:
            return first, rest
        having = [holder for holder, held in parts.items() if held.takes(name)]
        if len(having) > 1:
            raise ModelError(f"'{name}' could mean {' or '.join(f'{h}.{name}' for h in having)}: expected one of these")
        if not having:
            known = [row.name if dot else row.name.rpartition(".")[2] for row in self.rows()]
            raise unknown(f"setting of {self.place()}", name, known)
        return having[0], name

    def takes(self, name: str) -> bool:
        """Whether a value of its own has this name."""
        return any(one.name == name for one in fields(self))

    def as_words(self) -> dict[str, Any]:
        """All values as plain data, for files: a part is ``{name: values}``."""
        words: dict[str, Any] = {}
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, Part):
                words[one.name] = {value.called(): value.as_words()}
            else:
                words[one.name] = list(value) if isinstance(value, tuple) else value
        return words

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> Self:
        """What `as_words` gave, also after a way through JSON."""
        values: dict[str, Any] = {}
        for one in fields(cls):
            value = words[one.name]
            if _holds_part(one):
                ((name, inner),) = value.items()
                values[one.name] = type(one.metadata["part"].named(name)).from_words(inner)
            else:
                values[one.name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)


@dataclass(frozen=True)
class Part(Settings):
    """A part of a method. A kind of part is a subclass with `kind`, and what it can be are subclasses of that.

    Class attributes:
        kind: what it is, for messages.
        source: where it is described.
        known: the parts of this kind by name.
    """

    kind: ClassVar[str] = "part"
    source: ClassVar[str] = ""
    known: ClassVar[Registry[type[Any]]]

    @classmethod
    def named(cls, name: Any) -> Part:
        """The part of this kind with a name and its own values.

        Raises:
            ModelError: there is none.
        """
        if not isinstance(name, str) or name not in cls.known:
            raise unknown(cls.kind, str(name), cls.known)
        made: Part = cls.known[name]()
        return made

    @classmethod
    def place(cls) -> str:
        """Its kind and its name."""
        return f"{cls.kind} '{cls.called()}'"

    @classmethod
    def about(cls) -> str:
        """The first line of its docstring."""
        return (cls.__doc__ or "").partition("\n")[0]


def _holds_part(one: Field[Any]) -> bool:
    return "part" in one.metadata


def _checked(one: Field[Any], value: Any, place: str) -> Any:
    """A value in its canonical form; several become a tuple."""
    q, what = one.metadata["quantity"], f"{place}: {one.name}"
    if not isinstance(one.default, tuple):
        return check(q, value, what)
    if not isinstance(value, (list, tuple)) or not value:
        raise ModelError(f"{what} = {value!r}: expected a list, each of it {q.expected()}")
    return tuple(check(q, single, f"{what}[{k}]") for k, single in enumerate(value))
