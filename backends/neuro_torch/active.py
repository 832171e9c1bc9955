"""Updates of neurons that chips do in full: steps in which something arrives at a neuron, or in which it fires."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor

from neuro_torch.scan import compiled
from neuro_torch.scan.layers import Synapses

__all__ = ["active_updates"]


def active_updates(
    population: int, emitted: Mapping[int, Any], incoming: Iterable[Synapses], task: compiled.Task
) -> Tensor:
    """How many of a population in each recording, shape (batch,), as `neuro.Simulation.counts` has them.

    Args:
        population: the index.
        emitted: spikes of populations, dense or packed.
        incoming: the projections onto it.
        task: of the pass.
    """
    with torch.no_grad():
        heard = emitted[population] > 0
        for part in incoming:
            heard = heard | _arrived(part, emitted[part.source], task)
        updates: Tensor = heard.sum((1, 2))
        return updates


def _arrived(part: Synapses, spikes: Any, task: compiled.Task) -> Tensor:
    """Where spikes arrive, (batch, steps, targets), or (batch, steps, 1) where every target hears every source."""
    if not part.dense:
        return compiled.drive(part, spikes, torch.ones(part.shape, dtype=task.dtype), task) > 0
    listed = compiled.packed(spikes) if isinstance(spikes, Tensor) else spikes
    some = torch.from_numpy(listed.ends[1:] > listed.ends[:-1]).reshape(task.batch, task.steps)
    heard = torch.zeros_like(some)
    heard[:, part.least :] = some[:, : task.steps - part.least]
    return heard[:, :, None]
