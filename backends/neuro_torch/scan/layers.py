"""What a scan needs: of a program cells with their constants, synapses in one of two layouts, and their order; a task.

A `Plan` says which part of a network runs by what: scans where they fit, else step by step.
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
"""Models that are scanned, beside graded ones without circles (`neuro_torch.cells`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """The neurons of a population.

    Attributes:
        population: its index.
        size: neurons.
        model: a name of `CELLS`.
        constants: see `neuro_torch.scan.kernels`, (constants, size).
        per_pa: mV that a current of 1 pA adds in a step, (size,).
        constant: pA that always flow, (size,).
        v, current: at step 0, (size,).
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
        projection, source, target: indices.
        sizes: neurons of source and target.
        shape: of the weights as a user sees them.
        dense: whether they are rows of weights with one delay; `row_ends`, `targets`, `slot` are empty then.
        row_ends, targets, slot, delay: synapses by source: the target of each, the place of its weight, its steps.
        least: the smallest delay.
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
    """Populations that are simulated together: one, or those of a cycle of connections.

    Attributes:
        cells: by population.
        outside: synapses from populations that are complete before, in the order of the program.
        inside: synapses among its own populations.
        stretch: steps a pass, at most the smallest delay inside the component; 0: all steps.
    """

    cells: dict[int, Cells]
    outside: tuple[Synapses, ...]
    inside: tuple[Synapses, ...]
    stretch: int


def unfit(program: Program) -> list[str]:
    """Why a program cannot be scanned, one sentence for each reason."""
    found = []
    for part in program.populations:
        if part.kind == "neuron":
            found += [f"population '{part.name}': {why}" for why in _unfit_cells(part)]
    if driven(program):
        names = ", ".join(f"'{program.populations[k].name}'" for k in driven(program))
        found.append(f"the current into {names} changes in every step")
    return found


def _unfit_cells(part: Population) -> list[str]:
    if part.model.graded:
        several = isinstance(part.model, Neuron) and part.model.receptors > 1
        return ["it has several receptors"] if several else []
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
    """The neurons of a program in parts, in an order in which all input of one is complete when it is scanned."""
    wired = [synapses(program, q) for q, part in enumerate(program.projections) if part.carries == "spikes"]
    neurons = [k for k, part in enumerate(program.populations) if part.kind == "neuron"]
    label = _circles(len(program.populations), wired)
    order = TopologicalSorter({int(label[k]): set[int]() for k in neurons})
    for each in wired:
        if label[each.source] != label[each.target] and each.source in neurons:
            order.add(int(label[each.target]), int(label[each.source]))
    return [_component(program, [k for k in neurons if label[k] == one], wired) for one in order.static_order()]


def _circles(n: int, wired: list[Synapses]) -> NDArray[np.int32]:
    """A number for each population, the same for those that reach each other."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pre, post = ([getattr(each, word) for each in wired] for word in ("source", "target"))
    graph = coo_array((np.ones(len(wired)), (pre, post)), shape=(n, n))
    labels: NDArray[np.int32] = connected_components(graph, directed=True, connection="strong")[1]
    return labels


def _component(program: Program, members: list[int], wired: list[Synapses]) -> Component:
    onto = [each for each in wired if each.target in members]
    inside = tuple(each for each in onto if each.source in members)
    outside = tuple(each for each in onto if each.source not in members)
    return Component(
        {k: cells(program, k) for k in members}, outside, inside, min((e.least for e in inside), default=0)
    )


def cells(program: Program, index: int) -> Cells:
    """The neurons of a population with the constants of their model."""
    part = program.populations[index]
    model: Any = part.model
    if model.graded:  # these are stepped by their model
        none = np.zeros(part.size)
        return Cells(index, part.size, model.name, np.zeros((rows.CONSTANTS, part.size)), none, none, none, none)
    parameters = [np.broadcast_to(values, part.size) for values in part.parameters.values()]
    each = np.zeros((part.size, model.width))
    alike = all(values.size == 1 for values in part.parameters.values())
    for i in range(1 if alike else part.size):
        model.arithmetic.constants([float(values[i]) for values in parameters], program.resolution, each[i])
    if alike:
        each[:] = each[0]
    at = model.arithmetic.constants.__globals__  # the rows of the constants by name
    table = np.zeros((rows.CONSTANTS, part.size))
    for row, name in ((rows.E_L, "E_L"), (rows.P33, "P33"), (rows.V_TH, "V_TH"), (rows.V_RESET, "V_RESET")):
        table[row] = each[:, at[name]]
    table[rows.REFRACTORY] = each[:, at["R"]]
    if model.name == "iaf_psc_delta":
        table[rows.V_MIN] = each[:, at["V_MIN"]]
    else:
        table[rows.P32], table[rows.P11] = each[:, at["P32_EX"]], each[:, at["P11_EX"]]
    start = {name: np.broadcast_to(values, part.size).astype(np.float64) for name, values in part.initial.items()}
    current = start.get("I_syn_ex", 0.0) + start.get("I_syn_in", 0.0) + np.zeros(part.size)
    return Cells(index, part.size, model.name, table, each[:, at["P30"]], each[:, at["I_E"]], start["V_m"], current)


def push(program: Program, part: Cells, steps: int) -> Floats:
    """What currents add to V in each of the first steps, mV, (1 or steps, size)."""
    currents = Currents(program)
    if part.population not in currents.targets:
        return (part.per_pa * part.constant)[None]
    outside = np.array([currents.into(part.population, step) for step in range(1, steps + 1)])
    pushed: Floats = part.per_pa * (part.constant + outside)
    return pushed


def synapses(program: Program, index: int, listed: bool = False) -> Synapses:
    """The synapses of a projection, where asked one by one also if they are rows."""
    part = program.projections[index]
    sizes = program.populations[part.source].size, program.populations[part.target].size
    first, nothing = int(part.delay.min()) if part.delay.size else 1, np.zeros(0, dtype=np.int64)
    ends = index, part.source, part.target, sizes, shape_of(part, sizes)
    if not listed and part.layout == "dense" and np.all(part.delay == first):
        return Synapses(*ends, True, nothing, nothing.astype(np.int32), nothing, np.array([first]), first)
    source, target, slot = program.synapses(index)
    slot = np.zeros(len(source), dtype=np.int64) if part.weight.size == 1 else np.asarray(slot, dtype=np.int64)
    row_ends = np.searchsorted(source, np.arange(sizes[0] + 1)).astype(np.int64)
    delay = np.broadcast_to(part.delay, len(source)).astype(np.int64)
    return Synapses(*ends, False, row_ends, target.astype(np.int32), slot, delay, first)


def delayed(part: Synapses, delay: NDArray[np.int64]) -> Synapses:
    """Listed synapses with other delays in steps, one or one of each."""
    each = np.broadcast_to(delay, len(part.targets)).astype(np.int64)
    return replace(part, delay=each, least=int(each.min(initial=NEVER)))


def shape_of(part: Projection, sizes: tuple[int, int]) -> tuple[int, ...]:
    """How weights are laid out for users: as one number, rows by source, kernels by map, or one for each synapse."""
    if part.weight.size == 1:
        return (1,)
    if part.grid is not None:
        return part.grid.kernels
    return sizes if part.layout == "dense" else (part.size,)


Way = tuple[Synapses, Tensor]
"""Synapses that a spike goes along, and their weights."""


def ways(part: Synapses, weight: Tensor, steps: Tensor, exact: bool) -> list[Way]:
    """The ways of spikes along a projection.

    Args:
        part: its synapses, listed.
        weight: as a user sees it.
        steps: the delay, of all or of each, of `neuro_torch.trainable.in_steps`.
        exact: whether a spike arrives in the two steps between which the delay lies, in shares that say how near it is
            to each, so that a gradient moves it; else it arrives in the nearest step.
    """
    if not exact:
        return [(delayed(part, rounded(steps)), weight)]
    whole = steps.detach().floor()
    late = steps - whole
    # One weight of all synapses becomes one of each, since their delays differ.
    each = replace(part, slot=torch.arange(len(part.targets)).numpy())
    flat = weight.reshape(-1).expand(len(part.targets))
    earlier = whole.long().cpu().numpy()
    return [(delayed(each, earlier), flat * (1.0 - late)), (delayed(each, earlier + 1), flat * late)]


def rounded(steps: Tensor):  # type: ignore[no-untyped-def]
    """The nearest whole steps, as an array."""
    return steps.detach().round().long().cpu().numpy()


def component(part: Component, inside: list[Way]) -> Component:
    """A component with these synapses among its own populations."""
    least = min((synapses.least for synapses, _ in inside), default=0)
    return replace(part, inside=tuple(synapses for synapses, _ in inside), stretch=least)


@dataclass(frozen=True, slots=True, eq=False)
class ScanTask:
    """What one forward pass is about.

    Attributes:
        batch, steps: of it.
        dtype, device: of all numbers.
        surrogate: stands in for the derivative of a spike.
        damping: of gradients each time they go along a synapse of a circle.
        push: what currents add, by population, see `neuro_torch.scan.kernels`.
        wanted: populations whose potentials are asked for.
    """

    batch: int
    steps: int
    dtype: torch.dtype
    device: torch.device
    surrogate: Surrogate
    damping: float
    push: Mapping[int, Floats]
    wanted: frozenset[int]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """How a network runs; `str` shows it.

    Attributes:
        parts: what is scanned, in order; none where everything is stepped.
        by: "kernels" (compiled, on the CPU), "torch" (torch's operations, on any device) or "steps".
        why: the reasons for steps.
    """

    program: Program
    parts: tuple[Component, ...]
    by: str
    why: tuple[str, ...]

    def __str__(self) -> str:
        if not self.parts:
            return "\n".join(["all populations: step by step, since", *(f"  {why}" for why in self.why)])
        how = {"kernels": "by compiled kernels", "torch": "by torch's operations"}[self.by]
        lines = []
        for part in self.parts:
            populations = [self.program.populations[k] for k in part.cells]
            names = ", ".join(f"'{each.name}'" for each in populations)
            scan = (
                f"a recurrent scan, {some(part.stretch, 'step')} at once" if part.inside else "one scan over all steps"
            )
            is_graded = any(each.model.graded for each in populations)
            lines.append(f"{names}: {'graded neurons step by step, their input' if is_graded else scan} {how}")
        return "\n".join(lines)


def plan_of(program: Program, by: str | None, learning: Iterable[str]) -> Plan:
    """How a program runs.

    Args:
        program: the network.
        by: what is asked for, None for what is fastest on a CPU.
        learning: populations with parameters that learn.
    """
    why = [*unfit(program), *(f"population '{name}': its parameters learn" for name in learning)]
    if by == "steps":
        why.append("it is asked for")
    parts = () if why else tuple(components(program))
    circles = [k for each in parts if each.inside for k in each.cells if program.populations[k].model.graded]
    why += [f"population '{program.populations[k].name}': graded neurons in a circle" for k in circles]
    if why:
        return Plan(program, (), "steps", tuple(why))
    return Plan(program, parts, by or "kernels", ())
