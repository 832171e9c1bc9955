"""Runge-Kutta steps as text: the classical one of fourth order, and Fehlberg's with the size of its steps controlled.

The method and its source are those of `neuro.model.neurons.integrators`. Written out once more, since a threshold is
looked at after each part of a step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from neuro.model.equations.writing import Constants, indented, local
from neuro.model.neurons.integrators import FEHLBERG

Call = Callable[[dict[str, str]], str]
"""The text that asks for the rates at some values, by state."""

SMALLEST = 1e-12
"""The smallest part of a step that is taken, however large its error."""


def rk4_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """A step in some equal parts, with the threshold after each."""
    count = int(settings["substeps"])
    h = constants.place_of("h" if count == 1 else f"h / {count}")
    lines = _stage(1, states, call({name: local(name) for name in states}))
    for stage, share in ((2, 0.5), (3, 0.5), (4, 1.0)):
        near = f"{share} * {h}" if share != 1.0 else h
        lines += _stage(stage, states, call({n: f"{local(n)} + {near} * k{stage - 1}_{local(n)}" for n in states}))
    for name in states:
        k1, k2, k3, k4 = (f"k{stage}_{local(name)}" for stage in range(1, 5))
        lines.append(f"{local(name)} += {h} * ({k1} + 2.0 * {k2} + 2.0 * {k3} + {k4}) / 6.0")
    lines += spike
    return lines if count == 1 else [f"for _ in range({count}):", *indented(lines)]


def rkf45_lines(
    states: tuple[str, ...],
    call: Call,
    spike: list[str],
    constants: Constants,
    settings: Mapping[str, float],
    part: str,
) -> list[str]:
    """A step in parts of errors below the tolerance, with the threshold after each; `part` keeps their size."""
    h = constants.place_of("h")
    lines = [
        f"size = {part} if {part} > 0.0 else {h}",
        "t = 0.0",
        f"while t < {h}:",
        *indented(_stage(1, states, call({name: local(name) for name in states}))),
        "    trying = True",
        "    while trying:",
        *indented(_try(states, call, h, settings), 2),
        f"    t = {h} if last else t + now",
        *indented([f"{local(name)} = new_{local(name)}" for name in states]),
        *indented(spike),
        f"{part} = size",
    ]
    return lines


def _try(states: tuple[str, ...], call: Call, h: str, settings: Mapping[str, float]) -> list[str]:
    tolerance, by_slope = settings["tolerance"], settings["slope_tolerance"]
    lines = [f"last = size > {h} - t", f"now = {h} - t if last else size"]
    for stage in range(2, 7):
        near = {n: f"{local(n)} + now * ({_sum(FEHLBERG.stages[stage - 1], n)})" for n in states}
        lines += _stage(stage, states, call(near))
    lines += [f"new_{local(n)} = {local(n)} + now * ({_sum(FEHLBERG.result, n)})" for n in states]
    if by_slope:
        lines += _stage(7, states, call({n: f"new_{local(n)}" for n in states}))
    allowed = {n: f" + {by_slope!r} * abs(now * k7_{local(n)})" if by_slope else "" for n in states}
    errors = [f"abs(now * ({_sum(FEHLBERG.error, n)})) / ({tolerance!r}{allowed[n]})" for n in states]
    worst = errors[0]
    for error in errors[1:]:
        worst = f"max({worst}, {error})"
    return [
        *lines,
        f"worst = {worst}",
        "size = resized(now, worst)",
        f"trying = size < now and size > {SMALLEST!r} * {h}",
        "if size < now and not trying:",
        "    size = now",
    ]


def _stage(stage: int, states: tuple[str, ...], call: str) -> list[str]:
    names = "".join(f"k{stage}_{local(name)}, " for name in states)
    return [f"{names}= {call}"]


def _sum(factors: tuple[float, ...], name: str) -> str:
    terms = [f"{factor!r} * k{k}_{local(name)}" for k, factor in enumerate(factors, 1) if factor]
    return " + ".join(terms)
