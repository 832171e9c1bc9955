"""Settings as data: frozen dataclasses whose fields have unit, bounds, meaning and source; parts by name.

A method consists of numbers and parts. A part (a segmenter, a readout) comes from the `Registry` of its kind. The
name of a value is enough if only one part has a value of that name. Otherwise the name of the part and a dot precede,
as in ``segmenter.tau``. The name of a part replaces the part: ``readout=rbf``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, ClassVar, Self

from neuro.core.checks import check
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import Quantity
from neuro.core.registry import Registry


def setting(default: Any, unit: str = "", doc: str = "", source: str = "", *, option: str = "", **more: Any) -> Any:
    """Make a field for a value, or a tuple of values, within bounds.

    Args:
        default: a tuple takes lists of values, with kind "names" also empty ones; None may stay None.
        unit: physical unit.
        doc: meaning of the value.
        source: origin of the default.
        option: placeholder of the value on the command line, e.g. "N", or name and placeholder if the name differs
            from the field's, e.g. "--for MS"; "" for no option on the command line.
        more: bounds and words of `Quantity`; by default its `kind` follows from the default.
    """
    example = default[0] if isinstance(default, tuple) and default else default
    kinds = {bool: "boolean", int: "integer", str: "word" if more.get("words") else "name"}
    more.setdefault("kind", kinds.get(type(example), "number"))
    q = Quantity(unit=unit, doc=doc, optional=default is None, **more)
    return field(default=default, metadata={"quantity": q, "source": source, "option": option})


def part(kind: type[Part], default: Part) -> Any:
    """Make a field for a part of a kind."""
    return field(default=default, metadata={"part": kind})


@dataclass(frozen=True, slots=True)
class Row:
    """A value of the settings: full name, value, unit, meaning and source."""

    name: str
    value: Any
    unit: str
    doc: str
    source: str


@dataclass(frozen=True)
class Settings:
    """Base of settings: values that are checked when an instance is made.

    A field is made by `setting` or `part`. A plain field has a name as well, but no check; a field with the metadata
    ``{"fixed": True}`` can be neither changed by name nor written to a file.

    Class attributes:
        known_as: the name by which a user chooses the class; the name of the class in small letters if empty.
    """

    known_as: ClassVar[str] = ""

    def __post_init__(self) -> None:
        place = self.place()
        for entry in fields(self):
            if q := entry.metadata.get("quantity"):
                name = f"{place}: {entry.name}" if place else entry.name
                object.__setattr__(self, entry.name, self.checked(entry, q, getattr(self, entry.name), name))

    def checked(self, entry: Field[Any], q: Quantity, value: Any, what: str) -> Any:
        """Return the value of a field in its canonical form; several values become a tuple.

        Args:
            entry: the field.
            q: quantity of the field.
            value: value to check.
            what: name of the value in messages.

        Raises:
            ModelError: the value is out of bounds, or no list although the default is a list.
        """
        if not isinstance(entry.default, tuple) or q.kind == "names":
            return check(q, value, what)
        if not isinstance(value, (list, tuple)) or not value:
            raise ModelError(f"{what} = {value!r}: expected a list, each of it {q.expected()}")
        return tuple(check(q, single, f"{what}[{k}]") for k, single in enumerate(value))

    @classmethod
    def called(cls) -> str:
        """Return the name by which a user chooses the class: `known_as`, or its name in small letters."""
        return cls.known_as or cls.__name__.lower()

    def place(self) -> str:
        """Return what messages write before the name of a value, "" for nothing."""
        return self.called()

    @classmethod
    def own(cls) -> dict[str, Field[Any]]:
        """Return the fields that can be changed by name."""
        return {entry.name: entry for entry in fields(cls) if "fixed" not in entry.metadata}

    def rows(self, before: str = "") -> Iterator[Row]:
        """Yield all checked values; values of parts have the name of the part as prefix."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, Part):
                yield Row(before + entry.name, value.called(), "", value.about(), value.source)
                yield from value.rows(f"{before}{entry.name}.")
            elif q := entry.metadata.get("quantity"):
                yield Row(before + entry.name, value, q.unit, q.doc, entry.metadata["source"])

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return settings with some values changed.

        Args:
            values: new values by name. A part takes the name of another part, and its values are ``part.value``, or
                only the name of the value if no other part has that name.

        Raises:
            ModelError: a name is unknown or ambiguous, or a value is out of bounds.
        """
        known = self.own()
        new = {name: self._part_of(known[name], v) for name, v in values.items() if _holds_part(known.get(name))}
        new |= {name: values[name] for name in values if name in known and name not in new}
        new_settings = replace(self, **new)
        inner: dict[str, dict[str, Any]] = {}
        for name in values:
            if name not in known:
                holder, word = new_settings._holder(name)
                inner.setdefault(holder, {})[word] = values[name]
        return replace(new_settings, **{name: getattr(new_settings, name).changed(v) for name, v in inner.items()})

    def _part_of(self, entry: Field[Any], value: Any) -> Part:
        """Return the part with a name; the current part keeps its values."""
        kind: type[Part] = entry.metadata["part"]
        if isinstance(value, kind):
            return value
        present: Part = getattr(self, entry.name)
        return present if value == present.called() else kind.named(value)

    def _holder(self, name: str) -> tuple[str, str]:
        """Return the part, and the value in it, that a name means."""
        parts = {word: getattr(self, word) for word, entry in self.own().items() if _holds_part(entry)}
        part_name, dot, value_name = name.partition(".")
        if dot and part_name in parts:
            return part_name, value_name
        holders = [word for word, part in parts.items() if part.takes(name)]
        if len(holders) > 1:
            raise ModelError(
                f"'{name}' could mean {' or '.join(f'{h}.{name}' for h in holders)}: expected one of these"
            )
        if not holders:
            names = [row.name if dot else row.name.rpartition(".")[2] for row in self.rows()]
            raise unknown(f"setting of {self.place()}", name, names)
        return holders[0], name

    def takes(self, name: str) -> bool:
        """Return whether a value of its own has this name."""
        return name in self.own()

    def as_words(self) -> dict[str, Any]:
        """Return all values as plain data, for files: a part is ``{name: values}``."""
        plain_values: dict[str, Any] = {}
        for name in self.own():
            value = getattr(self, name)
            if isinstance(value, Part):
                plain_values[name] = {value.called(): value.as_words()}
            else:
                plain_values[name] = list(value) if isinstance(value, tuple) else value
        return plain_values

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> Self:
        """Return the settings from the result of `as_words`, also after storage as JSON."""
        values: dict[str, Any] = {}
        for name, entry in cls.own().items():
            value = words[name]
            if _holds_part(entry):
                ((part_name, inner),) = value.items()
                values[name] = type(entry.metadata["part"].named(part_name)).from_words(inner)
            else:
                values[name] = tuple(value) if isinstance(value, list) else value
        return cls(**values)


@dataclass(frozen=True)
class Part(Settings):
    """Base of the parts of settings. A kind of part is a subclass with `kind`, whose subclasses are the parts.

    Class attributes:
        kind: name of the kind in messages.
        source: publication of the part.
        known: the parts of this kind by name.
    """

    kind: ClassVar[str] = "part"
    source: ClassVar[str] = ""
    known: ClassVar[Registry[type[Any]]]

    @classmethod
    def named(cls, name: Any) -> Part:
        """Return the part of this kind with a name and the default values.

        Raises:
            ModelError: there is no such part.
        """
        if not isinstance(name, str) or name not in cls.known:
            raise unknown(cls.kind, str(name), cls.known)
        made: Part = cls.known[name]()
        return made

    def place(self) -> str:
        """Return the kind and the name."""
        return f"{self.kind} '{self.called()}'"

    @classmethod
    def about(cls) -> str:
        """Return the first line of the docstring."""
        return (cls.__doc__ or "").partition("\n")[0]


def _holds_part(entry: Field[Any] | None) -> bool:
    return entry is not None and "part" in entry.metadata
