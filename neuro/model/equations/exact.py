"""Linear systems: the step of a neuron as its exact solution, and a bound below which it cannot fire."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from neuro.core.grammar import Binary, Name, Tree
from neuro.model.equations import algebra
from neuro.model.equations.definition import CURRENT_NAME, Definition, Receptor
from neuro.model.equations.writing import Constants, local

REST = ""
"""The part of a row that depends on no state and no current."""


@dataclass(frozen=True)
class System:
    """z' = A z + b + e I, row by row: the factors of the states and of I, and under "" what is constant."""

    rows: Mapping[str, Mapping[str, Tree]]

    @property
    def states(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(self.rows)

    @property
    def size(self) -> int:
        """Rows of the matrix with two more for what is constant and for the current."""
        return len(self.rows) + 2

    def reached(self, held: tuple[str, ...] = ()) -> dict[str, set[str]]:
        """What each state depends on in the course of a step, while some are held."""
        found = {name: {name} | (set() if name in held else set(row)) for name, row in self.rows.items()}
        for _ in self.rows:
            for name, mine in found.items():
                found[name] = mine.union(*(found[other] for other in mine if other in found))
        return found


def kernel_rows(receptor: Receptor) -> dict[str, dict[str, Tree]]:
    """The equations of a receptor's states."""
    if receptor.tau is None:
        return {}
    fall = algebra.negative(algebra.divided(algebra.ONE, receptor.tau.tree))
    if receptor.kernel == "exp":
        return {receptor.name: {receptor.name: fall}}
    slope = slope_of(receptor)
    return {receptor.name: {receptor.name: fall, slope: algebra.ONE}, slope: {slope: fall}}


def slope_of(receptor: Receptor) -> str:
    """The second state of an alpha kernel."""
    return f"d{receptor.name}"


def system(d: Definition) -> System | None:
    """The equations as a linear system, None if they are none."""
    kernels = [row for receptor in d.receptors for row in kernel_rows(receptor).items()]
    variables = {*d.states, *(name for name, _ in kernels), CURRENT_NAME}
    rows: dict[str, Mapping[str, Tree]] = {}
    for name, expression in d.states.items():
        row = algebra.affine(d.full(expression.tree), variables)
        if row is None:
            return None
        rows[name] = {word: factor for word, factor in row.items() if factor != algebra.ZERO}
    return System({**rows, **dict(kernels)})


def matrix_lines(linear: System, constants: Constants, place: str, held: tuple[str, ...] = ()) -> Iterator[str]:
    """The lines of `constants` that solve the system; `held` ones stay."""
    size = linear.size
    columns = {name: k for k, name in enumerate((*linear.states, REST, CURRENT_NAME))}
    yield f"for k in range({size * size}):"
    yield f"    c[{place} + k] = 0.0"
    for i, (name, row) in enumerate(linear.rows.items()):
        for word, factor in row.items():
            if name not in held:
                yield f"c[{place} + {i * size + columns[word]}] = {constants.of_parameters(factor)}"
    yield f"change(c, {place}, {len(linear.rows)}, 2, h)"


def room(linear: System) -> int:
    """How many numbers the solution of the system lies in."""
    return ROOM * linear.size**2


def solution(linear: System, name: str, place: str, held: tuple[str, ...] = ()) -> tuple[list[str], str]:
    """Lines that unpack the solution for a state, and the state after a step in terms of those before it.

    Args:
        linear: the system.
        name: the state.
        place: the name of the place of its solution.
        held: the states that stay meanwhile.
    """
    states = linear.states
    i, reached = states.index(name), linear.reached(held)[name]
    lines, terms = [], []
    for j, word in enumerate((*states, REST, CURRENT_NAME)):
        if word in reached:
            factor = f"{'held' if held else 'free'}_{i}_{j}"
            lines.append(f"{factor} = {'1.0 + ' if reached == {name} else ''}c[{place} + {i * linear.size + j}]")
            value = {REST: "", CURRENT_NAME: " * i_0[i]"}.get(word, f" * {local(word)}")
            terms.append(f"{factor}{value}")
    change = " + ".join(terms)
    return lines, change if reached == {name} else f"{local(name)} + ({change})"


def quiet_lines(d: Definition, linear: System, constants: Constants, held_row: int | None) -> list[str] | None:
    """The body of `quiet`: the state at the threshold stays below where its drive holds it plus all that kernels add.

    None if no such bound is known.
    """
    if d.threshold is None:
        return ["return True"]
    tree = d.threshold.tree
    assert isinstance(tree, Binary)
    if tree.sign not in (">", ">=") or not isinstance(tree.left, Name) or tree.left.name not in linear.rows:
        return None
    if not constants.is_of_parameters(tree.right):
        return None
    name, row = tree.left.name, linear.rows[tree.left.name]
    drivers = _charges(d, linear, name, constants)
    if drivers is None:
        return None
    leak = algebra.negative(row.get(name, algebra.ZERO))
    gain = constants.place_of(f"lasting({constants.of_parameters(leak)})")
    drive = [constants.place(row[REST])] if REST in row else []
    drive += [f"{constants.place(row[CURRENT_NAME])} * i_0[i]"] if CURRENT_NAME in row else []
    at = linear.states.index(name)
    added = [f"max({charge} * s[{linear.states.index(word)}, i], 0.0)" for word, charge in drivers]
    refused = "" if held_row is None else f"s[{held_row}, i] != 0.0 or "
    return [
        "for i in range(lo, hi):",
        f"    top = relaxed(s[{at}, i], {' + '.join(drive) or '0.0'}, {gain})",
        *([f"    top += {' + '.join(added)}"] if added else []),
        f"    if {refused}not top < {constants.place(tree.right)}:",
        "        return False",
        "return True",
    ]


def _charges(d: Definition, linear: System, name: str, constants: Constants) -> list[tuple[str, str]] | None:
    """The states of kernels that drive a state, and how far one of each can carry it; None if others drive it."""
    kernels = {r.name: r for r in d.receptors if r.kernel != "delta"}
    found = []
    for word, factor in linear.rows[name].items():
        if word in (name, REST, CURRENT_NAME):
            continue
        if word not in kernels:
            return None
        receptor = kernels[word]
        assert receptor.tau is not None
        tau = f"positive({constants.of_parameters(receptor.tau.tree)})"
        charge = f"({constants.of_parameters(factor)}) * {tau}"
        found.append((word, constants.place_of(charge)))
        if receptor.kernel == "alpha":
            found.append((slope_of(receptor), constants.place_of(f"{charge} * {tau}")))
    return found


# mypy: disable-error-code="no-untyped-def,no-untyped-call"

TERMS = 14
"""Enough for an error below 1e-16 where the norm is at most 1/2."""
ROOM = 3
"""How many matrices of its size the exponential needs to lie in, itself among them."""


def change(c, at, n, more, h):
    """By how much z changes in h where z' = A z + B u, for a u that is constant meanwhile.

    Scaling, a Taylor sum and squaring. The identity is left out: beside it what is small would lose its last digits,
    and a potential that hardly changes in a step would come to rest elsewhere. Equal time constants and singular
    matrices are nothing special.

    Args:
        c: at `at` the matrix [[A, B], [0, 0]], row by row, which becomes [[exp(A h) - 1, integral of exp(A t) B],
            [0, 0]]; two matrices of room follow.
        at: where it begins.
        n: rows of A.
        more: columns of B.
        h: how long.
    """
    size = n + more
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(c[at + i * size + j])
        norm = max(norm, row * h)
    if not norm < math.inf:
        for k in range(size * size):
            c[at + k] = math.nan
        return
    squarings, part = 0, h
    while norm > 0.5:
        norm *= 0.5
        part *= 0.5
        squarings += 1
    first, room = at + size * size, at + 2 * size * size
    for k in range(size * size):
        c[at + k] *= part
        c[first + k] = c[at + k]
    for term in range(TERMS, 1, -1):
        for k in range(size * size):
            c[at + k] /= term
        for i in range(size):
            c[at + i * size + i] += 1.0
        multiply(c, first, at, room, size)
        for k in range(size * size):
            c[at + k] = c[room + k]
    for _ in range(squarings):
        multiply(c, at, at, room, size)
        for k in range(size * size):
            c[at + k] = 2.0 * c[at + k] + c[room + k]


def multiply(c, a, b, to, size):
    """Write the product of two matrices, most of whose elements are 0, to a third place."""
    for k in range(size * size):
        c[to + k] = 0.0
    for i in range(size):
        for j in range(size):
            factor = c[a + i * size + j]
            if factor != 0.0:
                for k in range(size):
                    c[to + i * size + k] += factor * c[b + j * size + k]


def lasting(leak):
    """How long a state remembers, 1/leak; infinite without leak, NaN if it grows by itself."""
    return 1.0 / leak if leak > 0.0 else (math.inf if leak == 0.0 else math.nan)


def positive(tau):
    """A time constant, NaN if it is none."""
    return tau if tau > 0.0 else math.nan


def relaxed(value, drive, gain):
    """The highest that a state with a leak comes under a constant drive; `gain` is `lasting` of its leak."""
    if math.isinf(gain):
        return value if drive <= 0.0 else math.inf
    return max(value, drive * gain) if gain > 0.0 else math.inf
