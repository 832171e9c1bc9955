"""A batch through a network step by step, where no scan fits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

from neuro_torch.scan.joined import joined
from neuro_torch.scan.task import Task
from neuro_torch.stepping import Stepper

Named = Mapping[str, Tensor]


class Tensors(NamedTuple):
    """What learns: weights and delays (ms) by projection, parameters by population and word."""

    weights: Named
    delays: Named
    parameters: Mapping[str, Named]


def stepped(
    stepper: Stepper, task: Task, learning: Tensors, given: Named
) -> tuple[dict[int, Tensor], dict[int, Tensor]]:
    """Spikes of all populations that emit some, and potentials of those that are wanted, (batch, steps, neurons).

    Args:
        stepper: of the network.
        task: what the pass is about.
        learning: what learns.
        given: the spikes that inputs are given, (batch, steps, neurons).
    """
    program = stepper.program
    stepper.begin(
        batch=task.batch,
        weights={name: values.double().reshape(-1) for name, values in learning.weights.items()},
        delays={name: values.double().reshape(-1) for name, values in learning.delays.items()},
        parameters={name: {word: v.double() for word, v in each.items()} for name, each in learning.parameters.items()},
    )
    names = [part.name for part in program.populations]
    with_v = [k for k in task.wanted if "V_m" in [s.name for s in program.populations[k].model.states]]
    inputs = {name: tensor.double() for name, tensor in given.items()}
    spikes: dict[int, list[Tensor]] = {}
    potentials: dict[int, list[Tensor]] = {k: [] for k in with_v}
    for t in range(task.steps):
        for name, emitted in stepper.step({name: tensor[:, t] for name, tensor in inputs.items()}).items():
            spikes.setdefault(names.index(name), []).append(emitted)
        for k in with_v:
            potentials[k].append(stepper.state(names[k], "V_m"))
    neurons = [each for words in learning.parameters.values() for each in words.values()]
    learns = [*learning.weights.values(), *learning.delays.values(), *neurons]
    return _stacked(spikes, task, learns), _stacked(potentials, task, learns)


def _stacked(found: Mapping[int, list[Any]], task: Task, learns: list[Tensor]) -> dict[int, Tensor]:
    return {k: joined(torch.stack(each, 1).to(task.dtype), learns) for k, each in found.items()}
