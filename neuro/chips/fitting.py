"""Fit: the cores that a program fills on a chip, and what fits on no core, on no machine or into no delay register.

Where the cores lie, and the hops between them, is in `neuro.chips.placing`. Most networks need no place to be accepted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from neuro.chips.description import Chip, capacity
from neuro.chips.incoming import Incoming, incoming, memory_limit, spiking
from neuro.chips.inputs import longest_lag, register
from neuro.chips.known import placed_as
from neuro.chips.splitting import Split, fewest_cores, neurons_of, split
from neuro.core.errors import ModelError, unknown
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Program

ORDERS = ("connected", "declared")

LARGEST = 2000
"""Most cores (or tiles) that are ordered and exchanged; more are laid out as they come."""


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """The cores of a program, before they have places.

    Attributes:
        order: as asked: "connected" or "declared".
        into: all synapses.
        declared: cores filled in the order of declaration; None where there are too many to fill them twice.
        tied: cores filled in the order that follows synapses; None where it is not asked for.
    """

    order: str
    into: Incoming
    declared: Split | None
    tied: Split | None


def cut(program: Program, chip: Chip, *, order: str = "connected", neurons_per_core: int | None = None) -> Cut:
    """Fill cores; arguments and errors are those of `neuro.chips.place`."""
    if order not in ORDERS:
        raise unknown("order", order, ORDERS)
    if neurons_per_core is not None:
        if type(neurons_per_core) is not int or neurons_per_core < 1:
            raise ModelError(f"neurons_per_core = {neurons_per_core!r}: expected a whole number >= 1")
        limit = chip.limit("neurons_per_core")
        if limit is not None and neurons_per_core > limit:
            raise ModelError(
                f"neurons_per_core = {neurons_per_core}: expected at most {limit}, the limit of {chip.name}"
            )
    into = incoming(program, placed_as(chip).keeps_kernels)
    numbers = neurons_of(program)
    is_large = order == "connected" and fewest_cores(program, chip, into) > LARGEST
    declared = None if is_large else split(program, chip, into, numbers, neurons_per_core)
    if order != "connected":
        return Cut(order, into, declared, None)
    by_ties = _tied(program, into, numbers)
    if declared is not None and by_ties == numbers and all(part.grid is None for part in program.projections):
        return Cut(order, into, declared, declared)
    return Cut(order, into, declared, split(program, chip, into, by_ties, neurons_per_core, by_place=True))


def fits_one_chip(program: Program, chip: Chip, found: Cut) -> bool:
    """Whether one chip holds all cores in whatever order, and nothing is beyond a limit."""
    shared = chip.limit("synapse_bytes_per_chip")
    return all(
        len(cores.cores) <= capacity(chip, len(cores.cores))
        and (shared is None or int(cores.memory.sum()) <= shared)
        and not exceeded(program, chip, found.into, cores, 1)
        for cores in (found.declared, found.tied)
        if cores is not None
    )


def _tied(program: Program, into: Incoming, populations: list[int]) -> list[int]:
    """Populations in an order that follows their synapses."""
    n = len(program.populations)
    synapses, pull = np.zeros((n, n)), np.zeros(n)
    for part, count in zip(program.projections, into.synapses, strict=True):
        if part.source in populations:
            synapses[[part.source, part.target], [part.target, part.source]] += count
        else:
            pull[part.target] += count
    np.fill_diagonal(synapses, 0.0)
    order = chain(synapses[np.ix_(populations, populations)], pull[populations])
    return [populations[i] for i in order]


def chain(traffic: Floats, pull: Floats) -> Ints:
    """An order in which each comes after those to which it is tied most.

    Args:
        traffic: spikes between each two, symmetric, shape (n, n).
        pull: spikes from the host to each.
    """
    n = len(pull)
    if n == 0 or n > LARGEST:
        return np.arange(n)
    left, tied = np.ones(n, dtype=bool), pull.astype(np.float64)
    order = np.zeros(n, dtype=np.int64)
    at = int(np.lexsort((np.arange(n), traffic.sum(axis=1), -pull))[0])
    for i in range(n):
        if i:
            at = int(np.argmax(np.where(left, tied, -1.0)))
        order[i], left[at] = at, False
        tied += traffic[at]
    return order


def exceeded(program: Program, chip: Chip, into: Incoming, split: Split, chips: int) -> tuple[Problem, ...]:
    """All that does not fit, at once; delays only where the arithmetic is not emulated, as quantising tells them else.

    Args:
        program: has the names and places in the description.
        chip: has the limits; `chips` among them is the size of the largest machine.
        into: all synapses.
        split: the cores; a neuron that fits on none has one of its own.
        chips: how many are needed.
    """
    return (
        *_too_much(program, chip, split, "memory", split.memory, memory_limit(chip), into),
        *_too_much(program, chip, split, "own", split.own, chip.limit("memory_bytes_per_core"), into),
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
    """Neurons that are beyond a limit although they are alone on their core, reported once for a population."""
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
        if kind == "memory":
            whose = "core" if chip.limit("synapse_bytes_per_core") is not None else "chip"
            why = f"its {synapses:,} synapses take {count:,} bytes, a {whose} of {chip.name} has {limit:,} for synapses"
            way_out = f"about {synapses * limit // count:,} synapses onto one neuron would fit"
        elif kind == "own":
            why = f"learning onto it takes {count:,} bytes of its core's own memory, {chip.name} has {limit:,}"
            way_out = "shorter time constants or delays, or fewer synapses of a source onto it, would fit"
        elif kind == "in":
            why = f"the spikes of {count:,} neurons reach it, a core of {chip.name} has {limit:,} input axons"
            way_out = f"at most {limit:,} sources of one neuron would fit: let neurons between gather them"
        else:
            why = f"its spikes go to {count:,} cores, a core of {chip.name} has {limit:,} output axons"
            way_out = f"targets on at most {limit:,} cores would fit: let neurons between pass its spikes on"
        yield Problem(True, f"population '{part.name}': neuron {neuron}{more}", why, way_out, part.origin)


def _too_large(program: Program, chip: Chip, split: Split, chips: int) -> Iterator[Problem]:
    """More chips than the largest machine has, reported for the population that takes most cores."""
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
