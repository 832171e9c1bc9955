"""The NIR node of a population, in the scales of the tool that reads the graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro import cuba_lif, iaf_psc_delta, iaf_psc_exp
from neuro.extend import Population, from_exponential
from neuro_exchange.nir.cells import SNNTORCH_STEP, Unsupported
from neuro_exchange.nir.graph import Floats

ENDLESS = 1e12
"""Time constant in seconds that stands for no leak in tools without IF. In a step of 1 ms the potential loses a share
of 1e-15, near the rounding error of a double."""

READOUT = "Output"
"""Type of neurons that have no memory and never fire."""

STRICT = ("norse", "snntorch")
"""Tools that fire at V > V_th instead of V >= V_th."""

NEVER = 1e20
"""Threshold in mV from which neurons never fire."""


@dataclass(frozen=True, slots=True, eq=False)
class ScaledNode:
    """The node of a population, with the scales of its inputs.

    Attributes:
        kind: type in NIR, e.g. "LIF".
        fields: fields of the node, one element per neuron.
        factor: factor from a weight here to a weight of NIR, one element per neuron.
        bias: bias of NIR that equals the population's own constant current `I_e`.
        per_pa: bias of NIR per pA. None for CubaLIF: its bias passes through the synapse, but currents here do not.
        how: description for the verdict.
    """

    kind: str
    fields: dict[str, Floats]
    factor: Floats
    bias: Floats
    per_pa: Floats | None
    how: str


@dataclass(frozen=True, slots=True, eq=False)
class Share:
    """A decaying state in the arithmetic of a tool.

    Attributes:
        tau: time constant in the tool's unit.
        gain: increase of the state per unit of input if the factor (r or w_in) is 1.
        unity: the factor (r or w_in) with which one unit of input increases the state by one.
    """

    tau: Floats
    gain: Floats
    unity: Floats


def neuron_of(part: Population, tool: str, h: float) -> ScaledNode:
    """Return the node of a population for steps of h ms.

    Raises:
        Unsupported: the convention has no such node.
    """
    if type(part.model) not in (iaf_psc_delta, iaf_psc_exp, cuba_lif):
        raise Unsupported(f"{part.model_name} has no node in NIR", "use iaf_psc_delta, iaf_psc_exp or cuba_lif")
    p = {word: np.broadcast_to(values, part.size).astype(np.float64) for word, values in part.parameters.items()}
    fires = bool(np.all(p["V_th"] < NEVER))
    if not fires and np.any(p["V_th"] < NEVER):
        raise Unsupported("some of its neurons never fire", "give them a population of their own")
    for name, values in part.initial.items():
        if np.any(values != (p["E_L"] if name == "V_m" else 0.0)):
            raise Unsupported(f"{name} does not start at rest: nodes of NIR have no initial state", "leave it out")
    if fires:
        _check_spikes(p, tool)
    elif "tau_syn_ex" not in p and np.all(np.exp(-h / p["tau_m"]) == 0.0) and np.all(p["E_L"] == 0.0):
        ones = np.ones(part.size)
        push = p["tau_m"] / p["C_m"]
        return ScaledNode(READOUT, {}, ones, push * p["I_e"], push, "an Output of the input of a step")
    elif tool != "nir":
        raise Unsupported(f"{tool} reads no neurons that never fire", "leave them out, or read V_m of the layer before")
    return _synaptic(p, tool, h, fires) if "tau_syn_ex" in p else _direct(p, tool, h, fires)


def _check_spikes(p: dict[str, Floats], tool: str) -> None:
    """Refuse parameters of threshold and reset that a tool does not support."""
    if np.any(p["t_ref"] > 0):
        raise Unsupported("t_ref is above 0: nodes of NIR have no refractory period", "give it t_ref: 0")
    subtracts = p["reset_by_subtraction"] != 0.0
    if tool == "sinabs":
        is_limited = p.get("max_spikes", np.ones(1)) < 255
        if not subtracts.all() or np.any(p["V_reset"] != 0.0) or np.any(is_limited) or np.any(p["E_L"] != 0.0):
            raise Unsupported(
                "Sinabs's neurons fall by V_th at a spike, several times in a step, and rest at 0",
                "give it reset_by_subtraction: true, max_spikes: 255, V_reset: 0 and E_L: 0; or another tool",
            )
        lowest = np.where(np.isinf(p["tau_m"]), -p["V_th"], -np.inf)
        if np.any(p.get("V_min", np.array(-np.inf)) != lowest):
            raise Unsupported(
                "Sinabs's IF has the lowest potential -V_th, its LIF none", "set V_min: -V_th for IF, -inf for LIF"
            )
        return
    if subtracts.any() or np.any(p.get("threshold_rises", 0.0)):
        raise Unsupported(f"{tool} resets to a value where it reads NIR", "for_='sinabs', or reset to a value")
    if np.any(p.get("V_min", np.array(-np.inf)) > -np.inf):
        raise Unsupported("V_min: only Sinabs's IF has a lowest potential", "leave it out")
    leaks_away = tool != "nir" and np.any(p["V_reset"] != p["E_L"])
    if leaks_away and (tool != "norse" or "tau_syn_ex" in p):
        raise Unsupported(f"V_reset is not E_L: {tool} resets to its resting potential", "reset to E_L, or for_=None")


def _direct(p: dict[str, Floats], tool: str, h: float, fires: bool) -> ScaledNode:
    """Return the node of neurons without a synapse: IF or LIF, or I or LI if they never fire."""
    step, ones = h / 1e3, np.ones(p["tau_m"].size)
    is_endless = np.isinf(p["tau_m"])
    kept_share = np.where(is_endless, 1.0, np.exp(-h / p["tau_m"]))
    finite_tau = np.where(is_endless, 1.0, p["tau_m"])
    push = np.where(is_endless, h, -finite_tau * np.expm1(-h / finite_tau)) / p["C_m"]  # mV per step and pA
    fields = _spike(p, tool) if fires else {}
    if is_endless.all() and tool != "snntorch":
        r = ones if tool in ("norse", "sinabs") else ones / step
        kind = "IF" if fires else "I"
        return ScaledNode(kind, {"r": r, **fields}, ones, push * p["I_e"], push, f"{kind}, as {_reader(tool)} reads it")
    share = _share(kept_share, tool, step)
    r = ones if tool in ("norse", "sinabs") else share.unity
    factor = 1.0 / (share.gain * r)
    fields = {"tau": share.tau, "r": r, "v_leak": p["E_L"] - _zero(p, tool), **fields}
    kind = "LIF" if fires else "LI"
    note = f"{kind}, as {_reader(tool)} reads it"
    return ScaledNode(kind, fields, factor, push * p["I_e"] * factor, push * factor, note)


def _synaptic(p: dict[str, Floats], tool: str, h: float, fires: bool) -> ScaledNode:
    """Return the node of neurons with a synapse: CubaLIF, or CubaLI if they never fire."""
    if tool == "sinabs":
        raise Unsupported("Sinabs reads no CubaLIF", "use iaf_psc_delta, or another tool")
    if np.any(p["tau_syn_ex"] != p["tau_syn_in"]):
        raise Unsupported("tau_syn_ex and tau_syn_in differ: CubaLIF has one current", "make them equal")
    if np.any(p["I_e"] != 0.0):
        raise Unsupported("I_e: a constant current goes past the synapse, and no bias does", "leave it out")
    if np.isinf(p["tau_m"]).any() and tool == "nir":
        raise Unsupported("tau_m is infinite: CubaLIF has a leak", "give it a finite tau_m")
    step, ones = h / 1e3, np.ones(p["tau_m"].size)
    membrane, synapse = (_share(np.exp(-h / p[word]), tool, step) for word in ("tau_m", "tau_syn_ex"))
    r, w_in = (ones, ones) if tool == "norse" else (membrane.unity, synapse.unity)
    factor = np.vectorize(from_exponential)(p["tau_m"], p["tau_syn_ex"], p["C_m"], h)
    factor = factor / (membrane.gain * r * synapse.gain * w_in)
    fields = {"tau_syn": synapse.tau, "tau_mem": membrane.tau, "r": r, "v_leak": 0.0 * ones, "w_in": w_in}
    kind = "CubaLIF" if fires else "CubaLI"
    fields |= _spike(p, tool) if fires else {}
    return ScaledNode(kind, fields, factor, 0.0 * ones, None, f"{kind}, as {_reader(tool)} reads it")


def _share(kept_share: Floats, tool: str, step: float) -> Share:
    """Return the state that keeps the share `kept_share` after a step, in the tool's arithmetic. `step` is in s."""
    ones, is_endless = np.ones(kept_share.shape), kept_share >= 1.0
    loss = np.where(is_endless, 1.0, 1.0 - kept_share)
    with np.errstate(divide="ignore"):
        exact_tau = np.where(is_endless, ENDLESS, -1.0 / np.log(kept_share))  # in steps
    if tool == "sinabs":
        return Share(exact_tau, ones, ones)
    if tool == "nir":
        return Share(np.where(is_endless, ENDLESS, exact_tau * step), loss, 1.0 / loss)
    unit = SNNTORCH_STEP if tool == "snntorch" else step
    tau = np.where(is_endless, ENDLESS, unit / loss)
    return Share(tau, unit / tau, tau / unit)


def _spike(p: dict[str, Floats], tool: str) -> dict[str, Floats]:
    zero = _zero(p, tool)
    return {"v_threshold": _threshold(p["V_th"] - zero, tool), "v_reset": p["V_reset"] - zero}


def _zero(p: dict[str, Floats], tool: str) -> Floats:
    """Return the potential that corresponds to 0 in the tool: V_reset for Norse, E_L for all other tools."""
    return p["V_reset"] if tool == "norse" and np.all(p["V_th"] < NEVER) else p["E_L"]


def _threshold(values: Floats, tool: str) -> Floats:
    """Return the single-precision threshold with which the tool fires at V >= V_th; the value itself for "nir"."""
    if tool == "nir":
        return values
    singles = values.astype(np.float32)
    if tool in STRICT:
        return np.where(singles >= values, np.nextafter(singles, np.float32(-np.inf)), singles).astype(np.float64)
    return np.where(singles < values, np.nextafter(singles, np.float32(np.inf)), singles).astype(np.float64)


def _reader(tool: str) -> str:
    return "the definition of NIR" if tool == "nir" else tool
