"""The integration of weights under dopamine, beside its formula in 60 digits."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, strategies as some

from neuro import stdp_dopa
from neuro.model.synapses import modulated

ELIGIBILITY = 3.0
rule = stdp_dopa.arithmetic
taus = some.floats(1.0, 5000.0)


def exact(h: float, steps: int, tau_c: float, tau_n: float, n: float, b: float) -> tuple[float, float, float]:
    """The change of w under ELIGIBILITY by n and by b, and n at the end."""
    with localcontext() as context:
        context.prec = 60
        passed, c, d = (Decimal(x) for x in (steps * h, tau_c, tau_n))
        both = c * d / (c + d)
        by_n = Decimal(n) * both * (1 - (-passed / both).exp())
        by_b = Decimal(b) * c * (1 - (-passed / c).exp())
        gain = Decimal(ELIGIBILITY) * by_n, Decimal(ELIGIBILITY) * by_b
        return float(gain[0]), float(gain[1]), float(Decimal(n) * (-passed / d).exp())


@given(some.sampled_from([0.05, 0.1, 1.0]), some.integers(0, 3000), taus, taus, some.sampled_from([0.0, 0.3]))
def test_the_weight_moves_exactly_however_short_the_time(h, steps, tau_c, tau_n, b):
    n = 0.7
    constants, state = np.zeros(stdp_dopa.width), np.array([[0.0], [ELIGIBILITY]])
    rule.constants(np.array([20.0, 1.0, 1.5, tau_c, tau_n, b, -1e9, 1e9, 1.0, -np.inf]), h, constants)
    left = modulated.drift(state, 0, constants, steps, n)
    by_n, by_b, expected = exact(h, steps, tau_c, tau_n, n, b)
    lost = 1.0 + steps * h / min(tau_c, tau_n)  # e^-x has the rounding of x
    assert state[0, 0] == pytest.approx(by_n - by_b, rel=0, abs=2e-15 * lost * (by_n + by_b))
    assert left == pytest.approx(expected, rel=2e-15 * lost)
