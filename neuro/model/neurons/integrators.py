"""Runge-Kutta integrators for models without an exact solution: NEST's adaptive RKF45 and classical RK4.

A system consists of two functions of a model's module. `rates(y, p)` returns the derivatives of the variables `y`, both
as tuples of floats. `system(s, c, i_0, i)` returns the argument `p` of `rates` for neuron i as a tuple. The variables
are the first rows of the states `s`. A module creates the integrators for the number of variables, and uses the
integrators in `step`. A step of the grid is a time step of the network, of h ms:

    rkf45, rk4, (take, put) = fehlberg(3), runge_kutta(3), rows(3)

    step_adaptively(rkf45, take, put, rates, system, s, c, i_0, lo, hi, h, SIZE, tolerance, fired)
    step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, h, substeps)
    is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps)     # for `quiet`

The size of the adaptive step is a hidden state of the neuron, row SIZE, and is kept from one step of the grid to the
next as in NEST. The size 0 stands for a whole step of the grid. This is the initial and the most frequent value, so a
whole step is tried for all neurons in a vectorised loop without branches. The few neurons that need shorter steps
are integrated afterwards.

Source: Fehlberg, NASA TR R-315, 1969, table III; step control of GSL 2.7, `cstd.c` and `evolve.c`, as used by NEST
3.10. The tolerance is absolute. For some neurons it is also relative to the slope.
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
"""Largest accepted error of a step, in units of the tolerance."""

MOST_STEPS = 1_000_000
"""Largest number of adaptive steps within a step of the grid. After more steps the variables of the neuron become NaN,
which is reported as a numerical instability. A diverging conductance would otherwise need ever shorter steps."""

TINY = 1e-300
"""Smallest error, which replaces an error of 0 in divisions."""


@dataclass(frozen=True, slots=True)
class Tableau:
    """An explicit Runge-Kutta method.

    Attributes:
        stages: for each stage, the weights of the rates of earlier stages. The first stage has none.
        result: weights of all stages in the result.
        error: weights of all stages in the estimated error, or () for a method without an error estimate.
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
"""Fehlberg's method of order 5 with an error estimate of order 4."""

RK4 = Tableau(stages=((), (1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0)), result=(1 / 6, 1 / 3, 1 / 3, 1 / 6))
"""The classical method of order 4."""


@cache
def fehlberg(variables: int, decaying: int = 0, *, by_slope: bool = False) -> FunctionType:
    """Return a step of RKF45 for a number of variables.

    The step `rkf45(rates, y, p, h)` returns the new `y` and the largest error of a variable. The last `decaying`
    variables decay exponentially, each with its own rate: `y' = rate y`. With `by_slope` the error of each variable is
    divided by 1 + |h y'| at the new point before the largest is chosen. The tolerance is then both absolute and
    relative to the slope, as in GSL's `gsl_odeiv_control_yp_new(tol, tol)`.
    """
    return _generate_step(FEHLBERG, variables, decaying, by_slope)


@cache
def runge_kutta(variables: int, decaying: int = 0) -> FunctionType:
    """Return a step of RK4 for a number of variables: `rk4(rates, y, p, h)` returns the new `y`.

    `decaying` is explained in `fehlberg`.
    """
    return _generate_step(RK4, variables, decaying, by_slope=False)


@cache
def rows(variables: int) -> tuple[FunctionType, FunctionType]:
    """Return `take(s, i)`, which reads the variables of neuron i as a tuple, and `put(s, i, y)`, which writes them."""
    values = "(" + "".join(f"s[{v}, i], " for v in range(variables)) + ")"
    assignments = [f"s[{v}, i] = y[{v}]" for v in range(variables)]
    return _function("take(s, i)", [f"return {values}"]), _function("put(s, i, y)", assignments)


def step_adaptively(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, unfinished):
    """Advance a step of the grid by adaptive steps.

    `attempt` is a function that `fehlberg` returns. `take` and `put` come from `rows`. `rates` and `system` are the
    equations, see the module. `s`, `c`, `i_0`, `lo` and `hi` are arguments of a model's `step`. `h` is the step of the
    grid in ms, `size` the row of `s` with the size of the next adaptive step, and `tolerance` the largest error
    of a variable per step. `unfinished` is a buffer, e.g. the array `fired` of a model's `step` before it is set.
    """
    step_whole(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, unfinished)
    for i in range(lo, hi):
        if unfinished[i]:
            y, p, t, next_size, n_steps = take(s, i), system(s, c, i_0, i), 0.0, s[size, i], 0
            while t < h:
                y, t, next_size = advance(attempt, rates, y, p, t, h, next_size, tolerance)
                n_steps += 1
                if n_steps == MOST_STEPS:
                    y, t, next_size = attempt(rates, y, p, math.nan)[0], h, 0.0
            put(s, i, y)
            s[size, i] = next_size


def step_whole(attempt, take, put, rates, system, s, c, i_0, lo, hi, h, size, tolerance, unfinished):
    """Take a whole step of the grid for each neuron whose error is small enough.

    For the other neurons set `unfinished[i]` to 1, and do not change the states. The arguments are those of
    `step_adaptively`.
    """
    for i in range(lo, hi):
        y = take(s, i)
        new, error = attempt(rates, y, system(s, c, i_0, i), h)
        is_unfinished = s[size, i] != 0.0 or error > ACCEPTED * tolerance
        put(s, i, y if is_unfinished else new)
        unfinished[i] = is_unfinished


def step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, h, substeps):
    """Advance a step of the grid by `substeps` steps of a method without an error estimate, see `runge_kutta`."""
    for _ in range(int(substeps)):
        for i in range(lo, hi):
            put(s, i, rk4(rates, take(s, i), system(s, c, i_0, i), h / substeps))


def is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps):
    """Return whether a step without input leaves neuron i unchanged. `substeps` of 0 selects RKF45, otherwise RK4."""
    y, p = take(s, i), system(s, c, i_0, i)
    new = rkf45(rates, y, p, h)[0] if substeps == 0.0 else rk4(rates, y, p, h / substeps)
    return new == y


def are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, refractory, size, v_top):
    """Return whether all neurons stay unchanged in a step without input.

    `refractory` and `size` are rows of hidden states. A neuron that is refractory, in the middle of a step of the grid,
    or has its first variable, V_m, at `v_top` or above is not at rest.
    """
    for i in range(lo, hi):
        if s[refractory, i] != 0.0 or s[size, i] != 0.0 or s[0, i] >= v_top:
            return False
        if not is_still(rkf45, rk4, take, rates, system, s, c, i_0, i, h, substeps):
            return False
    return True


def advance(attempt, rates, y, p, t, h, size, tolerance):
    """Take one step with an accepted error. Return the new `y`, the new `t`, and the size of the next step.

    `t` is the time in ms since the beginning of the step of the grid, whose length is `h`. `size` is the size of the
    adaptive step, where 0 stands for the rest of the step of the grid.
    """
    remaining = h - t
    step = remaining if size == 0.0 or size > remaining else size
    while True:
        new, error = attempt(rates, y, p, step)
        if not error > ACCEPTED * tolerance:
            break
        shorter = max(0.9 * (error / tolerance) ** -0.2, 0.2) * step
        if not (shorter < step and t + shorter != t):
            break
        step = shorter
    t = h if step == remaining else t + step
    if error < 0.5 * tolerance and step < h:
        step *= min(max(0.9 * (max(error, TINY) / tolerance) ** (-1.0 / 6.0), 1.0), 5.0)
    return new, t, 0.0 if step >= h else step


def finite_exp(x):
    """Return e^x, at most e^709. For larger values Python would raise an error, and compiled code would not."""
    return math.exp(709.0 if x > 709.0 else x)


def _generate_step(tableau: Tableau, variables: int, decaying: int, by_slope: bool) -> FunctionType:
    """Generate a step of a method as straight-line code without arrays, with a variable for every number.

    A decaying variable is multiplied by a factor at each stage and in the result. The factor depends only on h and on
    the rate of the variable, which is its derivative at y = 1. So compiled code computes the factor once for all
    neurons.
    """
    variables_range, n_free = range(variables), variables - decaying

    def tuple_of(names: Sequence[str]) -> str:
        return "(" + "".join(f"{name}, " for name in names) + ")"

    def tuple_of_numbered(name: str) -> str:
        return tuple_of([f"{name}_{v}" for v in variables_range])

    def increment(weights: Sequence[float], v: int) -> str:
        return " + ".join(f"h * {weight!r} * k{stage}_{v}" for stage, weight in enumerate(weights) if weight)

    def point(weights: Sequence[float]) -> str:
        moved = [f"y_{v} + ({increment(weights, v)})" for v in variables_range[:n_free]]
        return tuple_of(moved + [f"y_{v} * (1.0 + ({increment(weights, v)}))" for v in variables_range[n_free:]])

    lines = [f"{tuple_of_numbered('y')} = y"]
    if decaying:
        lines.append(f"{tuple_of_numbered('rate')} = rates({tuple_of(['1.0'] * variables)}, p)")
    for stage, weights in enumerate(tableau.stages):
        lines.append(f"{tuple_of_numbered(f'k{stage}')} = rates({point(weights) if weights else 'y'}, p)")
        for v in variables_range[n_free:]:
            lines.append(f"k{stage}_{v} = rate_{v}" + (f" * (1.0 + ({increment(weights, v)}))" if weights else ""))
    lines.append(f"{tuple_of_numbered('new')} = {point(tableau.result)}")
    if by_slope:
        lines.append(f"{tuple_of_numbered('slope')} = rates({tuple_of_numbered('new')}, p)")
    if tableau.error:
        lines.append("error = 0.0")
        for v in variables_range:
            lines.append(f"error_of_y = abs({f'y_{v} * ' if v >= n_free else ''}({increment(tableau.error, v)}))")
            if by_slope:
                lines.append(f"error_of_y /= 1.0 + abs(h * slope_{v})")
            lines.append("error = error_of_y if error_of_y > error else error")
    lines.append(f"return {tuple_of_numbered('new')}{', error' if tableau.error else ''}")
    return _function("step(rates, y, p, h)", lines)


def _function(head: str, lines: list[str]) -> FunctionType:
    """Compile generated lines to a function. The source stays readable for `inspect`."""
    text, scope = "\n    ".join([f"def {head}:", *lines]), dict[str, FunctionType]()
    file = f"<neuro {hashlib.sha256(text.encode()).hexdigest()[:16]}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    exec(compile(text, file, "exec"), {"__name__": __name__}, scope)
    return scope[head.partition("(")[0]]
