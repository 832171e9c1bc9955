"""What a neuron of NIR is in the convention of the tool that wrote it.

A cell is a difference equation, the form that all these tools have in common. In each step

    i = i_keep i + i_gain w s                       only where it has a synapse
    v = rest + keep (v - rest) + gain (i, or w s)
    spike where v >= threshold, or > if strict; then v = reset, or v falls by the threshold
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from neuro.core.errors import ModelError, unknown
from neuro.exchange.nir.graph import Floats, Node

ASK = "say which tool wrote it: from_='norse', 'snntorch', 'sinabs', 'spikingjelly', 'spyx', 'rockpool' or 'nir'"
BY_GRAPH_EXECUTOR = ("norse", "sinabs")
"""Tools whose importers run a graph by the `GraphExecutor` of nirtorch."""

FALLS_AND_RISES = "fires at V > V_th, and falls by V_th; at 2 V_th while more than V_th is left"
"""What a spike does in snnTorch 1.0 with reset by subtraction and without reset delay."""

BEYOND = "while more than V_th is left after a spike, snnTorch fires at 2 V_th, and cuba_lif at V_th"
"""What differs of a CubaLIF of snnTorch that is reset by subtraction."""

MOST_SPIKES = 255
"""Of a step here, where a tool has any number."""

FIRES_AND_FALLS = (
    f"fires at V >= V_th, several times if V_th fits several times (here {MOST_SPIKES} at most), "
    "and falls by V_th each time"
)
"""What a spike does in Sinabs and Rockpool."""

SNNTORCH_STEP = 1e-4
"""The step in seconds that snnTorch 1.0 has in its importer and exporter, whatever a step lasts."""


@dataclass(frozen=True, slots=True, eq=False)
class Cell:
    """The difference equation of the neurons of one node; arrays have its shape.

    Attributes:
        keep, rest, gain: of the potential.
        how: the convention in words.
        i_keep, i_gain: of the synapse, None without one.
        offset: a constant that is added to i.
        threshold: None where it never fires.
        strict: whether it fires above the threshold only.
        reset: the potential after a spike; None: it falls by the threshold.
        several: whether it fires as often in a step as the threshold fits.
        lowest: a bound of the potential from below after a spike, None without one.
        start: the potential at the beginning, `rest` if None.
        rises: whether a spike needs the threshold once more while what is left is above it.
        late: by how many steps the tool sends a spike after the threshold was crossed.
        fall: how far the potential falls where that is not the threshold.
        hold: for how many steps after a spike the potential stays, and does not take input.
        differs: what of it cannot be had exactly, "" if nothing.
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
    late: int = 0
    fall: Floats | None = None
    differs: str = ""


class Unsupported(Exception):
    """A node that a convention cannot have: why, and the way out."""

    def __init__(self, why: str, way_out: str) -> None:
        self.why, self.way_out = why, way_out
        super().__init__(why)


def cell_of(node: Node, tool: str, step: float, reset: str | None) -> Cell:
    """The cell of a stateful node.

    Args:
        node: the node.
        tool: a name of `TOOLS`.
        step: seconds.
        reset: a word of `from_nir` in place of the convention's, or None.

    Raises:
        Unsupported: the convention has no such node, or not with these parameters.
        ModelError: a field does not fit.
    """
    if node.kind == "Threshold":
        zero = np.zeros(node.shape)
        how = "fires where the input of a step reaches the threshold, and keeps nothing"
        return Cell(zero, zero, zero + 1.0, how, threshold=node.array("threshold"), reset=zero)
    cell = TOOLS[tool](node, step)
    if cell.threshold is not None and reset in ("subtract", "subtract_next"):
        fall = cell.threshold / np.maximum(cell.keep, 1e-9) if reset == "subtract_next" else cell.threshold
        when = "in the next step, after the decay" if reset == "subtract_next" else "in the same step"
        rises = tool == "snntorch" and reset == "subtract" and cell.i_keep is None
        spikes = FALLS_AND_RISES if rises else f"fires as there, and V falls by V_th {when}"
        how = f"{cell.how.rpartition('; ')[0]}; {spikes}, as `reset` says"
        differs = "" if rises or tool != "snntorch" or reset == "subtract_next" else BEYOND
        cell = replace(cell, reset=None, fall=fall, hold=0, rises=rises, how=how, differs=differs)
    elif cell.threshold is not None and reset in ("to_value", "to_value_next"):
        hold = int(reset == "to_value_next")
        when = "in the next step, which takes no input" if hold else "in the same step"
        how = f"{cell.how.rpartition('; ')[0]}; fires as there, then V = v_reset {when}, as `reset` says"
        cell = replace(cell, reset=_reset_value(node), several=False, rises=False, fall=None, hold=hold, how=how)
    return cell


def find_tool(said: str | None, metadata: object) -> str | None:
    """The convention that is asked for, or that the graph says it has; None where nothing tells.

    Raises:
        ModelError: there is none of that name.
    """
    known = metadata.get("neuro_convention") if isinstance(metadata, dict) else None
    known = known.decode("utf-8", "replace") if isinstance(known, bytes) else known
    name = known if said is None else said
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


def _zero(node: Node, word: str, tool: str) -> None:
    if np.any(node.array(word) != 0.0):
        raise Unsupported(f"{word} is not 0, which {tool} does not have", "read it with from_='nir'")


def _reset_value(node: Node) -> Floats:
    return np.zeros(node.shape) if node.fields.get("v_reset") is None else node.array("v_reset")


def _norse(node: Node, step: float) -> Cell:
    """Norse 1.1: `lif_box`, `iaf`, `leaky_integrator_box`, and the module that its importer makes of CubaLIF."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    fires = "fires at V > V_th, then V = 0 in the same step"
    match node.kind:
        case "IF":
            how = f"Norse: V grows by the input, r is not used; {fires}"
            return Cell(one, zero, one, how, threshold=node.array("v_threshold"), strict=True, reset=zero)
        case "I":
            return Cell(one, zero, one, "V grows by the input")
        case "LIF" | "LI":
            a = _euler(node, "tau", step)
            how = "Norse: Euler, r is not used"
            cell = Cell(1.0 - a, node.array("v_leak"), a, how)
        case _:
            a, b, leak = _euler(node, "tau_mem", step), _euler(node, "tau_syn", step), node.array("v_leak")
            how = "Norse: Euler, the current first, then V with it"
            cell = Cell(
                1.0 - a, leak, a * node.array("r"), how, i_keep=1.0 - b, i_gain=b * node.array("w_in"), offset=leak
            )
    if node.kind in ("LI", "CubaLI"):
        return cell
    return replace(cell, how=f"{how}; {fires}", threshold=node.array("v_threshold"), strict=True, reset=zero)


def _snntorch(node: Node, step: float) -> Cell:
    """SnnTorch 1.0: `Leaky` and `Synaptic` as its importer makes them, with its step of 1e-4 s."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    fires = "fires at V > V_th, then V = 0 in the same step"
    match node.kind:
        case "IF":
            how = f"snnTorch 1.0 reads IF as Leaky with beta = 0.9; {FALLS_AND_RISES}"
            if np.any(node.array("r") != 1.0):
                raise Unsupported("r is not 1, which snnTorch does not have", "read it with from_='nir'")
            return Cell(0.9 * one, zero, one, how, threshold=node.array("v_threshold"), strict=True, rises=True)
        case "I":
            return Cell(one, zero, node.array("r"), "V grows by r times the input")
        case "LIF" | "LI":
            _zero(node, "v_leak", "snnTorch")
            a = _euler(node, "tau", SNNTORCH_STEP)
            gain = a * node.array("r")
            how = "snnTorch: Euler with its step of 1e-4 s"
            if node.kind == "LIF" and np.unique(gain).size > 1:
                gain = np.full(node.shape, np.unique(gain)[0])
                how += ", the smallest r dt / tau of the node for all its neurons"
            cell = Cell(1.0 - a, zero, gain, how)
        case _:
            _zero(node, "v_leak", "snnTorch")
            a, b = (_euler(node, word, SNNTORCH_STEP) for word in ("tau_mem", "tau_syn"))
            how = "snnTorch: Euler with its step of 1e-4 s, the current first, then V with it"
            cell = Cell(1.0 - a, zero, a * node.array("r"), how, i_keep=1.0 - b, i_gain=b * node.array("w_in"))
    if node.kind in ("LI", "CubaLI"):
        return cell
    hold = int(node.kind == "CubaLIF" and node.recurrent)
    if hold:
        fires = "RSynaptic of snnTorch 1.0 fires at V > V_th, then V = 0 in the next step, which takes no input"
    return replace(cell, how=f"{how}; {fires}", threshold=node.array("v_threshold"), strict=True, reset=zero, hold=hold)


def _sinabs(node: Node, step: float) -> Cell:
    """Sinabs 3.1: `IAF`, `LIF` and `ExpLeak` as its importer makes them, whose tau is in steps."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    match node.kind:
        case "IF":
            threshold = node.array("v_threshold")
            how = f"Sinabs: V grows by the input, r is not used; {FIRES_AND_FALLS}; then V >= -V_th"
            return Cell(one, zero, one, how, threshold=threshold, several=True, lowest=-threshold)
        case "I":
            return Cell(one, zero, one, "V grows by the input")
        case "LIF" | "LI":
            _zero(node, "v_leak", "Sinabs")
            tau = _positive(node, "tau")
            if np.all(tau < 1.0):
                keep, gain = np.exp(-step / tau), step / tau
                how = "Sinabs: exact decay, the input times dt / tau; tau in seconds, since it is below one step"
            else:
                keep, gain, how = np.exp(-1.0 / tau), one, "Sinabs: exact decay, tau in steps, the input as it is"
            cell = Cell(keep, zero, gain, how)
            if node.kind == "LI":
                return cell
            return replace(cell, how=f"{how}; {FIRES_AND_FALLS}", threshold=node.array("v_threshold"), several=True)
    raise Unsupported(f"Sinabs does not have {node.kind}", "read it with from_='nir'")


def _spikingjelly(node: Node, step: float) -> Cell:
    """Spikingjelly 2.0: `IFNode`, `LIFNode` and `CUBALIFNode` as its importer makes them."""
    one = np.ones(node.shape)
    reset = _reset_value(node)
    fires = "fires at V >= V_th, then V = v_reset in the same step"
    match node.kind:
        case "IF":
            how = f"spikingjelly: V grows by r dt times the input; {fires}"
            threshold = node.array("v_threshold")
            return Cell(one, reset, step * node.array("r"), how, threshold=threshold, reset=reset)
        case "LIF":
            a = _euler(node, "tau", step)
            if np.any(node.array("v_leak") != reset):
                raise Unsupported("v_leak is not v_reset, which spikingjelly does not have", "read it with from_='nir'")
            how = f"spikingjelly: Euler; {fires}"
            threshold = node.array("v_threshold")
            return Cell(1.0 - a, reset, a * node.array("r"), how, threshold=threshold, reset=reset)
        case "CubaLIF":
            _zero(node, "v_leak", "spikingjelly")
            a, b = (_euler(node, word, step) for word in ("tau_mem", "tau_syn"))
            how = f"spikingjelly: Euler, the current first, then V with it; {fires}"
            cell = Cell(1.0 - a, 0.0 * one, a * node.array("r"), how, i_keep=1.0 - b, i_gain=b * node.array("w_in"))
            return replace(cell, threshold=node.array("v_threshold"), reset=reset, start=reset)
    raise Unsupported(f"spikingjelly does not have {node.kind}", "read it with from_='nir'")


def _spyx(node: Node, step: float) -> Cell:
    """Spyx 1.0: `IF`, `LIF` and `CuBaLIF`, whose spikes are those of the potential of the step before."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    fires = "fires a step after V > V_th, and falls by V_th then"
    threshold = node.array("v_threshold") if "v_threshold" in node.fields else zero
    spikes: dict[str, Any] = {"threshold": threshold, "strict": True, "late": 1}
    match node.kind:
        case "IF":
            return Cell(one, zero, one, f"Spyx: V grows by the input; {fires}", **spikes)
        case "LIF":
            _zero(node, "v_leak", "Spyx")
            a = _euler(node, "tau", step)
            own = np.allclose(node.array("r"), 1.0 - a, rtol=1e-4)  # what Spyx 1.0 writes; it does not read r
            gain = one if own else a * node.array("r")
            how = "Spyx: Euler, the input as it is" if own else "Spyx: Euler, the input times r dt / tau"
            return Cell(1.0 - a, zero, gain, f"{how}; {fires}", fall=threshold / np.maximum(1.0 - a, 1e-9), **spikes)
        case "CubaLIF":
            _zero(node, "v_leak", "Spyx")
            a, b = (_euler(node, word, step) for word in ("tau_mem", "tau_syn"))
            how = f"Spyx: Euler, the current first, then V with it, the input as it is; {fires}"
            return Cell(1.0 - a, zero, one, how, i_keep=1.0 - b, i_gain=one, **spikes)
    raise Unsupported(f"Spyx does not have {node.kind}", "read it with from_='nir'")


def _rockpool(node: Node, step: float) -> Cell:
    """Rockpool 3.1: `LIFNeuronTorch` and `LIFTorch`, whose input decays in the step in which it arrives."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    if node.kind == "LIF":
        _zero(node, "v_leak", "Rockpool")
        tau = _positive(node, "tau")
        how = f"Rockpool: exact decay, the input times r dt / tau; {FIRES_AND_FALLS}"
        gain = node.array("r") * step / tau
        return Cell(np.exp(-step / tau), zero, gain, how, threshold=node.array("v_threshold"), several=True)
    if node.kind == "CubaLIF":
        _zero(node, "v_leak", "Rockpool")
        keep, i_keep = (np.exp(-step / _positive(node, word)) for word in ("tau_mem", "tau_syn"))
        how = f"Rockpool: exact decay, also of the input in its first step, the current first; {FIRES_AND_FALLS}"
        threshold = node.array("v_threshold")
        return Cell(keep, zero, one, how, i_keep=i_keep, i_gain=i_keep, threshold=threshold, several=True)
    raise Unsupported(f"Rockpool does not have {node.kind}", "read it with from_='nir'")


def _nir(node: Node, step: float) -> Cell:
    """The equations of NIR, solved exactly for an input that is held for a step."""
    one, zero = np.ones(node.shape), np.zeros(node.shape)
    match node.kind:
        case "IF" | "I":
            cell = Cell(one, zero, step * node.array("r"), "NIR: V' = r I")
        case "LIF" | "LI":
            keep = np.exp(-step / _positive(node, "tau"))
            how = "NIR: solved exactly, the input held for a step"
            cell = Cell(keep, node.array("v_leak"), (1.0 - keep) * node.array("r"), how)
        case _:
            keep, i_keep = (np.exp(-step / _positive(node, word)) for word in ("tau_mem", "tau_syn"))
            how = "NIR: exact decay, the current first, then V with it"
            gain, i_gain = (1.0 - keep) * node.array("r"), (1.0 - i_keep) * node.array("w_in")
            cell = Cell(keep, node.array("v_leak"), gain, how, i_keep=i_keep, i_gain=i_gain)
    if node.kind in ("I", "LI", "CubaLI"):
        return cell
    how = f"{cell.how}; fires at V >= V_th, then V = v_reset in the same step"
    return replace(cell, how=how, threshold=node.array("v_threshold"), reset=_reset_value(node))


TOOLS: dict[str, Callable[[Node, float], Cell]] = {
    "norse": _norse,
    "snntorch": _snntorch,
    "sinabs": _sinabs,
    "spikingjelly": _spikingjelly,
    "spyx": _spyx,
    "rockpool": _rockpool,
    "nir": _nir,
}
"""The conventions by the name of the tool."""
