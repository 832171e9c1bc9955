"""Parameters of a model in equations: a number with its unit, and bounds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from neuro.core.checks import check
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, unknown
from neuro.core.grammar import Name
from neuro.core.quantities import Quantity
from neuro.core.units import Dimension, measured, unit
from neuro.core.values import shown
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.habits import parse

BOUNDS = ("above", "at_least", "below", "at_most")
WORDS = ("default", *BOUNDS, "doc")
NAME = "expected letters, digits and '_', a letter first, '_' neither last nor twice"


@dataclass(frozen=True)
class Parameter:
    """A parameter.

    Attributes:
        default: its value, in `unit`.
        factor: what one of its unit is in mV, ms and pA.
        bounds: said by the author, in `unit`.
    """

    default: float
    unit: str
    factor: float
    dimension: Dimension
    bounds: Mapping[str, float]
    doc: str

    def quantity(self, positive: bool, arrays: bool = True) -> Quantity:
        """The parameter as a field; `positive`: it must be so unless its author says bounds."""
        bounds: dict[str, Any] = dict(self.bounds) or ({"above": 0} if positive and self.default > 0 else {})
        return Quantity(unit=self.unit, doc=self.doc, arrays=arrays, **bounds)


def read_parameters(said: Any) -> dict[str, Parameter]:
    """Read `{C_m: 281 pF, a: {default: 4 nS, at_least: 0, doc: ...}}`.

    Args:
        said: the words.

    Raises:
        ModelError: one is wrong; its path leads there.
    """
    if not isinstance(said, Mapping):
        raise ModelError(f"parameters: found {shown(said)}: expected {{name: 10 ms}}", path=("parameters",))
    found = {}
    for name, words in said.items():
        try:
            found[name] = _parameter(name, words)
        except ModelError as error:
            message = f"parameters.{name}: {error.message}"
            raise error.but(message=message, path=("parameters", str(name), *error.path)) from None
    return found


def _parameter(name: Any, words: Any) -> Parameter:
    tree = parse(name).tree if isinstance(name, str) else None
    if not isinstance(tree, Name) or tree.name != name or name.endswith("_") or "__" in name:
        raise ModelError(f"name {shown(name)}: {NAME}")
    if name == "I" or name in ARGUMENTS:
        raise _taken(name)
    if not isinstance(words, Mapping):
        words = {"default": words}
    for word in words:
        if word not in WORDS:
            raise unknown("word of a parameter", word, WORDS, path=(str(word),))
    if "default" not in words:
        raise ModelError("a parameter needs 'default', e.g. {default: 10 ms, above: 0}")
    default, text = measured(words["default"])
    factor, dimension = unit(text)
    bounds = {word: _bound(word, words[word]) for word in BOUNDS if word in words}
    doc = words.get("doc", "")
    if not isinstance(doc, str):
        raise ModelError(f"doc = {shown(doc)}: expected text", path=("doc",))
    parameter = Parameter(default, text, factor, dimension, bounds, doc)
    check(parameter.quantity(positive=False), default, "default")
    return parameter


def refuse_attributes(parameters: Iterable[str], base: type[Choice]) -> None:
    """Refuse parameters that are called like an attribute of the class that gets them as fields.

    Args:
        parameters: their names.
        base: the class. An attribute that is only annotated counts, too.

    Raises:
        ModelError: the first such parameter; its path leads there.
    """
    for name in parameters:
        if hasattr(base, name) or any(name in vars(each).get("__annotations__", {}) for each in base.__mro__):
            error = _taken(name)
            raise error.but(message=f"parameters.{name}: {error.message}", path=("parameters", name))


def _taken(name: str) -> ModelError:
    return ModelError(f"'{name}' has a meaning in every model: expected another name")


def _bound(word: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ModelError(f"{word} = {shown(value)}: expected a number, in the unit of the default", path=(word,))
    return float(value)
