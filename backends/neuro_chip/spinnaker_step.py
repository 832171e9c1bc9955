"""SpiNNaker 1's neurons in the engine: arrays of registers, and integer steps.

States are s16.15. Slots have 16 bits, and each receptor has its own.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker import DELTA, LIF
from neuro.kernels.jit import subkernel
from neuro.program.program import Ints
from neuro_chip import tables as t
from neuro_chip.tables import Arrays

i32 = np.int32
SLOT = i32(65535)
FIFTEEN, THIRTY_TWO = np.int64(15), np.int64(32)


@subkernel
def product(a, b):
    """Return an s16.15 product, rounded down, not yet wrapped to 32 bits."""
    # A shift of a negative number rounds down, as the machine's arithmetic does.
    return (np.int64(a) * np.int64(b)) >> FIFTEEN


@subkernel
def fraction(x, d):
    """Return (x d) >> 32 with d unsigned 0.32."""
    return (np.int64(x) * np.int64(d)) >> THIRTY_TWO


@subkernel
def receptors(net, row, step):
    """Return the slots of this step of both receptors."""
    n = row[t.END] - row[t.BEGIN]
    begin = row[t.RING] + (step & (row[t.SLOTS] - 1)) * n
    below = begin + row[t.SLOTS] * n
    return net.ring[begin : begin + n], net.ring[below : below + n]


@subkernel
def lif(net, pop, row, step):
    """Step a population of exponential neurons; `fired` marks those that reach threshold.

    The input of a tick remains in g until the next tick decays it, which equals a decay at the end of a tick.
    """
    first, end = row[t.BEGIN], row[t.END]
    exc, inh = receptors(net, row, step)
    v, hold, fired = net.v[first:end], net.hold[first:end], net.fired[first:end]
    g_exc, g_inh = net.u[first:end], net.g_inh[first:end]
    shift_exc, shift_inh = row[t.EXC_SHIFT], row[t.INH_SHIFT]
    saturated = 0
    wraps = 0
    for k in range(v.size):
        i = first + k
        saturated += (exc[k] > SLOT) + (inh[k] > SLOT)
        # The slot has 16 bits and saturates; the shift of the receptor converts its unit to s16.15.
        slot_exc = np.int64(min(exc[k], SLOT)) << shift_exc
        slot_inh = np.int64(min(inh[k], SLOT)) << shift_inh
        exc[k] = 0
        inh[k] = 0
        # Each term is rounded down before the sum, in this order, which determines the last bit.
        full_exc = fraction(g_exc[k], net.exc_decay[i]) + fraction(slot_exc, net.exc_init[i])
        full_inh = fraction(g_inh[k], net.inh_decay[i]) + fraction(slot_inh, net.inh_init[i])
        ge, gi = i32(full_exc), i32(full_inh)
        wraps += (ge != full_exc) | (gi != full_inh)
        g_exc[k] = ge
        g_inh[k] = gi
        fired[k] = 0
        if hold[k] > 0:
            hold[k] -= 1
            # As in the machine's code, a refractory neuron is compared, too: with V_reset above V_th it fires at once.
            fired[k] = v[k] >= net.threshold[i]
            continue
        drive = np.int64(ge) - np.int64(gi) + np.int64(net.bias[i])
        alpha = product(i32(drive), net.r_m[i]) + np.int64(net.v_rest[i])
        gap = np.int64(i32(alpha)) - np.int64(v[k])
        new_v = np.int64(i32(alpha)) - product(net.keep_v[i], i32(gap))
        wraps += (i32(drive) != drive) | (i32(alpha) != alpha) | (i32(gap) != gap) | (i32(new_v) != new_v)
        v[k] = i32(new_v)
        fired[k] = v[k] >= net.threshold[i]
    net.native[pop, t.SATURATIONS] += saturated
    net.native[pop, t.WRAPS] += wraps


@subkernel
def delta(net, pop, row, step):
    """Step a population with delta input; `fired` marks the neurons that reach threshold."""
    first, end = row[t.BEGIN], row[t.END]
    exc, inh = receptors(net, row, step)
    v, hold, fired = net.v[first:end], net.hold[first:end], net.fired[first:end]
    shift_exc, shift_inh, lowest = row[t.EXC_SHIFT], row[t.INH_SHIFT], row[t.LOWEST]
    saturated = 0
    wraps = 0
    for k in range(v.size):
        i = first + k
        saturated += (exc[k] > SLOT) + (inh[k] > SLOT)
        x = (np.int64(min(exc[k], SLOT)) << shift_exc) - (np.int64(min(inh[k], SLOT)) << shift_inh)
        exc[k] = 0
        inh[k] = 0
        fired[k] = 0
        if hold[k] > 0:
            hold[k] -= 1
            continue
        above = np.int64(v[k]) - np.int64(net.v_rest[i])
        new_v = np.int64(net.v_rest[i]) + product(i32(above), net.keep_v[i]) + np.int64(net.bias[i]) + x
        wraps += (i32(above) != above) | (i32(new_v) != new_v)
        v[k] = max(i32(new_v), i32(lowest))
        fired[k] = v[k] >= net.threshold[i]
    net.native[pop, t.SATURATIONS] += saturated
    net.native[pop, t.WRAPS] += wraps


def write(a: Arrays, row: NDArray[np.int64], neurons: slice, r: Mapping[str, Ints]) -> None:
    """Write the registers of a population to rows `neurons` of the arrays that its step reads."""
    a["keep_v"][neurons] = r["exp_tc"]
    row[t.LOWEST] = int(r["v_min"][0]) if "v_min" in r else -(2**31) + 1
    a["fall"][neurons] = r.get("fall", 0)
    a["threshold"][neurons] = r["v_thresh"]
    a["bias"][neurons] = r["i_offset"]
    a["refractory"][neurons] = r["t_refract"]
    a["v_reset"][neurons], a["v_rest"][neurons] = r["v_reset"], r["v_rest"]
    row[t.EXC_SHIFT], row[t.INH_SHIFT] = r["exc_shift"][0], r["inh_shift"][0]
    for name in ("r_m", "exc_decay", "exc_init", "inh_decay", "inh_init"):
        if name in r:
            a[name][neurons] = r[name]


STEPS = {LIF: lif, DELTA: delta}
"""The integer step of each kind of population."""
