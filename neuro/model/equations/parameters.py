"""Parameters and expressions of models in equations, with hints for the syntax of Brian2, NESTML and Python."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from neuro.core.checks import check
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, unknown
from neuro.core.grammar import Expression, Hints, Name, parse as read
from neuro.core.quantities import Quantity
from neuro.core.units import Dimension, measured, unit
from neuro.core.values import shown
from neuro.model.equations.functions import ARGUMENTS

_CHOICE = "write where(a > b, value, other)"
_RECEPTOR = "spikes arrive in 'receptors', e.g. {g: {kernel: exp, tau: tau_syn}}"
_NO_NOISE = "equations have no noise: connect a poisson_generator"
_NO_TIME = "equations do not depend on time: connect a generator"
_LET = "write abbreviations in 'let', e.g. {I_syn: g*(E - V_m)}"
REFRACTORY = "write refractory: {time: t_ref, hold: [V_m]}"
RIGHT_SIDE = "write only the right side, by the name of the state: {V_m: (E_L - V_m)/tau_m}"

FUNCTION_HINTS: Mapping[str, str] = {
    "clip": "write min(max(value, low), high)",
    "int": _CHOICE,
    "heaviside": _CHOICE,
    "pow": "write value^power",
    "ln": "write log(value)",
    "log10": "write log(value)/log(10)",
    "rand": _NO_NOISE,
    "randn": _NO_NOISE,
    "convolve": _RECEPTOR,
    "delta": _RECEPTOR,
}
NAME_HINTS: Mapping[str, str] = {
    "xi": _NO_NOISE,
    "t": _NO_TIME,
    "i": "use a parameter with an array of values, one per neuron",
    "pi": "write 3.141592653589793",
    "not_refractory": REFRACTORY,
    "volt": "write mV or V",
    "amp": "write pA or nA",
    "second": "write ms or s",
    "siemens": "write nS",
    "farad": "write pF",
    "ohm": "write MOhm",
}
SIGN_HINTS: Mapping[str, str] = {
    "=": f"{RIGHT_SIDE}; compare with < <= > or >=",
    "'": RIGHT_SIDE,
    ":": "leave out the unit, since it follows from parameters or 'initial', and write refractoriness in 'refractory'",
    ";": "write an expression per state: {V_m: ..., w: ...}",
    "?": _CHOICE,
    "if": _CHOICE,
    "and": "write min(where(a > b, 1, 0), where(c > d, 1, 0))",
    "or": "write max(where(a > b, 1, 0), where(c > d, 1, 0))",
}
WORD_HINTS: Mapping[str, str] = {
    "model": RIGHT_SIDE.replace("write", "'equations' has"),
    "method": "write the method in 'integrator', e.g. {rk4: {substeps: 4}}",
    "inline": _LET,
    "function": _LET,
    "kernel": _RECEPTOR,
    "input": _RECEPTOR,
    "onReceive": _RECEPTOR,
    "events": _RECEPTOR,
    "state": "write states in 'equations' and their first values in 'initial'",
    "on_reward": "write on_signal",
}
_HINTS = Hints(SIGN_HINTS, "write parts of it in 'let'")


def parse(text: object) -> Expression:
    """Parse an expression of a model. Errors for the syntax of other languages have a hint with the right syntax.

    Raises:
        ModelError: see `neuro.core.grammar.parse`.
    """
    return read(text, _HINTS)


BOUNDS = ("above", "at_least", "below", "at_most")
WORDS = ("default", *BOUNDS, "doc")
NAME = "expected letters, digits and '_', with a letter first, no '_' at the end and no '__'"
"""End of the messages about names that are not valid."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a model in equations.

    Attributes:
        default: the default value, in `unit`.
        unit: unit of the default and of the bounds.
        factor: value of one unit in the base units mV, ms and pA.
        dimension: dimension of the unit.
        bounds: the bounds in the definition, in `unit`.
        doc: the description.
    """

    default: float
    unit: str
    factor: float
    dimension: Dimension
    bounds: Mapping[str, float]
    doc: str

    def quantity(self, positive: bool, arrays: bool = True) -> Quantity:
        """Return the quantity of the parameter's field.

        With `positive` the parameter must be > 0, unless the definition has bounds.
        """
        bounds: dict[str, Any] = dict(self.bounds) or ({"above": 0} if positive and self.default > 0 else {})
        return Quantity(unit=self.unit, doc=self.doc, arrays=arrays, **bounds)


def read_parameters(section: Any) -> dict[str, Parameter]:
    """Parse parameters such as `{C_m: 281 pF, a: {default: 4 nS, at_least: 0, doc: ...}}`.

    Args:
        section: the section `parameters`.

    Raises:
        ModelError: a parameter is not valid. The path of the error leads to the parameter.
    """
    if not isinstance(section, Mapping):
        raise ModelError(f"parameters: found {shown(section)}: expected {{name: 10 ms}}", path=("parameters",))
    parameters = {}
    for name, words in section.items():
        try:
            parameters[name] = _parameter(name, words)
        except ModelError as error:
            message = f"parameters.{name}: {error.message}"
            raise error.but(message=message, path=("parameters", str(name), *error.path)) from None
    return parameters


def _parameter(name: Any, words: Any) -> Parameter:
    tree = parse(name).tree if isinstance(name, str) else None
    if not isinstance(tree, Name) or tree.name != name or name.endswith("_") or "__" in name:
        raise ModelError(f"name {shown(name)}: {NAME}")
    if name == "I" or name in ARGUMENTS:
        raise _reserved(name)
    if not isinstance(words, Mapping):
        words = {"default": words}
    for word in words:
        if word not in WORDS:
            raise unknown("word of a parameter", word, WORDS, path=(str(word),))
    if "default" not in words:
        raise ModelError("a parameter needs 'default', e.g. {default: 10 ms, above: 0}")
    default, text = measured(words["default"])
    factor, dimension = unit(text)
    bounds = {word: words[word] for word in BOUNDS if word in words}
    for word, value in bounds.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ModelError(f"{word} = {shown(value)}: expected a number, in the unit of the default", path=(word,))
        bounds[word] = float(value)
    doc = words.get("doc", "")
    if not isinstance(doc, str):
        raise ModelError(f"doc = {shown(doc)}: expected text", path=("doc",))
    parameter = Parameter(default, text, factor, dimension, bounds, doc)
    check(parameter.quantity(positive=False), default, "default")
    return parameter


def refuse_attributes(parameters: Iterable[str], base: type[Choice]) -> None:
    """Raise an error for a parameter with the name of an attribute of the class. Parameters become fields of the class.

    Args:
        parameters: names of the parameters.
        base: the class. Annotations without a value count as attributes.

    Raises:
        ModelError: the first such parameter. The path of the error leads to the parameter.
    """
    for name in parameters:
        if hasattr(base, name) or any(name in vars(cls).get("__annotations__", {}) for cls in base.__mro__):
            error = _reserved(name)
            raise error.but(message=f"parameters.{name}: {error.message}", path=("parameters", name))


def _reserved(name: str) -> ModelError:
    return ModelError(f"'{name}' is reserved in every model: expected another name")
