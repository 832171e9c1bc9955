"""Sources of signals: lists, expressions of spikes, other signals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.core.errors import ModelError, here
from neuro.core.grammar import Expression, Hints, parse
from neuro.core.quantities import Value, quantity
from neuro.core.values import plain, shown
from neuro.model.signals import Source

_CHOICE = "write where(a > b, value, other)"
_HINTS = Hints(
    {
        "=": "a comparison is < <= > or >=; of all values only that of after has a name: after(a, b, within=20)",
        "?": _CHOICE,
        "if": _CHOICE,
        "and": "write min(a > b, c > d)",
        "or": "write max(a > b, c > d)",
    },
    "let a population relay what is meant",
    {"after": ("within", 2)},
)


@dataclass(frozen=True, eq=False)
class schedule(Source):
    """Values that hold from listed times on; before the first the signal is 0."""

    file_of: ClassVar[str] = "values"

    times: Any = quantity(unit="ms", doc="when the value changes, ascending", kind="array", arrays=True, at_least=0)
    values: Any = quantity(doc="a number for each time, or a row of one for each neuron", kind="array", arrays=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        times, values = self.listed()
        if times.ndim != 1 or (np.diff(times) <= 0).any():
            message = f"{self.name}.times = {shown(times.tolist())}: expected a list, each later than the one before"
            raise ModelError(message, where=here(), path=("times",))
        if values.ndim not in (1, 2) or len(values) != len(times):
            message = f"{self.name}.values: shape {list(values.shape)}: expected {len(times)} values, one for each time"
            raise ModelError(f"{message}, or as many rows", where=here(), path=("values",))

    def listed(self) -> tuple[Any, Any]:
        """Times in ms and values, also of a file."""
        return plain(self.times), plain(self.values)


@dataclass(frozen=True, eq=False)
class computed(Source):
    """The value of an expression of spikes, computed every so many ms and set after a delay.

    Numbers, + - * / ^, comparisons and the functions of equations, as `where(a > b, 1, -1)`. `p` is a population or
    some of its neurons, as `motors[0]`: `count(p)` are its spikes since the last time, `rate(p)` the same in Hz of a
    neuron, `after(p, q, within=20)` the spikes of q within so many ms after one of p (20 if not given). `mean(x)` is
    the mean of all x so far, `mean(x, tau)` one that forgets with tau ms, `trace(x, tau)` a sum that decays with tau.
    With `tau` each value other than 0 is a dose: the signal is set to the sum of all doses, which decays with tau.
    """

    expression: str = quantity(doc="what is computed", kind="expression")
    every: float = quantity(50.0, "ms", "between two values", above=0)
    delay: Value = quantity(0.0, "ms", "from a value to its effect, also drawn for each", at_least=0, arrays=True)
    tau: Any = quantity(None, "ms", "with which a sum of doses decays; a value holds if not given", above=0)
    scale: Value = quantity(1.0, "", "factor, one for all neurons or for each", arrays=True)
    largest: Any = quantity(None, "", "largest absolute value before the factor, which Loihi must know", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            self.parsed()
        except ModelError as error:
            message = f"{self.name}.expression: {error.message}"
            raise error.but(message=message, where=here(), path=("expression",)) from None

    def parsed(self) -> Expression:
        """The tree of the expression."""
        return parse(self.expression, _HINTS, views=True)


@dataclass(frozen=True, eq=False)
class population(Source):
    """A trace of spikes, as of dopaminergic neurons: each adds 1 over their number, and the sum decays with tau."""

    population: str = quantity(doc="whose spikes", kind="name")
    tau: float = quantity(50.0, "ms", "with which the trace decays", above=0)
    baseline: float = quantity(0.0, "", "taken from the trace, in spikes a neuron")
    scale: Value = quantity(1.0, "", "factor, one for all neurons or for each", arrays=True)
    every: float = quantity(10.0, "ms", "between two values", above=0)
    largest: Any = quantity(None, "", "largest absolute value before the factor, which Loihi must know", above=0)

    def stands_for(self) -> Source:
        """The expression."""
        spikes = f'rate("{self.population}") * {self.every / 1000.0!r}'
        text = f"trace({spikes}, {self.tau!r}) - ({self.baseline!r})"
        return computed(expression=text, every=self.every, scale=self.scale, largest=self.largest)


@dataclass(frozen=True, eq=False)
class like(Source):
    """The value of another signal times a factor, at the same time."""

    signal: str = quantity(doc="the other signal", kind="name")
    scale: Value = quantity(1.0, "", "factor, one for all neurons or for each", arrays=True)
