"""Parameters and expressions of a model in equations, with hints for words and signs of Brian2, NESTML and Python."""

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
_NO_NOISE = "equations have no noise of their own: connect a poisson_generator"
_NO_TIME = "equations do not depend on time: connect a generator"
_LET = "an abbreviation is a word of 'let', e.g. {I_syn: g*(E - V_m)}"
REFRACTORY = "write refractory: {time: t_ref, hold: [V_m]}"
RIGHT_SIDE = "write the right side alone, by the name of its state: {V_m: (E_L - V_m)/tau_m}"

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
    "i": "neurons differ by parameters, which may be arrays",
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
    "=": f"{RIGHT_SIDE}; a comparison is < <= > or >=",
    "'": RIGHT_SIDE,
    ":": "leave the unit out: it follows from those of parameters, or 'initial' says it; refractoriness is a word",
    ";": "each state has an expression of its own: {V_m: ..., w: ...}",
    "?": _CHOICE,
    "if": _CHOICE,
    "and": "write min(where(a > b, 1, 0), where(c > d, 1, 0))",
    "or": "write max(where(a > b, 1, 0), where(c > d, 1, 0))",
}
WORD_HINTS: Mapping[str, str] = {
    "model": RIGHT_SIDE.replace("write", "'equations' has"),
    "method": "the method is a word of 'integrator', e.g. {rk4: {substeps: 4}}",
    "inline": _LET,
    "function": _LET,
    "kernel": _RECEPTOR,
    "input": _RECEPTOR,
    "onReceive": _RECEPTOR,
    "events": _RECEPTOR,
    "state": "a state is a word of 'equations', its first value one of 'initial'",
    "on_reward": "write on_signal",
}
_HINTS = Hints(SIGN_HINTS, "give parts of it a name in 'let'")


def parse(text: object) -> Expression:
    """Read an expression of a model; for the syntax of other languages the hint gives ours.

    Raises:
        ModelError: as `neuro.core.grammar.parse`.
    """
    return read(text, _HINTS)


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
