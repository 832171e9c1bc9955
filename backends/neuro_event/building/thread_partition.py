"""Division of the neurons among threads."""

from __future__ import annotations

import numpy as np

from neuro.program.program import Ints, Program
from neuro_event.building.layout import WORD, PopulationPlace, in_runs
from neuro_event.building.shared_kernels import learns_shared
from neuro_event.loop import tables as t

WORTH_MEETING = 12_000
"""Number of neuron steps between two synchronisations of threads from which several threads are faster than one.

A neuron step takes about 1 ns. A synchronisation, with reading the spikes of other threads, takes 1 to 3 microseconds.
"""

SCATTERED = 1 << 22
"""Number of synapses with individual delays from which they exceed the caches, at 12 bytes a synapse."""

EVEN = 0.02
"""Largest relative excess of a thread over its share of the work, if populations are not divided."""

PATIENCE_S = 2.0
"""Time limit of the search for a division, s."""

SYNAPSES = 200
"""Number of synapses whose work equals the work of one neuron, if each source emits a few spikes per second."""


def thread_edges(program: Program, where: list[PopulationPlace], threads: int) -> Ints:
    """Return the first block of each thread in each population, and the end: (populations, threads + 1)."""
    scattered = sum(p.size for p in program.projections if in_runs(program, p))
    owners = whole_populations(program, threads) if threads > 1 and scattered >= SCATTERED else None
    if owners is None:
        return _equal_shares(program, where, threads)
    first = np.array([[place.begin // t.BLOCK] for place in where])
    end = np.array([[-(-place.end // t.BLOCK)] for place in where])
    return np.where(np.arange(threads + 1) > owners[:, None], end, first)


def _equal_shares(program: Program, where: list[PopulationPlace], threads: int) -> Ints:
    """Give each thread an equal share of every population, since activities are not known in advance.

    Small populations and groups cannot be divided evenly. The shares of the next populations compensate for this.
    """
    grouped = {g.population for g in program.groups}
    edges = np.zeros((len(program.populations), threads + 1), dtype=np.int64)
    # Work of all threads before each thread, and of all threads.
    below, total = np.zeros(threads + 1), 0.0
    for index, place in enumerate(where):
        first, last, end = place.begin // WORD, -(-place.end // WORD), -(-place.end // t.BLOCK)
        pieces = 1 if index in grouped else last - first
        work = _work(program, index) / pieces
        total += work * pieces
        cut = 0
        for k in range(1, threads):
            cut = min(max(cut, round((total * k / threads - below[k]) / work)), pieces)
            edges[index, k] = min((first + cut * (last - first) // pieces) * t.GROUPED, end)
            below[k] += cut * work
        edges[index, 0], edges[index, threads] = first * t.GROUPED, end
    return edges


def whole_populations(program: Program, threads: int) -> Ints | None:
    """Return the thread of each population, or None if whole populations cannot be divided evenly.

    The few synapses of a source with the same target population and delay are neighbours in memory. If two threads
    shared a population, one and a half times as many cache lines would be read. A generator belongs to the thread of
    the population that the generator drives.
    """
    members: dict[int, list[int]] = {}
    for index, population in enumerate(program.populations):
        driven = {p.target for p in program.projections if p.source == index}
        leads = population.kind == "neuron" or len(driven) != 1
        members.setdefault(index if leads else min(driven), []).append(index)
    units = list(members.values())
    owner = _divide(np.array([sum(_work(program, index) for index in unit) for unit in units]), threads)
    if owner is None:
        return None
    owners = np.zeros(len(program.populations), dtype=np.int64)
    for unit, thread in zip(units, owner, strict=True):
        owners[unit] = thread
    return owners


def _divide(work: Ints, threads: int) -> Ints | None:
    """Divide units of work among threads so that the largest load of a thread is smallest.

    Return the thread of each unit, or None if no even division is found in time.
    """
    from scipy.optimize import LinearConstraint, milp

    share = work * threads / work.sum()
    once = np.kron(np.eye(work.size), np.ones(threads))
    load = np.kron(share, np.eye(threads))
    solution = milp(
        np.append(np.zeros(work.size * threads), 1.0),  # unknowns: 1 where a thread has a unit, and the largest load
        integrality=np.append(np.ones(work.size * threads), 0.0),
        bounds=(0.0, np.append(np.ones(work.size * threads), np.inf)),
        constraints=(
            LinearConstraint(np.c_[once, np.zeros(work.size)], 1.0, 1.0),
            LinearConstraint(np.c_[load, -np.ones(threads)], -np.inf, 0.0),
        ),
        options={"mip_rel_gap": EVEN / 2.0, "time_limit": PATIENCE_S},
    )
    if solution.x is None:
        return None
    owner = solution.x[:-1].reshape(-1, threads).argmax(axis=1)
    return owner if np.bincount(owner, share, threads).max() <= 1.0 + EVEN else None


def _work(program: Program, index: int) -> int:
    """Return the work of a population, in units of the work of a synapse."""
    work = SYNAPSES * program.populations[index].size
    for p in program.projections:
        if p.target == index:
            g = p.grid
            work += p.size if g is None else g.maps * g.rows * g.columns * g.kernel_height * g.kernel_width
    return work


def parts(program: Program, threads: int) -> int:
    """Return the number of parts into which a program is divided for a number of threads.

    The program is not divided if its threads would synchronise too often, or if the kernels of a grid learn, because
    each kernel learns from all places of the grid.
    """
    if any(map(learns_shared, program.projections)):
        return 1
    steps = sum(p.size for p in program.populations) * max(1, program.min_delay)
    return threads if steps >= WORTH_MEETING else 1
