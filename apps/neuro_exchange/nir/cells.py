"""Difference equations of NIR's neurons, by the convention of the tool that wrote the graph.

All supported tools step a neuron by a difference equation, a `Cell`. In each step

    i = i_keep i + i_gain w s                       only with a synapse
    v = rest + keep (v - rest) + gain (i, or w s)
    spike if v >= threshold, or v > threshold if strict; then v = reset, or v falls by the threshold

`model_of` then finds the model of this package that has the equation of a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from neuro import ModelError, cuba_lif, iaf_psc_delta
from neuro.apps import unknown
from neuro.extend import Neuron, from_exponential
from neuro_exchange.nir.graph import Floats, Node

ASK = "name the tool: from_='norse', 'snntorch', 'sinabs', 'spikingjelly', 'spyx', 'rockpool' or 'nir'"
BY_GRAPH_EXECUTOR = ("norse", "sinabs")
"""Tools whose importers run a graph with the `GraphExecutor` of nirtorch."""

FALLS_AND_RISES = "fires at V > V_th, and falls by V_th; at 2 V_th while more than V_th is left"
"""The spike rule of snnTorch 1.0 with reset by subtraction and without reset delay."""

BEYOND = "while more than V_th is left after a spike, snnTorch fires at 2 V_th, and cuba_lif at V_th"
"""How `cuba_lif` differs from a CubaLIF of snnTorch with reset by subtraction."""

MOST_SPIKES = 255
"""Most spikes of a neuron in one step here. Sinabs and Rockpool have no limit."""

FIRES_AND_FALLS = (
    f"fires at V >= V_th, several times if V_th fits several times (here {MOST_SPIKES} at most), "
    "and falls by V_th each time"
)
"""The spike rule of Sinabs and Rockpool."""

SNNTORCH_STEP = 1e-4
"""Step in seconds that the importer and exporter of snnTorch 1.0 assume, whatever the simulated step is."""


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """The difference equation of the neurons of one node. Arrays have the shape of the node.

    The module's docstring has the equation. Potentials are in the unit of NIR.

    Attributes:
        keep: share of the potential's distance from `rest` that is left after a step.
        rest: resting potential.
        gain: factor of the input (of i with a synapse) that is added to the potential.
        how: the convention in words, for the verdict.
        i_keep: share of the synaptic current that is left after a step; None without a synapse.
        i_gain: factor of the input that is added to the synaptic current; None without a synapse.
        offset: constant that is added to i; None means 0.
        threshold: None for neurons that never fire.
        strict: whether a neuron fires at v > threshold instead of v >= threshold.
        reset: the potential after a spike. None: a spike lowers the potential by `fall`.
        several: whether a neuron fires floor((v - threshold) / fall) + 1 times in a step.
        lowest: lower bound of the potential after a spike; None without a bound.
        start: initial potential; None means `rest`.
        rises: whether a neuron that is still above the threshold after a spike needs twice the threshold to fire.
        spike_delay: steps from the crossing of the threshold to the spike in the tool.
        fall: decrease of the potential at a spike; None means the threshold.
        hold: steps after a spike in which the potential is constant and ignores input.
        differs: difference between the model here and the tool; "" if they agree exactly.
    """

    keep: Floats
    rest: Floats
    gain: Floats
    how: str
    i_keep: Floats | None = None
    i_gain: Floats | None = None
    offset: Floats | None = None
    threshold: Floats | None = None
    strict: bool = False
    reset: Floats | None = None
    several: bool = False
    lowest: Floats | None = None
    start: Floats | None = None
    rises: bool = False
    hold: int = 0
    spike_delay: int = 0
    fall: Floats | None = None
    differs: str = ""


class Unsupported(Exception):
    """Raised for a node that a convention lacks. `why` is the reason, `way_out` the advice to the user."""

    def __init__(self, reason: str, way_out: str) -> None:
        self.why, self.way_out = reason, way_out
        super().__init__(reason)


def cell_of(node: Node, tool: str, step: float, reset: str | None) -> Cell:
    """Return the cell of a stateful node.

    Args:
        node: the node.
        tool: a name of `TOOLS`.
        step: length of a step in seconds.
        reset: the rule of `from_nir` that replaces the reset of the convention, or None.

    Raises:
        Unsupported: the convention lacks this type of node, or lacks it with these parameters.
        ModelError: a field has the wrong shape.
    """
    if node.kind == "Threshold":
        zero = np.zeros(node.shape)
        how = "fires where the input of a step reaches the threshold, and keeps nothing"
        return Cell(zero, zero, zero + 1.0, how, threshold=node.array("threshold"), reset=zero)
    title, kinds, rests_at_zero, convention = TOOLS[tool]
    if node.kind not in kinds:
        raise Unsupported(f"{title} does not have {node.kind}", "read it with from_='nir'")
    if rests_at_zero and "v_leak" in node.fields and np.any(node.array("v_leak") != 0.0):
        raise Unsupported(f"v_leak is not 0, which {title} does not have", "read it with from_='nir'")
    cell = convention(node, step)
    # `how` is 'EQUATION; SPIKE RULE': a reset of the user replaces the text after the semicolon.
    if cell.threshold is not None and reset in ("subtract", "subtract_next"):
        fall = cell.threshold / np.maximum(cell.keep, 1e-9) if reset == "subtract_next" else cell.threshold
        step_text = "in the next step, after the decay" if reset == "subtract_next" else "in the same step"
        rises = tool == "snntorch" and reset == "subtract" and cell.i_keep is None
        spikes = FALLS_AND_RISES if rises else f"fires by the rule of the tool, and V falls by V_th {step_text}"
        how = f"{cell.how.rpartition('; ')[0]}; {spikes}, by `reset`"
        differs = "" if rises or tool != "snntorch" or reset == "subtract_next" else BEYOND
        cell = replace(cell, reset=None, fall=fall, hold=0, rises=rises, how=how, differs=differs)
    elif cell.threshold is not None and reset in ("to_value", "to_value_next"):
        hold = int(reset == "to_value_next")
        step_text = "in the next step, which takes no input" if hold else "in the same step"
        how = f"{cell.how.rpartition('; ')[0]}; fires by the rule of the tool, then V = v_reset {step_text}, by `reset`"
        cell = replace(cell, reset=_reset_value(node), several=False, rises=False, fall=None, hold=hold, how=how)
    return cell


def find_tool(from_: str | None, metadata: object) -> str | None:
    """Return the name of the convention: `from_`, else the name in the graph's metadata, else None.

    Raises:
        ModelError: no convention has that name.
    """
    convention = metadata.get("neuro_convention") if isinstance(metadata, dict) else None
    convention = convention.decode("utf-8", "replace") if isinstance(convention, bytes) else convention
    name = convention if from_ is None else from_
    if name is not None and str(name) not in TOOLS:
        raise unknown("convention", name, TOOLS)
    return None if name is None else str(name)


def _positive(node: Node, word: str) -> Floats:
    values = node.array(word)
    if np.any(values <= 0):
        raise ModelError(f"node '{node.name}': {word} = {values.min():g}: expected a time above 0")
    return values


def _euler(node: Node, word: str, step: float) -> Floats:
    share = step / _positive(node, word)
    if np.any(share > 1.0 + 1e-6):
        raise Unsupported(
            f"{word} = {step / share.max():g} s is below a step of {step:g} s, where Euler's method overshoots",
            "choose a smaller dt",
        )
    return np.minimum(share, 1.0)


def _reset_value(node: Node) -> Floats:
    return np.zeros(node.shape) if node.fields.get("v_reset") is None else node.array("v_reset")


def _synaptic(node: Node, lost: Floats, i_lost: Floats, note: str, **words: Any) -> Cell:
    """Return the cell of CubaLIF or CubaLI.

    In a step the potential keeps the share 1 - lost and adds lost * r times the current. The current keeps the share
    1 - i_lost and adds i_lost * w_in times the input.
    """
    gain, i_gain = lost * node.array("r"), i_lost * node.array("w_in")
    return Cell(1.0 - lost, words.pop("rest"), gain, note, i_keep=1.0 - i_lost, i_gain=i_gain, **words)


def _firing(node: Node, cell: Cell, spikes: str, **rule: Any) -> Cell:
    """Add the threshold and the spike rule to a cell. Cells of nodes without a threshold are returned unchanged."""
    if "v_threshold" not in node.fields:
        return cell
    return replace(cell, how=f"{cell.how}; {spikes}", threshold=node.array("v_threshold"), **rule)


def _norse(node: Node, step: float) -> Cell:
    """Norse 1.1: `lif_box`, `iaf`, `leaky_integrator_box`, and the module that its importer builds for CubaLIF."""
    ones, zero = np.ones(node.shape), np.zeros(node.shape)
    match node.kind:
        case "IF":
            cell = Cell(ones, zero, ones, "Norse: V grows by the input, r is not used")
        case "I":
            cell = Cell(ones, zero, ones, "V grows by the input")
        case "LIF" | "LI":
            a = _euler(node, "tau", step)
            cell = Cell(1.0 - a, node.array("v_leak"), a, "Norse: Euler, r is not used")
        case _:
            a, b, leak = _euler(node, "tau_mem", step), _euler(node, "tau_syn", step), node.array("v_leak")
            cell = _synaptic(node, a, b, "Norse: Euler, the current first, then V with it", rest=leak, offset=leak)
    return _firing(node, cell, "fires at V > V_th, then V = 0 in the same step", strict=True, reset=zero)


def _snntorch(node: Node, step: float) -> Cell:
    """SnnTorch 1.0: `Leaky` and `Synaptic` as built by the importer, which has a fixed step of 1e-4 s."""
    ones, zero = np.ones(node.shape), np.zeros(node.shape)
    note = "snnTorch: Euler with its step of 1e-4 s"
    match node.kind:
        case "IF":
            if np.any(node.array("r") != 1.0):
                raise Unsupported("r is not 1, which snnTorch does not have", "read it with from_='nir'")
            cell = Cell(0.9 * ones, zero, ones, "snnTorch 1.0 reads IF as Leaky with beta = 0.9", rises=True)
            return _firing(node, cell, FALLS_AND_RISES, strict=True)
        case "I":
            return Cell(ones, zero, node.array("r"), "V grows by r times the input")
        case "LIF" | "LI":
            a = _euler(node, "tau", SNNTORCH_STEP)
            gain = a * node.array("r")
            if node.kind == "LIF" and np.unique(gain).size > 1:
                gain = np.full(node.shape, np.unique(gain)[0])
                note += ", the smallest r dt / tau of the node for all its neurons"
            cell = Cell(1.0 - a, zero, gain, note)
        case _:
            a, b = (_euler(node, word, SNNTORCH_STEP) for word in ("tau_mem", "tau_syn"))
            cell = _synaptic(node, a, b, f"{note}, the current first, then V with it", rest=zero)
    hold = int(node.kind == "CubaLIF" and node.recurrent)
    fires = "fires at V > V_th, then V = 0 in the same step"
    if hold:
        fires = "RSynaptic of snnTorch 1.0 fires at V > V_th, then V = 0 in the next step, which takes no input"
    return _firing(node, cell, fires, strict=True, reset=zero, hold=hold)


def _sinabs(node: Node, step: float) -> Cell:
    """Sinabs 3.1: `IAF`, `LIF` and `ExpLeak` as built by the importer, with tau in steps."""
    ones, zero = np.ones(node.shape), np.zeros(node.shape)
    if node.kind == "IF":
        threshold = node.array("v_threshold")
        note = f"Sinabs: V grows by the input, r is not used; {FIRES_AND_FALLS}; then V >= -V_th"
        return Cell(ones, zero, ones, note, threshold=threshold, several=True, lowest=-threshold)
    if node.kind == "I":
        return Cell(ones, zero, ones, "V grows by the input")
    tau = _positive(node, "tau")
    if np.all(tau < 1.0):
        note = "Sinabs: exact decay, the input times dt / tau; tau in seconds, since it is below one step"
        cell = Cell(np.exp(-step / tau), zero, step / tau, note)
    else:
        cell = Cell(np.exp(-1.0 / tau), zero, ones, "Sinabs: exact decay, tau in steps, the input as it is")
    return _firing(node, cell, FIRES_AND_FALLS, several=True)


def _spikingjelly(node: Node, step: float) -> Cell:
    """Spikingjelly 2.0: `IFNode`, `LIFNode` and `CUBALIFNode` as built by the importer."""
    reset = _reset_value(node)
    match node.kind:
        case "IF":
            note = "spikingjelly: V grows by r dt times the input"
            cell = Cell(np.ones(node.shape), reset, step * node.array("r"), note)
        case "LIF":
            a = _euler(node, "tau", step)
            if np.any(node.array("v_leak") != reset):
                raise Unsupported("v_leak is not v_reset, which spikingjelly does not have", "read it with from_='nir'")
            cell = Cell(1.0 - a, reset, a * node.array("r"), "spikingjelly: Euler")
        case _:
            if np.any(node.array("v_leak") != 0.0):
                raise Unsupported("v_leak is not 0, which spikingjelly does not have", "read it with from_='nir'")
            a, b = (_euler(node, word, step) for word in ("tau_mem", "tau_syn"))
            note = "spikingjelly: Euler, the current first, then V with it"
            cell = _synaptic(node, a, b, note, rest=np.zeros(node.shape), start=reset)
    return _firing(node, cell, "fires at V >= V_th, then V = v_reset in the same step", reset=reset)


def _spyx(node: Node, step: float) -> Cell:
    """Spyx 1.0: `IF`, `LIF` and `CuBaLIF`. A spike follows one step after the potential crosses the threshold."""
    ones, zero = np.ones(node.shape), np.zeros(node.shape)
    match node.kind:
        case "IF":
            cell = Cell(ones, zero, ones, "Spyx: V grows by the input")
        case "LIF":
            a = _euler(node, "tau", step)
            # Spyx 1.0 writes r = 1 - dt / tau and ignores r on import, so a file with this r has a gain of 1.
            is_spyx = np.allclose(node.array("r"), 1.0 - a, rtol=1e-4)
            gain = ones if is_spyx else a * node.array("r")
            note = "Spyx: Euler, the input as it is" if is_spyx else "Spyx: Euler, the input times r dt / tau"
            fall = node.array("v_threshold") / np.maximum(1.0 - a, 1e-9)
            cell = Cell(1.0 - a, zero, gain, note, fall=fall)
        case _:
            a, b = (_euler(node, word, step) for word in ("tau_mem", "tau_syn"))
            note = "Spyx: Euler, the current first, then V with it, the input as it is"
            cell = Cell(1.0 - a, zero, ones, note, i_keep=1.0 - b, i_gain=ones)
    return _firing(node, cell, "fires a step after V > V_th, and falls by V_th then", strict=True, spike_delay=1)


def _rockpool(node: Node, step: float) -> Cell:
    """Rockpool 3.1: `LIFNeuronTorch` and `LIFTorch`. Input decays already in the step in which it arrives."""
    ones, zero = np.ones(node.shape), np.zeros(node.shape)
    if node.kind == "LIF":
        tau = _positive(node, "tau")
        note = "Rockpool: exact decay, the input times r dt / tau"
        cell = Cell(np.exp(-step / tau), zero, node.array("r") * step / tau, note)
    else:
        kept_share, i_keep = (np.exp(-step / _positive(node, word)) for word in ("tau_mem", "tau_syn"))
        note = "Rockpool: exact decay, also of the input in its first step, the current first"
        cell = Cell(kept_share, zero, ones, note, i_keep=i_keep, i_gain=i_keep)
    return _firing(node, cell, FIRES_AND_FALLS, several=True)


def _nir(node: Node, step: float) -> Cell:
    """The equations of NIR, solved exactly for input that is constant during a step."""
    match node.kind:
        case "IF" | "I":
            cell = Cell(np.ones(node.shape), np.zeros(node.shape), step * node.array("r"), "NIR: V' = r I")
        case "LIF" | "LI":
            kept_share = np.exp(-step / _positive(node, "tau"))
            note = "NIR: solved exactly, the input held for a step"
            cell = Cell(kept_share, node.array("v_leak"), (1.0 - kept_share) * node.array("r"), note)
        case _:
            kept_share, i_keep = (np.exp(-step / _positive(node, word)) for word in ("tau_mem", "tau_syn"))
            note = "NIR: exact decay, the current first, then V with it"
            gain, i_gain = (1.0 - kept_share) * node.array("r"), (1.0 - i_keep) * node.array("w_in")
            cell = Cell(kept_share, node.array("v_leak"), gain, note, i_keep=i_keep, i_gain=i_gain)
    return _firing(node, cell, "fires at V >= V_th, then V = v_reset in the same step", reset=_reset_value(node))


_ALL = ("IF", "I", "LIF", "LI", "CubaLIF", "CubaLI")
TOOLS: dict[str, tuple[str, tuple[str, ...], bool, Callable[[Node, float], Cell]]] = {
    "norse": ("Norse", _ALL, False, _norse),
    "snntorch": ("snnTorch", _ALL, True, _snntorch),
    "sinabs": ("Sinabs", ("IF", "I", "LIF", "LI"), True, _sinabs),
    "spikingjelly": ("spikingjelly", ("IF", "LIF", "CubaLIF"), False, _spikingjelly),
    "spyx": ("Spyx", ("IF", "LIF", "CubaLIF"), True, _spyx),
    "rockpool": ("Rockpool", ("LIF", "CubaLIF"), True, _rockpool),
    "nir": ("NIR", _ALL, False, _nir),
}
"""Conventions by tool: title, types of nodes, whether all nodes rest at 0, and the function that returns a cell."""


AT_ONCE = 1e-3
"""Time constant in steps of a potential that is forgotten after one step: e^-1000 is 0 in a double."""

NEVER = 1e30
"""Threshold in mV of neurons that never fire."""


@dataclass(frozen=True, slots=True, eq=False)
class CellModel:
    """The model of the neurons of a node, with the scales of its inputs.

    Attributes:
        model: the neuron model.
        gain: factor from a weight of NIR to a weight here, one element per neuron.
        per_input: constant current in pA per unit of constant input; None if a synapse filters the input.
        offset: constant current in pA that is part of the cell.
        initial: initial states that differ from the defaults of the model.
    """

    model: Neuron
    gain: Floats
    per_input: Floats | None
    offset: Floats
    initial: dict[str, Any] = field(default_factory=dict)


def model_of(cell: Cell, h: float) -> CellModel:
    """Return the model that has the difference equation of a cell.

    Args:
        cell: the difference equation.
        h: length of a step, ms.

    Raises:
        Unsupported: no model has this equation.
    """
    tau = time_constant(cell.keep, h)
    is_endless = np.isinf(tau)
    # With this capacity a current of 1 pA adds `per_pa` mV in a step: 1 - keep, as in NIR, or 1 without a leak.
    capacity, per_pa = np.where(is_endless, h, tau), np.where(is_endless, 1.0, 1.0 - cell.keep)
    parameters = {"tau_m": tau, "C_m": capacity, "t_ref": h * cell.hold, "E_L": cell.rest, **_spike(cell)}
    if cell.lowest is not None:
        parameters["V_min"] = cell.lowest
    initial = {} if cell.start is None or np.all(cell.start == cell.rest) else {"V_m": one_or_all(cell.start)}
    offset = cell.gain * (0.0 if cell.offset is None else cell.offset) / per_pa
    if cell.i_keep is None or cell.i_gain is None:
        return CellModel(_model(iaf_psc_delta, parameters), cell.gain, cell.gain / per_pa, offset, initial)
    tau_syn = time_constant(cell.i_keep, h)
    if np.any(np.isinf(tau_syn)):
        raise Unsupported("its current never decays, and no model here has such a current", "choose a finite tau_syn")
    p32 = np.vectorize(from_exponential)(tau, tau_syn, capacity, h)
    parameters |= {"tau_syn_ex": tau_syn, "tau_syn_in": tau_syn}
    return CellModel(_model(cuba_lif, parameters), cell.i_gain * cell.gain / p32, None, offset, initial)


def _model(kind: type[Neuron], words: dict[str, Any]) -> Neuron:
    parameters = {word: one_or_all(v) if isinstance(v, (float, np.ndarray)) else v for word, v in words.items()}
    return kind(**parameters)


def _spike(cell: Cell) -> dict[str, Any]:
    """Return the parameters of threshold and reset. V > V_th is expressed as V >= the next larger double."""
    if cell.threshold is None:
        return {"V_th": NEVER, "V_reset": cell.rest}
    v_th = np.nextafter(cell.threshold, np.inf) if cell.strict else cell.threshold
    if cell.reset is None:
        if np.any(cell.threshold <= 0.0):
            raise Unsupported("v_threshold is not above 0, so no spike lowers the potential", "raise v_threshold")
        fall = cell.threshold if cell.fall is None else cell.fall
        parameters = {"V_th": v_th, "V_reset": v_th - fall, "reset_by_subtraction": True}
        parameters |= {"threshold_rises": True} if cell.rises else {}
        return parameters | ({"max_spikes": MOST_SPIKES} if cell.several else {})
    if np.any(cell.reset >= v_th):
        raise Unsupported("v_reset is not below v_threshold", "raise v_threshold")
    return {"V_th": v_th, "V_reset": cell.reset}


def time_constant(keep: Floats, h: float) -> Floats:
    """Return the time constant in ms of a state that keeps the share `keep` in h ms, e.g. 10 for e^-0.1 and 1 ms."""
    with np.errstate(divide="ignore"):
        tau = -h / np.log(keep)
    return np.where(keep <= 0.0, AT_ONCE * h, np.where(keep >= 1.0, np.inf, tau))


def one_or_all(values: Any) -> Any:
    """Return a single number if all values are equal, else one value per neuron."""
    flat = np.asarray(values, dtype=np.float64).reshape(-1)
    return float(flat[0]) if np.all(flat == flat[0]) else flat
