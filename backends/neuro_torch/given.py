"""Tensors that stand for numbers of a program: whether they fit it, and delays between two steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from neuro.core.errors import ModelError, unknown
from neuro.program.program import Program
from neuro_torch.bounds import check_parameters, in_steps
from neuro_torch.wires import Wires

Tensors = Mapping[str, Tensor]


def check(program: Program, weights: Tensors, delays: Tensors, parameters: Mapping[str, Tensors]) -> None:
    """Refuse tensors for what is not there, of another shape, or parameters out of their bounds.

    Raises:
        ModelError: it says which.
    """
    projections = {part.name: part for part in program.projections if part.carries == "spikes"}
    for word, tensors in (("weights", weights), ("delays", delays)):
        for name, values in tensors.items():
            if name not in projections:
                raise unknown("projection of spikes", name, projections)
            _check_shape(f"{word} of '{name}'", values, projections[name].size)
    for name in delays:
        if projections[name].grid is not None or program.populations[projections[name].target].model.name == _RELAY:
            what = "shares its weights" if projections[name].grid is not None else "ends at parrots"
            raise ModelError(f"delays of '{name}' cannot be learnt: it {what}", hint="learn its weights")
    neurons = {part.name: part for part in program.populations if part.kind == "neuron"}
    for name, words in parameters.items():
        if name not in neurons:
            raise unknown("population of neurons", name, neurons)
        for word, values in words.items():
            if word not in neurons[name].parameters:
                raise unknown(f"parameter of '{name}'", word, neurons[name].parameters)
            _check_shape(f"{word} of '{name}'", values, neurons[name].size)
        check_parameters(neurons[name], words)


_RELAY = "parrot_neuron"


def _check_shape(what: str, values: Tensor, size: int) -> None:
    if values.shape not in ((1,), (size,)) or values.dtype is not torch.float64:
        found = f"{tuple(values.shape)} of {values.dtype}"
        raise ModelError(f"{what}: found {found}: expected (1,) or ({size},) of torch.float64")


def between_steps(
    program: Program, index: int, device: torch.device, delays: Tensor, weights: Tensor
) -> list[tuple[Wires, Tensor]]:
    """A projection whose delays lie between two steps: wires for the later and for the earlier, with their weights.

    A spike arrives in both, in shares that say how near the delay is to each, so that a gradient moves it.

    Args:
        program: the network.
        index: which projection.
        device: where its arrays are.
        delays: in ms, of all synapses or of each.
        weights: likewise.

    Raises:
        ModelError: a delay is NaN, or longer than any may be.
    """
    steps = in_steps(delays, program.resolution, program.projections[index].name)
    whole = steps.detach().floor()
    late = steps - whole
    earlier = whole.cpu().numpy().astype(np.int64)
    shares = ((earlier + 1, weights * late), (earlier, weights * (1.0 - late)))
    return [(Wires(program, index, device, delay), share) for delay, share in shares]
