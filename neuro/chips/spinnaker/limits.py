"""What SpiNNaker's programs cannot be or do: each limit told with what is needed and the way out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from neuro.chips.quantising.inputs import Inputs, refused, too_long, too_short
from neuro.model.neurons import iaf_psc_delta
from neuro.program.backend import Problem
from neuro.program.program import Floats

ONE = 32768
"""1.0 in s16.15."""

SLOT = 65535
LARGEST = 2**31 - 1
FRACTION = 2.0**32
LARGEST_SHIFT = 15


def lacking(inputs: Inputs) -> Iterator[Problem]:
    """All that the chip's programs lack of a population."""
    part, p, h = inputs.part, inputs.part.parameters, inputs.program.resolution
    told, delta = f"population '{part.name}'", isinstance(inputs.part.model, iaf_psc_delta)
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in p:
            yield from too_short(part, name, h)
    if np.isinf(p["tau_m"]).any() and not delta:
        what, why = f"{told}: tau_m = inf", "the membrane resistance tau_m / C_m would be infinite"
        yield refused(part.origin, what, why, "use a finite tau_m, or iaf_psc_delta")
    yield from too_long(part, "tau_m", h, -h / np.log1p(-1.0 / ONE), "a decay of 15 bits", delta)
    ticks = float(p["t_ref"].max()) / h
    if ticks > LARGEST:
        what, why = (
            f"{told}: t_ref = {p['t_ref'].max():g} ms",
            f"{ticks:g} ticks, and t_refract holds at most {LARGEST}",
        )
        yield refused(part.origin, what, why, f"use at most {LARGEST * h:g} ms")
    if "V_min" in p and np.isfinite(p["V_min"]).any():
        what = f"{told}: V_min = {p['V_min'].max():g} mV"
        yield refused(part.origin, what, "the chip's programs have no lowest potential", "leave V_min out")
    if p.get("refractory_input", np.zeros(1)).any():
        why = "the chip's programs lose input while a neuron is refractory"
        yield refused(part.origin, f"{told}: refractory_input", why, "leave it out")


def other_receptor(inputs: Inputs, index: int) -> Iterator[Problem]:
    """Why a projection cannot name its receptor: it is not the one that the signs of its weights choose."""
    part = inputs.program.projections[index]
    if part.receptor is not None and not part.as_by_sign(part.weight):
        yield refused(
            part.origin,
            f"projection '{part.name}': receptor '{part.receptor.name}' by name",
            "slots have no sign: what is excitatory is added, what is inhibitory subtracted",
            "use weights of at least 0 onto 'ex' and of at most 0 onto 'in', or run it on event",
        )


def overflows(inputs: Inputs, initial: Mapping[str, Floats], drive: Floats) -> Iterator[Problem]:
    """Numbers that s16.15 does not hold.

    Args:
        inputs: the population.
        initial: its state registers at step 0.
        drive: units of a constant current per pA.
    """
    part, p = inputs.part, inputs.part.parameters
    current = np.abs(p["I_e"]) + inputs.current
    held = [(f"{name} = {_largest(p[name]):g} mV", p[name] * ONE) for name in ("E_L", "V_reset", "V_th")]
    held.append((f"V_m = {_largest(part.initial['V_m']):g} mV at step 0", initial["v"]))
    if "tau_syn_ex" in p and np.isfinite(p["tau_m"]).all():
        resistance = p["tau_m"] / p["C_m"] * 1000.0
        held.append((f"tau_m / C_m = {_largest(resistance):g} MOhm", resistance * ONE))
    held.append((f"a constant current of {_largest(current):g} pA", current * drive))
    for name, register in (("I_syn_ex", "g_exc"), ("I_syn_in", "g_inh")):
        if register in initial:
            held.append((f"{name} = {_largest(part.initial[name]):g} pA at step 0", initial[register]))
    for what, values in held:
        if np.abs(values).max(initial=0.0) > LARGEST:
            units = float(np.abs(values).max()) / ONE
            why = f"it takes {units:.6g} in s16.15, which holds numbers below 65536"
            yield refused(part.origin, f"population '{part.name}': {what}", why, "scale the model down")


def _largest(values: Floats) -> float:
    return float(values.flat[int(np.argmax(np.abs(values)))])
