"""By how much `tsodyks2` differs from PyNN's TsodyksMarkramSynapse, whose resources stay at the target for a while."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.program.program import Floats

SPIKES, RATE, SEED = 200, 20.0, 0
"""Random spikes by which it is measured, and their rate in Hz."""


def difference(U: float, tau_rec: float, tau_fac: float, tau_syn: float) -> str:
    """What differs and by how much, in words; times are in ms."""
    intervals = np.random.default_rng(SEED).exponential(1000.0 / RATE, SPIKES)
    here, there = effects(intervals.tolist(), U, tau_rec, tau_fac, tau_syn)
    percent = 100.0 * np.abs(here - there).sum() / there.sum() if there.any() else 0.0
    return (
        f"resources recover from a spike on, and in PyNN after they were active for {tau_syn:.4g} ms: "
        f"{SPIKES} random spikes at {RATE:g} Hz differ in effect by {percent:.1f} %"
    )


def effects(
    intervals: Sequence[float], U: float, tau_rec: float, tau_fac: float, tau_syn: float
) -> tuple[Floats, Floats]:
    """The share of the weight that each spike sends, here and in PyNN's simulators.

    There the resources that a spike releases are active for `tau_syn` and recover then, for `tau_rec`; here they
    recover from the spike on.
    Source: Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000; NEST 3.10, `tsodyks2_synapse` and `tsodyks_synapse`.
    """
    if tau_syn == tau_rec:
        tau_syn *= 1.0 + 1e-6  # the solution has their difference below the line
    u, left_here, left_there, active = 0.0, 1.0, 1.0, 0.0
    sent = []
    for interval in intervals:
        facilitated = np.exp(-interval / tau_fac) if tau_fac else 0.0
        decayed, waiting = np.exp(-interval / tau_syn), np.exp(-interval / tau_rec)
        back = ((waiting - 1.0) * tau_rec - (decayed - 1.0) * tau_syn) / (tau_syn - tau_rec)
        left_there += back * active + (1.0 - waiting) * (1.0 - left_there - active)
        left_here += (1.0 - waiting) * (1.0 - left_here)
        u = U + u * facilitated * (1.0 - U)
        sent.append((u * left_here, u * left_there))
        active = active * decayed + u * left_there
        left_here, left_there = left_here * (1.0 - u), left_there * (1.0 - u)
    here, there = np.array(sent).T
    return here, there
