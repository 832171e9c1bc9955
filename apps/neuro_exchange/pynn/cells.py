"""The standard cells and synapses of PyNN and what they are here, in both directions.

PyNN's units are nA, nF, uS, mV and ms; ours pA, pF, nS, mV and ms.
Source: PyNN 0.13, `pyNN/nest/standardmodels/cells.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from neuro.extend import Floats

Words = dict[str, tuple[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A standard cell of PyNN, and the model that it is here.

    Attributes:
        name: of PyNN's class.
        model: of the class here.
        words: by parameter here, PyNN's parameter and the factor from its unit to ours.
        states: by PyNN's variable, the state here and the factor from its unit to ours.
        weight: the factor from PyNN's unit of a weight to ours.
        conductance: whether synapses are conductances, whose weights are positive in PyNN at both receptors.
        leak: whether PyNN gives the time constant of the membrane, and the model here takes its conductance.
        fixed: parameters here that are constants of PyNN's cell.
    """

    name: str
    model: str
    words: Words
    states: dict[str, tuple[str, float]]
    weight: float = 1000.0
    conductance: bool = False
    leak: bool = False
    fixed: dict[str, float] = field(default_factory=dict)

    def here(self, values: dict[str, Any]) -> dict[str, Any]:
        """Parameters of the model here from those of PyNN's cell; numbers or arrays."""
        found = {word: values[theirs] * factor for word, (theirs, factor) in self.words.items()}
        if self.leak:
            found["g_L"] = values["cm"] / values["tau_m"] * 1000.0
        return found | self.fixed

    def there(self, values: dict[str, Any]) -> dict[str, Any]:
        """Parameters of PyNN's cell from those of the model here; numbers or arrays."""
        found = {theirs: values[word] / factor for word, (theirs, factor) in self.words.items()}
        if self.leak:
            found["tau_m"] = values["C_m"] / values["g_L"]
        return found


_POTENTIALS: Words = {"E_L": ("v_rest", 1.0), "V_reset": ("v_reset", 1.0), "V_th": ("v_thresh", 1.0)}
_MEMBRANE: Words = _POTENTIALS | {"C_m": ("cm", 1000.0), "t_ref": ("tau_refrac", 1.0), "I_e": ("i_offset", 1000.0)}
_SYNAPSES: Words = {"tau_syn_ex": ("tau_syn_E", 1.0), "tau_syn_in": ("tau_syn_I", 1.0)}
_CURRENT: Words = _MEMBRANE | _SYNAPSES | {"tau_m": ("tau_m", 1.0)}
_REVERSALS: Words = {"E_ex": ("e_rev_E", 1.0), "E_in": ("e_rev_I", 1.0)}
_CONDUCTANCE: Words = _MEMBRANE | _SYNAPSES | _REVERSALS
_ADAPTATION: Words = {
    "V_peak": ("v_spike", 1.0),
    "Delta_T": ("delta_T", 1.0),
    "a": ("a", 1.0),
    "b": ("b", 1000.0),
    "tau_w": ("tau_w", 1.0),
}
_V = {"v": ("V_m", 1.0)}
_I = _V | {"isyn_exc": ("I_syn_ex", 1000.0), "isyn_inh": ("I_syn_in", 1000.0)}
_G = _V | {"gsyn_exc": ("g_ex", 1000.0), "gsyn_inh": ("g_in", 1000.0)}

CELLS = (
    Cell(name="IF_curr_exp", model="iaf_psc_exp", words=_CURRENT, states=_I),
    Cell(name="IF_curr_alpha", model="iaf_psc_alpha", words=_CURRENT, states=_I),
    Cell(
        name="IF_curr_delta",
        model="iaf_psc_delta",
        words=_MEMBRANE | {"tau_m": ("tau_m", 1.0)},
        states=_V,
        weight=1.0,
    ),
    Cell(name="IF_cond_exp", model="iaf_cond_exp", words=_CONDUCTANCE, states=_G, conductance=True, leak=True),
    Cell(name="IF_cond_alpha", model="iaf_cond_alpha", words=_CONDUCTANCE, states=_G, conductance=True, leak=True),
    Cell(
        name="EIF_cond_exp_isfa_ista",
        model="aeif_cond_exp",
        words=_CONDUCTANCE | _ADAPTATION,
        states=_G | {"w": ("w", 1000.0)},
        conductance=True,
        leak=True,
    ),
    Cell(
        name="Izhikevich",
        model="izhikevich",
        words={**{word: (word, 1.0) for word in "abcd"}, "I_e": ("i_offset", 1000.0)},
        states=_V | {"u": ("U_m", 1.0)},
        weight=1.0,
    ),
    Cell(
        name="IF_facets_hardware1",
        model="iaf_cond_exp",
        words=_POTENTIALS | _SYNAPSES | {"E_in": ("e_rev_I", 1.0), "g_L": ("g_leak", 1.0)},
        states=_G,
        conductance=True,
        fixed={"C_m": 200.0, "t_ref": 1.0, "E_ex": 0.0},
    ),
)
"""Neurons; of two with the same model the first one is written."""

BY_NAME = {cell.name: cell for cell in CELLS}
BY_MODEL = {cell.model: cell for cell in reversed(CELLS)}

DEPENDENCES = {
    "AdditiveWeightDependence": (0.0, 0.0),
    "MultiplicativeWeightDependence": (1.0, 1.0),
    "AdditivePotentiationMultiplicativeDepression": (0.0, 1.0),
}
"""PyNN's dependences of STDP on the weight, with `mu_plus` and `mu_minus` of `stdp`."""


SPIKES, RATE, SEED = 200, 20.0, 0
"""Random spikes by which it is measured, and their rate in Hz."""


def difference(U: float, tau_rec: float, tau_fac: float, tau_syn: float) -> str:
    """What differs and by how much, in words; times are in ms."""
    intervals = np.random.default_rng(SEED).exponential(1000.0 / RATE, SPIKES)
    here, there = effects(intervals.tolist(), U, tau_rec, tau_fac, tau_syn)
    percent = 100.0 * np.abs(here - there).sum() / there.sum() if there.any() else 0.0
    return (
        f"resources recover from a spike on, and in PyNN after they were active for {tau_syn:.4g} ms: "
        f"{SPIKES} random spikes at {RATE:g} Hz differ in effect by {percent:.1f} %"
    )


def effects(
    intervals: Sequence[float], U: float, tau_rec: float, tau_fac: float, tau_syn: float
) -> tuple[Floats, Floats]:
    """The share of the weight that each spike sends, here and in PyNN's simulators.

    There the resources that a spike releases are active for `tau_syn` and recover then, for `tau_rec`; here they
    recover from the spike on.
    Source: Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000; NEST 3.10, `tsodyks2_synapse` and `tsodyks_synapse`.
    """
    if tau_syn == tau_rec:
        tau_syn *= 1.0 + 1e-6  # the solution has their difference below the line
    u, left_here, left_there, active = 0.0, 1.0, 1.0, 0.0
    sent = []
    for interval in intervals:
        facilitated = np.exp(-interval / tau_fac) if tau_fac else 0.0
        decayed, waiting = np.exp(-interval / tau_syn), np.exp(-interval / tau_rec)
        back = ((waiting - 1.0) * tau_rec - (decayed - 1.0) * tau_syn) / (tau_syn - tau_rec)
        left_there += back * active + (1.0 - waiting) * (1.0 - left_there - active)
        left_here += (1.0 - waiting) * (1.0 - left_here)
        u = U + u * facilitated * (1.0 - U)
        sent.append((u * left_here, u * left_there))
        active = active * decayed + u * left_there
        left_here, left_there = left_here * (1.0 - u), left_there * (1.0 - u)
    here, there = np.array(sent).T
    return here, there
