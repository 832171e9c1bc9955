"""Inputs of a scan: neurons with their constants, synapses in one of two layouts, the order of scans, and a task.

A `Plan` lists which parts of a network are scanned and which are stepped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from graphlib import TopologicalSorter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neuro.core.clock import NEVER
from neuro.core.errors import some
from neuro.model.neurons import Neuron
from neuro.program.currents import Currents, driven
from neuro.program.program import Floats, Population, Program, Projection
from neuro_torch.scan import kernels as rows
from neuro_torch.surrogates import Surrogate

CELLS = ("iaf_psc_delta", "iaf_psc_exp")
"""Models that scans support, besides graded models outside of cycles (`neuro_torch.cells`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """The neurons of a population.

    Attributes:
        population: index of the population.
        size: number of neurons.
        model: a name of `CELLS`, or of a graded model.
        constants: constants of the model, see `neuro_torch.scan.kernels`, (constants, size).
        per_pa: potential that a current of 1 pA adds in a step, mV, (size,).
        constant: constant current, pA, (size,).
        v, current: potential (mV) and synaptic current (pA) at step 0, (size,).
    """

    population: int
    size: int
    model: str
    constants: Floats
    per_pa: Floats
    constant: Floats
    v: Floats
    current: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Synapses:
    """The synapses of a projection.

    Attributes:
        projection, source, target: indices of the projection and its populations.
        sizes: number of neurons of source and target.
        shape: shape of the weights in `neuro_torch.Module.weights`.
        dense: whether the synapses are a matrix with one delay; then `row_ends`, `targets` and `slot` are empty.
        row_ends: the synapses of source j are `row_ends[j] : row_ends[j + 1]`.
        targets, slot, delay: of each synapse the target, the index of the weight, and the delay in steps.
        least: the smallest delay in steps.
    """

    projection: int
    source: int
    target: int
    sizes: tuple[int, int]
    shape: tuple[int, ...]
    dense: bool
    row_ends: NDArray[np.int64]
    targets: NDArray[np.int32]
    slot: NDArray[np.int64]
    delay: NDArray[np.int64]
    least: int


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """Populations that are simulated together: a single population, or a cycle of connections.

    Attributes:
        cells: neurons by index of the population.
        outside: synapses from populations that are scanned earlier, in the order of the program.
        inside: synapses among the component's own populations.
        stretch: steps per pass, at most the smallest delay inside the component; 0 for all steps.
    """

    cells: dict[int, Cells]
    outside: tuple[Synapses, ...]
    inside: tuple[Synapses, ...]
    stretch: int


def reasons_to_step(program: Program) -> list[str]:
    """Return the reasons why a program cannot be scanned, one sentence each."""
    reasons = []
    for part in program.populations:
        if part.kind == "neuron":
            reasons += [f"population '{part.name}': {reason}" for reason in _reasons_of_population(part)]
    if driven(program):
        names = ", ".join(f"'{program.populations[k].name}'" for k in driven(program))
        reasons.append(f"the current into {names} changes in every step")
    return reasons


def _reasons_of_population(part: Population) -> list[str]:
    if part.model.graded:
        has_receptors = isinstance(part.model, Neuron) and part.model.receptors > 1
        return ["it has several receptors"] if has_receptors else []
    if part.model.name not in CELLS:
        return [f"scans support only {' and '.join(CELLS)}, not {part.model.name}"]
    p = part.parameters
    if np.any(p["reset_by_subtraction"] != 0.0):
        return ["its potential falls at a spike instead of being reset"]
    if part.model.name == "iaf_psc_delta":
        return ["it keeps input while refractory"] if np.any(p["refractory_input"] != 0.0) else []
    if isinstance(part.model, Neuron) and part.model.receptors > 2:
        return ["it has more receptors than excitation and inhibition"]
    return [] if np.all(p["tau_syn_ex"] == p["tau_syn_in"]) else ["tau_syn_ex and tau_syn_in differ"]


def components(program: Program) -> list[Component]:
    """Return the components of a program, sorted so that the input of each is known before its scan."""
    projections = [synapses(program, q) for q, part in enumerate(program.projections) if part.carries == "spikes"]
    neurons = [k for k, part in enumerate(program.populations) if part.kind == "neuron"]
    label = _cycle_labels(len(program.populations), projections)
    order = TopologicalSorter({int(label[k]): set[int]() for k in neurons})
    for projection in projections:
        if label[projection.source] != label[projection.target] and projection.source in neurons:
            order.add(int(label[projection.target]), int(label[projection.source]))
    return [
        _component(program, [k for k in neurons if label[k] == component_label], projections)
        for component_label in order.static_order()
    ]


def _cycle_labels(n: int, wired: list[Synapses]) -> NDArray[np.int32]:
    """Return a label for each population; populations that reach each other have the same label."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pre, post = ([getattr(wires, word) for wires in wired] for word in ("source", "target"))
    graph = coo_array((np.ones(len(wired)), (pre, post)), shape=(n, n))
    labels: NDArray[np.int32] = connected_components(graph, directed=True, connection="strong")[1]
    return labels


def _component(program: Program, members: list[int], wired: list[Synapses]) -> Component:
    incoming = [projection for projection in wired if projection.target in members]
    inside = tuple(projection for projection in incoming if projection.source in members)
    outside = tuple(projection for projection in incoming if projection.source not in members)
    return Component(
        {k: cells(program, k) for k in members}, outside, inside, min((e.least for e in inside), default=0)
    )


def cells(program: Program, index: int) -> Cells:
    """Return the neurons of a population with the constants of their model."""
    part = program.populations[index]
    model: Any = part.model
    if model.graded:  # graded neurons are stepped by their model and need no constants here
        zeros = np.zeros(part.size)
        return Cells(index, part.size, model.name, np.zeros((rows.CONSTANTS, part.size)), zeros, zeros, zeros, zeros)
    parameters = [np.broadcast_to(values, part.size) for values in part.parameters.values()]
    c = np.zeros((part.size, model.width))
    is_uniform = all(values.size == 1 for values in part.parameters.values())
    for i in range(1 if is_uniform else part.size):
        model.arithmetic.constants([float(values[i]) for values in parameters], program.resolution, c[i])
    if is_uniform:
        c[:] = c[0]
    row_of = model.arithmetic.constants.__globals__  # row of each constant by name
    table = np.zeros((rows.CONSTANTS, part.size))
    for row, name in ((rows.E_L, "E_L"), (rows.P33, "P33"), (rows.V_TH, "V_TH"), (rows.V_RESET, "V_RESET")):
        table[row] = c[:, row_of[name]]
    table[rows.REFRACTORY] = c[:, row_of["R"]]
    if model.name == "iaf_psc_delta":
        table[rows.V_MIN] = c[:, row_of["V_MIN"]]
    else:
        table[rows.P32], table[rows.P11] = c[:, row_of["P32_EX"]], c[:, row_of["P11_EX"]]
    start = {name: np.broadcast_to(values, part.size).astype(np.float64) for name, values in part.initial.items()}
    current = start.get("I_syn_ex", 0.0) + start.get("I_syn_in", 0.0) + np.zeros(part.size)
    return Cells(index, part.size, model.name, table, c[:, row_of["P30"]], c[:, row_of["I_E"]], start["V_m"], current)


def push(program: Program, part: Cells, steps: int) -> Floats:
    """Return the potential that currents add in each of the first steps, mV, (1 or steps, size)."""
    currents = Currents(program)
    if part.population not in currents.targets:
        return (part.per_pa * part.constant)[None]
    outside = np.array([currents.into(part.population, step) for step in range(1, steps + 1)])
    pushed: Floats = part.per_pa * (part.constant + outside)
    return pushed


def synapses(program: Program, index: int, by_synapse: bool = False) -> Synapses:
    """Return the synapses of a projection.

    Args:
        program: the network.
        index: index of the projection.
        by_synapse: whether to list the synapses one by one even if they are a matrix.
    """
    part = program.projections[index]
    sizes = program.populations[part.source].size, program.populations[part.target].size
    first, empty = int(part.delay.min()) if part.delay.size else 1, np.zeros(0, dtype=np.int64)
    ends = index, part.source, part.target, sizes, shape_of(part, sizes)
    if not by_synapse and part.layout == "dense" and np.all(part.delay == first):
        return Synapses(*ends, True, empty, empty.astype(np.int32), empty, np.array([first]), first)
    source, target, slot = program.synapses(index)
    slot = np.zeros(len(source), dtype=np.int64) if part.weight.size == 1 else np.asarray(slot, dtype=np.int64)
    row_ends = np.searchsorted(source, np.arange(sizes[0] + 1)).astype(np.int64)
    delay = np.broadcast_to(part.delay, len(source)).astype(np.int64)
    return Synapses(*ends, False, row_ends, target.astype(np.int32), slot, delay, first)


def delayed(part: Synapses, delay: NDArray[np.int64]) -> Synapses:
    """Return listed synapses with other delays in steps, one for all synapses or one per synapse."""
    delays = np.broadcast_to(delay, len(part.targets)).astype(np.int64)
    return replace(part, delay=delays, least=int(delays.min(initial=NEVER)))


def shape_of(part: Projection, sizes: tuple[int, int]) -> tuple[int, ...]:
    """Return the shape of the weights in `Module.weights`: (1,), rows by source, kernels by map, or one per synapse."""
    if part.weight.size == 1:
        return (1,)
    if part.grid is not None:
        return part.grid.kernels
    return sizes if part.layout == "dense" else (part.size,)


Path = tuple[Synapses, Tensor]
"""Synapses that deliver spikes, and their weights."""


def paths(part: Synapses, weight: Tensor, steps: Tensor, exact: bool) -> list[Path]:
    """Return the synapses with delays in steps that deliver the spikes of a projection whose delays learn.

    Args:
        part: the synapses, listed.
        weight: the weights in `Module.weights`.
        steps: delays in steps from `neuro_torch.trainable.in_steps`, one for all synapses or one per synapse.
        exact: whether a spike between two steps arrives in both, in shares by the distance to each, so that a gradient
            moves the delay; else it arrives in the nearest step. For example, 2.25 steps deliver 0.75 of the weight
            after 2 steps and 0.25 after 3 steps.
    """
    if not exact:
        return [(delayed(part, rounded(steps)), weight)]
    lower = steps.detach().floor()
    share_later = steps - lower
    # A shared weight is expanded to one per synapse, because shares differ.
    single = replace(part, slot=torch.arange(len(part.targets)).numpy())
    flat = weight.reshape(-1).expand(len(part.targets))
    earlier = lower.long().cpu().numpy()
    return [(delayed(single, earlier), flat * (1.0 - share_later)), (delayed(single, earlier + 1), flat * share_later)]


def rounded(steps: Tensor):  # type: ignore[no-untyped-def]
    """Return delays rounded to steps, as an array."""
    return steps.detach().round().long().cpu().numpy()


def component(part: Component, inside: list[Path]) -> Component:
    """Return a component with other synapses inside."""
    shortest = min((synapses.least for synapses, _ in inside), default=0)
    return replace(part, inside=tuple(synapses for synapses, _ in inside), stretch=shortest)


@dataclass(frozen=True, slots=True, eq=False)
class ScanTask:
    """Sizes, dtype and settings of one forward pass.

    Attributes:
        batch, steps: number of recordings, and of steps each.
        dtype, device: dtype and device of all numbers.
        surrogate: derivative of a spike.
        damping: factor of gradients each time they pass a synapse of a cycle.
        push: potential that currents add, by population, see `neuro_torch.scan.kernels`.
        potentials_of: populations whose potentials are returned.
    """

    batch: int
    steps: int
    dtype: torch.dtype
    device: torch.device
    surrogate: Surrogate
    damping: float
    push: Mapping[int, Floats]
    potentials_of: frozenset[int]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The scan or steps of each part of a network; `str` shows them.

    Attributes:
        parts: the components to scan, in order; empty if everything is stepped.
        by: "kernels" (compiled, on the CPU), "torch" (torch's operations, on any device) or "steps".
        why: the reasons for stepping.
    """

    program: Program
    parts: tuple[Component, ...]
    by: str
    why: tuple[str, ...]

    def __str__(self) -> str:
        if not self.parts:
            return "\n".join(["all populations: step by step, since", *(f"  {reason}" for reason in self.why)])
        means = {"kernels": "by compiled kernels", "torch": "by torch's operations"}[self.by]
        lines = []
        for part in self.parts:
            populations = [self.program.populations[k] for k in part.cells]
            names = ", ".join(f"'{population.name}'" for population in populations)
            scan = (
                f"a recurrent scan, {some(part.stretch, 'step')} at once" if part.inside else "one scan over all steps"
            )
            is_graded = any(population.model.graded for population in populations)
            lines.append(f"{names}: {'graded neurons step by step, their input' if is_graded else scan} {means}")
        return "\n".join(lines)


def plan_of(program: Program, by: str | None, learning: Iterable[str]) -> Plan:
    """Return the plan of a program.

    Args:
        program: the network.
        by: the user's choice, None for the fastest on a CPU.
        learning: populations with parameters that learn.
    """
    reasons = [*reasons_to_step(program), *(f"population '{name}': its parameters learn" for name in learning)]
    if by == "steps":
        reasons.append("by = 'steps'")
    parts = () if reasons else tuple(components(program))
    graded_in_cycles = [k for part in parts if part.inside for k in part.cells if program.populations[k].model.graded]
    reasons += [f"population '{program.populations[k].name}': graded neurons in a cycle" for k in graded_in_cycles]
    if reasons:
        return Plan(program, (), "steps", tuple(reasons))
    return Plan(program, parts, by or "kernels", ())
