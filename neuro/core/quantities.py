"""Parameters that know their unit and their bounds: the fields of models, synapses, rules and groups."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, Self, TypeAlias

from neuro.core.checks import check
from neuro.core.errors import ModelError, here, nearest, unknown
from neuro.core.values import FromFile, same, shown

__all__ = ["Choice", "FromFile", "Quantity", "Value", "check", "quantity", "same", "word_of"]

Value: TypeAlias = Any  # float | per-element array | Choice (a distribution) | FromFile; narrowed by check()


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a parameter may be.

    Attributes:
        unit: physical unit, "" for none.
        doc: one line on its meaning.
        kind: "number", "integer", "boolean", "name" (of a part of the network), "word" (one of
            `words`), "shape" (a list of integers), "times" (spike times, a list per neuron), "ids",
            "delay" (a time that is no number of the rule), "names" (a list of names) or "part" (a `part`).
        above, at_least, below, at_most: bounds of every element.
        infinite: whether an infinite value has a meaning.
        whole: whether a number, and every element of an array, must be a whole one.
        arrays: whether one value per element (an array or a distribution) is accepted.
        optional: whether it may be left out for good (None).
        words: the accepted words of kind "word", and those accepted beside numbers in a "shape".
        part: the class of kind "part".
    """

    unit: str = ""
    doc: str = ""
    kind: str = "number"
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    infinite: bool = False
    whole: bool = False
    arrays: bool = False
    optional: bool = False
    words: tuple[str, ...] = ()
    part: type[Choice] | None = None

    def expected(self) -> str:
        """The sentence part that says what is accepted, e.g. "a number > 0 ms"."""
        if self.kind == "word":
            return "one of " + ", ".join(self.words)
        noun = {
            "number": "a whole number" if self.whole else "a number",
            "integer": "a whole number",
            "boolean": "true or false",
            "name": "a name",
            "shape": "whole numbers",
            "times": "a list of spike times in ms for each neuron",
            "ids": "whole numbers >= 0",
            "delay": "a time > 0 ms",
            "names": "names",
            "part": f"the words of {self.part.__name__}" if self.part else "",
        }[self.kind]
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in (
                (">", self.above),
                (">=", self.at_least),
                ("<", self.below),
                ("<=", self.at_most),
            )
            if bound is not None
        ]
        text = " ".join([noun, " and ".join(bounds)]) if bounds else noun
        if self.kind == "shape" and self.words:
            text += " or " + " or ".join(self.words)
        unit = f" {self.unit}" if self.unit and self.kind == "number" else ""
        return text + unit


def quantity(default: Any = MISSING, unit: str = "", doc: str = "", **more: Any) -> Any:
    """A dataclass field that carries a `Quantity`; see there for `more`."""
    q = Quantity(unit=unit, doc=doc, optional=default is None, **more)
    return field(default=default, metadata={"quantity": q})


def word_of(name: str) -> str:
    """The word of the language for a Python field name (`lambda_` is `lambda`)."""
    return name.rstrip("_")


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """A named choice with parameters, said `name(parameters)` in Python and `{name: {parameters}}` in YAML.

    Subclasses are frozen dataclasses whose fields are made by `quantity`. Two choices are equal when
    they have the same name and equal parameters, arrays compared by value.
    """

    kind: ClassVar[str] = "choice"
    word: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        cls.__repr__ = Choice.__repr__  # type: ignore[method-assign]  # or @dataclass would make its own

    def __new__(cls, *args: Any, **words: Any) -> Self:
        """Refuse an unknown parameter by its nearest right name."""
        known = {entry.name for entry in fields(cls)}
        if len(args) > sum(not entry.kw_only for entry in fields(cls)):
            raise ModelError(
                f"{cls.called()}: found {len(args)} values without a name: expected {cls.called()}(name=value)",
                where=here(),
                hint=nearest("", [entry.name for entry in fields(cls)]),
            )
        for word in words:
            if word not in known:
                raise unknown(f"parameter of {cls.called()}", word, known, here(), (word,))
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for entry in fields(self):
            q, value, word = entry.metadata["quantity"], getattr(self, entry.name), word_of(entry.name)
            try:
                object.__setattr__(self, entry.name, check(q, value, f"{self.name}.{word}", (word,)))
            except ModelError as error:
                raise error.at(here()) from None

    @classmethod
    def called(cls) -> str:
        """The word that names this choice in the language: the name of its class, or `word`."""
        return cls.word or cls.__name__

    @property
    def name(self) -> str:
        """The word that names this choice in the language."""
        return self.called()

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """The parameters by their words, in the order of definition."""
        return {word_of(entry.name): entry.metadata["quantity"] for entry in fields(cls)}

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """The default of each parameter that has one, by its word."""
        return {word_of(f.name): f.default for f in fields(cls) if f.default is not MISSING}

    @classmethod
    def from_words(cls, parameters: Mapping[str, Any]) -> Self:
        """Make one from words and values.

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
                raise ModelError(f"{cls.called()} needs '{word}': expected {expected}")
        return cls(**{names[word].name: value for word, value in parameters.items()})

    def parameters(self) -> dict[str, Any]:
        """All parameters by their words, in the order of definition."""
        return {word_of(entry.name): getattr(self, entry.name) for entry in fields(self)}

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        mine, theirs = self.parameters(), other.parameters()
        return all(same(mine[word], theirs[word]) for word in mine)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        mine = {f.name: getattr(self, f.name) for f in fields(self)}
        changed = {f.name for f in fields(self) if f.default is MISSING or not same(mine[f.name], f.default)}
        return f"{self.name}({', '.join(f'{k}={shown(v)}' for k, v in mine.items() if k in changed)})"
