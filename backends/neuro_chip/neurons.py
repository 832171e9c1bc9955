"""One step of each kind of neuron, in integers. The loops have no branches, so that they run many neurons at a time."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner

I = np.int32
V_LIMIT = I(2**23 - 1)
ZERO, ONE, SIX, EIGHT, TWELVE, LOW, SIGN = I(0), I(1), I(6), I(8), I(12), I(4095), I(31)
SLOT = I(65535)
FIFTEEN, THIRTY_TWO = np.int64(15), np.int64(32)


@inner
def kept(value, share):
    """Value x share / 4096, truncated towards 0; numba widens each operation, so each is cut back to 32 bits.

    |a| f / 4096 is (|a| >> 12) f + ((|a| & 4095) f >> 12): no product leaves 32 bits.
    """
    sign = I(value >> SIGN)
    a = I(I(value ^ sign) - sign)
    high = I(I(a >> TWELVE) * share)
    low = I(I(I(a & LOW) * share) >> TWELVE)
    return I(I(I(high + low) ^ sign) - sign)


@inner
def step_loihi(x, v, u, hold, keep_u, keep_v, threshold, bias, fired):
    """Loihi 1's compartments; return how many currents wrapped and voltages were clipped."""
    wraps = ZERO
    clips = ZERO
    for i in range(v.size):
        full = I(kept(u[i], keep_u[i]) + I(x[i] << SIX))
        now = I(I(full << EIGHT) >> EIGHT)
        w = I(I(kept(v[i], keep_v[i]) + now) + bias[i])
        clipped = I(min(max(w, I(-V_LIMIT)), V_LIMIT))
        free = I(hold[i] == ZERO)
        wraps = I(wraps + I(now != full))
        clips = I(clips + I(free & I(clipped != w)))
        clipped = I(clipped * free)
        x[i] = ZERO
        u[i] = now
        v[i] = clipped
        hold[i] = I(hold[i] - I(ONE - free))
        fired[i] = np.uint8(free & I(clipped > threshold[i]))
    return wraps, clips


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
        ge = I(decayed(g_exc[k], r.exc_decay[i]) + decayed(slot_exc, r.exc_init[i]))
        gi = I(decayed(g_inh[k], r.inh_decay[i]) + decayed(slot_inh, r.inh_init[i]))
        g_exc[k] = ge
        g_inh[k] = gi
        fired[k] = 0
        if hold[k] > 0:
            hold[k] -= 1
            fired[k] = v[k] >= r.threshold[i]
            continue
        drive = np.int64(ge) - np.int64(gi) + np.int64(r.bias[i])
        alpha = product(I(drive), r.r_m[i]) + np.int64(r.v_rest[i])
        gap = np.int64(I(alpha)) - np.int64(v[k])
        now = np.int64(I(alpha)) - product(r.keep_v[i], I(gap))
        wraps += (I(drive) != drive) | (I(alpha) != alpha) | (I(gap) != gap) | (I(now) != now)
        v[k] = I(now)
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
        now = np.int64(r.v_rest[i]) + product(I(above), r.keep_v[i]) + np.int64(r.bias[i]) + x
        wraps += (I(above) != above) | (I(now) != now)
        v[k] = I(now)
        fired[k] = v[k] >= r.threshold[i]
    return saturated, wraps
