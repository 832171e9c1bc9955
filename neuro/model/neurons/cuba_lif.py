"""Leaky integrate-and-fire with a synaptic current that acts in the step of its arrival."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.iaf_psc_exp import constants as of_late, iaf_psc_exp, quiet as late_quiet
from neuro.model.neurons.propagators import after_spike, check_fall, spikes_in


@dataclass(frozen=True, kw_only=True, eq=False)
class cuba_lif(iaf_psc_exp):
    """As `iaf_psc_exp`, but input moves V_m in the step in which it arrives, not from the next step on.

    The current comes first, then V_m with it, as in Norse's, snnTorch's and spikingjelly's neurons of NIR's type
    CubaLIF, and in Loihi's compartments. So a recurrent synapse takes one step here as there.
    Source: Pedersen et al., Nat. Commun. 15:8122, 2024; Davies et al., IEEE Micro 38:82, 2018.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; spike at V_m >= V_th"
    )
    source: ClassVar[str] = "Pedersen et al., Nat. Commun. 15:8122, 2024, CubaLIF"
    states: ClassVar[tuple[State, ...]] = iaf_psc_exp.states
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {}
    collects: ClassVar[tuple[str, ...]] = ()
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction", "max_spikes")

    max_spikes: int = quantity(
        1, "", "most spikes of a step, if V_m falls and stays at V_th", kind="integer", at_least=1, at_most=255
    )

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Refuse several spikes in a step without a fall."""
        check_fall("cuba_lif", parameters)


V_M, I_EX, I_IN, REFRACTORY = range(4)
V_TH, V_RESET, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN, FALL, MOST = range(16)


def constants(p, h, c):
    """Fill `c` for a step of h ms: those of `iaf_psc_exp`, and the most spikes of a step."""
    of_late(p, h, c)
    c[MOST] = p[11]


def step(s, c, x, i_0, lo, hi, fired):
    """One step: the currents with the input, then V with them, then the threshold."""
    v_th, e_l, p33, p30, i_e, fall, most = c[V_TH], c[E_L], c[P33], c[P30], c[I_E], c[FALL], c[MOST]
    p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
    for i in range(lo, hi):
        i_ex = s[I_EX, i] * p11_ex + x[0, i]
        i_in = s[I_IN, i] * p11_in + x[1, i]
        s[I_EX, i] = i_ex
        s[I_IN, i] = i_in
        if s[REFRACTORY, i] == 0.0:
            v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            s[V_M, i] = v
            fired[i] = v >= v_th if most == 1.0 else spikes_in(v, v_th, fall, most)
        else:
            s[REFRACTORY, i] -= 1.0
            fired[i] = 0


def fire(s, c, i):
    """Reset V and hold it; the currents go on."""
    s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], c[MOST])
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """As of `iaf_psc_exp`: its bound does not depend on when in a step the current acts."""
    return late_quiet(s, c, i_0, lo, hi)


def catch_up(s, p, c, i_0, lo, hi, h, n):
    """Advance n steps at once; `p` is as in `constants`.

    In `iaf_psc_exp` a step moves V by the currents before the step, so n steps of h equal one step of n h. Here each
    step moves V by the currents after it, which are smaller by the factor exp(-h/tau_syn).
    """
    of_late(p, n * h, c)
    e_l, p33, p30, i_e, p11_ex, p11_in = c[E_L], c[P33], c[P30], c[I_E], c[P11_EX], c[P11_IN]
    p32_ex, p32_in = c[P32_EX] * math.exp(-h / p[8]), c[P32_IN] * math.exp(-h / p[9])
    for i in range(lo, hi):
        i_ex, i_in = s[I_EX, i], s[I_IN, i]
        s[V_M, i] = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
        s[I_EX, i] = i_ex * p11_ex
        s[I_IN, i] = i_in * p11_in
