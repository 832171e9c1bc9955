"""Named choices with parameters: models, synapses, rules, distributions, groups."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, replace
from typing import Any, ClassVar, Self

from neuro.core.checks import check
from neuro.core.errors import ModelError, here, nearest, unknown
from neuro.core.quantities import Quantity, with_unit, word_of
from neuro.core.values import same, shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """A choice by name, with parameters: `name(parameters)` in Python, `{name: {parameters}}` in YAML.

    Subclasses are frozen dataclasses whose fields are made by `quantity`. Two choices are equal if
    they have the same name and equal parameters; arrays are compared by value.

    Class attributes:
        file_of: parameter that YAML can read from a file with the words `file` and `key`; "" for none.
        strays: hints by word, for words that users may mistake for parameters.
    """

    kind: ClassVar[str] = "choice"
    word: ClassVar[str] = ""
    file_of: ClassVar[str] = ""
    strays: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls) -> None:
        cls.__repr__ = Choice.__repr__  # type: ignore[method-assign]  # otherwise @dataclass would make another one

    def __new__(cls, /, *args: Any, **words: Any) -> Self:
        """Refuse unknown parameters, with the nearest known name."""
        _check_class(cls)
        names = {entry.name for entry in fields(cls)}
        if len(args) > sum(not entry.kw_only for entry in fields(cls)):
            message = f"{cls.called()}: found {len(args)} values without a name: expected {cls.called()}(name=value)"
            raise ModelError(message, where=here(), hint=nearest("", [entry.name for entry in fields(cls)]))
        for word in words:
            if word not in names:
                raise unknown(f"parameter of {cls.called()}", word, names, here(), (word,))
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for entry in fields(self):
            q, value, word = entry.metadata["quantity"], getattr(self, entry.name), word_of(entry.name)
            try:
                object.__setattr__(self, entry.name, check(q, value, f"{self.name}.{word}", (word,)))
            except ModelError as error:
                raise error.at(here()) from None

    def in_unit(self, q: Quantity, label: str) -> Self:
        """Return a copy whose parameters with a unit are converted to the unit of the described value.

        Args:
            q: quantity of the value.
            label: name of the value in messages.

        Raises:
            ModelError: a parameter has another dimension; the error's path leads to the parameter.
        """
        numbers = {}
        for entry in self._measured():
            own_quantity, value = entry.metadata["quantity"], getattr(self, entry.name)
            full_name, word = f"{label}: {self.name}.{word_of(entry.name)}", word_of(entry.name)
            try:
                if isinstance(value, str):
                    numbers[entry.name] = with_unit(q, value, full_name)
                else:
                    unit = "ms" if q.kind == "delay" else q.unit or q.taken_in
                    converted = replace(own_quantity, of_value=False, taken_in=unit)
                    numbers[entry.name] = check(converted, value, full_name)
            except ModelError as error:
                inner = error.path if isinstance(value, str) else error.path[1:]
                raise error.but(where=None, path=(self.name, word, *inner)) from None
        return replace(self, **numbers) if numbers else self

    @property
    def measured(self) -> bool:
        """True if some parameters still carry a unit, because the unit of the described value is unknown."""
        return bool(self._measured())

    def _measured(self) -> list[Field[Any]]:
        """Return the fields of parameters that still carry a unit."""
        entries = (entry for entry in fields(self) if entry.metadata["quantity"].of_value)
        return [entry for entry in entries if _has_unit(getattr(self, entry.name))]

    @classmethod
    def called(cls) -> str:
        """Return the name of this choice in YAML: `word`, or by default the name of the class."""
        return cls.word or cls.__name__

    @classmethod
    def identity(cls) -> str:
        """Return a text that identifies the choice in a saved state, besides name and parameters; "" if built in."""
        return ""

    @property
    def name(self) -> str:
        """Name of this choice in YAML."""
        return self.called()

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """Return the quantities of the parameters by word, in the order of definition.

        Raises:
            ModelError: a field was not made by `quantity`, or the class is no dataclass.
        """
        _check_class(cls)
        return {word_of(entry.name): entry.metadata["quantity"] for entry in fields(cls)}

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Return the defaults by word, for parameters with a default."""
        return {word_of(f.name): f.default for f in fields(cls) if f.default is not MISSING}

    @classmethod
    def from_words(cls, parameters: Mapping[str, Any]) -> Self:
        """Make a choice from words and values.

        Raises:
            ModelError: a word is unknown, a required one is missing, or a value is out of bounds.
        """
        names = {word_of(entry.name): entry for entry in fields(cls)}
        for word in parameters:
            if word not in names:
                raise unknown(f"parameter of {cls.called()}", word, names, path=(str(word),))
        for word, entry in names.items():
            if entry.default is MISSING and word not in parameters:
                expected = entry.metadata["quantity"].expected()
                raise ModelError(f"{cls.called()} needs '{word}': expected {expected}", missing=word)
        return cls(**{names[word].name: value for word, value in parameters.items()})

    def parameters(self) -> dict[str, Any]:
        """Return the values of all parameters by word, in the order of definition."""
        return {word_of(entry.name): getattr(self, entry.name) for entry in fields(self)}

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        own_values, other_values = self.parameters(), other.parameters()
        return all(same(own_values[word], other_values[word]) for word in own_values)

    __hash__ = None  # type: ignore[assignment]

    def changed(self) -> dict[str, Any]:
        """Return the parameters that differ from the default, by field name."""
        now = {f.name: getattr(self, f.name) for f in fields(self)}
        return {f.name: now[f.name] for f in fields(self) if f.default is MISSING or not same(now[f.name], f.default)}

    def __repr__(self) -> str:
        return f"{self.name}({', '.join(f'{name}={shown(value)}' for name, value in self.changed().items())})"


def _has_unit(value: Any) -> bool:
    """Return True if a value, or a parameter of a distribution, is written with a unit."""
    return isinstance(value, (str, tuple)) or (isinstance(value, Choice) and value.measured)


_CHECKED: dict[int, type[Choice]] = {}
"""Classes whose fields have been checked, by `id`."""


def _check_class(cls: type[Choice]) -> None:
    """Raise an error if a class is no dataclass, or if `quantity` did not make all of its fields."""
    if id(cls) in _CHECKED:
        return
    if any(isinstance(value, Field) for value in vars(cls).values()):
        message = f"{cls.kind} '{cls.__name__}' is no dataclass"
        raise ModelError(message, hint="write @dataclass(frozen=True, kw_only=True, eq=False) above its class")
    for entry in fields(cls):
        if "quantity" not in entry.metadata:
            default = "..." if entry.default is MISSING else repr(entry.default)
            message = f"{cls.kind} '{cls.__name__}': '{entry.name}' is no quantity"
            raise ModelError(message, hint=f'write {entry.name}: float = quantity({default}, "unit", "meaning")')
        if entry.default is not MISSING:
            check(entry.metadata["quantity"], entry.default, f"{cls.__name__}.{entry.name}, its default")
    _CHECKED[id(cls)] = cls
