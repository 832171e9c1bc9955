"""The exact integration of neurons, beside its formulas in 60 digits."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import pytest
from hypothesis import given, strategies as some

import neuro
from neuro.model.neurons.propagators import from_alpha, from_constant, from_exponential

C_M = 250.0
taus = some.floats(0.05, 500.0)
steps = some.sampled_from([0.05, 0.1, 1.0, 16.0, 1e3, 1e5])


def exact(tau_m: float, tau_syn: float, h: float) -> tuple[float, float]:
    """Response to an exponential and to an alpha current, in closed form where the time constants differ."""
    with localcontext() as context:
        context.prec = 60
        m, s, t, c = (Decimal(x) for x in (tau_m, tau_syn, h, C_M))
        if m == s:
            return float(t / c * (-t / m).exp()), float(t * t / 2 / c * (-t / m).exp())
        a, b = t / m, t / s
        exponential = t / c * ((-b).exp() - (-a).exp()) / (a - b)
        alpha = t * t / c * ((-a).exp() + (a - b - 1) * (-b).exp()) / (a - b) ** 2
        return float(exponential), float(alpha)


def assert_exact(tau_m: float, tau_syn: float, h: float) -> None:
    found = from_exponential(tau_m, tau_syn, C_M, h), from_alpha(tau_m, tau_syn, C_M, h)
    lost = 1.0 + h / max(tau_m, tau_syn)  # e^-x has the rounding of x
    assert found == pytest.approx(exact(tau_m, tau_syn, h), rel=5e-15 * lost, abs=1e-290)


@given(taus, taus, steps)
def test_propagators_are_exact(tau_m, tau_syn, h):
    assert_exact(tau_m, tau_syn, h)


@given(taus, some.integers(1, 17), some.sampled_from([-1.0, 1.0]), steps)
def test_propagators_are_exact_where_time_constants_nearly_equal(tau_m, digits, sign, h):
    assert_exact(tau_m, tau_m * (1.0 + sign * 10.0**-digits), h)


@given(taus, steps)
def test_without_leak_all_charge_stays(tau_syn, h):
    late = from_exponential(math.inf, tau_syn, C_M, 1e9), from_alpha(math.inf, tau_syn, C_M, 1e9)
    assert late == pytest.approx((tau_syn / C_M, tau_syn * tau_syn / C_M), rel=1e-12)
    assert from_constant(math.inf, C_M, h) == h / C_M
    with_leak = from_exponential(1e12, tau_syn, C_M, h), from_alpha(1e12, tau_syn, C_M, h)
    without = from_exponential(math.inf, tau_syn, C_M, h), from_alpha(math.inf, tau_syn, C_M, h)
    assert with_leak == pytest.approx(without, rel=1e-5)


@pytest.mark.parametrize("off", [1e-9, -1e-10, 1e-11, -1e-12, 1e-13])
def test_alpha_with_nearly_equal_time_constants_is_that_with_equal_ones(off):
    def potential(tau_syn: float) -> float:
        net = neuro.Network("near", resolution=0.1)
        drive = net.population("drive", 1, neuro.spike_generator(spike_times=[[1.0, 3.0, 4.0]]))
        cells = net.population("cells", 1, neuro.iaf_psc_alpha(tau_syn_ex=tau_syn))
        net.connect(drive, cells, neuro.one_to_one(), weight=300.0, delay=1.0)
        sim = neuro.compile(net, backend="reference")
        sim.run(15.0)
        return float(sim.get("cells", "V_m")[0])

    assert potential(10.0 + off) == pytest.approx(potential(10.0), abs=1e-9)
