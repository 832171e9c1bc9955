"""Exact integration of a leaky membrane driven by exponential and alpha currents.

Source: Rotter & Diesmann, Biol. Cybern. 81:381, 1999; NEST 3.10, `libnestutil/iaf_propagator.h`.
An infinite `tau_m` means no leak.
"""

# mypy: disable-error-code="no-untyped-def"
import math


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
    if tau_syn == tau_m:
        return h / c_m * math.exp(-h / tau_m)
    beta = tau_syn if math.isinf(tau_m) else tau_syn * tau_m / (tau_m - tau_syn)
    return beta / c_m * math.exp(-h / tau_syn) * math.expm1(h / beta)


def from_alpha(tau_m, tau_syn, c_m, h):
    """Potential in mV after h ms for the current t exp(-t / tau_syn) pA, t from 0 ms."""
    if tau_syn == tau_m:
        return 0.5 * h * h / c_m * math.exp(-h / tau_m)
    beta = tau_syn if math.isinf(tau_m) else tau_syn * tau_m / (tau_m - tau_syn)
    return beta / c_m * math.exp(-h / tau_syn) * (beta * math.expm1(h / beta) - h)
