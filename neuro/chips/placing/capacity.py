"""What of a network fits on no core, on no machine, or into no delay register.

What the delay register of a spike holds follows from when it acts (`neuro.chips.arrival_rule`) and from how its
family counts. Chips without an arithmetic here are taken to count as Loihi 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.chips.arithmetics import placed_as
from neuro.chips.arrival_rule import longest_lag, register
from neuro.chips.description import Chip
from neuro.chips.placing.fan_out import spiking
from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.mesh import capacity
from neuro.chips.placing.packing import memory_limit
from neuro.chips.placing.split import Split
from neuro.program.backend import Problem
from neuro.program.program import Ints, Program


def exceeded(program: Program, chip: Chip, into: Incoming, split: Split, chips: int) -> tuple[Problem, ...]:
    """All that does not fit, at once; delays only where the arithmetic is not emulated, as quantising tells them else.

    Args:
        program: tells names and places in the description.
        chip: has the limits; `chips` among them is the size of the largest machine.
        into: all synapses.
        split: the cores; a neuron that fits on none has one of its own.
        chips: how many are needed.
    """
    return (
        *_too_much(program, chip, split, "memory", split.memory, memory_limit(chip), into),
        *_too_much(program, chip, split, "in", split.axons_in, chip.limit("axons_in_per_core"), into),
        *_too_much(program, chip, split, "out", split.axons_out, chip.limit("axons_out_per_core"), into),
        *_too_large(program, chip, split, chips),
        *(() if chip.arithmetic else too_late(program, chip)),
    )


def too_late(program: Program, chip: Chip) -> Iterator[Problem]:
    """Projections with a delay that the chip's register does not hold, in the words of `neuro.chips.quantise`."""
    most, h = chip.limit("delay_max"), program.resolution
    if most is None:
        return
    of_one = placed_as(chip).register_of_one
    for index in spiking(program):
        part = program.projections[index]
        steps = part.delay_range(h)[1] if part.size else 0
        need = int(register(longest_lag(program, index), of_one).max(initial=0))
        if need > most:
            yield Problem(
                True,
                f"projection '{part.name}': a delay of {steps * h:g} ms",
                f"{need} steps in the delay register, which holds at most {most} on {chip.name}",
                f"use at most {(most - need + steps) * h:g} ms, a coarser resolution, or a chain of parrots",
                part.origin,
            )


def _too_much(
    program: Program, chip: Chip, split: Split, kind: str, need: Ints, limit: int | None, into: Incoming
) -> Iterator[Problem]:
    """Neurons that are beyond a limit although they are alone on their core, told once for a population."""
    if limit is None:
        return
    alone: dict[int, list[tuple[int, int]]] = {}
    for core in np.flatnonzero(need > limit):
        population, neuron, _ = split.cores[core][0]
        alone.setdefault(population, []).append((neuron, int(need[core])))
    for population, found in sorted(alone.items()):
        neuron, count = min(found)
        part = program.populations[population]
        more = f" and {len(found) - 1:,} more" if len(found) > 1 else ""
        synapses = int(np.diff(into.ends)[into.start[population] + neuron])
        why, way_out = _reason(kind, chip, count, limit, synapses)
        yield Problem(True, f"population '{part.name}': neuron {neuron}{more}", why, way_out, part.origin)


def _reason(kind: str, chip: Chip, need: int, limit: int, synapses: int) -> tuple[str, str]:
    if kind == "memory":
        whose = "core" if chip.limit("synapse_bytes_per_core") is not None else "chip"
        why = f"its {synapses:,} synapses take {need:,} bytes, a {whose} of {chip.name} has {limit:,} for synapses"
        return why, f"about {synapses * limit // need:,} synapses onto one neuron would fit"
    if kind == "in":
        why = f"the spikes of {need:,} neurons reach it, a core of {chip.name} has {limit:,} input axons"
        return why, f"at most {limit:,} sources of one neuron would fit: let neurons between gather them"
    why = f"its spikes go to {need:,} cores, a core of {chip.name} has {limit:,} output axons"
    return why, f"targets on at most {limit:,} cores would fit: let neurons between pass its spikes on"


def _too_large(program: Program, chip: Chip, split: Split, chips: int) -> Iterator[Problem]:
    """More chips than the largest machine has, told of the population that takes most cores."""
    most = chip.limit("chips")
    if most is None or chips <= most:
        return
    held = np.bincount([index for parts in split.cores for index in {population for population, _, _ in parts}])
    largest, cores = int(np.argmax(held)), len(split.cores)
    part, own = program.populations[largest], int(held.max())
    surplus = cores - most * capacity(chip, cores)
    alone = np.sort([split.neurons[i] for i, parts in enumerate(split.cores) if {p for p, _, _ in parts} == {largest}])
    fit = part.size - int(alone[:surplus].sum())
    machine = f"{most:,} chip{'s' if most > 1 else ''} of {capacity(chip, cores):,} cores"
    yield Problem(
        True,
        f"population '{part.name}': {own:,} of {cores:,} cores",
        f"the network needs {chips:,} chips, the largest machine of {chip.name} has {machine}",
        f"about {fit:,} of its {part.size:,} neurons would fit, or more with fewer synapses"
        if 0 < surplus <= len(alone) and surplus < own
        else "the network must be smaller: fewer neurons, or fewer synapses onto each",
        part.origin,
    )
