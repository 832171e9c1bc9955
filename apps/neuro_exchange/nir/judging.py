"""The analysis of a NIR graph: a verdict for each node, and the cells, links and delays needed to build a network."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from neuro import ModelError, grid
from neuro.apps import Quantity, check, some
from neuro_exchange.nir.cells import (
    ASK,
    BY_GRAPH_EXECUTOR,
    Cell,
    CellModel,
    Unsupported,
    cell_of,
    find_tool,
    model_of,
)
from neuro_exchange.nir.graph import (
    FIELDS,
    STATEFUL,
    Floats,
    Graph,
    Map,
    Node,
    compose,
    map_of,
    sheet,
    shorten,
    sources,
    spread,
)
from neuro_exchange.nir.reading import read
from neuro_exchange.verdict import APPROXIMATE, EXACT, REFUSED, Verdict, Verdicts

DT = Quantity(unit="ms", doc="length of a step", above=0)
RESET = Quantity(
    doc="what a spike does",
    kind="word",
    words=("to_value", "to_value_next", "subtract", "subtract_next"),
    optional=True,
)
STEP = "neuro_dt_ms"
"""Key of a graph's metadata for the length of a step in ms."""

LONG = 10_000
"""Number of steps. If the shortest time constant has more steps, the user probably gave dt in seconds."""

LACKS = {
    **dict.fromkeys(("norse", "sinabs"), ("Delay", "Scale", "Threshold", "AvgPool2d")),
    **dict.fromkeys(("snntorch", "spikingjelly"), ("Delay", "Scale", "Threshold")),
}
"""Types of nodes that the importer of a tool does not read."""

NO_RUN = "not measured: the tool runs no such network"
FIRST_STEPS = "not measured: only the steps before that differ"
MOST_PATHS = 10_000
"""Largest number of paths of linear nodes into one node."""

_HOW = {
    "Input": "listed or injected spikes; a count is a spike of that multiplicity",
    "Output": "a probe of the population before it",
    "Linear": "weights",
    "Affine": "weights; the bias is a constant current",
    "Conv1d": "shared kernels; the bias is a constant current",
    "Conv2d": "shared kernels; the bias is a constant current",
    "SumPool2d": "part of the weights behind it",
    "AvgPool2d": "part of the weights behind it",
    "Flatten": "neurons in the same order",
    "Scale": "part of the weights",
    "Delay": "part of the delays of the weights",
}
"""Representation of each type of node in a network, for verdicts."""


@dataclass(slots=True)
class Link:
    """A connection between two neuron nodes along one path of linear nodes.

    Attributes:
        source, target: names of the nodes.
        map: the product of the linear nodes on the path.
        lag: sum of the delays on the path in seconds, one element per source neuron.
    """

    source: str
    target: str
    map: Map
    lag: Floats


@dataclass(slots=True)
class Analysis:
    """The analysis of a graph, from which `importing` builds a network. Most attributes are dictionaries by node name.

    Attributes:
        graph: the graph.
        tool: name of the tool whose convention holds; None if neither the user nor the metadata names one.
        step: length of a step in seconds.
        cells: difference equations of the stateful nodes.
        models: models of the stateful nodes.
        links: connections between neuron nodes.
        bias: constant input of each stateful node from the first step on, in the unit of weighted input.
        late_bias: constant input that begins only with the second step.
        depths: number of steps by which the spikes of each node are later here than in the tool.
        names: populations of the Input and stateful nodes.
        verdicts: verdicts of all nodes.
    """

    graph: Graph
    tool: str | None
    step: float
    cells: dict[str, Cell] = field(default_factory=dict)
    models: dict[str, CellModel] = field(default_factory=dict)
    links: list[Link] = field(default_factory=list)
    bias: dict[str, Floats] = field(default_factory=dict)
    late_bias: dict[str, Floats] = field(default_factory=dict)
    depths: dict[str, int] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    verdicts: dict[str, Verdict] = field(default_factory=dict)

    def refuse(self, node: str, why: str, way_out: str) -> None:
        """Refuse a node. The first refusal of a node is kept."""
        if node not in self.verdicts or self.verdicts[node].verdict != REFUSED:
            self.verdicts[node] = Verdict(node, self.graph.nodes[node].kind, REFUSED, why, way_out)

    def table(self) -> Verdicts:
        """Return the verdicts in the order of the graph's nodes."""
        nodes = [node for node in self.graph.nodes.values() if node.kind != "Identity"]
        heading = f"{self.graph.source}: from {self.tool or 'an unknown tool'}, steps of {self.step * 1e3:g} ms"
        return Verdicts(heading, tuple(self.verdicts[node.name] for node in nodes))


def judge(graph: Any, dt: float, from_: str | None, reset: str | None = None) -> Analysis:
    """Read a graph and give each node a verdict.

    Args:
        graph: a file, a `nir.NIRGraph` or a `Graph`.
        dt: length of a step in ms.
        from_: the tool whose convention holds; None reads the convention from the metadata.
        reset: the reset rule of `from_nir`, or None.

    Raises:
        ModelError: the graph is damaged, no convention is known, or dt seems to be in seconds.
    """
    step = check(DT, dt, "dt", ("dt",)) / 1e3
    reset = check(RESET, reset, "reset", ("reset",))
    flat_graph = graph if isinstance(graph, Graph) else read(graph)
    analysis = Analysis(flat_graph, find_tool(from_, flat_graph.metadata), step)
    if analysis.tool is None and any(node.kind in STATEFUL for node in flat_graph.nodes.values()):
        raise ModelError(
            f"{flat_graph.source}: does not name the tool that wrote it, and tools differ in spikes", hint=ASK
        )
    # NIR's times are in seconds, so dt=0.001 is a likely mistake for dt=1.
    fields = () if analysis.tool in ("sinabs", "snntorch") else ("tau", "tau_mem", "tau_syn")
    nodes = analysis.graph.nodes.values()
    taus = [node.array(w).min() for node in nodes for w in fields if w in node.fields and not node.problem[0]]
    steps = float(min(taus)) / analysis.step if taus else 0.0
    if LONG < steps < math.inf:
        ms = analysis.step * 1e3
        message = f"{analysis.graph.source}: dt = {ms:g} ms: the shortest time constant is {steps:,.0f} steps"
        raise ModelError(message, hint=f"dt is in ms: dt={ms * 1e3:g} for steps of {ms:g} s")
    for node in flat_graph.nodes.values():
        _judge(analysis, node, reset)
    if not analysis.table().refused:
        _find_links(analysis)
    if not analysis.table().refused:
        _find_depths(analysis)
        for link in analysis.links:
            if link.target in analysis.cells and link.map.kernel is not None and grid_of(link.map) is None:
                verdict, weights = analysis.verdicts[link.target], link.map.sparse().nnz
                note = f"its convolution is {some(weights, 'weight')}, as a grid has one stride for both axes"
                analysis.verdicts[link.target] = replace(verdict, how=f"{verdict.how}; {note}")
    return analysis


def _judge(analysis: Analysis, node: Node, reset: str | None) -> None:
    """Add the verdict of a node by itself, before its connections are analysed."""
    note = _HOW.get(node.kind, "")
    analysis.verdicts[node.name] = Verdict(node.name, node.kind, EXACT, note)
    if node.kind in LACKS.get(str(analysis.tool), ()):
        behaviour = "runs only a part of the graph" if analysis.tool in BY_GRAPH_EXECUTOR else "refuses the file"
        note = f"{note or 'as NIR defines it'}; {analysis.tool}'s own importer has no {node.kind}, and {behaviour}"
        analysis.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE, note, measured=NO_RUN)
    elif analysis.tool == "norse" and node.kind == "SumPool2d" and np.any(np.asarray(node.fields["padding"]) != 0):
        note = f"{note}; Norse's own importer ignores its padding, so the nodes behind it have other shapes"
        analysis.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE, note, measured=NO_RUN)
    if node.kind != "Identity" and node.kind not in FIELDS:
        analysis.refuse(node.name, f"{node.kind} has no counterpart here", "replace it in the tool that wrote the file")
    elif node.problem[0]:
        analysis.refuse(node.name, *node.problem)
    elif node.kind in STATEFUL:
        try:
            cell = cell_of(node, str(analysis.tool), analysis.step, reset)
            analysis.models[node.name] = model_of(cell, analysis.step * 1e3)
        except Unsupported as error:
            analysis.refuse(node.name, error.why, error.way_out)
            return
        analysis.cells[node.name] = cell
        note = cell.how + (f"; {cell.differs}" if cell.differs else "")
        if analysis.verdicts[node.name].verdict == EXACT:
            analysis.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE if cell.differs else EXACT, note)
    elif node.kind == "Delay":
        steps = node.array("delay") / analysis.step
        if np.any(steps < 0):
            analysis.refuse(node.name, f"is {steps.min() * analysis.step:g} s, below 0", "give it a time of 0 or above")
        elif not np.allclose(steps, np.rint(steps), rtol=2e-7, atol=1e-3):  # single precision
            analysis.refuse(node.name, "is not a multiple of the step", "choose a dt that divides the delay")


def _find_links(analysis: Analysis) -> None:
    graph = analysis.graph
    for name, node in graph.nodes.items():
        if node.kind not in (*STATEFUL, "Output"):
            continue
        analysis.bias[name], analysis.late_bias[name] = np.zeros(node.shape), np.zeros(node.shape)
        counted: set[tuple[str, ...]] = set()
        first = len(analysis.links)
        for count, path in enumerate(sources(graph, name)):
            if count >= MOST_PATHS:
                raise ModelError(f"{graph.source}: more than {MOST_PATHS} paths lead to node '{name}'")
            _add_link(analysis, path, counted)
        links = analysis.links[first:]
        passes_on = len(links) == 1 and _is_identity(analysis, links[0]) and not analysis.bias[name].any()
        if node.kind == "Output" and not passes_on:
            # An Output of weighted spikes becomes a population without memory that never fires. Its V_m is the output.
            zero = np.zeros(node.shape)
            cell = Cell(zero, zero, zero + 1.0, "V_m of neurons without memory that never fire")
            analysis.cells[name], analysis.models[name] = cell, model_of(cell, analysis.step * 1e3)
            analysis.verdicts[name] = Verdict(name, node.kind, EXACT, f"a probe of {cell.how}")
    for name, node in graph.nodes.items():
        prefix = name.rpartition(".")[0]
        is_inner = prefix and any(
            n.kind == "Identity" and n.name.rpartition(".")[0] == prefix for n in graph.nodes.values()
        )
        # snnTorch writes recurrent weights as a subgraph, and interprets them differently outside a subgraph.
        if analysis.tool == "snntorch" and node.recurrent and node.kind in ("Linear", "Affine") and not is_inner:
            note = (
                "recurrent weights, as in RLeaky and RSynaptic; snnTorch 1.0's importer fails with nirtorch 2.6,"
                " or sends the input of the neurons through them, too"
            )
            analysis.verdicts[name] = Verdict(name, node.kind, APPROXIMATE, note)
    for link in analysis.links:
        is_silent = link.source in analysis.cells and analysis.cells[link.source].threshold is None
        if is_silent and link.target in analysis.cells:
            reason = "sends its potential to other neurons, and neurons here send only spikes"
            analysis.refuse(link.source, reason, "replace it by a neuron that fires")


def _is_identity(analysis: Analysis, link: Link) -> bool:
    """Return whether the link has no weights, and no delays except the source's own spike delay."""
    spike_delay = analysis.step * analysis.cells[link.source].spike_delay if link.source in analysis.cells else 0.0
    is_unweighted = link.map.diagonal is not None and np.all(link.map.diagonal == 1.0)
    return bool(is_unweighted and np.all(link.lag == spike_delay))


def _add_link(analysis: Analysis, path: list[str], counted: set[tuple[str, ...]]) -> None:
    """Add the links of a path. The biases of its nodes are added to the constant input of the target.

    Args:
        analysis: the analysis, changed in place.
        path: names of the nodes, from the source to the target.
        counted: tails of paths whose bias is already added. A tail begins at a node with a bias and ends at the
            target. Several paths can have the same tail.
    """
    graph = analysis.graph
    nodes = [graph.nodes[name] for name in path]
    shape = nodes[0].shape
    maps: list[Map] = []
    source_delay, target_delay = np.zeros(shape), np.zeros(())  # delays in seconds before and behind the weights
    has_weights, uneven_delay = False, ""
    for node in nodes[1:-1]:
        maps.append(map_of(node, shape))
        shape = maps[-1].target
        if maps[-1].diagonal is None:
            if uneven_delay:
                reason = "its delays differ from neuron to neuron between two nodes of weights"
                analysis.refuse(uneven_delay, reason, "give all neurons one delay")
                return
            has_weights, target_delay = True, target_delay.reshape(-1)[0]
        elif node.kind == "Delay":
            delay = node.array("delay")
            if has_weights:
                target_delay = (target_delay.reshape(delay.shape) if target_delay.size > 1 else target_delay) + delay
                uneven_delay = node.name if np.unique(target_delay).size > 1 else ""
            else:
                source_delay = source_delay + delay.reshape(source_delay.shape)
    if path[0] in analysis.cells:
        source_delay = source_delay + analysis.step * analysis.cells[path[0]].spike_delay
    identity = Map(shape, nodes[-1].shape, diagonal=np.ones(nodes[-1].shape))
    product = compose([*maps, identity])
    times = np.unique(target_delay)
    for time in times:  # one link for each delay, onto the targets with this delay
        part = product if times.size == 1 else product.onto(target_delay.reshape(product.target) == time)
        analysis.links.append(Link(path[0], path[-1], part, source_delay + time))
    for k, node in enumerate(nodes[1:-1]):
        tail = tuple(path[k + 1 :])
        bias = node.fields.get("bias")
        if bias is None or tail in counted:
            continue
        counted.add(tail)
        convolves, target = node.kind.startswith("Conv"), maps[k].target
        values = spread(bias, target[:1] if convolves else target[-1:], f"node '{node.name}': bias")
        values = values.reshape(-1, *[1] * (len(target) - 1)) if convolves else values
        full_bias = np.broadcast_to(values, target).astype(np.float64)
        for other in nodes[k + 2 : -1]:
            if other.kind == "Delay" and other.array("delay").any() and full_bias.any():
                note = f"{_HOW['Delay']}; the bias of '{node.name}' acts from the first step here, in the tool later"
                analysis.verdicts[other.name] = Verdict(other.name, "Delay", APPROXIMATE, note, measured=FIRST_STEPS)
        # The GraphExecutor delays recurrent input by a step, so the bias of recurrent input is 0 in the first step.
        is_late = path[0] == path[-1] and analysis.tool in BY_GRAPH_EXECUTOR
        (analysis.late_bias if is_late else analysis.bias)[path[-1]] += compose([*maps[k + 1 :], identity])(full_bias)


def _find_depths(analysis: Analysis) -> None:
    """Compute the delay of each node in steps, and refuse loops of several layers.

    In the tools a spike passes all forward layers in the same step, and recurrent connections of a layer take a step.
    Here every connection takes at least one step. So the delay of a node is at least the number of layers on its
    shortest path from the Input. A Delay on the path does not replace any of these steps. So neurons behind a Delay of
    5 steps fire 5 steps after neurons of the same layer without a Delay, as in the tool.
    """
    inputs = [name for name, node in analysis.graph.nodes.items() if node.kind == "Input"]
    depths = analysis.depths
    names = [*inputs, *analysis.cells]
    index = {name: k for k, name in enumerate(names)}
    hops = [math.inf if name in analysis.cells else 0.0 for name in names]
    spike_delays = {name: cell.spike_delay for name, cell in analysis.cells.items()}
    forward_links = [x for x in analysis.links if x.target in analysis.cells and x.source != x.target]
    shorten(hops, [(index[x.source], index[x.target], 1 - spike_delays.get(x.source, 0)) for x in forward_links])
    depths.update((name, 0 if hop == math.inf else int(hop)) for name, hop in zip(names, hops, strict=True))
    # A current acts two steps after its generator starts, so a node with a constant current has a delay of 2 or more.
    for name, cell_model in analysis.models.items():
        if cell_model.offset.any() or (cell_model.per_input is not None and analysis.bias[name].any()):
            depths[name] = max(2, depths[name])
    links = [(x, 1 - round(x.lag.min() / analysis.step)) for x in analysis.links if x.target in analysis.cells]
    for _ in depths:
        shallow_nodes = {
            x.target for x, steps in links if depths[x.source] + steps - (x.source == x.target) > depths[x.target]
        }
        for name in shallow_nodes:
            depths[name] = max(depths[x.source] + steps for x, steps in links if x.target == name and x.source != name)
        if not shallow_nodes:
            break
    else:
        for name in shallow_nodes:
            reason = "is in a loop of several layers, which takes one step in the tools, and here one per layer"
            way_out = "delay the way back in the tool, too, or leave out all but one layer of the loop"
            analysis.refuse(name, reason, way_out)
    for name in analysis.cells:
        verdict, extra_delay = analysis.verdicts[name], depths[name] - analysis.cells[name].spike_delay
        if verdict.verdict != REFUSED:
            analysis.verdicts[name] = replace(verdict, how=f"{verdict.how}; {some(extra_delay, 'step')} later here")


def grid_of(part: Map) -> grid | None:
    """Return the connection rule of a convolution, or None for unequal strides, which `grid` does not support."""
    assert part.kernel is not None
    (_, *source_sides), (_, *target_sides) = sheet(part.source), sheet(part.target)
    size, border = part.kernel.weight.shape[2:], part.kernel.padding
    for stride in dict.fromkeys(part.kernel.stride):
        settings: dict[str, Any] = {"kernel": size, "stride": stride, "depthwise": part.kernel.depthwise}
        if target_sides == [(n + 2 * b - k) // stride + 1 for n, b, k in zip(source_sides, border, size, strict=True)]:
            column_padding = None if border[0] == border[1] else border[1]
            return grid(**settings, padding=border[0], column_padding=column_padding)
        if stride == 1 and target_sides == source_sides:
            return grid(**settings, padding="same")
    return None
