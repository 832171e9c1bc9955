"""Loihi 1's compartments in the engine: where their registers lie, and their step in integers.

The loop of a step has no branches, so that it runs many at a time.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi_registers import KIND
from neuro.kernels.jit import subkernel
from neuro.program.program import Ints
from neuro_chip import tables as t
from neuro_chip.tables import Arrays

i32 = np.int32
V_LIMIT = i32(2**23 - 1)
ZERO, ONE, SIX, EIGHT, TWELVE, SIXTEEN = i32(0), i32(1), i32(6), i32(8), i32(12), i32(16)
LOW, SIGN = i32(4095), i32(31)


@subkernel
def lif(net, pop, row, step):
    """Step a population; `fired` says which are above threshold."""
    lo, hi = row[t.BEGIN], row[t.END]
    begin = row[t.RING] + (step & (row[t.SLOTS] - 1)) * (hi - lo)
    inputs, currents, drives, clips = step_loihi(
        net.ring[begin : begin + hi - lo],
        net.v[lo:hi],
        net.u[lo:hi],
        net.hold[lo:hi],
        net.keep_u[lo:hi],
        net.keep_v[lo:hi],
        net.threshold[lo:hi],
        net.bias[lo:hi],
        net.fired[lo:hi],
        i32(row[t.LOWEST]),
    )
    net.native[pop, t.INPUT_WRAPS] += inputs
    net.native[pop, t.WRAPS] += currents
    net.native[pop, t.DRIVE_WRAPS] += drives
    net.native[pop, t.CLIPS] += clips


@subkernel
def kept(value, share):
    """Value x share / 4096, truncated towards 0; numba widens each operation, so each is cut back to 32 bits.

    |a| f / 4096 is (|a| >> 12) f + ((|a| & 4095) f >> 12): no product leaves 32 bits.
    """
    # Two's complement without a branch: a = (v ^ s) - s with s all ones where v is negative.
    sign = i32(value >> SIGN)
    a = i32(i32(value ^ sign) - sign)
    high = i32(i32(a >> TWELVE) * share)
    low = i32(i32(i32(a & LOW) * share) >> TWELVE)
    return i32(i32(i32(high + low) ^ sign) - sign)


@subkernel
def step_loihi(x, v, u, hold, keep_u, keep_v, threshold, bias, fired, lowest):
    """Loihi 1's compartments; return how many inputs, currents and drives wrapped and voltages were clipped.

    The input of a step is kept in units of 64, so that its 22 bits are 16 of x; u and u + bias have 24.
    """
    inputs = ZERO
    currents = ZERO
    drives = ZERO
    clips = ZERO
    for i in range(v.size):
        # Shifted up and back: the upper bits are lost and the sign is that of the highest bit kept, as a register of
        # that width has it.
        arrived = i32(i32(x[i] << SIXTEEN) >> SIXTEEN)
        full = i32(kept(u[i], keep_u[i]) + i32(arrived << SIX))
        now = i32(i32(full << EIGHT) >> EIGHT)
        driven = i32(now + bias[i])
        drive = i32(i32(driven << EIGHT) >> EIGHT)
        w = i32(kept(v[i], keep_v[i]) + drive)
        clipped = i32(min(max(w, i32(-V_LIMIT)), V_LIMIT))
        free = i32(hold[i] == ZERO)
        inputs = i32(inputs + i32(arrived != x[i]))
        currents = i32(currents + i32(now != full))
        drives = i32(drives + i32(drive != driven))
        clips = i32(clips + i32(free & i32(clipped != w)))
        # While refractory the voltage is held at 0, Loihi's reset, but the current goes on.
        clipped = i32(max(clipped, lowest) * free)
        x[i] = ZERO
        u[i] = now
        v[i] = clipped
        hold[i] = i32(hold[i] - i32(ONE - free))
        fired[i] = np.uint8(free & i32(clipped > threshold[i]))
    return inputs, currents, drives, clips


def write(a: Arrays, row: NDArray[np.int64], here: slice, r: Mapping[str, Ints]) -> None:
    """Put the registers of a population, rows `here` of the arrays, where its step reads them."""
    a["keep_u"][here] = 4095 - r["du"]
    a["keep_v"][here] = 4096 - r["dv"]
    row[t.LOWEST] = int(r["v_min"][0]) if "v_min" in r else -(2**23) + 1
    a["fall"][here] = r.get("fall", 0)
    a["threshold"][here] = r["vth"] * 64
    a["bias"][here] = r["bias_mant"] << r["bias_exp"]
    a["refractory"][here] = r["refractory"] - 1


STEPS = {KIND: lif}
"""The step of each kind of population."""
