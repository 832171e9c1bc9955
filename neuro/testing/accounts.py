"""The counts that all backends share, counted anew from recorded spikes and connections."""

from __future__ import annotations

import numpy as np

from neuro.model.neurons import Neuron, dc_generator
from neuro.program.program import Grid, Ints, Projection
from neuro.run.simulation import Simulation
from neuro.testing.case import Found


def expected_counts(sim: Simulation) -> Found:
    """What `counted` must be by the definitions: every spike is followed along every synapse.

    The spikes of all populations must be recorded, and there must be no trials.
    """
    program = sim.program
    now = round(sim.time / program.resolution)
    spikes = {p.name: _steps(sim, p.name, p.size) for p in program.populations}
    active = {p.name: np.zeros((p.size, now + 1), dtype=bool) for p in program.populations}
    found: Found = {"steps": np.array(now)}
    for index, part in enumerate(program.projections):
        source, target = program.populations[part.source].name, program.populations[part.target].name
        pre, post, delay = _synapses(sim, index)
        operations = updates = 0
        for i, j, d in zip(pre, post, delay, strict=True):
            operations += spikes[source][i].size
            arrivals = spikes[source][i] + d
            active[target][j, arrivals[arrivals <= now]] = True
            if part.synapse.learns:
                updates += np.unique(spikes[source][i]).size + np.unique(spikes[target][j]).size
        found[f"counts of {part.name}"] = np.array([operations, updates])
    for p in program.populations:
        for i, steps in enumerate(spikes[p.name]):
            active[p.name][i, steps] = True
        total = sum(steps.size for steps in spikes[p.name])
        computes = isinstance(p.model, Neuron)
        found[f"counts of {p.name}"] = np.array([total, computes * p.size * now, computes * active[p.name].sum()])
    return found


def _steps(sim: Simulation, name: str, size: int) -> list[Ints]:
    """The steps of the spikes of each neuron; several in one step are listed as often."""
    if isinstance(next(p for p in sim.program.populations if p.name == name).model, dc_generator):
        return [np.zeros(0, dtype=np.int64)] * size
    times, ids = sim.spikes(name)
    steps = np.rint(times / sim.program.resolution).astype(np.int64)
    return [steps[ids == i] for i in range(size)]


def _synapses(sim: Simulation, index: int) -> tuple[Ints, Ints, Ints]:
    """Source, target and delay of every synapse; of a grid, of every place of a kernel."""
    part: Projection = sim.program.projections[index]
    pre, post = sim.program.connections(index) if part.grid is None else _under_kernels(part.grid)
    return pre, post, np.broadcast_to(part.delay, pre.size).astype(np.int64)


def _under_kernels(g: Grid) -> tuple[Ints, Ints]:
    """Source and target of every place of every kernel that lies on the source."""
    maps, depth, height, width = g.kernels
    m, r, c, k, i, j = np.indices((maps, g.rows, g.columns, depth, height, width)).reshape(6, -1)
    y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
    inside = (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
    if g.depthwise:
        k = m * g.channels // g.maps
    return ((k * g.height + y) * g.width + x)[inside], ((m * g.rows + r) * g.columns + c)[inside]
