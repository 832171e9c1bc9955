"""The standard cells and synapses of PyNN, and their models in neuro, for reading and writing scripts.

"Here" means in neuro, in all files of this package.

PyNN's units are nA, nF, uS, mV and ms; the units here are pA, pF, nS, mV and ms.
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
    """A standard cell of PyNN, and its model here.

    Attributes:
        name: name of PyNN's class.
        model: name of the model here.
        words: for each parameter here, PyNN's parameter and the factor from PyNN's unit to the unit here.
        states: for each variable of PyNN, the state here and the factor from PyNN's unit to the unit here.
        weight: factor from PyNN's unit of a weight to the unit here.
        conductance: whether synapses are conductances. PyNN's weights are then positive at both receptors.
        leak: whether the model here has a leak conductance in place of PyNN's time constant of the membrane.
        fixed: values of parameters here that are constants of PyNN's cell.
    """

    name: str
    model: str
    words: Words
    states: dict[str, tuple[str, float]]
    weight: float = 1000.0
    conductance: bool = False
    leak: bool = False
    fixed: dict[str, float] = field(default_factory=dict)

    def from_pynn(self, values: dict[str, Any]) -> dict[str, Any]:
        """Convert parameters of PyNN's cell (numbers or arrays) to those of the model here."""
        parameters = {word: values[pynn_word] * factor for word, (pynn_word, factor) in self.words.items()}
        if self.leak:
            parameters["g_L"] = values["cm"] / values["tau_m"] * 1000.0
        return parameters | self.fixed

    def to_pynn(self, values: dict[str, Any]) -> dict[str, Any]:
        """Convert parameters of the model here (numbers or arrays) to those of PyNN's cell."""
        parameters = {pynn_word: values[word] / factor for word, (pynn_word, factor) in self.words.items()}
        if self.leak:
            parameters["tau_m"] = values["C_m"] / values["g_L"]
        return parameters


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
"""Cells of neurons. If two cells have the same model, a written script uses the first cell, e.g. IF_cond_exp."""

BY_NAME = {cell.name: cell for cell in CELLS}
BY_MODEL = {cell.model: cell for cell in reversed(CELLS)}

DEPENDENCES = {
    "AdditiveWeightDependence": (0.0, 0.0),
    "MultiplicativeWeightDependence": (1.0, 1.0),
    "AdditivePotentiationMultiplicativeDepression": (0.0, 1.0),
}
"""Weight dependences of PyNN's STDP, as `mu_plus` and `mu_minus` of `stdp`."""


SPIKES, RATE, SEED = 200, 20.0, 0
"""Number and rate (Hz) of the random spikes that `difference` compares, and their seed."""


def difference(U: float, tau_rec: float, tau_fac: float, tau_syn: float) -> str:
    """Describe how short-term plasticity differs between neuro and PyNN's simulators, measured with random spikes.

    Times are in ms.
    """
    intervals = np.random.default_rng(SEED).exponential(1000.0 / RATE, SPIKES)
    here_effects, pynn_effects = effects(intervals.tolist(), U, tau_rec, tau_fac, tau_syn)
    percent = 100.0 * np.abs(here_effects - pynn_effects).sum() / pynn_effects.sum() if pynn_effects.any() else 0.0
    return (
        f"resources recover from the spike on, and in PyNN only after they were active for {tau_syn:.4g} ms: "
        f"{SPIKES} random spikes at {RATE:g} Hz differ in effect by {percent:.1f} %"
    )


def effects(
    intervals: Sequence[float], U: float, tau_rec: float, tau_fac: float, tau_syn: float
) -> tuple[Floats, Floats]:
    """Return the share of the weight that each spike transmits, here and in PyNN's simulators.

    In PyNN's simulators the resources that a spike releases are active with the time constant `tau_syn`, and recover
    afterwards with `tau_rec`. Here resources recover from the spike on. Both arrays have one share
    per interval. All times are in ms.

    Source: Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000; NEST 3.10, `tsodyks2_synapse` and `tsodyks_synapse`.
    """
    if tau_syn == tau_rec:
        tau_syn *= 1.0 + 1e-6  # the solution divides by the difference of the time constants
    u, resources, pynn_resources, active = 0.0, 1.0, 1.0, 0.0
    shares = []
    for interval in intervals:
        facilitated = np.exp(-interval / tau_fac) if tau_fac else 0.0
        decayed, unrecovered = np.exp(-interval / tau_syn), np.exp(-interval / tau_rec)
        recovered = ((unrecovered - 1.0) * tau_rec - (decayed - 1.0) * tau_syn) / (tau_syn - tau_rec)
        pynn_resources += recovered * active + (1.0 - unrecovered) * (1.0 - pynn_resources - active)
        resources += (1.0 - unrecovered) * (1.0 - resources)
        u = U + u * facilitated * (1.0 - U)
        shares.append((u * resources, u * pynn_resources))
        active = active * decayed + u * pynn_resources
        resources, pynn_resources = resources * (1.0 - u), pynn_resources * (1.0 - u)
    here_shares, pynn_shares = np.array(shares).T
    return here_shares, pynn_shares
