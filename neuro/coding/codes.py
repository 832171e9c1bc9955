"""Registries of the codes by name, and the class of each code for descriptions."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, make_dataclass
from functools import cache
from types import NoneType
from typing import Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import numpy as np

from neuro.coding.encoders import (
    Floats,
    burst,
    intensity_to_latency,
    log_intensity_to_latency,
    phase,
    poisson,
    population,
    rank,
    rate,
)
from neuro.core.checks import numbers
from neuro.core.choice import Choice
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import quantity
from neuro.core.registry import Registry
from neuro.core.values import shown

SEED = "seed"
"""Name of the argument for the seed. A description has no seed, because the network derives one from its own seed."""

_KINDS = {float: "number", int: "integer", bool: "boolean"}
_ARGUMENTS = re.compile(r"^Args:\n((?: .*\n|\n)*)", re.M)
_SOURCE = re.compile(r"^Source: (.*(?:\n    .*)*)", re.M)
_ARGUMENT = re.compile(r"^    (\w+): (.*(?:\n        .*)*)", re.M)
_UNIT = re.compile(r"(?:, | \()(ms|Hz)\)?$")
"""Pattern of the end of an argument's description with a unit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Code(Choice):
    """Base of the codes.

    Class attributes:
        function: function of an array of values, and of the parameters by name.
        values: name of the first argument of the function.
        draws: whether the function takes a seed.
        rates: whether the function returns rates, or values for another code, instead of spike times.
        source: publication of the code.

    An instance is a code with parameters, e.g. `{rank: {window: 20.0}}` in a description.

    The parameters are the arguments of the function, with kinds from the annotations and meanings from the docstring.
    """

    kind: ClassVar[str] = "code"
    function: ClassVar[Callable[..., Any]]
    values: ClassVar[str] = ""
    draws: ClassVar[bool] = False
    rates: ClassVar[bool] = False
    source: ClassVar[str] = ""

    def __call__(self, values: Floats, seed: int) -> Floats:
        """Return spike times in ms or rates in Hz, in the shape of the values, or with one more axis for spikes.

        Raises:
            ModelError: the code refuses a value or a parameter, or returns invalid times or rates.
        """
        seeds = {SEED: seed} if self.draws else {}
        parameters = {name: value for name, value in vars(self).items() if value is not None}
        code = numbers(self.function(values, **parameters, **seeds), self.name)
        if code.shape[: values.ndim] != values.shape or code.ndim > values.ndim + 1:
            shape, expected = list(code.shape), list(values.shape)
            raise ModelError(f"gives an array of the shape {shape}: expected {expected}, or one more axis")
        is_invalid = ~np.isfinite(code) if self.rates else ~(np.isnan(code) | ((code >= 0) & np.isfinite(code)))
        if is_invalid.any():
            expected_values = "finite rates" if self.rates else "times >= 0 ms, or NaN for no spike"
            raise ModelError(f"gives {code[is_invalid][0]}: expected {expected_values}")
        return code if self.rates or code.ndim > values.ndim else code[..., None]


@cache
def as_choice(function: Callable[..., Any], rates: bool) -> type[Code]:
    """Return the class of a code for a function.

    Args:
        function: function of the values and named parameters. A parameter is annotated `float`, `int`, `bool` or with
            `Literal` words, each also `| None`; without annotation it is a `float`.
        rates: whether the function is a rate code.

    Raises:
        TypeError: the function has other arguments or annotations, or no argument.
    """
    message = f"code '{function.__name__}'"
    arguments = [
        p for p in inspect.signature(function).parameters.values() if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    if not arguments:
        raise TypeError(f"{message} takes no argument: expected the values first")
    values, *parameters = arguments
    try:
        hints = get_type_hints(function)
    except NameError as error:
        raise TypeError(f"{message}: its annotations cannot be read: {error}") from None
    doc = inspect.getdoc(function) or ""
    meanings = _meanings(doc)
    named_parameters = [p for p in parameters if p.name != SEED]
    code_class: type[Code] = make_dataclass(
        function.__name__,
        [
            (p.name, Any, _field(message, p, hints.get(p.name, float), meanings.get(p.name, "")))
            for p in named_parameters
        ],
        bases=(Code,),
        namespace={
            "__doc__": doc.partition("\nArgs:")[0].strip(),
            "function": staticmethod(function),
            "values": values.name,
            "draws": len(named_parameters) < len(parameters),
            "rates": rates,
            "source": _on_one_line("".join(_SOURCE.findall(doc))),
        },
        frozen=True,
        kw_only=True,
        eq=False,
    )
    return code_class


def _meanings(doc: str) -> dict[str, str]:
    """Return the description of each argument in a docstring."""
    section = _ARGUMENTS.search(doc + "\n")
    return {name: _on_one_line(text) for name, text in _ARGUMENT.findall(section[1])} if section else {}


def _on_one_line(text: str) -> str:
    """Return a sentence on a single line, without the full stop."""
    return " ".join(text.split()).removesuffix(".")


def _field(code_name: str, argument: inspect.Parameter, hint: Any, doc: str) -> Any:
    """Return the quantity of one argument."""
    inner = [type_ for type_ in get_args(hint) if type_ is not NoneType]
    if NoneType in get_args(hint) and len(inner) == 1:
        hint = inner[0]
    if hasattr(Code, argument.name):
        raise TypeError(
            f"{code_name}: '{argument.name}' has a special meaning: expected another name for the parameter"
        )
    default = MISSING if argument.default is argument.empty else argument.default
    if get_origin(hint) is Literal:
        return quantity(default, "", doc, kind="word", words=get_args(hint))
    if hint not in _KINDS:
        raise TypeError(
            f"{code_name}: '{argument.name}' is annotated {hint}: expected float, int, bool or Literal words"
        )
    unit = _UNIT.search(doc) if hint is float else None
    return quantity(default, unit[1] if unit else "", doc[: unit.start()] if unit else doc, kind=_KINDS[hint])


Function = Callable[..., Floats]


def _complete(function: Function, rates: bool) -> Function:
    """Return a third-party function if it is a valid code.

    Raises:
        TypeError: the function is no valid code, or a code of the other kind has its name.
    """
    as_choice(function, rates)
    if function.__name__ in (CODES if rates else RATE_CODES):
        raise TypeError(f"'{function.__name__}' is both a code and a rate code: expected another name for one")
    return function


CODES: Registry[Function] = Registry(
    "code",
    (intensity_to_latency, log_intensity_to_latency, rank, poisson, phase, burst),
    group="neuro.codes",
    complete=lambda function: _complete(function, False),
)
"""All codes by name: functions of values and named parameters that return spike times.

The times have the shape of the values, or one more axis for the spikes of a value; NaN stands for no spike.
"""

RATE_CODES: Registry[Function] = Registry(
    "rate code",
    (rate, population),
    group="neuro.rate_codes",
    complete=lambda function: _complete(function, True),
)
"""All rate codes by name: functions that return rates in Hz, or values for another code. The result has the shape of
the values, or one more axis."""


class _Choices(Mapping[str, type[Code]]):
    def __getitem__(self, name: str) -> type[Code]:
        return as_choice(CODES[name], False) if name in CODES else as_choice(RATE_CODES[name], True)

    def __iter__(self) -> Iterator[str]:
        yield from (*CODES, *RATE_CODES)

    def __len__(self) -> int:
        return len(CODES) + len(RATE_CODES)

    def __contains__(self, name: object) -> bool:
        return name in CODES or name in RATE_CODES


CHOICES: Mapping[str, type[Code]] = _Choices()
"""Classes of all codes by name, with the parameters of a description."""


def chain(description: Any) -> tuple[Code, ...]:
    """Return codes from a description: a name, `{name: {parameters}}`, or a list of these.

    Raises:
        ModelError: the description contains something other than codes, or the list is empty.
    """
    items = description if isinstance(description, (list, tuple)) else [description]
    if not items:
        raise ModelError("code = []: expected a code, or a list of codes", path=("code",))
    return tuple(_code(item) for item in items)


def _code(item: Any) -> Code:
    if isinstance(item, Code):
        return item
    name, parameters = next(iter(item.items())) if isinstance(item, Mapping) and len(item) == 1 else (item, {})
    if not isinstance(name, str) or not isinstance(parameters, Mapping):
        message = f"code = {shown(item)}: expected the name of a code, or {{name: {{parameters}}}}"
        raise ModelError(message, path=("code",))
    if name not in CHOICES:
        raise unknown("code", name, CHOICES, path=("code",))
    return CHOICES[name].from_words(parameters)
