"""Runge-Kutta integrators for models whose equations have no exact solution: NEST's adaptive RKF45 and plain RK4.

A system is a plain function `rates(y, p)`: the derivatives of the variables `y`, both tuples of floats, with whatever
else it needs in the tuple `p`. A model takes the step of a method for its number of variables once, in its module, and
hands both on in `step`:

    attempt = fehlberg(3)
    y, size = integrate(attempt, rates, y, p, h, size, tolerance)     # adaptive, over a step of the grid of h ms

    quarter = runge_kutta(3)
    for _ in range(4):
        y = quarter(rates, y, p, 0.25 * h)

The size of the adaptive steps is a state of the neuron, kept from one step of the grid to the next as in NEST. It is 0
for a whole step of the grid, where it starts and mostly stays, so a hidden state at 0 needs nothing else.

Source: Fehlberg, NASA TR R-315, 1969, table III; step control of GSL 2.7, `cstd.c` and `evolve.c`, as NEST 3.10 uses
it: an absolute tolerance only.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import FunctionType

ACCEPTED = 1.1
"""A step is accepted with an error up to so many times the tolerance."""

TINY = 1e-300
"""What an error of 0 counts as."""


@dataclass(frozen=True, slots=True)
class Tableau:
    """An explicit Runge-Kutta method.

    Attributes:
        stages: weights of the earlier stages' rates in the point of each stage; the first has none.
        result: weights of all stages in the result.
        error: weights of all stages in the estimated error, none if the method estimates none.
    """

    stages: tuple[tuple[float, ...], ...]
    result: tuple[float, ...]
    error: tuple[float, ...] = ()


FEHLBERG = Tableau(
    stages=(
        (),
        (1 / 4,),
        (3 / 32, 9 / 32),
        (1932 / 2197, -7200 / 2197, 7296 / 2197),
        (8341 / 4104, -32832 / 4104, 29440 / 4104, -845 / 4104),
        (-6080 / 20520, 41040 / 20520, -28352 / 20520, 9295 / 20520, -5643 / 20520),
    ),
    result=(902880 / 7618050, 0.0, 3953664 / 7618050, 3855735 / 7618050, -1371249 / 7618050, 277020 / 7618050),
    error=(1 / 360, 0.0, -128 / 4275, -2197 / 75240, 1 / 50, 2 / 55),
)
"""Order 5 with an error of order 4."""

RK4 = Tableau(stages=((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), result=(1 / 6, 1 / 3, 1 / 3, 1 / 6))
"""The classical method of order 4."""


@cache
def fehlberg(variables: int) -> FunctionType:
    """A step of RKF45 for so many variables: `attempt(rates, y, p, h)` returns the new `y` and its largest error."""
    return _written(FEHLBERG, variables)


@cache
def runge_kutta(variables: int) -> FunctionType:
    """A step of RK4 for so many variables: `rk4(rates, y, p, h)` returns the new `y`."""
    return _written(RK4, variables)


def integrate(attempt, rates, y, p, h, size, tolerance):
    """Go h ms on by adaptive steps; return the new `y` and the size of the next step.

    Args:
        attempt: a step of a method with an error, as from `fehlberg`.
        rates: the system.
        y: the variables, in a tuple.
        p: what else `rates` needs, in a tuple.
        h: a step of the grid in ms.
        size: of the first step in ms, as from the last call; 0 for h.
        tolerance: largest error of a variable in a step.
    """
    t = 0.0
    while t < h:
        y, t, size = advance(attempt, rates, y, p, t, h, size, tolerance)
    return y, size


def advance(attempt, rates, y, p, t, h, size, tolerance):
    """One accepted step on the way from 0 to h; return the new `y`, the time and the size of the next step.

    For a system that something happens to between two steps; the other arguments are those of `integrate`.
    """
    left = h - t
    step = left if size == 0.0 or size > left else size
    while True:
        new, error = attempt(rates, y, p, step)
        if not error > ACCEPTED * tolerance:
            break
        shorter = max(0.9 * (error / tolerance) ** -0.2, 0.2) * step
        if not (shorter < step and t + shorter != t):
            break
        step = shorter
    t = h if step == left else t + step
    if error < 0.5 * tolerance and step < h:
        step *= min(max(0.9 * (max(error, TINY) / tolerance) ** (-1.0 / 6.0), 1.0), 5.0)
    return new, t, 0.0 if step >= h else step


def _written(tableau: Tableau, variables: int) -> FunctionType:
    """A step of a method as straight code, every number in a variable of its own: no array is made in it."""
    each = range(variables)

    def listed(name: str) -> str:
        return "(" + "".join(f"{name}_{v}, " for v in each) + ")"

    def mean(weights: Sequence[float], v: int) -> str:
        return " + ".join(f"{weight!r} * k{stage}_{v}" for stage, weight in enumerate(weights) if weight)

    def point(weights: Sequence[float]) -> str:
        return "(" + "".join(f"y_{v} + h * ({mean(weights, v)}), " for v in each) + ")"

    lines = ["def step(rates, y, p, h):", f"{listed('y')} = y"]
    for stage, weights in enumerate(tableau.stages):
        lines.append(f"{listed(f'k{stage}')} = rates({point(weights) if weights else 'y'}, p)")
    if tableau.error:
        lines.append("error = 0.0")
        for v in each:
            lines.append(f"of_one = abs(h * ({mean(tableau.error, v)}))")
            lines.append("error = of_one if of_one > error else error")
    lines.append(f"return {point(tableau.result)}{', error' if tableau.error else ''}")
    scope: dict[str, FunctionType] = {}
    exec("\n    ".join(lines), {"__name__": __name__}, scope)
    return scope["step"]
