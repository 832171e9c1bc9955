"""Conformance cases, and the comparison of their outcomes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import Neuron, dc_generator
from neuro.program.program import Grid, Ints, Projection, synapse_states
from neuro.run.simulation import Simulation

Found = dict[str, NDArray[Any]]
"""Outcome of a case: arrays by the name of the quantity, e.g. "spikes of cells: steps"."""
Start = Callable[..., Simulation]
"""Function that compiles the network of a case: `start(net, seed=..., threads=...)`."""
Function = TypeVar("Function", bound=Callable[..., Any])
LIMIT = 1e-9
"""Largest accepted deviation of floats from the reference, in the unit of the value."""


@dataclass(frozen=True, slots=True)
class Case:
    """A test of one feature of the language.

    Attributes:
        name: name of the function that defines the case.
        about: one-line description of the feature.
        run: function that calls `start(net, seed=..., threads=...)` for a simulation, runs it, and returns the values
            to compare.
        exact: whether `run` returns two outcomes that must agree bit for bit. Otherwise its one outcome is compared
            with the reference.
        floats: whether the values are exact in floats only. A backend with integer arithmetic skips the case.
    """

    name: str
    about: str
    run: Callable[[Start], Any]
    exact: bool = False
    floats: bool = True


CASES: dict[str, Case] = {}
"""All registered cases by name."""


def case(function: Callable[[Start], Found]) -> Callable[[Start], Found]:
    """Register a function as a case whose outcome is compared with the reference."""
    CASES[function.__name__] = Case(function.__name__, about(function), function)
    return function


def law(function: Callable[[Start], tuple[Found, Found]]) -> Callable[[Start], tuple[Found, Found]]:
    """Register a function as a case whose two outcomes must agree bit for bit."""
    CASES[function.__name__] = Case(function.__name__, about(function), function, exact=True)
    return function


def integers_too(function: Function) -> Function:
    """Mark a registered case as exact in integers also, so that every backend must pass it."""
    CASES[function.__name__] = replace(CASES[function.__name__], floats=False)
    return function


def about(function: Callable[..., Any]) -> str:
    """Return the first line of a function's docstring."""
    return (function.__doc__ or "").strip().partition("\n")[0]


def network(resolution: float = 0.1) -> Network:
    """Return an empty network."""
    return Network("case", resolution=resolution)


def after(start: Start, net: Network, ms: float = 60.0) -> Found:
    """Run a network for `ms` milliseconds and return all readable values, see `observe`."""
    sim = start(net)
    sim.run(ms)
    return observe(sim)


def run_on(sim: Simulation, ms: float) -> None:
    """Run a simulation and ignore a numerical instability, because unstable states are compared like any others."""
    try:
        sim.run(ms)
    except ModelError as error:
        if error.kind != "instability":
            raise


def observe(sim: Simulation) -> Found:
    """Return all readable values: spikes, states, weights, traces and counts."""
    outcome: Found = {"time": np.array(round(sim.time / sim.program.resolution))}
    for population in sim.program.populations:
        name = population.name
        if population.records:
            times, ids = sim.spikes(name)
            outcome[f"spikes of {name}: steps"] = np.rint(times / sim.program.resolution).astype(np.int64)
            outcome[f"spikes of {name}: neurons"] = ids
        for state in sim.states(name):
            outcome[f"{state} of {name}"] = sim.get(name, state)
    for projection in sim.program.projections:
        name = projection.name
        for state in synapse_states(projection):
            outcome[f"{state} of {name}"] = sim.get(name, state)
    for probe in sim.program.probes:
        if probe.record != "spikes":
            outcome[f"trace of {probe.name}: times"], outcome[f"trace of {probe.name}"] = sim.trace(probe.name)
    for part in sim.program.synapse_probes:
        outcome[f"trace of {part.name}: times"], values = sim.trace(part.name)
        by_word = values if isinstance(values, dict) else {part.record: values}
        outcome |= {f"trace of {part.name}: {word}": array for word, array in by_word.items()}
    return outcome | counted(sim)


def counted(sim: Simulation) -> Found:
    """Return the counts of a simulation for each population and projection."""
    counts = sim.counts()
    outcome: Found = {"steps": np.array(counts.steps)}
    for name, cells in counts.populations.items():
        outcome[f"counts of {name}"] = np.array([cells.spikes, cells.neuron_updates, cells.neuron_updates_active])
    for name, wires in counts.projections.items():
        outcome[f"counts of {name}"] = np.array([wires.synaptic_ops, wires.learning_updates])
    return outcome


def differences(expected: Mapping[str, NDArray[Any]], actual: Mapping[str, NDArray[Any]], exact: bool) -> list[str]:
    """Return the differences of two outcomes, one line for each quantity.

    Whole numbers must be equal. Floats must be equal within 1e-9, or exactly if `exact`.
    """
    messages = [f"'{name}' is missing" for name in expected if name not in actual]
    messages += [f"'{name}' is not expected" for name in actual if name not in expected]
    for name in expected:
        if name in actual:
            messages += _difference(name, np.asarray(expected[name]), np.asarray(actual[name]), exact)
    return messages


def _difference(name: str, expected: NDArray[Any], actual: NDArray[Any], exact: bool) -> list[str]:
    if expected.shape != actual.shape:
        return [f"{name}: {actual.size} values, expected {expected.size}"]
    unequal = (expected != actual) & ~((expected != expected) & (actual != actual))  # NaN counts as equal to NaN
    if not exact and expected.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            unequal &= ~(np.abs(actual - expected) <= LIMIT)
    if not unequal.any():
        return []
    index = int(np.flatnonzero(unequal.ravel())[0])
    value, expected_value = actual.ravel()[index].item(), expected.ravel()[index].item()
    return [f"{name}: {int(unequal.sum())} differ, first [{index}] = {value!r}, expected {expected_value!r}"]


def expected_counts(sim: Simulation) -> Found:
    """Compute the counts of `counted` from their definitions, by following each spike along each synapse.

    The spikes of all populations must be recorded, and the network must have no trials.
    """
    program = sim.program
    step = round(sim.time / program.resolution)
    spikes = {p.name: _steps(sim, p.name, p.size) for p in program.populations}
    active = {p.name: np.zeros((p.size, step + 1), dtype=bool) for p in program.populations}
    outcome: Found = {"steps": np.array(step)}
    for index, part in enumerate(program.projections):
        source, target = program.populations[part.source].name, program.populations[part.target].name
        pre, post, delay = _synapses(sim, index)
        operations = updates = 0
        for i, j, d in zip(pre, post, delay, strict=True):
            operations += spikes[source][i].size
            arrivals = spikes[source][i] + d
            active[target][j, arrivals[arrivals <= step]] = True
            if part.synapse.learns:
                updates += np.unique(spikes[source][i]).size + np.unique(spikes[target][j]).size
        outcome[f"counts of {part.name}"] = np.array([operations, updates])
    for p in program.populations:
        for i, steps in enumerate(spikes[p.name]):
            active[p.name][i, steps] = True
        total = sum(steps.size for steps in spikes[p.name])
        computes = isinstance(p.model, Neuron)
        outcome[f"counts of {p.name}"] = np.array([total, computes * p.size * step, computes * active[p.name].sum()])
    return outcome


def _steps(sim: Simulation, name: str, size: int) -> list[Ints]:
    """Return the steps of each neuron's spikes; a step with several spikes is repeated."""
    if isinstance(next(p for p in sim.program.populations if p.name == name).model, dc_generator):
        return [np.zeros(0, dtype=np.int64)] * size
    times, ids = sim.spikes(name)
    steps = np.rint(times / sim.program.resolution).astype(np.int64)
    return [steps[ids == i] for i in range(size)]


def _synapses(sim: Simulation, index: int) -> tuple[Ints, Ints, Ints]:
    """Return source, target and delay of each synapse; in a grid each application of a kernel weight is a synapse."""
    part: Projection = sim.program.projections[index]
    pre, post = sim.program.connections(index) if part.grid is None else _under_kernels(part.grid)
    return pre, post, np.broadcast_to(part.delay, pre.size).astype(np.int64)


def _under_kernels(g: Grid) -> tuple[Ints, Ints]:
    """Return source and target of each application of a kernel weight, except in the padding."""
    maps, depth, height, width = g.kernels
    m, r, c, k, i, j = np.indices((maps, g.rows, g.columns, depth, height, width)).reshape(6, -1)
    y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
    is_inside = (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
    if g.depthwise:
        k = m * g.channels // g.maps
    return ((k * g.height + y) * g.width + x)[is_inside], ((m * g.rows + r) * g.columns + c)[is_inside]
