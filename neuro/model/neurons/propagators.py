"""Exact integration of a leaky membrane driven by exponential and alpha currents.

Source: Rotter & Diesmann, Biol. Cybern. 81:381, 1999; NEST 3.10, `libnestutil/iaf_propagator.h`.
An infinite `tau_m` means no leak.

Over h the membrane decays by e^-a, the current by e^-b. What the current leaves on the membrane is the slower of the
two decays times a mean over s in 0..1 of e^(z s) with z = -|a - b|. Nothing overflows in it, however long h is, and it
is exact also where the two are nearly equal and the closed form is a difference of nearly equal numbers. Nothing
divides 0 by 0, not even on a way that is not taken: where tensors are neurons, gradients come from both.
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
"""So small that e^z - 1 is z in a double."""

SERIES_TERMS = 15
"""Enough for the last term to vanish in a double where |z| is at most 1/2."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaky(Resting):
    """The first parameters of neurons with a leaky membrane, which is reset and held after a spike."""

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, infinite=True, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_reset: Value = quantity(-70.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold", arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeakyWithCurrents(Leaky):
    """The parameters of those whose input goes into two currents that decay exponentially."""

    weight_unit: ClassVar[str] = "pA"
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "decay of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "decay of the inhibitory current", above=0, arrays=True)


FALL = "V_m falls by V_th - V_reset at a spike, instead of to V_reset"
"""What the parameter `reset_by_subtraction` means."""


def check_fall(model, parameters):
    """Refuse several spikes in a step of neurons that are reset to a value."""
    falls = np.any(parameters.get("reset_by_subtraction", 0.0) != 0.0)
    several = np.any(parameters.get("max_spikes", 1.0) != 1.0)
    if several and not falls:
        raise ModelError("max_spikes above 1: expected reset_by_subtraction: true", path=(model, "max_spikes"))
    if np.any(parameters.get("threshold_rises", 0.0) != 0.0) and (several or not falls):
        message = "threshold_rises: expected reset_by_subtraction: true, and max_spikes: 1"
        raise ModelError(message, path=(model, "threshold_rises"))


def fall_of(falls, v_th, v_reset):
    """How far V falls at a spike; 0: it goes to V_reset."""
    return v_th - v_reset if falls != 0.0 else 0.0


def spikes_in(v, v_th, fall, most):
    """How often V reaches the threshold in a step if it falls each time."""
    count = 0
    while v >= v_th and count < most:
        v -= fall
        count += 1
    return count


def after_spike(v, v_th, v_reset, fall, most):
    """V after the spikes of a step."""
    return v_reset if fall == 0.0 else v - fall * spikes_in(v, v_th, fall, most)


def leak(tau_m, h):
    """Share of V - E_L left after h ms."""
    return 0.0 if tau_m == 0.0 else math.exp(-h / tau_m)


def from_constant(tau_m, c_m, h):
    """Potential in mV after h ms for a constant current of 1 pA."""
    if math.isinf(tau_m):
        return h / c_m
    return -tau_m / c_m * math.expm1(-h / tau_m)


def from_exponential(tau_m, tau_syn, c_m, h):
    """Potential in mV after h ms for a current of 1 pA that decays with tau_syn."""
    a, b = h / tau_m, h / tau_syn
    return h / c_m * math.exp(-min(a, b)) * mean_decay(-abs(a - b))


def from_alpha(tau_m, tau_syn, c_m, h):
    """Potential in mV after h ms for the current t exp(-t / tau_syn) pA, t from 0 ms."""
    a, b = h / tau_m, h / tau_syn
    z = -abs(a - b)
    mean = mean_decay_weighted_late(z) if a < b else mean_decay_weighted_early(z)
    return h * h / c_m * math.exp(-min(a, b)) * mean


def mean_decay(z):
    """Mean of e^(z s) over s in 0..1, z <= 0."""
    z = min(z, -NEARLY_0)
    return math.expm1(z) / z


def mean_decay_weighted_late(z):
    """Mean of s e^(z s) over s in 0..1, z <= 0."""
    if z < -0.5:
        far = min(z, -0.5)
        return (1.0 - (1.0 - far) * math.exp(far)) / (far * far)
    return mean_decay(z) - mean_decay_weighted_early(z)


def mean_decay_weighted_early(z):
    """Mean of (1 - s) e^(z s) over s in 0..1, z <= 0."""
    if z < -0.5:
        far = min(z, -0.5)
        return (math.expm1(far) - far) / (far * far)
    total = term = 0.5
    for k in range(3, 3 + SERIES_TERMS):
        term *= z / k
        total += term
    return total


def highest(v, e_l, gain, drive):
    """A bound of V_m in mV while no input arrives: from `v` it goes towards e_l + gain drive, and not beyond.

    `gain` is tau_m / C_m in mV/pA, infinite without a leak, `drive` a constant current in pA.
    """
    if math.isinf(gain):
        return v if drive <= 0.0 else math.inf
    return max(v, e_l + gain * drive)
