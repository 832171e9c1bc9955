"""The effective delay of a spike on a chip: one rule for delay registers, their memory, and refused delays.

Input of most neurons acts in the step in which it arrives: a spike over a delay of D steps acts after D. NEST's
synaptic currents (`I_syn_ex`, `I_syn_in`) move the potential a step after they arrive, so there it acts after D + 1. A
chip's current acts at once, so its spike must be that much later. How the delay register counts is a family's own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.model.neurons import Model, cuba_lif
from neuro.program.program import Program


def acts_late(model: Model) -> bool:
    """Whether input moves the potential only in the step after its arrival."""
    return any(state.name.startswith("I_syn") for state in model.states) and not isinstance(model, cuba_lif)


def lag(program: Program, index: int) -> NDArray[np.int32]:
    """Steps from the emission of a spike of a projection to the update of its target that sees it.

    Args:
        program: has the projection.
        index: of the projection.

    Returns:
        shape (1,) where the projection has one delay and keeps it, else one per synapse.
    """
    part = program.projections[index]
    late = acts_late(program.populations[part.target].model)
    delay = np.broadcast_to(part.delay, part.size) if part.synapse.delays else part.delay
    return np.add(delay, late, dtype=np.int32)


def longest_lag(program: Program, index: int) -> NDArray[np.int32]:
    """The longest lag of a projection, now or when its delays have learnt, shape (1,), or none without synapses."""
    part = program.projections[index]
    late = acts_late(program.populations[part.target].model)
    if part.synapse.delays:
        _, most = part.delay_range(program.resolution)
        return np.array([most + late], dtype=np.int32)
    return (
        np.add(part.delay.max(keepdims=True), late, dtype=np.int32) if part.delay.size else part.delay.astype(np.int32)
    )


def register(lag: NDArray[np.int32], of_one: int) -> NDArray[np.int32]:
    """What a delay register holds for some lags; `of_one` is what it holds for a lag of one step."""
    return lag + np.int32(of_one - 1)
