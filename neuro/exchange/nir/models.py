"""The model that a cell is here, and how its inputs are scaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from neuro.exchange.nir.cells import MOST_SPIKES, Cell, Unsupported
from neuro.exchange.nir.graph import Floats
from neuro.model.neurons.base import Neuron
from neuro.model.neurons.builtin import cuba_lif, iaf_psc_delta
from neuro.model.neurons.propagators import from_exponential

AT_ONCE = 1e-3
"""Time constant, in steps, of a potential that keeps nothing: e^-1000 is 0 in a double."""

NEVER = 1e30
"""A threshold in mV that no potential reaches."""


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A model for the neurons of a node.

    Attributes:
        model: the model.
        gain: weight per weight of NIR, an element for each neuron.
        per_input: pA of a constant current per unit of constant input; None where a synapse filters the input.
        offset: pA of a constant current that belongs to the cell itself.
        initial: states at the beginning that differ from the model's.
    """

    model: Neuron
    gain: Floats
    per_input: Floats | None
    offset: Floats
    initial: dict[str, Any] = field(default_factory=dict)


def model_of(cell: Cell, h: float) -> Made:
    """The model of a cell.

    Args:
        cell: the difference equation.
        h: length of a step, ms.

    Raises:
        Unsupported: no model has it.
    """
    tau = time_constant(cell.keep, h)
    endless = np.isinf(tau)
    # With this capacity a current of 1 pA adds 1 - keep mV in a step, as in NIR; without a leak 1 mV.
    capacity, push = np.where(endless, h, tau), np.where(endless, 1.0, 1.0 - cell.keep)
    words = {"tau_m": tau, "C_m": capacity, "t_ref": h * cell.hold, "E_L": cell.rest, **_spike(cell)}
    if cell.lowest is not None:
        words["V_min"] = cell.lowest
    initial = {} if cell.start is None or np.all(cell.start == cell.rest) else {"V_m": one_or_all(cell.start)}
    offset = cell.gain * (0.0 if cell.offset is None else cell.offset) / push
    if cell.i_keep is None or cell.i_gain is None:
        return Made(_model(iaf_psc_delta, words), cell.gain, cell.gain / push, offset, initial)
    tau_syn = time_constant(cell.i_keep, h)
    if np.any(np.isinf(tau_syn)):
        raise Unsupported("a current that never decays has no model here", "choose a finite tau_syn")
    p32 = np.vectorize(from_exponential)(tau, tau_syn, capacity, h)
    words |= {"tau_syn_ex": tau_syn, "tau_syn_in": tau_syn}
    return Made(_model(cuba_lif, words), cell.i_gain * cell.gain / p32, None, offset, initial)


def _model(kind: type[Neuron], words: dict[str, Any]) -> Neuron:
    plain = {word: one_or_all(v) if isinstance(v, (float, np.ndarray)) else v for word, v in words.items()}
    return kind(**plain)


def _spike(cell: Cell) -> dict[str, Any]:
    """Threshold and reset. V_m > V_th is V_m >= the next number above it."""
    if cell.threshold is None:
        return {"V_th": NEVER, "V_reset": cell.rest}
    v_th = np.nextafter(cell.threshold, np.inf) if cell.strict else cell.threshold
    if cell.reset is None:
        if np.any(cell.threshold <= 0.0):
            raise Unsupported("v_threshold is not above 0, so that no spike lowers the potential", "raise it")
        fall = cell.threshold if cell.fall is None else cell.fall
        words = {"V_th": v_th, "V_reset": v_th - fall, "reset_by_subtraction": True}
        words |= {"threshold_rises": True} if cell.rises else {}
        return words | ({"max_spikes": MOST_SPIKES} if cell.several else {})
    if np.any(cell.reset >= v_th):
        raise Unsupported("v_reset is not below v_threshold", "raise v_threshold")
    return {"V_th": v_th, "V_reset": cell.reset}


def time_constant(keep: Floats, h: float) -> Floats:
    """The time constant in ms that leaves the share `keep` after h ms."""
    with np.errstate(divide="ignore"):
        tau = -h / np.log(keep)
    return np.where(keep <= 0.0, AT_ONCE * h, np.where(keep >= 1.0, np.inf, tau))


def one_or_all(values: Any) -> Any:
    """One number where all are the same, else a number for each neuron."""
    flat = np.asarray(values, dtype=np.float64).reshape(-1)
    return float(flat[0]) if np.all(flat == flat[0]) else flat
