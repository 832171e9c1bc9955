# mypy: ignore-errors
"""Compiled loops of `neuro.events.segmentation`."""

from __future__ import annotations

from math import exp

from neuro.kernels.jit import kernel


@kernel
def msd(t, tau_us, threshold, v, last, cuts):
    """t: int64[n]; v, last: potential and time so far; cuts: int64[n]. Returns number of cuts, v and last."""
    n = 0
    for k in range(t.shape[0]):
        v = v * exp((last - t[k]) / tau_us) + 1.0
        last = t[k]
        if v >= threshold:
            cuts[n] = k + 1
            n += 1
            v = 0.0
    return n, v, last


@kernel
def peaks(t, last, seen, constants, state, candidate, queue_t, queue_v, held, cuts):
    """Peaks of the potential.

    A queue holds the events of the search range that no later event exceeds, so its first is the highest.

    Args:
        t: int64[n].
        last: time of the event before.
        seen: number of events before.
        constants: tau, rise, v0, search (us) and threshold.
        state: float64[2], slow and fast part of the potential.
        candidate: int64[2], its number (-1: none) and time.
        queue_t: int64[held + n].
        queue_v: float64[held + n].
        held: length of the queue so far.
        cuts: int64[n + 1], filled.

    Returns:
        number of cuts, and where the queue begins and ends.
    """
    tau, rise, v0, search, threshold = constants
    slow, fast = state
    number, when = candidate
    n, head, tail = 0, 0, held
    for k in range(t.shape[0]):
        now = t[k]
        passed = last - now
        slow = slow * exp(passed / tau) + v0
        if rise > 0.0:
            fast = fast * exp(passed / rise) + v0
        v = slow - fast
        last = now
        if number >= 0 and now - when > search:
            cuts[n] = number + 1
            n += 1
            number = -1
        while head < tail and now - queue_t[head] > search:
            head += 1
        if (head == tail or queue_v[head] < v) and v > threshold:
            number, when = seen + k, now
        while head < tail and queue_v[tail - 1] <= v:
            tail -= 1
        queue_t[tail] = now
        queue_v[tail] = v
        tail += 1
    state[0], state[1] = slow, fast
    candidate[0], candidate[1] = number, when
    return n, head, tail
