"""The model that a cell is here, and how its inputs are scaled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from neuro.exchange.nir.cells import Cell, Unsupported
from neuro.exchange.nir.graph import Floats
from neuro.model.neurons.base import Neuron
from neuro.model.neurons.builtin import iaf_psc_delta

AT_ONCE = 1e-3
"""Time constant, in steps, of a potential that keeps nothing: e^-1000 is 0 in a double."""


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A model for the neurons of a node.

    Attributes:
        model: the model.
        gain: weight per weight of NIR, an element for each neuron.
        per_input: pA of a constant current per unit of input.
        initial: states at the beginning that differ from the model's.
    """

    model: Neuron
    gain: Floats
    per_input: Floats
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
    capacity = np.where(np.isinf(tau), h, tau)
    constant = np.where(np.isinf(tau), 1.0, 1.0 - cell.keep)
    if cell.i_keep is not None or cell.threshold is None or cell.reset is None:
        raise Unsupported("not yet", "")
    threshold = np.nextafter(cell.threshold, np.inf) if cell.strict else cell.threshold
    words = {"tau_m": tau, "C_m": capacity, "t_ref": 0.0, "E_L": cell.rest, "V_th": threshold, "V_reset": cell.reset}
    initial = {} if cell.start is None else {"V_m": one_or_all(cell.start)}
    return Made(iaf_psc_delta(**{k: one_or_all(v) for k, v in words.items()}), cell.gain, cell.gain / constant, initial)


def time_constant(keep: Floats, h: float) -> Floats:
    """The time constant in ms that leaves the share `keep` after h ms."""
    with np.errstate(divide="ignore"):
        tau = -h / np.log(keep)
    return np.where(keep <= 0.0, AT_ONCE * h, np.where(keep >= 1.0, np.inf, tau))


def one_or_all(values: Any) -> Any:
    """One number where all are the same, else a number for each neuron."""
    flat = np.asarray(values, dtype=np.float64).reshape(-1)
    return float(flat[0]) if np.all(flat == flat[0]) else flat
