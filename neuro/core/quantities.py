"""Parameters that know their unit and their bounds: the fields of models, synapses, rules and groups."""

from __future__ import annotations

import keyword
from dataclasses import MISSING, dataclass, field
from typing import Any, TypeAlias

LARGEST = 2**31 - 1
"""The largest whole number, unless a quantity has a bound of its own, and the negative of the smallest."""

Value: TypeAlias = Any  # float | per-element array | Choice (a distribution) | FromFile; narrowed by check()


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a parameter may be.

    Attributes:
        unit: physical unit, "" for none.
        doc: one line on its meaning.
        kind: "number", "integer", "microseconds" (time of an event, 64 bits), "boolean", "name" (of a part of the
            network), "receptor" (of neurons), "word" (one of `words`), "shape" (a list of integers), "times" (spike
            times, a list per neuron), "moments" (times at which something changes), "series" (values at moments, in a
            list or a row per neuron), "train" (spikes, a row of time and neuron for each), "graded_train" (with a
            third column, the payload), "ids", "delay" (a time that
            is no number of the rule), "names" (a list of names), "words" (values by name), "part" (a `part`),
            "codes" (of `neuro.coding`), "choice" (a `choice`; with bounds also a number), "file" (a path; in YAML
            inside the folder of the description) or "events" (what holds events, in Python alone).
        above, at_least, below, at_most: bounds of every element.
        nonzero: whether 0 has no meaning.
        infinite: whether an infinite value has a meaning.
        whole: whether a number, and every element of an array, must be a whole one.
        arrays: whether one value per element (an array or a distribution) is accepted.
        optional: whether it may be left out for good (None).
        words: the accepted words of kind "word", and those accepted beside numbers by "integer" and "shape".
        part: the class of kind "part", a `Choice`.
        choice: of kind "choice": the base of what may be chosen, a `Choice`.
        of_value: whether its unit is that of what it belongs to: of the value which the distribution or function that
            has it stands for, of the weight of a synapse. Until that is known a number with its unit is a text.
        taken_in: the unit in which numbers with a unit are taken, where `unit` does not tell it.
        of_distance: whether a function of the distance between two neurons is accepted.
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

    def expected(self) -> str:
        """The sentence part that says what is accepted, e.g. "a number > 0 ms"."""
        if self.kind == "word":
            return "one of " + ", ".join(self.words)
        if self.kind == "microseconds":
            return f"a whole number of us from {'-2^63' if self.at_least is None else self.at_least} to 2^63 - 1"
        noun = {
            "number": "a whole number" if self.whole else "a number",
            "integer": "a whole number",
            "boolean": "true or false",
            "name": "a name",
            "receptor": "a name",
            "shape": "whole numbers",
            "times": "a list of spike times in ms for each neuron",
            "ids": "whole numbers",
            "moments": "times > 0 ms, each later than the one before",
            "series": "a list of numbers",
            "train": "a row for each spike: a time > 0 ms, not before the last one, and a neuron",
            "graded_train": (
                "a row for each spike: a time > 0 ms, not before the last one, a neuron and a whole payload of 32 bits"
            ),
            "delay": "a time > 0 ms",
            "names": "names",
            "words": "{name: value}",
            "codes": "a code, or a list of codes",
            "file": "the name of a file",
            "events": "events",
            "choice": ("a number" if self.at_least is not None else f"a {self.choice.kind}") if self.choice else "",
            "part": f"the words of {self.part.__name__}" if self.part else "",
        }[self.kind]
        bounds = [
            f"{sign} {bound if isinstance(bound, int) else f'{bound:g}'}"
            for sign, bound in (
                (">", self.above),
                (">=", 0 if self.kind == "ids" else self.at_least),
                ("<", self.below),
                ("<=", self.at_most),
            )
            if bound is not None
        ]
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
    """A dataclass field that carries a `Quantity`; see there for `more`."""
    q = Quantity(unit=unit, doc=doc, optional=default is None, **more)
    return field(default=default, metadata={"quantity": q})


def word_of(name: str) -> str:
    """The word of the language for a Python field name (`lambda_` is `lambda`)."""
    return name.rstrip("_")


def field_of(word: str) -> str:
    """The Python field name for a word of the language: keywords get a trailing underscore (`lambda` is `lambda_`)."""
    return f"{word}_" if keyword.iskeyword(word) else word
