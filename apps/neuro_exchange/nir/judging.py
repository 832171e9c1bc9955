"""A NIR graph with a verdict for each of its nodes, and all that a network needs of it."""

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
    Made,
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
    map_of,
    sheet,
    shorten,
    sources,
    spread,
    together,
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
"""The word of a graph's metadata that says the length of a step in ms."""

LONG = 10_000
"""Steps of the shortest time constant above which a step is taken for one in seconds."""

LACKS = {
    **dict.fromkeys(("norse", "sinabs"), ("Delay", "Scale", "Threshold", "AvgPool2d")),
    **dict.fromkeys(("snntorch", "spikingjelly"), ("Delay", "Scale", "Threshold")),
}
"""Types of nodes that a tool's own importer does not read."""

NO_RUN = "not measured: the tool runs no such network"
FIRST_STEPS = "not measured: only the steps before that differ"
MOST_PATHS = 10_000
_HOW = {
    "Input": "spikes, as listed or injected; a count is a spike of that multiplicity",
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


@dataclass(slots=True)
class Link:
    """What one neuron node sends another along one path of linear nodes.

    Attributes:
        source, target: names of the nodes.
        map: the linear nodes together.
        lag: seconds of the delays on the path, an element each of the source; 0 without one.
    """

    source: str
    target: str
    map: Map
    lag: Floats


@dataclass(slots=True)
class Read:
    """A graph with all that a network needs.

    Attributes:
        graph: the graph.
        tool: the convention, None where nothing tells.
        step: seconds.
        cells, made: of each stateful node.
        links: between neurons.
        bias: of each stateful node the constant input, in the unit of weighted input.
        late: the part of it that begins with the second step.
        depths: by how many steps each node is later here than in the tool.
        names: by Input and stateful node, the population that it is.
        verdicts: of each node.
    """

    graph: Graph
    tool: str | None
    step: float
    cells: dict[str, Cell] = field(default_factory=dict)
    made: dict[str, Made] = field(default_factory=dict)
    links: list[Link] = field(default_factory=list)
    bias: dict[str, Floats] = field(default_factory=dict)
    late: dict[str, Floats] = field(default_factory=dict)
    depths: dict[str, int] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    verdicts: dict[str, Verdict] = field(default_factory=dict)

    def refuse(self, node: str, why: str, way_out: str) -> None:
        """A node cannot be had."""
        if node not in self.verdicts or self.verdicts[node].verdict != REFUSED:
            self.verdicts[node] = Verdict(node, self.graph.nodes[node].kind, REFUSED, why, way_out)

    def table(self) -> Verdicts:
        """The verdicts in the order of the graph."""
        nodes = [each for each in self.graph.nodes.values() if each.kind != "Identity"]
        heading = f"{self.graph.source}: from {self.tool or 'an unknown tool'}, steps of {self.step * 1e3:g} ms"
        return Verdicts(heading, tuple(self.verdicts[node.name] for node in nodes))


def judge(graph: Any, dt: float, from_: str | None, reset: str | None = None) -> Read:
    """Read a graph and decide on each node."""
    step = check(DT, dt, "dt", ("dt",)) / 1e3
    reset = check(RESET, reset, "reset", ("reset",))
    plain = graph if isinstance(graph, Graph) else read(graph)
    found = Read(plain, find_tool(from_, plain.metadata), step)
    if found.tool is None and any(node.kind in STATEFUL for node in plain.nodes.values()):
        raise ModelError(f"{plain.source}: nothing says which tool wrote it, on which spikes depend", hint=ASK)
    # Refuse a step that was meant in seconds, as NIR's times are.
    words = () if found.tool in ("sinabs", "snntorch") else ("tau", "tau_mem", "tau_syn")
    nodes = found.graph.nodes.values()
    taus = [node.array(w).min() for node in nodes for w in words if w in node.fields and not node.problem[0]]
    steps = float(min(taus)) / found.step if taus else 0.0
    if LONG < steps < math.inf:
        said = f"dt = {found.step * 1e3:g} ms"
        message = f"{found.graph.source}: {said}: the shortest time constant is {steps:,.0f} steps"
        raise ModelError(message, hint=f"dt is in ms: dt={found.step * 1e6:g} for steps of {found.step * 1e3:g} s")
    for node in plain.nodes.values():
        _judge(found, node, reset)
    if not found.table().refused:
        _find_links(found)
    if not found.table().refused:
        _find_depths(found)
        for link in found.links:
            if link.target in found.cells and link.map.kernel is not None and grid_of(link.map) is None:
                old, weights = found.verdicts[link.target], link.map.sparse().nnz
                how = f"{old.how}; its convolution is {some(weights, 'weight')}, as a grid has one stride for both axes"
                found.verdicts[link.target] = replace(old, how=how)
    return found


def _judge(found: Read, node: Node, reset: str | None) -> None:
    """The verdict of a node by itself."""
    how = _HOW.get(node.kind, "")
    found.verdicts[node.name] = Verdict(node.name, node.kind, EXACT, how)
    if node.kind in LACKS.get(str(found.tool), ()):
        does = "runs only a part of the graph" if found.tool in BY_GRAPH_EXECUTOR else "refuses the file"
        how = f"{how or 'as NIR defines it'}; {found.tool}'s own importer has no {node.kind}, and {does}"
        found.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE, how, measured=NO_RUN)
    elif found.tool == "norse" and node.kind == "SumPool2d" and np.any(np.asarray(node.fields["padding"]) != 0):
        how = f"{how}; Norse's own importer leaves its padding out, and all behind it has another shape"
        found.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE, how, measured=NO_RUN)
    if node.kind != "Identity" and node.kind not in FIELDS:
        found.refuse(node.name, f"{node.kind} has no counterpart here", "replace it in the tool that wrote the file")
    elif node.problem[0]:
        found.refuse(node.name, *node.problem)
    elif node.kind in STATEFUL:
        try:
            cell = cell_of(node, str(found.tool), found.step, reset)
            found.made[node.name] = model_of(cell, found.step * 1e3)
        except Unsupported as error:
            found.refuse(node.name, error.why, error.way_out)
            return
        found.cells[node.name] = cell
        how = cell.how + (f"; {cell.differs}" if cell.differs else "")
        if found.verdicts[node.name].verdict == EXACT:
            found.verdicts[node.name] = Verdict(node.name, node.kind, APPROXIMATE if cell.differs else EXACT, how)
    elif node.kind == "Delay":
        steps = node.array("delay") / found.step
        if np.any(steps < 0):
            found.refuse(node.name, f"is {steps.min() * found.step:g} s, below 0", "give it a time of 0 or above")
        elif not np.allclose(steps, np.rint(steps), rtol=2e-7, atol=1e-3):  # single precision
            found.refuse(node.name, "is no multiple of the step", "choose a dt that divides it")


def _find_links(found: Read) -> None:
    graph = found.graph
    for name, node in graph.nodes.items():
        if node.kind not in (*STATEFUL, "Output"):
            continue
        found.bias[name], found.late[name] = np.zeros(node.shape), np.zeros(node.shape)
        known: set[tuple[str, ...]] = set()
        first = len(found.links)
        for count, path in enumerate(sources(graph, name)):
            if count >= MOST_PATHS:
                raise ModelError(f"{graph.source}: more than {MOST_PATHS} paths lead to node '{name}'")
            _add_link(found, path, known)
        onto = found.links[first:]
        if node.kind == "Output" and not (len(onto) == 1 and _is_plain(found, onto[0]) and not found.bias[name].any()):
            # An Output of weighted spikes is the potential of neurons that keep nothing and never fire.
            zero = np.zeros(node.shape)
            cell = Cell(zero, zero, zero + 1.0, "V_m of neurons that keep nothing and never fire")
            found.cells[name], found.made[name] = cell, model_of(cell, found.step * 1e3)
            found.verdicts[name] = Verdict(name, node.kind, EXACT, f"a probe of {cell.how}")
    for name, node in graph.nodes.items():
        prefix = name.rpartition(".")[0]
        in_subgraph = prefix and any(
            n.kind == "Identity" and n.name.rpartition(".")[0] == prefix for n in graph.nodes.values()
        )
        # snnTorch reads recurrent weights that are no subgraph otherwise than it writes them.
        if found.tool == "snntorch" and node.recurrent and node.kind in ("Linear", "Affine") and not in_subgraph:
            how = (
                "recurrent weights, as RLeaky and RSynaptic have them; snnTorch 1.0's importer, where it does not fail"
                " with nirtorch 2.6, sends the input of the neurons through them, too"
            )
            found.verdicts[name] = Verdict(name, node.kind, APPROXIMATE, how)
    for link in found.links:
        silent = link.source in found.cells and found.cells[link.source].threshold is None
        if silent and link.target in found.cells:
            found.refuse(link.source, "its potential is sent on, and only spikes are sent here", "let it fire")


def _is_plain(found: Read, link: Link) -> bool:
    """Whether it sends on what it receives."""
    own = found.step * found.cells[link.source].late if link.source in found.cells else 0.0
    same = link.map.diagonal is not None and np.all(link.map.diagonal == 1.0)
    return bool(same and np.all(link.lag == own))


def _add_link(found: Read, path: list[str], known: set[tuple[str, ...]]) -> None:
    graph = found.graph
    nodes = [graph.nodes[name] for name in path]
    shape = nodes[0].shape
    maps: list[Map] = []
    before, behind = np.zeros(shape), np.zeros(())  # seconds of the delays before weights, and behind them
    mixed, differing = False, ""
    for node in nodes[1:-1]:
        maps.append(map_of(node, shape))
        shape = maps[-1].target
        if maps[-1].diagonal is None:
            if differing:
                why = "its delays differ from neuron to neuron between two nodes of weights"
                found.refuse(differing, why, "give it one time")
                return
            mixed, behind = True, behind.reshape(-1)[0]
        elif node.kind == "Delay":
            delay = node.array("delay")
            if mixed:
                behind = (behind.reshape(delay.shape) if behind.size > 1 else behind) + delay
                differing = node.name if np.unique(behind).size > 1 else ""
            else:
                before = before + delay.reshape(before.shape)
    if path[0] in found.cells:
        before = before + found.step * found.cells[path[0]].late
    identity = Map(shape, nodes[-1].shape, diagonal=np.ones(nodes[-1].shape))
    whole = together([*maps, identity])
    times = np.unique(behind)
    for time in times:  # targets that are reached at other times have links of their own
        part = whole if times.size == 1 else whole.onto(behind.reshape(whole.target) == time)
        found.links.append(Link(path[0], path[-1], part, before + time))
    for k, node in enumerate(nodes[1:-1]):
        rest = tuple(path[k + 1 :])
        bias = node.fields.get("bias")
        if bias is None or rest in known:
            continue
        known.add(rest)
        convolves, target = node.kind.startswith("Conv"), maps[k].target
        values = spread(bias, target[:1] if convolves else target[-1:], f"node '{node.name}': bias")
        values = values.reshape(-1, *[1] * (len(target) - 1)) if convolves else values
        full = np.broadcast_to(values, target).astype(np.float64)
        for later in nodes[k + 2 : -1]:
            if later.kind == "Delay" and later.array("delay").any() and full.any():
                how = f"{_HOW['Delay']}; the bias of '{node.name}' acts from the first step on, there later"
                found.verdicts[later.name] = Verdict(later.name, "Delay", APPROXIMATE, how, measured=FIRST_STEPS)
        # What comes back to a layer is of the step before, and the first step has none, in these also no bias.
        late = path[0] == path[-1] and found.tool in BY_GRAPH_EXECUTOR
        (found.late if late else found.bias)[path[-1]] += together([*maps[k + 1 :], identity])(full)


def _find_depths(found: Read) -> None:
    """By how many steps each node is later: a spike takes at least one, and back to its own layer one in the tools.

    A node is at least as many layers behind the Input as its shortest way from it has, also where a Delay would leave
    room for the steps of the layers: neurons behind a Delay of 5 steps fire 5 steps after those beside it.
    """
    inputs = [name for name, node in found.graph.nodes.items() if node.kind == "Input"]
    depths = found.depths
    names = [*inputs, *found.cells]
    place = {name: k for k, name in enumerate(names)}
    hops = [math.inf if name in found.cells else 0.0 for name in names]
    sent_late = {name: cell.late for name, cell in found.cells.items()}
    forward = [x for x in found.links if x.target in found.cells and x.source != x.target]
    shorten(hops, [(place[x.source], place[x.target], 1 - sent_late.get(x.source, 0)) for x in forward])
    depths.update((name, 0 if hop == math.inf else int(hop)) for name, hop in zip(names, hops, strict=True))
    # A current acts two steps after its generator begins, so a node with one is at least two steps behind.
    for name, made in found.made.items():
        if made.offset.any() or (made.per_input is not None and found.bias[name].any()):
            depths[name] = max(2, depths[name])
    links = [(x, 1 - round(x.lag.min() / found.step)) for x in found.links if x.target in found.cells]
    for _ in depths:
        late = {x.target for x, least in links if depths[x.source] + least - (x.source == x.target) > depths[x.target]}
        for name in late:
            depths[name] = max(depths[x.source] + least for x, least in links if x.target == name and x.source != name)
        if not late:
            break
    else:
        for name in late:
            why = "is in a loop of several layers, which takes one step in the tools, and here one for each layer"
            found.refuse(name, why, "delay the way back in the tool, too, or leave out all but one layer of the loop")
    for name in found.cells:
        old, later = found.verdicts[name], depths[name] - found.cells[name].late
        if old.verdict != REFUSED:
            found.verdicts[name] = replace(old, how=f"{old.how}; {some(later, 'step')} later here")


def grid_of(part: Map) -> grid | None:
    """The rule of a convolution, None where the language has none: for unequal strides."""
    assert part.kernel is not None
    (_, *sides), (_, *places) = sheet(part.source), sheet(part.target)
    size, border = part.kernel.weight.shape[2:], part.kernel.padding
    for stride in dict.fromkeys(part.kernel.stride):
        words: dict[str, Any] = {"kernel": size, "stride": stride, "depthwise": part.kernel.depthwise}
        if places == [(n + 2 * b - k) // stride + 1 for n, b, k in zip(sides, border, size, strict=True)]:
            apart = None if border[0] == border[1] else border[1]
            return grid(**words, padding=border[0], column_padding=apart)
        if stride == 1 and places == sides:
            return grid(**words, padding="same")
    return None
