"""Loihi 1's compartments in the engine: arrays of registers, and the integer step.

The loop of a step has no branches, so that it is vectorised.
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
    """Step a population; `fired` marks the neurons above threshold."""
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
def multiplied(value, share):
    """Return value x share / 4096, truncated towards 0.

    numba widens each operation, so each is narrowed to 32 bits. |a| f / 4096 is (|a| >> 12) f + ((|a| & 4095) f >> 12),
    where no product exceeds 32 bits.
    """
    # Two's complement without a branch: a = (v ^ s) - s with s all ones where v is negative.
    sign = i32(value >> SIGN)
    a = i32(i32(value ^ sign) - sign)
    high = i32(i32(a >> TWELVE) * share)
    low = i32(i32(i32(a & LOW) * share) >> TWELVE)
    return i32(i32(i32(high + low) ^ sign) - sign)


@subkernel
def step_loihi(x, v, u, hold, keep_u, keep_v, threshold, bias, fired, lowest):
    """Update compartments; return the numbers of wrapped inputs, currents and drives, and of clipped voltages.

    The input of a step is stored in units of 64, so that its 22 bits are 16 of x; u and u + bias have 24 bits.
    """
    inputs = ZERO
    currents = ZERO
    drives = ZERO
    clips = ZERO
    for i in range(v.size):
        # Shifting up and back drops the upper bits. The sign is that of the highest remaining bit, as in a register of
        # that width.
        arrived = i32(i32(x[i] << SIXTEEN) >> SIXTEEN)
        full = i32(multiplied(u[i], keep_u[i]) + i32(arrived << SIX))
        wrapped = i32(i32(full << EIGHT) >> EIGHT)
        driven = i32(wrapped + bias[i])
        drive = i32(i32(driven << EIGHT) >> EIGHT)
        w = i32(multiplied(v[i], keep_v[i]) + drive)
        clipped = i32(min(max(w, i32(-V_LIMIT)), V_LIMIT))
        free = i32(hold[i] == ZERO)
        inputs = i32(inputs + i32(arrived != x[i]))
        currents = i32(currents + i32(wrapped != full))
        drives = i32(drives + i32(drive != driven))
        clips = i32(clips + i32(free & i32(clipped != w)))
        # During refractoriness the voltage is held at 0, Loihi's reset, but the current continues.
        clipped = i32(max(clipped, lowest) * free)
        x[i] = ZERO
        u[i] = wrapped
        v[i] = clipped
        hold[i] = i32(hold[i] - i32(ONE - free))
        fired[i] = np.uint8(free & i32(clipped > threshold[i]))
    return inputs, currents, drives, clips


def write(a: Arrays, row: NDArray[np.int64], neurons: slice, r: Mapping[str, Ints]) -> None:
    """Write the registers of a population to rows `neurons` of the arrays that its step reads."""
    a["keep_u"][neurons] = 4095 - r["du"]
    a["keep_v"][neurons] = 4096 - r["dv"]
    row[t.LOWEST] = int(r["v_min"][0]) if "v_min" in r else -(2**23) + 1
    a["fall"][neurons] = r.get("fall", 0)
    a["threshold"][neurons] = r["vth"] * 64
    a["bias"][neurons] = r["bias_mant"] << r["bias_exp"]
    a["refractory"][neurons] = r["refractory"] - 1


STEPS = {KIND: lif}
"""The integer step of each kind of population."""
