"""Runge-Kutta integrators for models whose equations have no exact solution: NEST's adaptive RKF45 and plain RK4.

A system is two plain functions of a model's module. `rates(y, p)` returns the derivatives of the variables `y`, both
tuples of floats; `system(s, c, i_0, i)` returns `p`, what `rates` needs for neuron i, in a tuple. The variables are the
first rows of the states `s`. A module makes what it needs for its number of variables, and hands all on in `step`:

    rkf45, rk4, (take, put) = fehlberg(3), runge_kutta(3), rows(3)

    step_adaptively(rkf45, take, put, rates, system, s, c, i_0, lo, hi, h, SIZE, tolerance, fired)
    step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, h, substeps)
    is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps)     # for `quiet`

The size of the adaptive steps is a hidden state of the neuron, row SIZE, kept from one step of the grid to the next as
in NEST. It is 0 for a whole step of the grid, where it starts and mostly stays. So a whole step is tried for all
neurons in a loop without branches, which is vectorised, and the few that need shorter ones are integrated after it.

Source: Fehlberg, NASA TR R-315, 1969, table III; step control of GSL 2.7, `cstd.c` and `evolve.c`, as NEST 3.10 uses
it: an absolute tolerance, and for some neurons one relative to the slope.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import hashlib
import linecache
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import FunctionType

ACCEPTED = 1.1
"""A step is accepted with an error up to so many times the tolerance."""

MOST_STEPS = 1_000_000
"""Adaptive steps within one of the grid after which a neuron is given up: its variables become NaN, which is
reported as a numerical instability. A conductance that has run away would take for ever."""

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
def fehlberg(variables: int, decaying: int = 0, *, by_slope: bool = False) -> FunctionType:
    """A step of RKF45 for so many variables: `rkf45(rates, y, p, h)` returns the new `y` and its largest error.

    The last `decaying` of the variables do nothing but decay, each with a rate of its own: `y' = rate y`. With
    `by_slope` the error of each is divided by 1 + |h y'| at the new point before they are compared, so that a
    tolerance is absolute and relative to the slope at once, as in GSL's `gsl_odeiv_control_yp_new(tol, tol)`.
    """
    return _written(FEHLBERG, variables, decaying, by_slope)


@cache
def runge_kutta(variables: int, decaying: int = 0) -> FunctionType:
    """A step of RK4 for so many variables: `rk4(rates, y, p, h)` returns the new `y`; `decaying` as above."""
    return _written(RK4, variables, decaying, by_slope=False)


@cache
def rows(variables: int) -> tuple[FunctionType, FunctionType]:
    """For so many variables `take(s, i)`, which returns the `y` of neuron i, and `put(s, i, y)`, which writes it."""
    taken = "(" + "".join(f"s[{v}, i], " for v in range(variables)) + ")"
    written = [f"s[{v}, i] = y[{v}]" for v in range(variables)]
    return _function("take(s, i)", [f"return {taken}"]), _function("put(s, i, y)", written)


def step_adaptively(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, left):
    """A step of the grid by adaptive steps.

    `attempt` is a step of a method with an error, as from `fehlberg`; `take` and `put` are from `rows`; `rates` and
    `system` the equations, see above; `s, c, i_0, lo, hi` as of a model's `step`. `h` is the step of the grid in ms,
    `size` the row of `s` with the size of the next adaptive step, `tolerance` the largest error of a variable in a
    step. What it leaves in `left` is of no use: it is the `fired` of a model's `step`, before that is set.
    """
    step_whole(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, left)
    for i in range(lo, hi):
        if left[i]:
            y, p, t, next_size, taken = take(s, i), system(s, c, i_0, i), 0.0, s[size, i], 0
            while t < h:
                y, t, next_size = advance(attempt, rates, y, p, t, h, next_size, tolerance)
                taken += 1
                if taken == MOST_STEPS:
                    y, t, next_size = attempt(rates, y, p, math.nan)[0], h, 0.0
            put(s, i, y)
            s[size, i] = next_size


def step_whole(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, left):
    """Take a whole step of the grid wherever it is small enough; set `left` where it is not, and nothing is done.

    The arguments are those of `step_adaptively`.
    """
    for i in range(lo, hi):
        y = take(s, i)
        new, error = attempt(rates, y, system(s, c, i_0, i), h)
        short = s[size, i] != 0.0 or error > ACCEPTED * tolerance
        put(s, i, y if short else new)
        left[i] = short


def step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, h, substeps):
    """A step of the grid by so many steps of a method without an error, as from `runge_kutta`."""
    for _ in range(int(substeps)):
        for i in range(lo, hi):
            put(s, i, rk4(rates, take(s, i), system(s, c, i_0, i), h / substeps))


def is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps):
    """Whether a step without input leaves every bit of neuron i where it is; with 0 `substeps` one of RKF45."""
    y, p = take(s, i), system(s, c, i_0, i)
    new = rkf45(rates, y, p, h)[0] if substeps == 0.0 else rk4(rates, y, p, h / substeps)
    return new == y


def are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, refractory, size, v_top):
    """Whether neurons stay as they are in a step without input; `refractory` and `size` are rows of hidden states.

    None may be refractory, amid a step of the grid, or have its first variable, V_m, at `v_top` or above.
    """
    for i in range(lo, hi):
        if s[refractory, i] != 0.0 or s[size, i] != 0.0 or s[0, i] >= v_top:
            return False
        if not is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps):
            return False
    return True


def advance(attempt, rates, y, p, t, h, size, tolerance):
    """One accepted step on the way from 0 to h; return the new `y`, the time and the size of the next step.

    `t` is the time in ms since the last step of the grid, `h` that step, `size` that of the adaptive step, 0 for h.
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


def finite_exp(x):
    """e^x, at most e^709: beyond it Python raises an error where machine code goes on with infinity."""
    return math.exp(709.0 if x > 709.0 else x)


def _written(tableau: Tableau, variables: int, decaying: int, by_slope: bool) -> FunctionType:
    """A step of a method as straight code, every number in a variable of its own: no array is made in it.

    What decays is, at each stage and in the end, what it was times a number that follows from the rate and h alone, so
    it is the same for all neurons and worked out once. The rate is the derivative of 1.
    """
    each, free = range(variables), variables - decaying

    def listed(names: Sequence[str]) -> str:
        return "(" + "".join(f"{name}, " for name in names) + ")"

    def numbered(name: str) -> str:
        return listed([f"{name}_{v}" for v in each])

    def mean(weights: Sequence[float], v: int) -> str:
        return " + ".join(f"h * {weight!r} * k{stage}_{v}" for stage, weight in enumerate(weights) if weight)

    def point(weights: Sequence[float]) -> str:
        moved = [f"y_{v} + ({mean(weights, v)})" for v in each[:free]]
        return listed(moved + [f"y_{v} * (1.0 + ({mean(weights, v)}))" for v in each[free:]])

    lines = [f"{numbered('y')} = y"]
    if decaying:
        lines.append(f"{numbered('rate')} = rates({listed(['1.0'] * variables)}, p)")
    for stage, weights in enumerate(tableau.stages):
        lines.append(f"{numbered(f'k{stage}')} = rates({point(weights) if weights else 'y'}, p)")
        for v in each[free:]:
            lines.append(f"k{stage}_{v} = rate_{v}" + (f" * (1.0 + ({mean(weights, v)}))" if weights else ""))
    lines.append(f"{numbered('new')} = {point(tableau.result)}")
    if by_slope:
        lines.append(f"{numbered('slope')} = rates({numbered('new')}, p)")
    if tableau.error:
        lines.append("error = 0.0")
        for v in each:
            lines.append(f"of_one = abs({f'y_{v} * ' if v >= free else ''}({mean(tableau.error, v)}))")
            if by_slope:
                lines.append(f"of_one /= 1.0 + abs(h * slope_{v})")
            lines.append("error = of_one if of_one > error else error")
    lines.append(f"return {numbered('new')}{', error' if tableau.error else ''}")
    return _function("step(rates, y, p, h)", lines)


def _function(head: str, lines: list[str]) -> FunctionType:
    """A function of generated lines, whose source `inspect` finds as that of any other."""
    text, scope = "\n    ".join([f"def {head}:", *lines]), dict[str, FunctionType]()
    file = f"<neuro {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    exec(compile(text, file, "exec"), {"__name__": __name__}, scope)
    return scope[head.partition("(")[0]]
