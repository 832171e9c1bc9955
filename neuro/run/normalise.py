"""Weights whose sum onto each neuron is held, as by a neuron with a limited resource."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from neuro.coding.arguments import finite
from neuro.core.errors import ModelError
from neuro.model.parts import Projection
from neuro.run.simulation import Simulation


def normalise(sim: Simulation, projection: Projection | str, total: ArrayLike) -> None:
    """Scale the weights onto each post neuron so that they have a given sum; call it now and then while it learns.

    The weights are those that `sim.weights` shows: of `stdp` and its like those sent last, so what post spikes have
    added to a weight since is left out.

    Args:
        sim: the simulation.
        projection: the projection or its name; of a grid the weights of each map are scaled.
        total: the sum, in the unit of the weights: a number, or one for each post neuron (of a grid: map).

    Raises:
        ModelError: there is no such projection, the weights onto a neuron cannot be scaled to the sum, or a weight
            would pass the bounds of its rule. No weight is changed then.

    Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015; von der Malsburg, Kybernetik 14:85, 1973.
    """
    found = sim.weights(projection)
    part = sim.program.projections[sim.handles.projection(projection)]
    shared = not isinstance(found, tuple)
    weights = found.reshape(-1) if shared else found[2]
    onto = np.repeat(np.arange(len(found)), found[0].size) if shared else found[1]
    sums = np.bincount(onto, weights)
    wanted = finite(total, "total")
    size = len(found) if shared else sim.program.populations[part.target].size
    if wanted.shape not in ((), (size,)):
        raise ModelError(f"total has the shape {list(wanted.shape)}, expected a number or [{size}]", path=("total",))
    wanted = np.broadcast_to(wanted, size)[: sums.size]
    reached = np.bincount(onto, minlength=sums.size) > 0
    bad = np.flatnonzero(reached & (sums * wanted <= 0.0))
    if bad.size:
        what = "map" if shared else "neuron"
        raise ModelError(
            f"normalise: the weights of '{part.name}' onto {what} {bad[0]} have the sum {sums[bad[0]]:g}: "
            f"expected a sum that can be scaled to {wanted[bad[0]]:g}, of its sign and not 0"
        )
    scale = np.divide(wanted, sums, out=np.ones(sums.size), where=reached)
    sim.set_weights(projection, (weights * scale[onto]).reshape(found.shape if shared else -1))
