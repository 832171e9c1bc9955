"""One step of each kind of neuron, in integers. The loops have no branches, so that they run many neurons at a time."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner

i32 = np.int32
V_LIMIT = i32(2**23 - 1)
ZERO, ONE, SIX, EIGHT, TWELVE, SIXTEEN = i32(0), i32(1), i32(6), i32(8), i32(12), i32(16)
LOW, SIGN = i32(4095), i32(31)
SLOT = i32(65535)
FIFTEEN, THIRTY_TWO = np.int64(15), np.int64(32)


@inner
def kept(value, share):
    """Value x share / 4096, truncated towards 0; numba widens each operation, so each is cut back to 32 bits.

    |a| f / 4096 is (|a| >> 12) f + ((|a| & 4095) f >> 12): no product leaves 32 bits.
    """
    sign = i32(value >> SIGN)
    a = i32(i32(value ^ sign) - sign)
    high = i32(i32(a >> TWELVE) * share)
    low = i32(i32(i32(a & LOW) * share) >> TWELVE)
    return i32(i32(i32(high + low) ^ sign) - sign)


@inner
def step_loihi(x, v, u, hold, keep_u, keep_v, threshold, bias, fired):
    """Loihi 1's compartments; return how many inputs, currents and drives wrapped and voltages were clipped.

    The input of a step is kept in units of 64, so that its 22 bits are 16 of x; u and u + bias have 24.
    """
    inputs = ZERO
    currents = ZERO
    drives = ZERO
    clips = ZERO
    for i in range(v.size):
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
        clipped = i32(clipped * free)
        x[i] = ZERO
        u[i] = now
        v[i] = clipped
        hold[i] = i32(hold[i] - i32(ONE - free))
        fired[i] = np.uint8(free & i32(clipped > threshold[i]))
    return inputs, currents, drives, clips


@inner
def product(a, b):
    """An s16.15 product: floor, not yet wrapped to 32 bits."""
    return (np.int64(a) * np.int64(b)) >> FIFTEEN


@inner
def decayed(x, d):
    """(x d) >> 32 with d unsigned 0.32."""
    return (np.int64(x) * np.int64(d)) >> THIRTY_TWO


@inner
def step_spinnaker(exc, inh, v, g_exc, g_inh, hold, r, first, shift_exc, shift_inh, fired):
    """SpiNNaker's exponential neurons; return how many slots were saturated and values wrapped.

    The input of a tick stays in g until the next tick decays it, which is the same as decaying at the end of a tick.
    """
    saturated = 0
    wraps = 0
    for k in range(v.size):
        i = first + k
        saturated += (exc[k] > SLOT) + (inh[k] > SLOT)
        slot_exc = np.int64(min(exc[k], SLOT)) << shift_exc
        slot_inh = np.int64(min(inh[k], SLOT)) << shift_inh
        exc[k] = 0
        inh[k] = 0
        full_exc = decayed(g_exc[k], r.exc_decay[i]) + decayed(slot_exc, r.exc_init[i])
        full_inh = decayed(g_inh[k], r.inh_decay[i]) + decayed(slot_inh, r.inh_init[i])
        ge, gi = i32(full_exc), i32(full_inh)
        wraps += (ge != full_exc) | (gi != full_inh)
        g_exc[k] = ge
        g_inh[k] = gi
        fired[k] = 0
        if hold[k] > 0:
            hold[k] -= 1
            fired[k] = v[k] >= r.threshold[i]
            continue
        drive = np.int64(ge) - np.int64(gi) + np.int64(r.bias[i])
        alpha = product(i32(drive), r.r_m[i]) + np.int64(r.v_rest[i])
        gap = np.int64(i32(alpha)) - np.int64(v[k])
        now = np.int64(i32(alpha)) - product(r.keep_v[i], i32(gap))
        wraps += (i32(drive) != drive) | (i32(alpha) != alpha) | (i32(gap) != gap) | (i32(now) != now)
        v[k] = i32(now)
        fired[k] = v[k] >= r.threshold[i]
    return saturated, wraps


@inner
def step_delta(exc, inh, v, hold, r, first, shift_exc, shift_inh, fired):
    """Delta-input neurons in SpiNNaker's arithmetic; return how many slots were saturated and values wrapped."""
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
        above = np.int64(v[k]) - np.int64(r.v_rest[i])
        now = np.int64(r.v_rest[i]) + product(i32(above), r.keep_v[i]) + np.int64(r.bias[i]) + x
        wraps += (i32(above) != above) | (i32(now) != now)
        v[k] = i32(now)
        fired[k] = v[k] >= r.threshold[i]
    return saturated, wraps
