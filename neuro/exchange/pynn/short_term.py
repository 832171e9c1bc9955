"""By how much `tsodyks2` differs from PyNN's TsodyksMarkramSynapse, whose resources stay at the target for a while."""

from __future__ import annotations

import numpy as np

SPIKES, RATE, SEED = 200, 20.0, 0
"""Random spikes by which it is measured, and their rate in Hz."""


def difference(U: float, tau_rec: float, tau_fac: float, tau_syn: float) -> str:
    """What differs and by how much, in words.

    The resources that a spike releases are active for `tau_syn` in PyNN's simulators and recover then, for `tau_rec`.
    Here they recover from the spike on. Times are in ms.
    Source: Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000; NEST 3.10, `tsodyks_synapse` and `tsodyks2_synapse`.
    """
    if tau_syn == tau_rec:
        tau_syn *= 1.0 + 1e-6  # the solution has their difference below the line
    intervals = np.random.default_rng(SEED).exponential(1000.0 / RATE, SPIKES)
    u, left, active, here = 0.0, 1.0, 0.0, 1.0
    total = apart = 0.0
    for interval in intervals.tolist():
        facilitated = np.exp(-interval / tau_fac) if tau_fac else 0.0
        decayed, waiting = np.exp(-interval / tau_syn), np.exp(-interval / tau_rec)
        back = ((waiting - 1.0) * tau_rec - (decayed - 1.0) * tau_syn) / (tau_syn - tau_rec)
        left += back * active + (1.0 - waiting) * (1.0 - left - active)
        active *= decayed
        here += (1.0 - waiting) * (1.0 - here)
        u = U + u * facilitated * (1.0 - U)
        total += u * left
        apart += abs(u * here - u * left)
        active += u * left
        left -= u * left
        here -= u * here
    percent = 100.0 * apart / total if total else 0.0
    return (
        f"resources recover from a spike on, and in PyNN after they were active for {tau_syn:.4g} ms: "
        f"{SPIKES} random spikes at {RATE:g} Hz differ in effect by {percent:.1f} %"
    )
