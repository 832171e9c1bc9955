"""How projections that learn eagerly keep their traces, see `eager`: which these are, and values out and in."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro.model.synapses import Trace
from neuro.program.program import Floats, Projection
from neuro_event import layout, tables as t
from neuro_event.arrays import Arrays
from neuro_event.own_rules import OWN

LONGEST = 1024
"""Steps of an epoch at most."""

LEAST = math.exp(-64.0)
"""What is left of a trace at the end of an epoch at least: less would cost digits."""


def acts_at_once(a: Arrays, p: Projection) -> bool:
    """Whether a plastic projection learns eagerly: it has no modulator, and its synapses share delay and tau_minus."""
    tau_minus = np.ravel(a.program.populations[p.target].parameters["tau_minus"])
    alike = bool(np.all(tau_minus == tau_minus[0])) or all(trace.tau != "tau_minus" for trace in p.synapse.post)
    return a.eager and alike and not p.synapse.modulated and not layout.own_delays(p)


def first_kept(trace: Trace, value: float) -> float:
    """As what a trace is kept at step 0."""
    return value if trace.tau else -math.inf


def length(decays: Floats) -> int:
    """Steps of an epoch, from what is left of each trace after 0, 1, ... steps."""
    used = decays[decays[:, 0] == 1.0, : LONGEST + 1]
    return max(1, int(np.min((used > LEAST).sum(axis=1), initial=LONGEST + 1)) - 1)


def no_spikes(a: Arrays, learning: list[int], table: NDArray[np.int64], n_targets: int) -> Floats:
    """The traces of the post spikes that synapses have heard at step 0, a row for each target of a projection."""
    eager = [(row, a.program.projections[q]) for row, q in zip(table, learning, strict=True) if row[t.EAGER]]
    heard = np.zeros((n_targets if eager else 0, max((len(p.synapse.post) for _, p in eager), default=0)))
    for row, p in eager:
        first, size = row[t.FIRST_TARGET], a.program.populations[p.target].size
        for j, trace in enumerate(p.synapse.post):
            heard[first : first + size, j] = first_kept(trace, 0.0)
    return heard


def first_trace(a: Arrays, k: int, step: int) -> Floats:
    """The values at a step of the first pre trace of the plastic projection number k."""
    row = a.plastic["table"][k]
    p, stride = a.program.projections[row[t.PROJECTION]], row[t.SOURCE_STRIDE]
    first = row[t.FIRST_SOURCE]
    kept = a.plastic["k_plus"][0, first : first + a.program.populations[p.source].size * stride : stride]
    values: Floats = kept * a.plastic["decay"][k, OWN, step % row[t.EPOCH]]
    return values if p.synapse.pre[0].tau else (step - kept) * a.program.resolution


def unpack(a: Arrays, k: int, step: int) -> None:
    """Put the values at a step in the place of how the traces of projection number k are kept."""
    for kept, left in _traces(a, k, step):
        kept *= left


def pack(a: Arrays, k: int, step: int) -> None:
    """Keep traces from their values at a step, with the time constants of now."""
    a.plastic["table"][k, t.EPOCH] = length(a.plastic["decay"][k, OWN:])
    for kept, left in _traces(a, k, step):
        kept *= 1.0 / left if left > 0.0 else 0.0


def _traces(a: Arrays, k: int, step: int) -> Iterator[tuple[Floats, float]]:
    """As what the decaying traces of a projection are kept, and what is left since the epoch of a step began."""
    row, half = a.plastic["table"][k], a.plastic["kinds"].shape[1] // 2
    p = a.program.projections[row[t.PROJECTION]]
    left = a.plastic["decay"][k, OWN:, step % row[t.EPOCH]]
    first, stride = row[t.FIRST_SOURCE], row[t.SOURCE_STRIDE]
    end = first + a.program.populations[p.source].size * stride
    for j, trace in enumerate(p.synapse.pre):
        if trace.tau:
            yield a.plastic["k_plus"][:, first + j : end : stride], left[j]
    first, size = row[t.FIRST_TARGET], a.program.populations[p.target].size
    for j, trace in enumerate(p.synapse.post):
        if trace.tau:
            yield a.plastic["heard"][first : first + size, j], left[half + j]
