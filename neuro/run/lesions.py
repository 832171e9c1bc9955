"""Neurons that are silenced or activated: which synapses and which generators that concerns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.model.synapses import tsodyks2
from neuro.program.counts import fan_out
from neuro.program.program import Program
from neuro.run.handles import Neurons


def outgoing(program: Program, neurons: Neurons) -> list[int]:
    """The projections that have synapses from some neurons.

    Raises:
        ModelError: only some neurons share a kernel with the others, or weights learn and would grow again.
    """
    found = [k for k, part in enumerate(program.projections) if part.source == neurons.index and part.size]
    among = neurons.among()
    for part in (program.projections[k] for k in found):
        if part.grid is not None and not among.all():
            message = f"silence: {neurons.text}: '{part.name}' has one kernel for all neurons: expected all of them"
            raise ModelError(message, hint=f"sim.silence('{neurons.part.name}')")
    reached = [k for k in found if _reaches(program, k, among)]
    for part in (program.projections[k] for k in reached):
        if part.synapse.learns and not part.synapse.delays and not isinstance(part.synapse, tsodyks2):
            rule = part.synapse.name
            message = f"silence: {neurons.text}: '{part.name}' learns by {rule}, so its weights would grow again"
            hint = "sim.network() has what was learnt; silence it with static synapses"
            raise ModelError(f"{message}: expected weights that stay", hint=hint)
    return reached


def _reaches(program: Program, index: int, among: NDArray[np.bool_]) -> bool:
    """Whether a projection has synapses from some neurons."""
    part = program.projections[index]
    return part.layout != "csr" or bool(fan_out(program, index)[among].any())


def driver(program: Program, neurons: Neurons) -> Neurons:
    """The generators that drive some neurons one to one; of several the ones that are described without a rate.

    Raises:
        ModelError: there are none, or several between which nothing decides.
    """
    found = [
        part.source
        for part in program.projections
        if part.target == neurons.index
        and part.whole_layout == "one_to_one"
        and program.populations[part.source].kind == "poisson"
    ]
    if len(found) > 1:
        found = [index for index in found if not np.any(program.populations[index].parameters["rate"])] or found
    name = neurons.part.name
    if not found:
        message = f"activate: {neurons.text}: expected a poisson_generator that is connected to '{name}' one_to_one"
        raise ModelError(message, hint="net.wiring(..., drive=weight) adds one")
    if len(found) > 1:
        names = " and ".join(f"'{program.populations[index].name}'" for index in found)
        message = (
            f"activate: {neurons.text}: {names} are connected to '{name}' one_to_one: expected one with a rate of 0"
        )
        raise ModelError(message, hint=f"sim.set('{program.populations[found[0]].name}', rate=...) sets one of them")
    return Neurons(found[0], program.populations[found[0]], neurons.end)
