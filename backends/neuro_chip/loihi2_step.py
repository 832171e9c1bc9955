"""Loihi 2's neurons in the engine: arrays of registers, and integer steps without branches."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import subkernel
from neuro.program.program import Ints
from neuro_chip import tables as t
from neuro_chip.loihi_step import EIGHT, ONE, SIX, V_LIMIT, ZERO, i32, multiplied
from neuro_chip.tables import Arrays

TURN = i32(2**23)
"""Largest current of lava, whose currents wrap to (-2^23, 2^23]."""


@subkernel
def arrivals(net, row, step):
    """Add the input of this step from all planes of a population to the population's ring.

    A plane is the ring of a projection whose sums are shifted or wrapped before they are added.

    Returns:
        Index in `net.ring` of the step's input to the first neuron.
    """
    n = row[t.END] - row[t.BEGIN]
    slot = (step & (row[t.SLOTS] - 1)) * n
    begin = row[t.RING] + slot
    add_planes(net, row[t.PLANES], row[t.PLANES_END], slot, n, 0, begin)
    return begin


@subkernel
def second_arrivals(net, row, step):
    """Add the input of this step to the second receptor from all its planes to the first plane of the population.

    Returns:
        Index in `net.ring` of the step's input to the first neuron.
    """
    n = row[t.END] - row[t.BEGIN]
    slot = (step & (row[t.SLOTS] - 1)) * n
    begin = net.planes[row[t.PLANES], t.PLANE_RING] + slot
    add_planes(net, row[t.PLANES] + 1, row[t.PLANES_END], slot, n, 1, begin)
    return begin


@subkernel
def add_planes(net, first, last, slot, n, receptor, begin):
    """Add the planes of a receptor to the n slots from `begin` on."""
    for p in range(first, last):
        if net.planes[p, t.PLANE_RECEPTOR] == receptor:
            place = net.planes[p, t.PLANE_RING] + slot
            add_plane(
                net.ring[begin : begin + n],
                net.ring[place : place + n],
                i32(net.planes[p, t.PLANE_SHIFT]),
                i32(8 if net.planes[p, t.PLANE_WRAPS] else 0),
            )


@subkernel
def add_plane(slots, sums, shift, lost):
    """Add sums to slots and clear the sums. Before, each sum loses its `lost` upper bits and is shifted down."""
    for k in range(slots.size):
        slots[k] = i32(slots[k] + i32(i32(i32(sums[k] << lost) >> lost) >> shift))
        sums[k] = ZERO


@subkernel
def integrate(net, pop, row, step):
    """Update the current and the voltage of a population."""
    lo, hi = row[t.BEGIN], row[t.END]
    begin = arrivals(net, row, step)
    if row[t.INTERVAL] > 0 and (step - row[t.OFFSET]) % row[t.INTERVAL] == 0:
        net.v[lo:hi] = 0
        net.u[lo:hi] = 0
    wraps, clips = step_loihi2(
        net.ring[begin : begin + hi - lo],
        net.v[lo:hi],
        net.u[lo:hi],
        net.keep_u[lo:hi],
        net.keep_v[lo:hi],
        net.bias[lo:hi],
    )
    net.native[pop, t.WRAPS] += wraps
    net.native[pop, t.CLIPS] += clips


@subkernel
def step_loihi2(x, v, u, keep_u, keep_v, bias):
    """Update currents and voltages; return the numbers of wrapped currents and of clipped voltages."""
    wraps = ZERO
    clips = ZERO
    for i in range(v.size):
        full = i32(multiplied(u[i], keep_u[i]) + i32(x[i] << SIX))
        wrapped = i32(i32(full << EIGHT) >> EIGHT)
        # lava wraps to (-2^23, 2^23]; a two's complement has -2^23 instead of 2^23.
        wrapped = TURN if wrapped == i32(-TURN) else wrapped
        w = i32(i32(multiplied(v[i], keep_v[i]) + wrapped) + bias[i])
        clipped = i32(min(max(w, i32(-V_LIMIT)), V_LIMIT))
        wraps = i32(wraps + i32(wrapped != full))
        clips = i32(clips + i32(clipped != w))
        x[i] = ZERO
        u[i] = wrapped
        v[i] = clipped
    return wraps, clips


@subkernel
def lif(net, pop, row, step):
    """Step a population; `fired` marks the neurons above threshold."""
    integrate(net, pop, row, step)
    for i in range(row[t.BEGIN], row[t.END]):
        net.fired[i] = np.uint8(net.v[i] > net.threshold[i])


@subkernel
def ternary_lif(net, pop, row, step):
    """Step a population; neurons above the upper or below the lower threshold send their sign and are reset."""
    integrate(net, pop, row, step)
    for i in range(row[t.BEGIN], row[t.END]):
        sign = i32(i32(net.v[i] > net.threshold[i]) - i32(net.v[i] < net.v_rest[i]))
        net.payload[i] = sign
        net.fired[i] = np.uint8(sign != ZERO)
        net.v[i] = net.v[i] if sign == ZERO else ZERO


@subkernel
def encode(net, row, i, y):
    """Send the change of a value to y, if the change is large enough."""
    # `u` is the old value, `g_inh` the residue, `hold` the sum of changes.
    delta = i32(i32(y - net.u[i]) + net.g_inh[i])
    error = i32(net.hold[i] + delta) if row[t.CUMULATIVE] else delta
    out = delta if i32(abs(error)) >= net.threshold[i] else ZERO
    if row[t.CUMULATIVE]:
        net.hold[i] = error if out == ZERO else ZERO
    net.g_inh[i] = i32(delta - out)
    net.u[i] = y
    send(net, i, i32(out >> i32(row[t.STATE_EXP])))


@subkernel
def send(net, i, payload):
    """Let a neuron send a payload, unless it is 0."""
    net.payload[i] = payload
    net.fired[i] = np.uint8(payload != ZERO)


@subkernel
def sigma_delta(net, pop, row, step):
    """Sum the messages, apply the activation function, and send its changes."""
    begin, lo = arrivals(net, row, step), row[t.BEGIN]
    for i in range(lo, row[t.END]):
        net.v[i] = i32(net.v[i] + net.ring[begin + i - lo])
        net.ring[begin + i - lo] = ZERO
        y = i32(net.v[i] + net.bias[i])
        encode(net, row, i, max(y, ZERO) if row[t.RELU] else y)


@subkernel
def delta_encoder(net, pop, row, step):
    """Send the changes of the input."""
    begin, lo = arrivals(net, row, step), row[t.BEGIN]
    for i in range(lo, row[t.END]):
        y = i32(net.ring[begin + i - lo] << i32(row[t.INPUT_EXP]))
        net.ring[begin + i - lo] = ZERO
        encode(net, row, i, y)


@subkernel
def sigma_decoder(net, pop, row, step):
    """Sum the messages, and send the sum."""
    begin, lo = arrivals(net, row, step), row[t.BEGIN]
    for i in range(lo, row[t.END]):
        net.v[i] = i32(net.v[i] + net.ring[begin + i - lo])
        net.ring[begin + i - lo] = ZERO
        send(net, i, net.v[i])


@subkernel
def graded_vector(net, pop, row, step):
    """Send the input if it exceeds the threshold."""
    begin, lo = arrivals(net, row, step), row[t.BEGIN]
    for i in range(lo, row[t.END]):
        a = net.ring[begin + i - lo]
        net.ring[begin + i - lo] = ZERO
        send(net, i, a if (a if row[t.RELU] else i32(abs(a))) > net.threshold[i] else ZERO)


@subkernel
def share(value, factor):
    """Return value x factor / 4096, truncated towards 0, for factors of either sign."""
    part = multiplied(value, i32(abs(factor)))
    return part if factor >= ZERO else i32(-part)


@subkernel
def product(net, pop, row, step):
    """Send the product of the inputs of both receptors, shifted down, if it exceeds the threshold."""
    first, second, lo = arrivals(net, row, step), second_arrivals(net, row, step), row[t.BEGIN]
    for i in range(lo, row[t.END]):
        k = i - lo
        a = i32(i32(net.ring[first + k] * net.ring[second + k]) >> i32(row[t.INPUT_EXP]))
        net.ring[first + k] = ZERO
        net.ring[second + k] = ZERO
        send(net, i, a if i32(abs(a)) > net.threshold[i] else ZERO)


@subkernel
def resonate(net, pop, row, step):
    """Rotate the states of resonators: `v` is real, `u` imaginary, and `hold` gets the old imaginary part."""
    first, second, lo = arrivals(net, row, step), second_arrivals(net, row, step), row[t.BEGIN]
    exponent = i32(row[t.STATE_EXP])
    clips = ZERO
    for i in range(lo, row[t.END]):
        re, im, k = net.v[i], net.u[i], i - lo
        rotated = i32(share(re, net.keep_u[i]) - share(im, net.keep_v[i]))
        x = np.int64(rotated) + np.int64(i32(net.ring[first + k] << exponent))
        rotated = i32(share(re, net.keep_v[i]) + share(im, net.keep_u[i]))
        y = np.int64(rotated) + np.int64(i32(net.ring[second + k] << exponent))
        net.ring[first + k] = ZERO
        net.ring[second + k] = ZERO
        net.hold[i] = im
        net.v[i] = i32(min(max(x, np.int64(-V_LIMIT)), np.int64(V_LIMIT)))
        net.u[i] = i32(min(max(y, np.int64(-V_LIMIT)), np.int64(V_LIMIT)))
        clips = i32(clips + i32(net.v[i] != x) + i32(net.u[i] != y))
    net.native[pop, t.CLIPS] += clips


@subkernel
def rf(net, pop, row, step):
    """Step resonators that fire when their phase passes 0."""
    resonate(net, pop, row, step)
    for i in range(row[t.BEGIN], row[t.END]):
        send(net, i, i32(net.v[i] >= net.threshold[i]) & i32(net.u[i] >= ZERO) & i32(net.hold[i] < ZERO))


@subkernel
def rf_iz(net, pop, row, step):
    """Step resonators that fire at a threshold of their imaginary part, and are reset."""
    resonate(net, pop, row, step)
    for i in range(row[t.BEGIN], row[t.END]):
        send(net, i, i32(net.u[i] >= net.threshold[i]))
        if net.fired[i]:
            net.v[i] = ZERO
            net.u[i] = i32(net.threshold[i] - ONE)


_COLUMNS = {
    "reset_interval": t.INTERVAL,
    "reset_offset": t.OFFSET,
    "state_exp": t.STATE_EXP,
    "relu": t.RELU,
    "cum_error": t.CUMULATIVE,
}
"""Registers that all neurons of a population share, with their columns in the table of populations."""


def write(a: Arrays, row: NDArray[np.int64], neurons: slice, r: Mapping[str, Ints]) -> None:
    """Write the registers `r` of a population to the arrays that its step reads, at the indices `neurons`."""
    for name, column in _COLUMNS.items():
        row[column] = int(r[name][0]) if name in r else 0
    row[t.INPUT_EXP] = sum(int(r[name][0]) for name in ("spike_exp", "state_exp", "exp") if name in r)
    if "du" in r:
        a["keep_u"][neurons] = 4095 - r["du"]
        a["keep_v"][neurons] = 4096 - r["dv"]
        a["threshold"][neurons] = r["vth_hi" if "vth_hi" in r else "vth"] * 64
        a["v_rest"][neurons] = r["vth_lo"] * 64 if "vth_lo" in r else 0
        a["bias"][neurons] = r["bias_mant"] << r["bias_exp"]
        return
    if "cos_decay" in r:
        a["keep_u"][neurons], a["keep_v"][neurons] = r["cos_decay"], r["sin_decay"]
        a["threshold"][neurons] = r["vth"]
        return
    for name, array in (("vth", "threshold"), ("bias", "bias")):
        a[array][neurons] = r.get(name, 0)


STEPS = {
    "loihi2_lif": lif,
    "loihi2_ternary_lif": ternary_lif,
    "loihi2_rf": rf,
    "loihi2_rf_iz": rf_iz,
    "sigma_delta": sigma_delta,
    "delta_encoder": delta_encoder,
    "sigma_decoder": sigma_decoder,
    "graded_vector": graded_vector,
    "graded_product": product,
}
"""The step of each kind of population."""
