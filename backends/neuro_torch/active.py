"""Updates of neurons that chips do in full: steps in which something arrives at a neuron, or in which it fires."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor

from neuro_torch.scan.compiled import Packed
from neuro_torch.scan.layers import Synapses
from neuro_torch.scan.task import Task

__all__ = ["active_updates"]


def active_updates(
    population: int, emitted: Mapping[int, Any], incoming: Iterable[Synapses], task: Task, scans: Any
) -> Tensor:
    """How many of a population in each recording, shape (batch,), as `neuro.Simulation.counts` has them.

    Args:
        population: the index.
        emitted: spikes of populations, dense or packed.
        incoming: the projections onto it.
        task: of the pass.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`, which took the spikes.
    """
    with torch.no_grad():
        heard = emitted[population] > 0
        for part in incoming:
            heard = heard | _arrived(part, emitted[part.source], task, scans)
        updates: Tensor = heard.sum((1, 2))
        return updates


def _arrived(part: Synapses, spikes: Any, task: Task, scans: Any) -> Tensor:
    """Where spikes arrive, (batch, steps, targets), or (batch, steps, 1) where every target hears every source."""
    if not part.dense or not isinstance(spikes, (Tensor, Packed)):
        ones = torch.ones(part.shape, dtype=task.dtype, device=task.device)
        arrived: Tensor = scans.drive(part, spikes, ones, task) > 0
        return arrived
    if isinstance(spikes, Tensor):
        some = (spikes > 0).any(2)
    else:
        some = torch.from_numpy(spikes.ends[1:] > spikes.ends[:-1]).reshape(task.batch, task.steps)
    heard = torch.zeros_like(some)
    heard[:, part.least :] = some[:, : task.steps - part.least]
    return heard[:, :, None]
