"""Room in the registers of a chip: how much of them what arrives in a step takes, and scales that leave more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch

import neuro
from neuro.chips import chip, chips, filled, quantise
from neuro_train.data import BatchData
from neuro_train.plan import TrainingPlan
from neuro_train.trainer import module_of

if TYPE_CHECKING:
    from neuro.chips import Chip

MARGIN = 2.0
"""The largest input of the recordings that were learnt from, times this, shall fit into its register."""
AT_ONCE = 50
"""Recordings that a module is shown at once."""


@dataclass(frozen=True, slots=True)
class MemoryRoom:
    """How much of its registers the input of a population takes on a chip.

    Attributes:
        chip: its name.
        population: whose.
        share: the largest of any neuron and step of the recordings that were learnt from, at `scale`; 1 wraps.
        scale: units of the voltage register per mV.
        chosen: whether the scale was made smaller than the chip's own, to leave room.
    """

    chip: str
    population: str
    share: float
    scale: float
    chosen: bool


def chip_of(target: str) -> Chip | None:
    """The chip that a backend emulates, if it does."""
    return chip(target) if target in chips() or target.endswith((".yaml", ".yml")) else None


def rooms(net: neuro.Network, target: str, shown: BatchData, plan: TrainingPlan) -> list[MemoryRoom]:
    """How much room a chip's registers have, at scales that leave some.

    A chip chooses a scale as fine as its threshold allows, so that only a sum of all synapses is sure to fit. Here it
    is halved until the largest sum of some recordings fits `MARGIN` times, or a weight would lose a bit.

    Args:
        net: what was learnt.
        target: the chip; another backend has no registers.
        shown: the recordings that were learnt from.
        plan: how they are seen.

    Returns:
        Of each population that spikes reach; none where the chip's arithmetic does not say (`neuro.chips.filled`).
    """
    on = chip_of(target)
    if on is None or not on.arithmetic:
        return []
    every = [name for name, part in net.populations.items() if part.model.role == "neuron"]
    if all(net.populations[name].model.graded for name in every):
        return []  # their sums have 32 bits, and no current
    module = module_of(net, replace(plan, bits=None), every).eval()
    fixed = quantise(module.program, on)
    shares: dict[str, float] = {}
    for first in range(0, len(shown), AT_ONCE):
        events = shown.events[list(range(first, min(first + AT_ONCE, len(shown))))]
        with torch.no_grad():
            spikes = {name: each.cpu().numpy() for name, each in module(events).spikes.items()}
        for name, train in events.trains.items():
            size = math.prod(int(side) for side in net.populations[name].shape)
            spikes[name] = np.zeros((events.batch, events.steps, size), np.float32)
            spikes[name][np.repeat(np.arange(events.batch), np.diff(train.ends)), train.step, train.neuron] = 1.0
        for name, share in filled(fixed, spikes).items():
            shares[name] = max(share, shares.get(name, 0.0))
    found = []
    for k, cells in enumerate(fixed.populations):
        if cells.name in shares:
            parts = zip(module.program.projections, fixed.projections, strict=True)
            spare = min(wires.exponent for part, wires in parts if part.target == k and wires is not None)
            wanted = math.ceil(math.log2(max(MARGIN * shares[cells.name], 1.0)))
            less = 2.0 ** max(0, min(wanted, spare))
            found.append(MemoryRoom(target, cells.name, shares[cells.name] / less, cells.volt / less, less > 1.0))
    return found


def scales(found: Sequence[MemoryRoom], target: str) -> dict[str, float]:
    """The option `scales` of `neuro.compile` on a chip: of the populations whose scale is not the chip's own."""
    return {room.population: room.scale for room in found if room.chip == target and room.chosen}


def told(found: Sequence[MemoryRoom]) -> list[str]:
    """A line for each chip."""
    lines = []
    for target in dict.fromkeys(room.chip for room in found):
        shares = ", ".join(f"{room.share:.0%} of that of '{room.population}'" for room in found if room.chip == target)
        own = ", ".join(f"'{name}': {scale:.6g}" for name, scale in scales(found, target).items())
        way = f"; scales={{{own}}} leaves this room" if own else ""
        lines.append(f"{target}: input registers on the recordings learnt from: at most {shares}{way}")
    return lines
