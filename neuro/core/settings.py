"""Settings as data: frozen dataclasses whose fields have unit, bounds, meaning and source; parts by name.

A method consists of numbers and parts. A part (a segmenter, a readout) comes from the `Registry` of its kind. A value
is set by its name, or by part and name, as in ``segmenter.tau``, if several parts have the name. A part is replaced by
the name of another part, as in ``readout=rbf``.
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
        default: default value. A field with a tuple as default accepts lists, and with kind "names" also an empty list.
            A field with None as default accepts None.
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
    """A value of the settings: full name, e.g. "segmenter.tau", value, unit, meaning and source."""

    name: str
    value: Any
    unit: str
    doc: str
    source: str


@dataclass(frozen=True)
class Settings:
    """Base of settings: values that are checked when an instance is made.

    Make fields with `setting` or `part`. A plain field is not checked. A field with the metadata ``{"fixed": True}``
    can be neither changed by name nor written to a file.

    Class attributes:
        known_as: name by which a user chooses the class; "" for the name of the class in small letters.
    """

    known_as: ClassVar[str] = ""

    def __post_init__(self) -> None:
        place = self.place()
        for entry in fields(self):
            if q := entry.metadata.get("quantity"):
                name = f"{place}: {entry.name}" if place else entry.name
                object.__setattr__(self, entry.name, self.checked(entry, q, getattr(self, entry.name), name))

    def checked(self, entry: Field[Any], q: Quantity, value: Any, label: str) -> Any:
        """Return the value of a field in its canonical form; several values become a tuple.

        Args:
            entry: the field.
            q: quantity of the field.
            value: value to check.
            label: name of the value in messages.

        Raises:
            ModelError: the value is out of bounds, or is not a list although the default is one.
        """
        if not isinstance(entry.default, tuple) or q.kind == "names":
            return check(q, value, label)
        if not isinstance(value, (list, tuple)) or not value:
            raise ModelError(f"{label} = {value!r}: expected a list of elements, each {q.expected()}")
        return tuple(check(q, single, f"{label}[{k}]") for k, single in enumerate(value))

    @classmethod
    def called(cls) -> str:
        """Return the name by which a user chooses the class: `known_as`, or its name in small letters."""
        return cls.known_as or cls.__name__.lower()

    def place(self) -> str:
        """Return the prefix of a value's name in messages; "" for none."""
        return self.called()

    @classmethod
    def own(cls) -> dict[str, Field[Any]]:
        """Return the fields that can be changed by name."""
        return {entry.name: entry for entry in fields(cls) if "fixed" not in entry.metadata}

    def rows(self, prefix: str = "") -> Iterator[Row]:
        """Yield all checked values; values of parts have the name of the part as prefix."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, Part):
                yield Row(prefix + entry.name, value.called(), "", value.about(), value.source)
                yield from value.rows(f"{prefix}{entry.name}.")
            elif q := entry.metadata.get("quantity"):
                yield Row(prefix + entry.name, value, q.unit, q.doc, entry.metadata["source"])

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return settings with some values changed.

        Args:
            values: new values by name. The value of a part is the name of another part. A value inside a part has the
                name ``part.value``, or only ``value`` if no other part has a value of that name.

        Raises:
            ModelError: a name is unknown or ambiguous, or a value is out of bounds.
        """
        known = self.own()
        changes = {name: self._part_of(known[name], v) for name, v in values.items() if _holds_part(known.get(name))}
        changes |= {name: values[name] for name in values if name in known and name not in changes}
        new_settings = replace(self, **changes)
        of_parts: dict[str, dict[str, Any]] = {}
        for name in values:
            if name not in known:
                holder, word = new_settings._holder(name)
                of_parts.setdefault(holder, {})[word] = values[name]
        return replace(new_settings, **{name: getattr(new_settings, name).changed(v) for name, v in of_parts.items()})

    def _part_of(self, entry: Field[Any], value: Any) -> Part:
        """Return a part for a name: the current part with its values if it has the name, else a part with defaults."""
        kind: type[Part] = entry.metadata["part"]
        if isinstance(value, kind):
            return value
        present: Part = getattr(self, entry.name)
        return present if value == present.called() else kind.named(value)

    def _holder(self, name: str) -> tuple[str, str]:
        """Split a name such as "tau" or "segmenter.tau" into the name of the part and the name of the value."""
        parts = {word: getattr(self, word) for word, entry in self.own().items() if _holds_part(entry)}
        part_name, dot, value_name = name.partition(".")
        if dot and part_name in parts:
            return part_name, value_name
        holders = [word for word, part in parts.items() if part.takes(name)]
        if len(holders) > 1:
            raise ModelError(f"'{name}' can mean {' or '.join(f'{h}.{name}' for h in holders)}: expected one of these")
        if not holders:
            names = [row.name if dot else row.name.rpartition(".")[2] for row in self.rows()]
            raise unknown(f"setting of {self.place()}", name, names)
        return holders[0], name

    def takes(self, name: str) -> bool:
        """Return whether the part has a value with this name."""
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
        """Return settings from the plain data that `as_words` returned. The data may have been stored as JSON."""
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
    """Base of the parts of settings.

    A direct subclass with `kind` defines a kind of part, e.g. the segmenters. Its subclasses are the parts of the kind.

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
