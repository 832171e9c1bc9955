"""Learning of values and actions by a temporal-difference error."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Trace


@dataclass(frozen=True, kw_only=True, eq=False)
class td_ltp(Modulated):
    """The weight moves with the error n along what the synapse gave to recent spikes of its post neuron.

    At a post spike it gave eps: the potential, of peak below 1, by the pre spikes since the post spike before. The
    eligibility z is eps smoothed by kappa, a difference of exponentials of area 1. A signal sets n, which stays until
    it is set again. `tau_m` and `tau_s` are best those of the neuron (tau_m and tau_syn_ex of `srm0`), and `tau_kappa`
    and `tau_rise` those by which the critic reads its rate. Integration is exact; the weight is within Wmin and Wmax
    at all times.

    Source: Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013 (TD-LTP).
    """

    equation: ClassVar[str] = (
        "w' = eta n z; z = (eps at post spikes) * kappa, "
        "eps(t) = exp(-t/tau_m) - exp(-t/tau_s) summed over the pre spikes since the last post spike, "
        "kappa(t) = (exp(-t/tau_kappa) - exp(-t/tau_rise)) / (tau_kappa - tau_rise)"
    )
    source: ClassVar[str] = "Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_m"), Trace("tau_s"))
    post: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("tau_rise", "tau_kappa"), ("Wmin", "Wmax"))
    states: ClassVar[tuple[State, ...]] = (
        State("z", "1/ms", "eligibility trace"),
        State("rise", "1/ms", "the part of kappa that fades with tau_rise", hidden=True),
        State("m", "", "pre trace of tau_m just after the last post spike", hidden=True),
        State("s", "", "pre trace of tau_s just after the last post spike", hidden=True),
    )

    tau_m: float = quantity(20.0, "ms", "time constant of the membrane", above=0)
    tau_s: float = quantity(5.0, "ms", "time constant of the synaptic current, shorter", above=0)
    tau_kappa: float = quantity(200.0, "ms", "time constant of the eligibility", above=0)
    tau_rise: float = quantity(50.0, "ms", "time constant of its rise, shorter", above=0)
    eta: float = quantity(1.0, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)


TAU_M, TAU_S, TAU_KAPPA, TAU_RISE, ETA, W_MIN, W_MAX, H = range(8)
WEIGHT, Z, RISE, M, S = range(5)


def constants(p, h, c):
    """The parameters and the step."""
    c[:H] = p[:H]
    c[H] = h


def on_post(y, e, c, pre, post):
    """What the pre spikes since the last post spike gave begins to be eligible; z itself is continuous."""
    m = pre[0] - y[M, e] * math.exp(-post[0] / c[TAU_M])
    s = pre[1] - y[S, e] * math.exp(-post[0] / c[TAU_S])
    y[RISE, e] += (m - s) / (c[TAU_KAPPA] - c[TAU_RISE])
    y[M, e], y[S, e] = pre[0], pre[1]


def on_pre(y, e, c, pre, post):
    """Nothing is learnt; the traces remember."""


def advance(y, e, c, begin, end, n, grid):
    """Integrate from step `begin` to `end`; z is never below 0, so w moves one way and is clipped at the end."""
    passed, rise = (end - begin) * c[H], y[RISE, e]
    decay, fall = y[Z, e] + rise, rise
    lost, risen = math.expm1(-passed / c[TAU_KAPPA]), math.expm1(-passed / c[TAU_RISE])
    moved = c[ETA] * n * (fall * c[TAU_RISE] * risen - decay * c[TAU_KAPPA] * lost)
    y[WEIGHT, e] = min(max(y[WEIGHT, e] + moved, c[W_MIN]), c[W_MAX])
    y[RISE, e] = rise * (1.0 + risen)
    y[Z, e] = decay * (1.0 + lost) - y[RISE, e]
