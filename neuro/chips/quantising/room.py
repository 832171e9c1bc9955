"""How much of its input register each population takes: exact sums of words, for spikes that are given."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from neuro.chips.arithmetics import arithmetic_of
from neuro.chips.quantising.fixed import FixedProjection
from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.program.program import Floats

Spikes = Mapping[str, npt.NDArray[np.floating]]


def filled(fixed: FixedProgram, spikes: Spikes) -> dict[str, float]:
    """The largest share of its registers that the input of a population takes, in any neuron and step.

    1 or more wraps. Weights count as they are now, and delays as they are now.

    Args:
        fixed: a quantised program.
        spikes: by population how many each neuron emits in each step, (recordings, steps, neurons); none of those that
            are left out.

    Returns:
        By population that spikes reach; empty on chips whose arithmetic does not say (`Arithmetic.filled`).
    """
    program, share = fixed.program, arithmetic_of(fixed.chip).filled
    found = {}
    for target, cells in enumerate(fixed.populations):
        onto = [k for k, part in enumerate(program.projections) if part.target == target]
        sums = [_sums(fixed, k, wires, spikes) for k in onto if (wires := fixed.projections[k]) is not None]
        arriving = [one for one in sums if one is not None]
        if share is not None and arriving:
            found[cells.name] = share(cells, np.sum(arriving, axis=0))
    return found


def _sums(fixed: FixedProgram, index: int, wires: FixedProjection, spikes: Spikes) -> Floats | None:
    """What a projection brings in each step, (recordings, steps, neurons) in words; None without spikes."""
    from scipy.sparse import csr_array

    program = fixed.program
    part = program.projections[index]
    source, target = program.populations[part.source], program.populations[part.target]
    emitted = spikes.get(source.name)
    if emitted is None or not part.size:
        return None
    batch, steps, _ = emitted.shape
    pre, post, place = program.synapses(index)
    words = np.broadcast_to(wires.words, max(wires.words.size, int(place.max()) + 1))[place].astype(np.float64)
    lags = np.broadcast_to(wires.lag, max(wires.lag.size, int(place.max()) + 1))[place]
    rows = csr_array(emitted.reshape(batch * steps, -1).astype(np.float64))
    found = np.zeros((batch, steps, target.size))
    for lag in np.unique(lags):
        here = lags == lag
        table = csr_array((words[here], (pre[here], post[here])), shape=(source.size, target.size))
        dense = table.nnz > source.size * target.size // 8
        brought = rows @ (table.toarray() if dense else table)
        brought = (brought if dense else brought.toarray()).reshape(batch, steps, -1)
        found[:, lag:] += brought[:, : steps - lag]
    return found
