"""Find the cores that a program fills on a chip, and the parts beyond a limit of a core, of the machine or of a delay.

`neuro.chips.placing` computes positions of cores and hops; most networks are accepted without them.
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
"""Largest number of cores (or tiles) whose order is optimised. More are laid out in the order of declaration."""


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """The cores of a program, before they have positions.

    Attributes:
        order: "connected" or "declared", the choice of the user.
        into: all synapses of the program.
        declared: cores filled in the order of declaration; None for large programs, which are split once only.
        connected: cores filled in an order that follows synapses; None for order "declared".
    """

    order: str
    into: Incoming
    declared: Split | None
    connected: Split | None


def cut(program: Program, chip: Chip, *, order: str = "connected", neurons_per_core: int | None = None) -> Cut:
    """Split the populations over cores; arguments and errors are those of `neuro.chips.place`."""
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


def fits_one_chip(program: Program, chip: Chip, cores_of_program: Cut) -> bool:
    """Return whether one chip holds all cores in either order, within all limits."""
    shared = chip.limit("synapse_bytes_per_chip")
    return all(
        len(each.cores) <= capacity(chip, len(each.cores))
        and (shared is None or int(each.memory.sum()) <= shared)
        and not exceeded(program, chip, cores_of_program.into, each, 1)
        for each in (cores_of_program.declared, cores_of_program.connected)
        if each is not None
    )


def _tied(program: Program, into: Incoming, populations: list[int]) -> list[int]:
    """Return the populations in an order that follows their synapses."""
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
    """Return an order of elements that puts elements with many common spikes next to each other.

    Args:
        traffic: spikes between each pair, symmetric, shape (n, n).
        pull: spikes from the host to each element.
    """
    n = len(pull)
    if n == 0 or n > LARGEST:
        return np.arange(n)
    is_left, tied = np.ones(n, dtype=bool), pull.astype(np.float64)
    order = np.zeros(n, dtype=np.int64)
    element = int(np.lexsort((np.arange(n), traffic.sum(axis=1), -pull))[0])
    for i in range(n):
        if i:
            element = int(np.argmax(np.where(is_left, tied, -1.0)))
        order[i], is_left[element] = element, False
        tied += traffic[element]
    return order


def exceeded(program: Program, chip: Chip, into: Incoming, split: Split, chips: int) -> tuple[Problem, ...]:
    """Return all parts that exceed a limit.

    Delays are checked only for a chip whose arithmetic is not emulated; quantising checks the delays on other chips.

    Args:
        program: the whole network.
        chip: the chip with the limits; `chips` is the size of the largest machine.
        into: all synapses of the program.
        split: the cores. A neuron too large for any core has a core of its own.
        chips: number of chips that the program needs.
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
    """Yield the projections whose delay exceeds the chip's register, with the messages of `neuro.chips.quantise`."""
    limit, h = chip.limit("delay_max"), program.resolution
    if limit is None:
        return
    of_one = placed_as(chip).register_of_one
    for index in spiking(program):
        part = program.projections[index]
        steps = part.delay_range(h)[1] if part.size else 0
        need = int(register(longest_lag(program, index), of_one).max(initial=0))
        if need > limit:
            yield Problem(
                True,
                f"projection '{part.name}': a delay of {steps * h:g} ms",
                f"{need} steps in the delay register, which holds at most {limit} on {chip.name}",
                f"use at most {(limit - need + steps) * h:g} ms, a coarser resolution, or a chain of parrots",
                part.origin,
            )


def _too_much(
    program: Program, chip: Chip, split: Split, kind: str, need: Ints, limit: int | None, into: Incoming
) -> Iterator[Problem]:
    """Yield a problem for each population with neurons that exceed a limit even alone on a core."""
    if limit is None:
        return
    lone_neurons: dict[int, list[tuple[int, int]]] = {}
    for core in np.flatnonzero(need > limit):
        population, neuron, _ = split.cores[core][0]
        lone_neurons.setdefault(population, []).append((neuron, int(need[core])))
    for population, neurons in sorted(lone_neurons.items()):
        neuron, count = min(neurons)
        part = program.populations[population]
        others_text = f" and {len(neurons) - 1:,} more" if len(neurons) > 1 else ""
        synapses = int(np.diff(into.ends)[into.start[population] + neuron])
        if kind == "memory":
            owner = "core" if chip.limit("synapse_bytes_per_core") is not None else "chip"
            reason = f"its {synapses:,} synapses need {count:,} bytes, "
            reason += f"but a {owner} of {chip.name} has {limit:,} for synapses"
            way_out = f"about {synapses * limit // count:,} synapses onto one neuron would fit"
        elif kind == "own":
            reason = f"learning onto it needs {count:,} bytes of its core's own memory, but {chip.name} has {limit:,}"
            way_out = "shorter time constants or delays, or fewer synapses from each source onto it, would fit"
        elif kind == "in":
            reason = f"the spikes of {count:,} neurons reach it, but a core of {chip.name} has {limit:,} input axons"
            way_out = f"at most {limit:,} sources of one neuron would fit: add neurons in between that gather spikes"
        else:
            reason = f"its spikes go to {count:,} cores, but a core of {chip.name} has {limit:,} output axons"
            way_out = f"targets on at most {limit:,} cores would fit: add neurons in between that pass on its spikes"
        yield Problem(True, f"population '{part.name}': neuron {neuron}{others_text}", reason, way_out, part.origin)


def _too_large(program: Program, chip: Chip, split: Split, chips: int) -> Iterator[Problem]:
    """Yield a problem if the largest machine has too few chips, for the population with most cores."""
    limit = chip.limit("chips")
    if limit is None or chips <= limit:
        return
    core_counts = np.bincount([index for parts in split.cores for index in {population for population, _, _ in parts}])
    largest, cores = int(np.argmax(core_counts)), len(split.cores)
    part, core_count = program.populations[largest], int(core_counts.max())
    surplus = cores - limit * capacity(chip, cores)
    alone = np.sort([split.neurons[i] for i, parts in enumerate(split.cores) if {p for p, _, _ in parts} == {largest}])
    fit = part.size - int(alone[:surplus].sum())
    machine = f"{limit:,} chip{'s' if limit > 1 else ''} of {capacity(chip, cores):,} cores"
    yield Problem(
        True,
        f"population '{part.name}': {core_count:,} of {cores:,} cores",
        f"the network needs {chips:,} chips, the largest machine of {chip.name} has {machine}",
        f"about {fit:,} of its {part.size:,} neurons would fit, or more with fewer synapses"
        if 0 < surplus <= len(alone) and surplus < core_count
        else "the network must be smaller: fewer neurons, or fewer synapses onto each",
        part.origin,
    )
