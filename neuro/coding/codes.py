"""The codes by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from neuro.coding.arguments import Floats
from neuro.coding.choices import Code, as_choice
from neuro.coding.latency import intensity_to_latency, log_intensity_to_latency, rank
from neuro.coding.rates import population, rate
from neuro.coding.trains import burst, phase, poisson
from neuro.core.errors import ModelError, unknown
from neuro.core.registry import Registry
from neuro.core.values import shown

Function = Callable[..., Floats]


def _complete(function: Function, rates: bool) -> Function:
    """Return a function of a stranger if it can be said in a description.

    Raises:
        TypeError: it cannot, or a code of the other kind has its name.
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
"""All codes by name: functions of values and named parameters that give spike times.

The times have the shape of the values, or one more axis with the spikes of each; NaN is no spike.
"""

RATE_CODES: Registry[Function] = Registry(
    "rate code",
    (rate, population),
    group="neuro.rate_codes",
    complete=lambda function: _complete(function, True),
)
"""All codes by name that give values, in Hz if they are rates: of the shape of theirs, or with one more axis."""


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
"""Both kinds by name, with their parameters as a description says them."""


def chain(said: Any) -> tuple[Code, ...]:
    """Codes from the words of the language: a name, `{name: {parameters}}`, or a list of these.

    Raises:
        ModelError: they are no codes, or there is none.
    """
    items = said if isinstance(said, (list, tuple)) else [said]
    if not items:
        raise ModelError("code = []: expected a code, or a list of codes", path=("code",))
    return tuple(_code(item) for item in items)


def _code(said: Any) -> Code:
    if isinstance(said, Code):
        return said
    name, parameters = next(iter(said.items())) if isinstance(said, Mapping) and len(said) == 1 else (said, {})
    if not isinstance(name, str) or not isinstance(parameters, Mapping):
        told = f"code = {shown(said)}: expected the name of a code, or {{name: {{parameters}}}}"
        raise ModelError(told, path=("code",))
    if name not in CHOICES:
        raise unknown("code", name, CHOICES, path=("code",))
    return CHOICES[name].from_words(parameters)
