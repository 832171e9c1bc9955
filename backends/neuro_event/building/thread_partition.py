"""The neurons of each thread."""

from __future__ import annotations

import numpy as np

from neuro.program.program import Ints, Program
from neuro_event.building.layout import WORD, PopulationPlace, in_runs
from neuro_event.building.shared_kernels import learns_shared
from neuro_event.loop import tables as t

WORTH_MEETING = 12_000
"""Steps of single neurons between two meetings of threads, about a nanosecond each, from which on they gain by sharing.

A meeting, and what each reads of the other's spikes, take one to three microseconds.
"""

SCATTERED = 1 << 22
"""Synapses with delays of their own from which on they lie beyond the caches, twelve bytes each."""

EVEN = 0.02
"""By how much the busiest thread may have more than its share of the work where populations are left whole."""

PATIENCE_S = 2.0
"""How long a division is looked for."""

SYNAPSES = 200
"""So many, each with a few spikes a second, are as much work as the steps of a neuron."""


def thread_edges(program: Program, where: list[PopulationPlace], threads: int) -> Ints:
    """Blocks at which the threads' neurons of each population begin, and the end: (populations, threads + 1)."""
    scattered = sum(p.size for p in program.projections if in_runs(program, p))
    owners = whole_populations(program, threads) if threads > 1 and scattered >= SCATTERED else None
    if owners is None:
        return _alike(program, where, threads)
    first = np.array([[place.begin // t.BLOCK] for place in where])
    end = np.array([[-(-place.end // t.BLOCK)] for place in where])
    return np.where(np.arange(threads + 1) > owners[:, None], end, first)


def _alike(program: Program, where: list[PopulationPlace], threads: int) -> Ints:
    """Each thread has a like share of every population, since no one knows before how busy one will be.

    What cannot be shared out evenly, of small ones or of groups that stay whole, is made up for in the next
    populations.
    """
    grouped = {g.population for g in program.groups}
    edges = np.zeros((len(program.populations), threads + 1), dtype=np.int64)
    below, total = np.zeros(threads + 1), 0.0  # the work of the threads before each, and of all
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
    """The thread of each population, where all can be left whole and the work is even all the same; else None.

    The synapses of one source, population and delay are few, and lie anywhere in memory: halves of them take half as
    many lines of memory again. A generator goes with the population that it drives.
    """
    together: dict[int, list[int]] = {}
    for index, population in enumerate(program.populations):
        driven = {p.target for p in program.projections if p.source == index}
        leads = population.kind == "neuron" or len(driven) != 1
        together.setdefault(index if leads else min(driven), []).append(index)
    units = list(together.values())
    owner = _divided(np.array([sum(_work(program, index) for index in unit) for unit in units]), threads)
    if owner is None:
        return None
    owners = np.zeros(len(program.populations), dtype=np.int64)
    for unit, thread in zip(units, owner, strict=True):
        owners[unit] = thread
    return owners


def _divided(work: Ints, threads: int) -> Ints | None:
    """The thread of each unit, so that the most that any has is least; None if that is not found to be even."""
    from scipy.optimize import LinearConstraint, milp

    share = work * threads / work.sum()
    once = np.kron(np.eye(work.size), np.ones(threads))
    load = np.kron(share, np.eye(threads))
    found = milp(
        np.append(np.zeros(work.size * threads), 1.0),  # unknown: whether a thread has a unit, and the largest load
        integrality=np.append(np.ones(work.size * threads), 0.0),
        bounds=(0.0, np.append(np.ones(work.size * threads), np.inf)),
        constraints=(
            LinearConstraint(np.c_[once, np.zeros(work.size)], 1.0, 1.0),
            LinearConstraint(np.c_[load, -np.ones(threads)], -np.inf, 0.0),
        ),
        options={"mip_rel_gap": EVEN / 2.0, "time_limit": PATIENCE_S},
    )
    if found.x is None:
        return None
    owner = found.x[:-1].reshape(-1, threads).argmax(axis=1)
    return owner if np.bincount(owner, share, threads).max() <= 1.0 + EVEN else None


def _work(program: Program, index: int) -> int:
    """Of a population, a synapse is 1."""
    work = SYNAPSES * program.populations[index].size
    for p in program.projections:
        if p.target == index:
            g = p.grid
            work += p.size if g is None else g.maps * g.rows * g.columns * g.kernel_height * g.kernel_width
    return work


def parts(program: Program, threads: int) -> int:
    """Into how many parts a program is cut for some threads.

    One where they would meet more often than is worth it, or where a shared kernel learns from all places at once.
    """
    if any(map(learns_shared, program.projections)):
        return 1
    steps = sum(p.size for p in program.populations) * max(1, program.min_delay)
    return threads if steps >= WORTH_MEETING else 1
