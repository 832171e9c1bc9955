"""The node of NIR that a population is, in the scales of the tool that reads it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from neuro.exchange.nir.cells import SNNTORCH_STEP, Unsupported
from neuro.exchange.nir.graph import Floats
from neuro.model.neurons.builtin import iaf_psc_delta, iaf_psc_exp
from neuro.program.program import Population

ENDLESS = 1e12
"""Seconds of a time constant beside which a step is nothing in a double, for tools that have no IF."""

STRICT = ("norse", "snntorch")
"""Tools that fire above the threshold only."""


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """A population as a node.

    Attributes:
        kind: "IF", "LIF" or "CubaLIF".
        fields: of the node, an element for each neuron.
        factor: weight of NIR per weight, of each neuron.
        bias: of NIR, that is its own constant current.
        per_pa: bias of NIR per pA.
        how: what it is, for the verdict.
    """

    kind: str
    fields: dict[str, Floats]
    factor: Floats
    bias: Floats
    per_pa: Floats
    how: str


def neuron_of(part: Population, tool: str, h: float) -> Scaled:
    """The node of a population, for steps of h ms.

    Raises:
        Unsupported: it has none in this convention.
    """
    if type(part.model) not in (iaf_psc_delta, iaf_psc_exp):
        raise Unsupported(f"{part.said} has no node in NIR", "use iaf_psc_delta or iaf_psc_exp")
    p = {word: np.broadcast_to(values, part.size).astype(np.float64) for word, values in part.parameters.items()}
    if np.any(p["t_ref"] > 0):
        raise Unsupported("t_ref is above 0: nodes of NIR have no refractory period", "give it t_ref: 0")
    if np.any(p.get("V_min", np.array(-np.inf)) > -np.inf):
        raise Unsupported("V_min: nodes of NIR have no lowest potential", "leave it out")
    start = np.broadcast_to(part.initial.get("V_m", p["E_L"]), part.size)
    if np.any(start != p["E_L"]):
        raise Unsupported("V_m does not start at E_L: nodes of NIR have no initial state", "start at E_L")
    reset = p["V_reset"] - p["E_L"]
    if tool in ("norse", "snntorch") and np.any(reset != 0.0):
        raise Unsupported(f"V_reset is not E_L: {tool} resets to its resting potential", "reset to E_L, or for_=None")
    if tool == "sinabs":
        raise Unsupported("Sinabs resets by subtraction", "for_='norse' or 'spikingjelly'")
    return _leaky(part, p, reset, tool, h)


def _leaky(part: Population, p: dict[str, Floats], reset: Floats, tool: str, h: float) -> Scaled:
    step = h / 1e3
    endless = np.isinf(p["tau_m"])
    keep = np.where(endless, 1.0, np.exp(-h / p["tau_m"]))
    push = np.where(endless, h / p["C_m"], p["tau_m"] / p["C_m"] * (1.0 - keep))  # mV in a step per pA
    threshold = _threshold(p["V_th"] - p["E_L"], tool)
    zero = np.zeros(part.size)
    if endless.all() and tool != "snntorch":
        r = zero + (1.0 if tool == "norse" else 1.0 / step)
        fields = {"r": r, "v_threshold": threshold, "v_reset": reset}
        return Scaled("IF", fields, zero + 1.0, push * p["I_e"], push, "IF")
    tau, gain = SCALES[tool](keep, step)
    r = (
        gain / np.where(endless, 1.0, 1.0 - keep)
        if tool == "nir"
        else (gain if tool == "norse" else tau / _dt(tool, step))
    )
    fields = {"tau": tau, "r": r, "v_leak": zero, "v_threshold": threshold, "v_reset": reset}
    scale = _scale(keep, tool)
    return Scaled("LIF", fields, scale, push * p["I_e"] * scale, push * scale, f"LIF in the convention of {tool}")


def _dt(tool: str, step: float) -> float:
    return SNNTORCH_STEP if tool == "snntorch" else step


def _scale(keep: Floats, tool: str) -> Floats:
    """Weight of NIR per mV of a jump."""
    return 1.0 / (1.0 - keep) if tool == "norse" else np.ones(keep.shape)


def _euler(keep: Floats, step: float) -> tuple[Floats, Floats]:
    with np.errstate(divide="ignore"):
        return np.where(keep >= 1.0, ENDLESS, step / (1.0 - keep)), np.ones(keep.shape)


def _exact(keep: Floats, step: float) -> tuple[Floats, Floats]:
    with np.errstate(divide="ignore"):
        return np.where(keep >= 1.0, ENDLESS, -step / np.log(keep)), np.ones(keep.shape)


SCALES: dict[str, Callable[[Floats, float], tuple[Floats, Floats]]] = {
    "norse": _euler,
    "snntorch": lambda keep, step: _euler(keep, SNNTORCH_STEP),
    "spikingjelly": _euler,
    "nir": _exact,
}
"""The time constant in seconds that keeps a share of the potential, by tool."""


def _threshold(values: Floats, tool: str) -> Floats:
    """A threshold in single precision with which the tool fires where V >= V_th."""
    single = values.astype(np.float32)
    if tool in STRICT:
        return np.where(single >= values, np.nextafter(single, np.float32(-np.inf)), single).astype(np.float64)
    return np.where(single < values, np.nextafter(single, np.float32(np.inf)), single).astype(np.float64)
