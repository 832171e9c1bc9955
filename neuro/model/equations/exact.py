"""Linear systems: the exact step of a neuron, and an upper bound of V_m for proof that the neuron cannot fire."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from neuro.core.grammar import Binary, Name, Tree
from neuro.model.equations import algebra
from neuro.model.equations.definition import CURRENT_NAME, Definition, Receptor
from neuro.model.equations.writing import Constants, local

CONSTANT = ""
"""Key of the constant part of a row."""


@dataclass(frozen=True)
class System:
    """A linear system z' = A z + b + e I. A row has the coefficients of one equation by name of the state.

    The coefficient of the current has the key "I", and the constant part has the key "". Coefficients of 0 are left
    out.
    """

    rows: Mapping[str, Mapping[str, Tree]]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        return tuple(self.rows)

    @property
    def size(self) -> int:
        """Number of rows of the matrix, including one for the constant part and one for the current."""
        return len(self.rows) + 2

    def dependencies(self, fixed: tuple[str, ...] = ()) -> dict[str, set[str]]:
        """Return, for each state, the names that affect it during a step. States in `fixed` are constant."""
        dependencies = {name: {name} | (set() if name in fixed else set(row)) for name, row in self.rows.items()}
        for _ in self.rows:
            for name, names in dependencies.items():
                dependencies[name] = names.union(*(dependencies[other] for other in names if other in dependencies))
        return dependencies


def kernel_rows(receptor: Receptor) -> dict[str, dict[str, Tree]]:
    """Return the rows of the system for the states of a receptor; none for a delta kernel."""
    if receptor.tau is None:
        return {}
    decay = algebra.negate(algebra.divide(algebra.ONE, receptor.tau.tree))
    if receptor.kernel == "exp":
        return {receptor.name: {receptor.name: decay}}
    slope = slope_of(receptor)
    return {receptor.name: {receptor.name: decay, slope: algebra.ONE}, slope: {slope: decay}}


def slope_of(receptor: Receptor) -> str:
    """Return the name of the second state of an alpha kernel."""
    return f"d{receptor.name}"


def system(definition: Definition) -> System | None:
    """Return the equations as a linear system, or None if they are not linear."""
    kernels = [row for receptor in definition.receptors for row in kernel_rows(receptor).items()]
    variables = {*definition.states, *(name for name, _ in kernels), CURRENT_NAME}
    rows: dict[str, Mapping[str, Tree]] = {}
    for name, expression in definition.states.items():
        row = algebra.affine(definition.full(expression.tree), variables)
        if row is None:
            return None
        rows[name] = {word: factor for word, factor in row.items() if factor != algebra.ZERO}
    return System({**rows, **dict(kernels)})


def matrix_lines(linear: System, constants: Constants, place: str, fixed: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the lines of `constants` that solve the system. States in `fixed` are constant."""
    size = linear.size
    columns = {name: k for k, name in enumerate((*linear.states, CONSTANT, CURRENT_NAME))}
    yield f"for k in range({size * size}):"
    yield f"    c[{place} + k] = 0.0"
    for i, (name, row) in enumerate(linear.rows.items()):
        for word, factor in row.items():
            if name not in fixed:
                yield f"c[{place} + {i * size + columns[word]}] = {constants.of_parameters(factor)}"
    yield f"change(c, {place}, {len(linear.rows)}, 2, h)"


def buffer_size(linear: System) -> int:
    """Return the size of the buffer for the solution of the system."""
    return N_MATRICES * linear.size**2


def solution(linear: System, name: str, offset_name: str, fixed: tuple[str, ...] = ()) -> tuple[list[str], str]:
    """Return the lines that unpack the solution for a state, and the expression of the state after a step.

    Args:
        linear: the system.
        name: the state.
        offset_name: name of the variable with the offset of the solution in the constants.
        fixed: states that are constant during the step.
    """
    states = linear.states
    i, names = states.index(name), linear.dependencies(fixed)[name]
    lines, terms = [], []
    for j, word in enumerate((*states, CONSTANT, CURRENT_NAME)):
        if word in names:
            factor = f"{'held' if fixed else 'free'}_{i}_{j}"
            lines.append(f"{factor} = {'1.0 + ' if names == {name} else ''}c[{offset_name} + {i * linear.size + j}]")
            value = {CONSTANT: "", CURRENT_NAME: " * i_0[i]"}.get(word, f" * {local(word)}")
            terms.append(f"{factor}{value}")
    change = " + ".join(terms)
    return lines, change if names == {name} else f"{local(name)} + ({change})"


def quiet_lines(definition: Definition, linear: System, constants: Constants, held_row: int | None) -> list[str] | None:
    """Return the body of `quiet`, or None if no bound is known.

    An upper bound of the state in the threshold test is its highest value under the constant drive alone, plus the
    remaining charge of all kernels. The neuron is quiet if this bound is below the threshold.
    """
    if definition.threshold is None:
        return ["return True"]
    tree = definition.threshold.tree
    assert isinstance(tree, Binary)
    if tree.sign not in (">", ">=") or not isinstance(tree.left, Name) or tree.left.name not in linear.rows:
        return None
    if not constants.is_of_parameters(tree.right):
        return None
    name, row = tree.left.name, linear.rows[tree.left.name]
    drivers = _charges(definition, linear, name, constants)
    if drivers is None:
        return None
    leak = algebra.negate(row.get(name, algebra.ZERO))
    gain = constants.place_of(f"lasting({constants.of_parameters(leak)})")
    drive = [constants.place(row[CONSTANT])] if CONSTANT in row else []
    drive += [f"{constants.place(row[CURRENT_NAME])} * i_0[i]"] if CURRENT_NAME in row else []
    at = linear.states.index(name)
    charges = [f"max({charge} * s[{linear.states.index(word)}, i], 0.0)" for word, charge in drivers]
    refractory_test = "" if held_row is None else f"s[{held_row}, i] != 0.0 or "
    return [
        "for i in range(lo, hi):",
        f"    top = relaxed(s[{at}, i], {' + '.join(drive) or '0.0'}, {gain})",
        *([f"    top += {' + '.join(charges)}"] if charges else []),
        f"    if {refractory_test}not top < {constants.place(tree.right)}:",
        "        return False",
        "return True",
    ]


def _charges(definition: Definition, linear: System, name: str, constants: Constants) -> list[tuple[str, str]] | None:
    """Return the kernel states that drive a state, each with the total effect of one unit of the state.

    The result is None if another state drives the state too.
    """
    kernels = {r.name: r for r in definition.receptors if r.kernel != "delta"}
    charges = []
    for word, factor in linear.rows[name].items():
        if word in (name, CONSTANT, CURRENT_NAME):
            continue
        if word not in kernels:
            return None
        receptor = kernels[word]
        assert receptor.tau is not None
        tau = f"positive({constants.of_parameters(receptor.tau.tree)})"
        charge = f"({constants.of_parameters(factor)}) * {tau}"
        charges.append((word, constants.place_of(charge)))
        if receptor.kernel == "alpha":
            charges.append((slope_of(receptor), constants.place_of(f"{charge} * {tau}")))
    return charges


# mypy: disable-error-code="no-untyped-def,no-untyped-call"

TERMS = 14
"""Number of terms of the series. The error is below 1e-16 for a norm of at most 1/2."""
N_MATRICES = 3
"""Number of matrices in the buffer of the exponential, including the result."""


def change(c, offset, n, n_inputs, h):
    """Compute the change of z in h for z' = A z + B u with constant u.

    The method is scaling, a Taylor series and squaring. The identity matrix is left out of the result, because adding
    it would cut the last digits of small elements, and a potential that hardly changes in a step would come to rest at
    another value. Equal time constants and singular matrices need no special case.

    Args:
        c: array with the matrix [[A, B], [0, 0]] at `offset`, row by row. The function replaces the matrix by
            [[exp(A h) - 1, integral of exp(A t) B], [0, 0]]. The space of the next two matrices is a buffer.
        offset: offset of the matrix.
        n: rows of A.
        n_inputs: columns of B.
        h: duration of the step in ms.
    """
    size = n + n_inputs
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(c[offset + i * size + j])
        norm = max(norm, row * h)
    if not norm < math.inf:
        for k in range(size * size):
            c[offset + k] = math.nan
        return
    squarings, duration = 0, h
    while norm > 0.5:
        norm *= 0.5
        duration *= 0.5
        squarings += 1
    scaled, buffer = offset + size * size, offset + 2 * size * size
    for k in range(size * size):
        c[offset + k] *= duration
        c[scaled + k] = c[offset + k]
    for term in range(TERMS, 1, -1):
        for k in range(size * size):
            c[offset + k] /= term
        for i in range(size):
            c[offset + i * size + i] += 1.0
        multiply(c, scaled, offset, buffer, size)
        for k in range(size * size):
            c[offset + k] = c[buffer + k]
    for _ in range(squarings):
        multiply(c, offset, offset, buffer, size)
        for k in range(size * size):
            c[offset + k] = 2.0 * c[offset + k] + c[buffer + k]


def multiply(c, a, b, output, size):
    """Write the product of the matrices at offsets `a` and `b` of `c` to offset `output`. Elements of 0 are skipped."""
    for k in range(size * size):
        c[output + k] = 0.0
    for i in range(size):
        for j in range(size):
            factor = c[a + i * size + j]
            if factor != 0.0:
                for k in range(size):
                    c[output + i * size + k] += factor * c[b + j * size + k]


def lasting(leak):
    """Return the time constant 1/leak: infinite for a leak of 0, and NaN for a negative leak."""
    return 1.0 / leak if leak > 0.0 else (math.inf if leak == 0.0 else math.nan)


def positive(tau):
    """Return a time constant, or NaN if it is not positive."""
    return tau if tau > 0.0 else math.nan


def relaxed(value, drive, gain):
    """Return the highest future value of a state with a leak under a constant drive. `gain` is `lasting(leak)`."""
    if math.isinf(gain):
        return value if drive <= 0.0 else math.inf
    return max(value, drive * gain) if gain > 0.0 else math.inf
