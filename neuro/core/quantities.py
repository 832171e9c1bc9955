"""Quantities: parameters with unit and bounds, the fields of models, synapses, rules and groups."""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, replace
from operator import ge, gt, le, lt
from typing import Any, NamedTuple, TypeAlias, TypeVar

from neuro.core.errors import ModelError, words_of

LARGEST = 2**31 - 1
"""Largest absolute value of a whole number, if its quantity has no bound."""

Value: TypeAlias = Any  # float | per-element array | Choice (a distribution) | FromFile; narrowed by check()


_BOUNDS = (("above", ">", gt), ("at_least", ">=", ge), ("below", "<", lt), ("at_most", "<=", le))


class Kind(NamedTuple):
    """A kind of quantities.

    Attributes:
        noun: noun for a value in messages.
        check: function that returns a value in its canonical form. The arguments are the quantity, the value, and the
            name of the value in messages.
        is_list: True if a value is a list, which may also come from a file.
    """

    noun: str
    check: Callable[[Quantity, Any, str], Any]
    is_list: bool


KINDS: dict[str, Kind] = {}
"""Kinds by name, defined by `neuro.core.checks` and `neuro.core.lists`."""

_Check = TypeVar("_Check", bound=Callable[..., Any])


def kind(name: str, noun: str, is_list: bool = False) -> Callable[[_Check], _Check]:
    """Decorate the function that checks values of a kind; see `Kind`."""

    def define(check: _Check) -> _Check:
        KINDS[name] = Kind(noun, check, is_list)
        return check

    return define


@dataclass(frozen=True, slots=True)
class Quantity:
    """Type, unit and bounds of a parameter.

    Attributes:
        unit: physical unit, "" for none.
        doc: meaning in one line.
        kind: "number", "integer", "microseconds" (time of an event, 64 bits), "boolean", "name" (of a part of the
            network), "receptor" (of neurons), "word" (one of `words`), "shape" (a list of integers), "times" (spike
            times, a list per neuron), "moments" (times at which something changes), "series" (values at moments, in a
            list or a row per neuron), "train" (spikes, a row of time and neuron for each), "graded_train" (with a
            third column, the payload), "ids", "delay" (of a projection, and not a parameter of its rule), "names" (a
            list of names), "words" (values by name), "part" (a `part`), "array" (numbers in a list or a file, not
            drawn), "states" (numbers by state), "neurons" (a population or some of its neurons), "codes" (of
            `neuro.coding`), "choice" (a `choice`; with bounds also a number, with `arrays` also numbers), "choices"
            (`choice` objects by name), "expression" (text), "file" (a path; in YAML inside the description's folder) or
            "events" (an object with events, in Python only).
        above, at_least, below, at_most: bounds of every element.
        nonzero: 0 is refused.
        infinite: infinite values are accepted.
        whole: a number, and every element of an array, must be whole.
        arrays: one value per element (an array or a distribution) is accepted.
        optional: None is accepted.
        words: accepted words of kind "word"; for kinds "integer" and "shape", words accepted besides numbers.
        part: class of kind "part", a `Choice`.
        choice: base class of the choices of kinds "choice" and "choices".
        of_value: the parameter takes the unit of the value that its distribution or function describes, e.g. `low` of
            `uniform` is in pA if the weight is. Until that unit is known, a number with a unit stays a text.
        taken_in: unit to which a number with a unit is converted, if `unit` is "".
        of_distance: a function of the distance between two neurons is accepted.
        bounds: sign, number and comparison of each bound.
    """

    unit: str = ""
    doc: str = ""
    kind: str = "number"
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    nonzero: bool = False
    infinite: bool = False
    whole: bool = False
    arrays: bool = False
    optional: bool = False
    words: tuple[str, ...] = ()
    part: type[Any] | None = None
    choice: type[Any] | None = None
    of_distance: bool = False
    of_value: bool = False
    taken_in: str = ""
    bounds: tuple[tuple[str, float, Callable[[Any, float], Any]], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bounds = ((sign, getattr(self, word), holds) for word, sign, holds in _BOUNDS)
        object.__setattr__(self, "bounds", tuple(bound for bound in bounds if bound[1] is not None))

    def expected(self) -> str:
        """Return the accepted values as a part of a sentence, e.g. "a number > 0 ms"."""
        if self.kind == "word":
            return "one of " + ", ".join(self.words)
        if self.kind == "microseconds":
            return f"a whole number of us from {'-2^63' if self.at_least is None else self.at_least} to 2^63 - 1"
        noun = KINDS[self.kind].noun
        if self.kind == "number" and self.whole:
            noun = "a whole number"
        elif self.part:
            noun = f"the words of {self.part.__name__}"
        elif self.choice:
            noun = "a number" if self.at_least is not None else f"a {self.choice.kind}"
            noun = f"a number, one for each, or {noun}" if self.arrays else noun
        limits = replace(self, at_least=0).bounds if self.kind == "ids" else self.bounds
        bounds = [f"{sign} {bound if isinstance(bound, int) else f'{bound:g}'}" for sign, bound, _ in limits]
        if self.nonzero:
            bounds.append("other than 0")
        text = " ".join([noun, " and ".join(bounds)]) if bounds else noun
        if self.choice and bounds:
            text += f" or a {self.choice.kind}"
        if self.words:
            text += " or " + " or ".join(self.words)
        unit = f" {self.unit}" if self.unit and self.kind == "number" else ""
        return text + unit


def quantity(default: Any = MISSING, unit: str = "", doc: str = "", **more: Any) -> Any:
    """Return a dataclass field with a `Quantity`; see `Quantity` for `more`."""
    q = Quantity(unit=unit, doc=doc, optional=default is None, **more)
    return field(default=default, metadata={"quantity": q})


def word_of(name: str) -> str:
    """Return the word of the language for a Python field name, e.g. `lambda` for `lambda_`."""
    return name.rstrip("_")


def field_of(word: str) -> str:
    """Return the Python field name for a word of the language. Keywords get an underscore, e.g. `lambda_`."""
    return f"{word}_" if keyword.iskeyword(word) else word


def with_unit(q: Quantity, value: str, label: str) -> float:
    """Convert a number written with its unit to the unit of the quantity.

    Raises:
        ModelError: the number has another dimension, or the unit does not exist.
    """
    from neuro.core.units import converted

    try:
        number = converted(value, "ms" if q.kind in ("delay", "times") else q.unit or q.taken_in)
    except ModelError as error:
        raise error.but(message=f"{label} = {value.strip()}: {error.message}") from None
    if math.isinf(number):
        raise ModelError(f"{label} = {value.strip()}: expected a number below 1.8e308")
    return number


def in_ms(value: Any, label: str) -> Any:
    """Convert a time written with its unit to ms; other values are returned unchanged.

    Raises:
        ModelError: the value has another dimension, or the unit does not exist.
    """
    try:
        return with_unit(Quantity("ms"), value, label) if is_written(value) else value
    except ModelError as error:
        raise error.but(path=words_of(label)) from None


def is_written(value: Any) -> bool:
    """Return True if a value is a text of a number and a unit."""
    if not isinstance(value, str):
        return False
    from neuro.core.units import is_measure

    return is_measure(value)
