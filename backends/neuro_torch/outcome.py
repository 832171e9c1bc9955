"""The result of a batch: spikes, potentials and counts, as tensors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from neuro.core.errors import unknown
from neuro_torch.scan.compiled import Packed
from neuro_torch.scan.layers import ScanTask, Synapses

if TYPE_CHECKING:
    from torch import Tensor

    from neuro.program.program import Program

__all__ = ["Outcome", "active_updates"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a batch.

    Index 0 of an axis of steps is the first step of the run.

    Attributes:
        spikes: spikes of each output population, 0 or 1, or payloads of graded neurons, (batch, steps, neurons); the
            surrogate gives their gradient.
        V_m: potentials of each output population at the end of each step, after a reset, as NEST records them, mV.
        counts: number of spikes or messages of each neuron, by population, inputs included, (batch, neurons). Counts of
            neurons have gradients.
        active: number of updates with an arrival or a spike, by population of neurons, (batch,).
        steps: number of steps of each recording.
        step: length of a step in ms.
        program: the network of the outcome.
    """

    spikes: Mapping[str, Tensor]
    V_m: Mapping[str, Tensor]
    counts: Mapping[str, Tensor]
    active: Mapping[str, Tensor]
    steps: int
    step: float
    program: Program

    @cached_property
    def batch(self) -> int:
        """Number of recordings."""
        return len(next(iter(self.spikes.values())))


class LazyMapping(Mapping[str, Any]):
    """Values by population that are computed on first access.

    Args:
        kind: noun for a key in messages, such as "population".
        makers: function by name that computes each value.
    """

    def __init__(self, kind: str, makers: Mapping[str, Any]) -> None:
        self._kind, self._makers, self._values = kind, makers, dict[str, Any]()

    def __getitem__(self, name: str) -> Any:
        if name not in self._makers:
            raise unknown(self._kind, name, self._makers)
        if name not in self._values:
            self._values[name] = self._makers[name]()
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        return name in self._makers

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)

    def __repr__(self) -> str:
        return f"{self._kind}: {', '.join(self._makers)}"


def active_updates(
    population: int, emitted: Mapping[int, Any], incoming: Iterable[Synapses], task: ScanTask, scans: Any
) -> Tensor:
    """Return the number of active updates of a population in each recording, shape (batch,).

    An update is active if a spike arrives or the neuron fires, as in `neuro.Simulation.counts`.

    Args:
        population: index of the population.
        emitted: spikes by population, dense or packed.
        incoming: the projections onto the population.
        task: sizes, dtype and device of the pass.
        scans: `neuro_torch.scan.compiled` or `neuro_torch.scan.operations`, whose format `emitted` has.
    """
    with torch.no_grad():
        is_active = emitted[population] > 0
        for part in incoming:
            is_active = is_active | _arrived(part, emitted[part.source], task, scans)
        updates: Tensor = is_active.sum((1, 2))
        return updates


def _arrived(part: Synapses, spikes: Any, task: ScanTask, scans: Any) -> Tensor:
    """Return where spikes arrive, (batch, steps, targets), or (batch, steps, 1) if all targets receive every source."""
    if not part.dense or not isinstance(spikes, (Tensor, Packed)):
        ones = torch.ones(part.shape, dtype=task.dtype, device=task.device)
        arrived: Tensor = scans.drive(part, spikes, ones, task) > 0
        return arrived
    if isinstance(spikes, Tensor):
        has_spike = (spikes > 0).any(2)
    else:
        has_spike = torch.from_numpy(spikes.ends[1:] > spikes.ends[:-1]).reshape(task.batch, task.steps)
    steps_with_arrival = torch.zeros_like(has_spike)
    steps_with_arrival[:, part.least :] = has_spike[:, : task.steps - part.least]
    return steps_with_arrival[:, :, None]
