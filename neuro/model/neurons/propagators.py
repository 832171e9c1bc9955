"""Exact integration of a leaky membrane driven by exponential and alpha-shaped currents.

Source: Rotter & Diesmann, Biol. Cybern. 81:381, 1999; NEST 3.10, `libnestutil/iaf_propagator.h`.
An infinite `tau_m` means no leak.

In h ms the membrane decays by e^-a and the current by e^-b, with a = h / tau_m and b = h / tau_syn. A current of 1 pA
at the beginning adds h / C_m e^-min(a, b) m to the membrane potential. Here m is the mean of e^(z s) over s in 0..1,
and z = -|a - b|. This form does not overflow for large h. The textbook formula divides a difference of e^-a and e^-b by
a - b, so it loses digits when a and b are nearly equal; this form does not. Gradients of tensors flow through both
branches of a condition. Therefore no branch divides 0 by 0, even for arguments that select the other branch.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Resting

NEARLY_0 = 1e-100
"""Smallest |z| that is used, in place of 0. For numbers this small e^z - 1 equals z in double precision."""

SERIES_TERMS = 15
"""Number of terms of the series. For |z| up to 1/2 the last term is below the precision of a double."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaky(Resting):
    """Base of the neurons with a leaky membrane that is reset and refractory after a spike."""

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, infinite=True, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_reset: Value = quantity(-70.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold", arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeakyWithCurrents(Leaky):
    """Base of the leaky neurons with two synaptic currents that decay exponentially."""

    weight_unit: ClassVar[str] = "pA"
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)


FALL = "whether a spike reduces V_m by V_th - V_reset instead of setting it to V_reset"
"""Description of the parameter `reset_by_subtraction`."""


def check_fall(model, parameters):
    """Raise an error if parameters need a reset by subtraction and it is off. `model` is the name of the model."""
    subtracts = np.any(parameters.get("reset_by_subtraction", 0.0) != 0.0)
    has_several = np.any(parameters.get("max_spikes", 1.0) != 1.0)
    if has_several and not subtracts:
        raise ModelError("max_spikes above 1: expected reset_by_subtraction: true", path=(model, "max_spikes"))

    if np.any(parameters.get("threshold_rises", 0.0) != 0.0) and (has_several or not subtracts):
        message = "threshold_rises: expected reset_by_subtraction: true, and max_spikes: 1"
        raise ModelError(message, path=(model, "threshold_rises"))


def fall_of(subtracts, v_th, v_reset):
    """Return the reduction of V_m by a spike in mV, or 0 for a reset to V_reset."""
    return v_th - v_reset if subtracts != 0.0 else 0.0


def spikes_in(v, v_th, fall, most):
    """Return the number of spikes in a step, at most `most`, if each spike reduces V_m by `fall` mV."""
    count = 0
    while v >= v_th and count < most:
        v -= fall
        count += 1
    return count


def after_spike(v, v_th, v_reset, fall, most):
    """Return V_m after the spikes of a step. A `fall` of 0 stands for a reset to V_reset."""
    return v_reset if fall == 0.0 else v - fall * spikes_in(v, v_th, fall, most)


def leak(tau_m, h):
    """Return the share of V_m - E_L that remains after h ms."""
    return 0.0 if tau_m == 0.0 else math.exp(-h / tau_m)


def from_constant(tau_m, c_m, h):
    """Return the potential in mV after h ms for a constant current of 1 pA."""
    if math.isinf(tau_m):
        return h / c_m
    return -tau_m / c_m * math.expm1(-h / tau_m)


def from_exponential(tau_m, tau_syn, c_m, h):
    """Return the potential in mV after h ms for a current of 1 pA that decays with tau_syn."""
    a, b = h / tau_m, h / tau_syn
    return h / c_m * math.exp(-min(a, b)) * mean_decay(-abs(a - b))


def from_alpha(tau_m, tau_syn, c_m, h):
    """Return the potential in mV after h ms for the current t exp(-t / tau_syn) pA, t from 0 ms."""
    a, b = h / tau_m, h / tau_syn
    z = -abs(a - b)
    mean = mean_decay_weighted_late(z) if a < b else mean_decay_weighted_early(z)
    return h * h / c_m * math.exp(-min(a, b)) * mean


def mean_decay(z):
    """Return the mean of e^(z s) over s in 0..1, z <= 0."""
    z = min(z, -NEARLY_0)
    return math.expm1(z) / z


def mean_decay_weighted_late(z):
    """Return the mean of s e^(z s) over s in 0..1, z <= 0."""
    if z < -0.5:
        nonzero = min(z, -0.5)
        return (1.0 - (1.0 - nonzero) * math.exp(nonzero)) / (nonzero * nonzero)
    return mean_decay(z) - mean_decay_weighted_early(z)


def mean_decay_weighted_early(z):
    """Return the mean of (1 - s) e^(z s) over s in 0..1, z <= 0."""
    if z < -0.5:
        nonzero = min(z, -0.5)
        return (math.expm1(nonzero) - nonzero) / (nonzero * nonzero)
    total = term = 0.5
    for k in range(3, 3 + SERIES_TERMS):
        term *= z / k
        total += term
    return total


def highest(v, e_l, gain, drive):
    """Return an upper bound of V_m in mV without input. V_m relaxes from `v` to `e_l + gain * drive` without overshoot.

    `gain` is tau_m / C_m in mV/pA, which is infinite without a leak. `drive` is a constant current in pA.
    """
    if math.isinf(gain):
        return v if drive <= 0.0 else math.inf
    return max(v, e_l + gain * drive)
