"""Energy of a recording on a chip, in joules, as a differentiable tensor: a regulariser or a bill.

The energy is that of `neuro.chips.price` without the ranges, the sum of three terms:

- spikes x (fan-out x energy of a synaptic operation + energy of the hops between cores),
- updates of neurons,
- static power x run time of the chip, which its busiest core determines.

Where only a ceiling is published, as for every operation of Loihi 2, the ceiling is used. A graded message counts as
one spike.

All terms but the busiest core's are linear in the spikes, so the energy of a batch is computed from the mean recording.
Spikes have the gradient of the surrogate. Updates that are active only because input arrives have no gradient.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch
from torch import Tensor

from neuro.chips.description import Chip
from neuro.chips.energy import STATIC
from neuro.chips.known import chip as chip_of
from neuro.chips.placing import Placement, place
from neuro.chips.pricing import BARRIERS, barrier, check_costs, check_fits
from neuro.core.errors import ModelError
from neuro.program.counts import fan_out
from neuro.program.program import Floats, Program

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Bill"]

_HOPS = {"spike_in_tile": "local", "hop_east_west": "east_west", "hop_north_south": "north_south", "packet": "chip"}


class Counted(Protocol):
    """The part of `neuro_torch.Outcome` that a bill reads: spikes (batch, neurons) and active updates (batch,)."""

    @property
    def counts(self) -> Mapping[str, Tensor]: ...
    @property
    def active(self) -> Mapping[str, Tensor]: ...
    @property
    def steps(self) -> int: ...


class Compiled(Protocol):
    """The part of `neuro_torch.Module` that a bill reads."""

    @property
    def program(self) -> Program: ...


class Bill:
    """Energy of a recording on a chip; calling it with an outcome returns joules.

    A bill belongs to one set of synapses; weights may differ. After `neuro_torch.prune`, make a new one from the
    pruned module.

    Args:
        module: the network, a `neuro_torch.Module`.
        chip: name of a chip or processor with published costs, or a table file.
        neurons_per_core: limit of neurons per core, if lower than the chip's; the busiest core then has less work.

    Attributes:
        chip: the target.
        placement: cores of the neurons; None if the target has no cores.

    Raises:
        ModelError: the target is unknown, has no costs, or prices dense layers; or the network does not fit on it.
    """

    def __init__(
        self, module: Compiled, chip: str | PathLike[str] = "loihi", *, neurons_per_core: int | None = None
    ) -> None:
        self.chip, self.program = chip_of(chip), module.program
        self._last_checked = self.program
        check_costs(self.chip)
        if "mac" in self.chip.costs:
            problem = f"target '{self.chip.name}' prices every synapse in every step"
            raise ModelError(f"{problem}: expected a target that prices spikes", hint="loihi, spinnaker, truenorth")
        self.placement: Placement | None = None
        if self.chip.mesh is not None:
            self.placement = place(self.program, self.chip, neurons_per_core=neurons_per_core)
            check_fits(self.program, self.placement, self.chip)
        parts = enumerate(self.program.populations)
        self._spike = {part.name: torch.from_numpy(self._joules_per_spike(index)) for index, part in parts}
        self._time = _Time(self.program, self.chip, self.placement)
        self._watts = self._cost(STATIC) * (1 if self.placement is None else self.placement.chips_used)

    def __call__(self, outcome: Counted) -> Tensor:
        """Return joules per recording, the mean of the batch, if the chip runs as fast as it can.

        Raises:
            ModelError: the outcome is of a network with other synapses. The other methods raise the same error.
        """
        return self.dynamic(outcome) + self.static(outcome)

    def real_time(self, outcome: Counted) -> Tensor:
        """Return joules per recording in real time: a chip that finishes early waits for the end of the recording."""
        duration = outcome.steps * self.program.resolution * 1e-3
        return self.dynamic(outcome) + self._time(outcome).clamp(min=duration) * self._watts

    def dynamic(self, outcome: Counted) -> Tensor:
        """Return joules of the operations."""
        self._check(outcome)
        total = self._updates(outcome)
        for name, joules in self._spike.items():
            total = total + (_mean(outcome.counts[name]) * joules.to(outcome.counts[name].device)).sum()
        return total

    def static(self, outcome: Counted) -> Tensor:
        """Return joules of the static power; 0 if no figure is published."""
        self._check(outcome)
        return self._time(outcome) * self._watts

    def seconds(self, outcome: Counted) -> Tensor:
        """Return the run time of the chip per recording, s; 0 if no figure is published."""
        self._check(outcome)
        return self._time(outcome)

    def _check(self, outcome: Counted) -> None:
        """Refuse the outcome of a network with other synapses."""
        program = getattr(outcome, "program", self._last_checked)
        if not _same_wiring(program, self._last_checked):
            n_synapses, expected = (sum(part.size for part in net.projections) for net in (program, self.program))
            raise ModelError(
                f"Bill: the outcome is of a network of {n_synapses:,} synapses: expected that of the bill, which has "
                f"{expected:,}",
                hint="neuro_torch.Bill(module) of the module that made the outcome",
            )
        self._last_checked = program

    def _cost(self, operation: str) -> float:
        figure = self.chip.costs.get(operation)
        return 0.0 if figure is None else figure.value or figure.high or 0.0

    def _joules_per_spike(self, population: int) -> Floats:
        """Return joules per spike of each neuron of a population."""
        program = self.program
        joules = np.zeros(program.populations[population].size)
        outgoing = [index for index, part in enumerate(program.projections) if part.source == population]
        if outgoing:
            joules += self._cost("packet")
        for index in outgoing:
            joules += fan_out(program, index) * self._cost("synaptic_op")
            if self.placement is not None:
                hops = self.placement.hops(index)
                joules += sum(self._cost(operation) * getattr(hops, kind) for operation, kind in _HOPS.items())
        return joules

    def _updates(self, outcome: Counted) -> Tensor:
        """Return joules of the updates of neurons."""
        active, inactive = (self._cost(f"neuron_update_{suffix}") for suffix in ("active", "inactive"))
        neurons = [part for part in self.program.populations if part.kind == "neuron"]
        total = torch.tensor(inactive * outcome.steps * sum(part.size for part in neurons), dtype=torch.float64)
        for part in neurons:
            n_active = _mean(outcome.active[part.name])
            total = total.to(n_active.device) + n_active * (active - inactive)
        return total


class _Time:
    """Run time of a recording on the chip: steps x the barrier of a step + the work of the busiest core."""

    def __init__(self, program: Program, chip: Chip, placement: Placement | None) -> None:
        self._program, self._step_seconds, self._has_cores = program, 0.0, False
        if chip.step_s is not None:
            self._step_seconds = chip.step_s.value
        elif placement is not None and all(name in chip.costs for name in BARRIERS):
            self._step_seconds = barrier(placement, chip, {"chips": float(placement.chips_used)})
            self._has_cores = True
            sizes = [part.size for part in program.populations]
            share = np.zeros((len(placement.cores), len(sizes)))
            for row, core in zip(share, placement.cores, strict=True):
                for population, first, last in core.parts:
                    row[population] += (last - first) / sizes[population]
            self._share = torch.from_numpy(share)
            figures = (chip.costs.get(f"{operation}_time") for operation in ("synaptic_op", *_UPDATES))
            self._op, self._active, self._inactive = (0.0 if figure is None else figure.value for figure in figures)
            self._fans = [torch.from_numpy(fan_out(program, i)).double() for i in range(len(program.projections))]

    def __call__(self, outcome: Counted) -> Tensor:
        """Return seconds per mean recording."""
        first_counts = _mean(next(iter(outcome.counts.values())))
        if not self._has_cores:
            return first_counts.new_tensor(outcome.steps * self._step_seconds)
        work = [first_counts.new_zeros(()) for _ in self._program.populations]
        for index, part in enumerate(self._program.populations):
            if part.kind == "neuron":
                active = _mean(outcome.active[part.name])
                inactive = part.size * outcome.steps - active
                work[index] = active * self._active + inactive * self._inactive
        for projection, fans in zip(self._program.projections, self._fans, strict=True):
            counts = _mean(outcome.counts[self._program.populations[projection.source].name])
            work[projection.target] = work[projection.target] + (counts * fans.to(counts.device)).sum() * self._op
        return outcome.steps * self._step_seconds + (self._share.to(first_counts.device) @ torch.stack(work)).amax()


_UPDATES = ("neuron_update_active", "neuron_update_inactive")


def _same_wiring(first: Program, second: Program) -> bool:
    """Return whether two networks have the same neurons and synapses; weights may differ."""
    if first is second:
        return True
    neurons = [[(part.name, part.size) for part in network.populations] for network in (first, second)]
    synapses = [[(part.name, part.size) for part in network.projections] for network in (first, second)]
    return (
        neurons[0] == neurons[1]
        and synapses[0] == synapses[1]
        and all(
            np.array_equal(ours, theirs)
            for index in range(len(first.projections))
            for ours, theirs in zip(first.connections(index), second.connections(index), strict=True)
        )
    )


def _mean(counts: Tensor) -> Tensor:
    """Return the mean of a batch in double precision, since joules are sums of small numbers."""
    return counts.double().mean(dim=0)
