"""Neurons that spike at random, with a rate or probability that depends on their potential."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, Resting, State
from neuro.model.neurons.currents import (
    E_L,
    I_E,
    I_EX,
    I_IN,
    P11_EX,
    P11_IN,
    P30,
    P32_EX,
    P32_IN,
    P33,
    REFRACTORY,
    STATES,
    V_M,
    V_TH,
    R,
    highest_with_currents,
    set_decays,
)
from neuro.model.neurons.propagators import from_constant, leak

ETA = 4
P, E_SFA = 1, 2
"""Rows of the states, in addition to those of `neuro.model.neurons.currents`."""

ETA_0, ETA_SUM, HAZARD, PER_DELTA_V = range(14, 18)
C_1, C_2, C_3, H, RESET, Q33, Q_SFA = range(8, 15)
"""Indices of the constants, in addition to those of `neuro.model.neurons.currents`."""

LARGEST = 500.0
"""Largest exponent of a rate. At e^500 per step a spike is certain, and the number does not overflow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class srm0(Resting):
    """Spike response model. V_m is the sum of the responses to received spikes and of the after-potential.

    A received spike adds its weight in pA to a current that decays exponentially: the excitatory current, or the
    inhibitory current if the weight is negative. An emitted spike adds -eta_0 exp(-t/tau_m) to V_m. By default this
    after-potential replaces that of the previous spike; with `eta_sum` the after-potentials of all spikes add up. A
    spike does not change V_m in any other way. The neuron spikes at most once in `t_ref`.

    With `lambda_0` above 0 the neuron has escape noise: it has no sharp threshold, but spikes at random at a rate that
    grows exponentially with V_m - V_th.

    Source: Gerstner & Kistler, Spiking Neuron Models, 2002, sections 4.2.3 and 5.3.
    """

    equation: ClassVar[str] = (
        "V_m = E_L + eta + (responses to I_syn_ex + I_syn_in + I); eta(t) = -eta_0 exp(-(t - t_spike)/tau_m); "
        "spike at V_m >= V_th, or where lambda_0 > 0 with probability 1 - exp(-h lambda_0 exp((V_m - V_th)/Delta_V))"
    )
    source: ClassVar[str] = "Gerstner & Kistler, Spiking Neuron Models, 2002, sections 4.2.3 and 5.3"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (*STATES, State("eta", "mV", "after-potential, a part of V_m"))
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True
    draws: ClassVar[bool] = True

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "shortest interval between two spikes", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold", arrays=True)
    eta_0: Value = quantity(15.0, "mV", "depth of the after-potential just after a spike", arrays=True)
    eta_sum: bool = quantity(
        False, "", "whether the after-potentials of all spikes add up, instead of the last only", kind="boolean"
    )
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)
    lambda_0: Value = quantity(0.0, "Hz", "rate of spikes at V_th; 0: sharp threshold", at_least=0, arrays=True)
    Delta_V: Value = quantity(2.0, "mV", "rise of V_m that increases the rate e-fold", above=0, arrays=True)

    @staticmethod
    def caution(parameters: Mapping[str, Any], resolution: float) -> str:
        """Warn about a current that keeps V_m above V_th in spite of the after-potential, so every step has a spike."""
        p = parameters
        only_last = (p["eta_sum"] == 0) & (p["lambda_0"] == 0) & (p["t_ref"] < resolution)
        overdrive = (
            p["E_L"] + p["I_e"] * p["tau_m"] / p["C_m"] - p["eta_0"] * np.exp(-resolution / p["tau_m"]) - p["V_th"]
        )
        if not np.any(only_last & (overdrive >= 0.0)):
            return ""
        return "I_e drives V_m beyond V_th + eta_0 and t_ref is 0, so it fires in every step: set t_ref or eta_sum"

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[V_TH], c[E_L], c[I_E], c[R] = p[5], p[4], p[8], round(p[3] / h)
        set_decays(c, h, p[1], p[2], p[9], p[10])
        c[ETA_0], c[ETA_SUM] = p[6], p[7]
        c[HAZARD], c[PER_DELTA_V] = p[11] * h / 1000.0, 1.0 / p[12]

    def step(s, c, x, i_0, lo, hi, fired, u):
        """Advance V_m with the currents before the step, then the currents, then test the threshold or draw."""
        v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
        p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
        hazard, per_delta_v = c[HAZARD], c[PER_DELTA_V]
        for i in range(lo, hi):
            i_ex, i_in = s[I_EX, i], s[I_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            s[V_M, i] = v
            s[I_EX, i] = i_ex * p11_ex + x[0, i]
            s[I_IN, i] = i_in * p11_in + x[1, i]
            s[ETA, i] *= p33
            free = s[REFRACTORY, i] == 0.0
            s[REFRACTORY, i] -= not free
            if hazard > 0.0:
                spikes = hazard * math.exp(min((v - v_th) * per_delta_v, LARGEST))
                fired[i] = free and u[i] < -math.expm1(-spikes)
            else:
                fired[i] = free and v >= v_th

    def fire(s, c, i):
        """Begin an after-potential, which replaces or is added to the last after-potential."""
        eta = s[ETA, i] * c[ETA_SUM] - c[ETA_0]
        s[V_M, i] += eta - s[ETA, i]
        s[ETA, i] = eta
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m cannot reach V_th and there is no escape noise."""
        if c[HAZARD] > 0.0:
            return False
        for i in range(lo, hi):
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < c[V_TH]:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class pp_psc_delta(Neuron):
    """Point process neuron. V_m integrates its input with a leak, and spikes are drawn at a rate that depends on V_m.

    Input changes V_m by its weight in mV. With V = V_m - E_sfa the rate in Hz is c_1 V + c_2 exp(c_3 V), or 0 if this
    sum is negative. After a spike the neuron is silent for `dead_time`, while V_m evolves. Each spike raises the
    threshold E_sfa by `q_sfa`, and E_sfa decays, so spikes become more regular. The state `p` is the probability of a
    spike in the last step, for learning rules that use it. NEST's lists of several adaptations and its random dead
    times are not supported.

    Source: NEST 3.10, `pp_psc_delta`; Gerstner & Kistler, Spiking Neuron Models, 2002, section 5.3.
    """

    equation: ClassVar[str] = (
        "V_m' = -V_m/tau_m + (I_e + I)/C_m + sum w delta(t - t_spike); E_sfa' = -E_sfa/tau_sfa, + q_sfa at a spike; "
        "spike with probability 1 - exp(-h max(0, c_1 V + c_2 exp(c_3 V))), V = V_m - E_sfa"
    )
    source: ClassVar[str] = "NEST 3.10 pp_psc_delta; Gerstner & Kistler, Spiking Neuron Models, 2002, section 5.3"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential, relative to rest"),
        State("p", "", "probability of a spike in the last step", follows=True),
        State("E_sfa", "mV", "adaptation of the threshold"),
        State("refractory", "steps", "remaining refractory steps", hidden=True),
    )
    draws: ClassVar[bool] = True

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    dead_time: Value = quantity(1.0, "ms", "dead time after a spike, at least a step", above=0, arrays=True)
    with_reset: bool = quantity(True, "", "whether a spike sets V_m to 0", kind="boolean")
    c_1: Value = quantity(0.0, "Hz/mV", "slope of the linear part of the rate", arrays=True)
    c_2: Value = quantity(1.238, "Hz", "factor of the exponential part of the rate", arrays=True)
    c_3: Value = quantity(0.25, "1/mV", "exponent of the exponential part", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_sfa: Value = quantity(34.0, "ms", "time constant of the adaptation", above=0, arrays=True)
    q_sfa: Value = quantity(0.0, "mV", "rise of the threshold per spike", arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[P33], c[P30], c[I_E] = leak(p[1], h), from_constant(p[1], p[2], h), p[8]
        c[C_1], c[C_2], c[C_3], c[H] = p[5], p[6], p[7], h / 1000.0
        c[R], c[RESET] = max(1.0, round(p[3] / h)), p[4]
        c[Q33], c[Q_SFA] = leak(p[9], h), p[10]

    def step(s, c, x, i_0, lo, hi, fired, u):
        """Advance V_m with its input, then draw. V_m also evolves during the dead time."""
        p33, p30, i_e, c_1, c_2, c_3, h = c[P33], c[P30], c[I_E], c[C_1], c[C_2], c[C_3], c[H]
        q33 = c[Q33]
        constant = c_3 == 0.0  # avoids an exponential
        for i in range(lo, hi):
            v = p30 * (i_0[i] + i_e) + p33 * s[V_M, i] + x[0, i]
            s[V_M, i] = v
            s[E_SFA, i] *= q33
            v -= s[E_SFA, i]
            free = s[REFRACTORY, i] == 0.0
            s[REFRACTORY, i] -= not free
            rate = c_1 * v + (c_2 if constant else c_2 * math.exp(min(c_3 * v, LARGEST)))
            p = -math.expm1(-rate * h) if free and rate > 0.0 else 0.0
            s[P, i] = p
            fired[i] = u[i] < p

    def fire(s, c, i):
        """Begin the dead time, raise the threshold, and reset V_m if `with_reset` is set."""
        s[REFRACTORY, i] = c[R]
        s[E_SFA, i] += c[Q_SFA]
        if c[RESET] != 0.0:
            s[V_M, i] = 0.0

    def quiet(s, c, i_0, lo, hi):
        """Return false, because a draw may cause a spike in any step."""
        return False


@dataclass(frozen=True, kw_only=True, eq=False)
class soft_wta(Neuron):
    """Neurons that compete softly. A spike to the receptor `ask` makes exactly one of its target neurons spike.

    Input to `ex` changes V_m by its weight in mV. V_m leaks towards 0 and is not reset. In a step with input to `ask`,
    the neurons with this input compete: neuron k spikes with the probability p_k = exp(V_k / Delta_V) /
    sum_j exp(V_j / Delta_V). Among point processes with rates exp(V / Delta_V), p_k is the probability to spike first.
    The state `p` is p_k in such a step, and 0 in other steps. Learning rules compare it with the spikes. A population
    is one circuit of at most 64 neurons.

    Source: Nessler, Pfeiffer, Buesing & Maass, PLoS Comput. Biol. 9:e1003037, 2013, eqs. 2 to 4.
    """

    equation: ClassVar[str] = (
        "V_m' = -V_m/tau_m + sum w delta(t - t_spike); at input to ask, one spike: p_k = exp(V_k/Delta_V) / sum_j "
        "exp(V_j/Delta_V)"
    )
    source: ClassVar[str] = "Nessler, Pfeiffer, Buesing & Maass, PLoS Comput. Biol. 9:e1003037, 2013"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential, relative to rest"),
        State("p", "", "probability of a spike in the last step", follows=True),
    )
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("ex", "ask")
    signed: ClassVar[bool] = False
    takes_current: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    draws: ClassVar[bool] = True
    most: ClassVar[int] = 64

    tau_m: float = quantity(10.0, "ms", "membrane time constant", above=0)
    Delta_V: float = quantity(1.0, "mV", "rise of V_m that makes a spike e times as likely", above=0)

    def constants(p, h, c):
        """Fill `c` for a step of h ms; `p` is tau_minus, tau_m, Delta_V."""
        c[P33], c[PER_DELTA_V] = leak(p[1], h), 1.0 / p[2]

    def step(s, c, x, i_0, lo, hi, fired, u):
        """Advance V_m with its input, then choose one of the neurons with input to `ask`."""
        p33, per_delta_v = c[P33], c[PER_DELTA_V]
        top, n_candidates = -math.inf, 0
        for i in range(lo, hi):
            s[V_M, i] = p33 * s[V_M, i] + x[0, i]
            s[P, i] = 0.0
            fired[i] = 0
            if x[1, i] > 0.0:
                top = max(top, s[V_M, i])
                n_candidates += 1
        if n_candidates == 0:
            return
        total = 0.0
        for i in range(lo, hi):
            if x[1, i] > 0.0:
                # Potentials relative to the largest one keep the exponential from overflowing.
                s[P, i] = math.exp((s[V_M, i] - top) * per_delta_v)
                total += s[P, i]
        # The random number of the first neuron decides. The numbers of the other neurons are not used.
        remaining, last = u[lo], lo
        is_chosen = False
        for i in range(lo, hi):
            if s[P, i] > 0.0:
                s[P, i] /= total
                last = i
                if not is_chosen and remaining < s[P, i]:
                    fired[i], is_chosen = 1, True
                remaining -= s[P, i]
        if not is_chosen:  # rounded probabilities may add up to slightly less than 1
            fired[last] = 1

    def fire(s, c, i):
        """Do nothing, because a spike does not reset V_m."""

    def quiet(s, c, i_0, lo, hi):
        """Return whether all probabilities are 0, because a step without input only sets them to 0."""
        has_probability = False
        for i in range(lo, hi):
            has_probability |= s[P, i] != 0.0
        return not has_probability
