"""Sources of signals: schedules, expressions of spikes, traces of populations, and copies of other signals."""

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
        "=": "compare with < <= > or >=; only 'after' has an argument with a name: after(a, b, within=20)",
        "?": _CHOICE,
        "if": _CHOICE,
        "and": "write min(a > b, c > d)",
        "or": "write max(a > b, c > d)",
    },
    "add a population that computes this by spikes",
    {"after": ("within", 2)},
)


@dataclass(frozen=True, eq=False)
class schedule(Source):
    """Listed values. Each value holds from its listed time until the next. Before the first time the signal is 0."""

    file_of: ClassVar[str] = "values"

    times: Any = quantity(
        unit="ms", doc="times at which the value changes, ascending", kind="array", arrays=True, at_least=0
    )
    values: Any = quantity(doc="a number for each time, or a row with a number per neuron", kind="array", arrays=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        times, values = self.arrays_of_schedule()
        if times.ndim != 1 or (np.diff(times) <= 0).any():
            message = f"{self.name}.times = {shown(times.tolist())}: expected a list, each later than the one before"
            raise ModelError(message, where=here(), path=("times",))
        if values.ndim not in (1, 2) or len(values) != len(times):
            message = f"{self.name}.values: shape {list(values.shape)}: expected {len(times)} values, one for each time"
            raise ModelError(f"{message}, or as many rows", where=here(), path=("values",))

    def arrays_of_schedule(self) -> tuple[Any, Any]:
        """Return the times in ms, shape (times,), and the values, shape (times,) or (times, neurons)."""
        return plain(self.times), plain(self.values)


@dataclass(frozen=True, eq=False)
class computed(Source):
    """The value of an expression of spikes, computed at a fixed interval and applied after a delay.

    An expression consists of numbers, + - * / ^, comparisons and the functions of equations, e.g.
    `where(a > b, 1, -1)`. Below, `p` and `q` are populations or some neurons of a population, e.g. `motors[0]`:

    - `count(p)` is the number of spikes of p since the last evaluation, and `rate(p)` the mean rate per neuron in Hz.
    - `after(p, q, within=20)` is the number of spikes of q at most 20 ms after a spike of p (20 is the default).
    - `mean(x)` is the mean of all values of x so far. `mean(x, tau)` is an exponential moving average.
    - `trace(x, tau)` is a sum of the values of x that decays with the time constant tau in ms.

    With the parameter `tau`, each value other than 0 is a dose. The signal is the sum of all doses and decays with tau.
    """

    expression: str = quantity(doc="expression of spikes", kind="expression")
    every: float = quantity(50.0, "ms", "interval between two evaluations", above=0)
    delay: Value = quantity(
        0.0, "ms", "time from an evaluation to its effect; a distribution is drawn each time", at_least=0, arrays=True
    )
    tau: Any = quantity(
        None, "ms", "time constant of the sum of doses; without it a value holds until the next one", above=0
    )
    scale: Value = quantity(1.0, "", "factor, for all neurons or per neuron", arrays=True)
    largest: Any = quantity(None, "", "largest absolute value before the factor, required for Loihi", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            self.syntax_tree()
        except ModelError as error:
            message = f"{self.name}.expression: {error.message}"
            raise error.but(message=message, where=here(), path=("expression",)) from None

    def syntax_tree(self) -> Expression:
        """Return the syntax tree of the expression."""
        return parse(self.expression, _HINTS, views=True)


@dataclass(frozen=True, eq=False)
class population(Source):
    """A trace of a population's spikes, e.g. of dopaminergic neurons.

    Each spike adds 1 divided by the number of neurons, and the trace decays with tau.
    """

    population: str = quantity(doc="the population whose spikes are traced", kind="name")
    tau: float = quantity(50.0, "ms", "time constant of the trace", above=0)
    baseline: float = quantity(0.0, "", "value subtracted from the trace, in spikes per neuron")
    scale: Value = quantity(1.0, "", "factor, for all neurons or per neuron", arrays=True)
    every: float = quantity(10.0, "ms", "interval between two updates of the signal", above=0)
    largest: Any = quantity(None, "", "largest absolute value before the factor, required for Loihi", above=0)

    def stands_for(self) -> Source:
        """Return the equivalent expression."""
        spikes = f'rate("{self.population}") * {self.every / 1000.0!r}'
        text = f"trace({spikes}, {self.tau!r}) - ({self.baseline!r})"
        return computed(expression=text, every=self.every, scale=self.scale, largest=self.largest)


@dataclass(frozen=True, eq=False)
class like(Source):
    """The present value of another signal times a factor."""

    signal: str = quantity(doc="the other signal", kind="name")
    scale: Value = quantity(1.0, "", "factor, for all neurons or per neuron", arrays=True)
