"""A `Network` from a NIR graph."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from neuro.core.checks import check
from neuro.core.english import some
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.exchange.nir.cells import (
    ASK,
    BY_GRAPH_EXECUTOR,
    Cell,
    Unsupported,
    cell_of,
    find_tool,
)
from neuro.exchange.nir.graph import FIELDS, STATEFUL, Floats, Graph, Node, Shape, shorten, sources, spread
from neuro.exchange.nir.judged import Link, Read
from neuro.exchange.nir.maps import Map, map_of, same_in_each_map, sheet, together
from neuro.exchange.nir.measured import measure
from neuro.exchange.nir.models import Made, model_of, one_or_all
from neuro.exchange.nir.reading import read
from neuro.exchange.verdict import APPROXIMATE, EXACT, REFUSED, Verdict, Verdicts
from neuro.model.network import Network
from neuro.model.neurons.base import Model
from neuro.model.neurons.builtin import dc_generator, iaf_psc_delta, spike_generator
from neuro.model.rules import SAME, all_to_all, grid, one_to_one, pairs

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
LONGEST = 200
"""Letters of a name; YAML has none of more than 1024."""

MOST_PATHS = 10_000
CURRENT, TICKS = "bias", "every_step"
"""The population that sends constant currents, and the neuron that fires in every step."""

DENSE = 0.5
"""Share of weights that are not 0 from which all pairs are connected."""


def from_nir(graph: Any, dt: float, from_: str | None = None, *, reset: str | None = None) -> Network:
    """A network from a NIR graph, which spikes as the tool that wrote the graph.

    A layer sends its spikes one step later here, since a spike takes at least one step: the spikes of a population that
    is d layers behind the input come d steps later than in the tool (one more if the first layer has a bias), and are
    otherwise the same. The verdict of a node says its d. The input is a `spike_generator`; a count of events is a spike
    of that multiplicity. Each Output is a probe of its name.

    Args:
        graph: a `nir.NIRGraph`, or the name of a file.
        dt: length of a step, ms. NIR has no steps, and its times are in seconds.
        from_: the tool whose convention holds: "norse", "snntorch", "sinabs", "spikingjelly", "spyx", "rockpool", or
            "nir" for the equations of NIR; not needed if the graph was written by `to_nir`.
        reset: "to_value", "to_value_next", "subtract" or "subtract_next", where the file is known to mean another than
            its tool's importer takes. "to_value_next" is in the step after the spike, which takes no input;
            "subtract_next" lowers V by V_th after the decay of the next step, as snnTorch by default.

    Returns:
        The network; its `verdicts` says what became of each node.

    Raises:
        ModelError: the file is damaged, nothing tells the convention, or a node is refused: all of them, each with the
            way out.
    """
    return network_of(examine(graph, dt, from_, reset))


def network_of(found: Read) -> Network:
    """The network of a graph that has been read, with its verdicts.

    Raises:
        ModelError: a node is refused.
    """
    table = found.table()
    table.check()
    net = _network(found)
    net.verdicts = table
    return net


def check_nir(graph: Any, dt: float, from_: str | None = None, *, reset: str | None = None) -> Verdicts:
    """What would become of each node of a NIR graph; arguments as of `from_nir`.

    Raises:
        ModelError: the file is damaged, or nothing tells the convention.
    """
    return examine(graph, dt, from_, reset).table()


def examine(graph: Any, dt: float, from_: str | None, reset: str | None) -> Read:
    """Read a graph and decide on each node; of approximate ones measure by how much they differ."""
    found = judge(graph, dt, from_, reset)
    if not found.table().refused:
        _measure(found)
    return found


def judge(graph: Any, dt: float, from_: str | None, reset: str | None = None) -> Read:
    """Read a graph and decide on each node."""
    step = check(DT, dt, "dt", ("dt",)) / 1e3
    reset = check(RESET, reset, "reset", ("reset",))
    plain = graph if isinstance(graph, Graph) else read(graph)
    found = Read(plain, find_tool(from_, plain.metadata), step)
    if found.tool is None and any(node.kind in STATEFUL for node in plain.nodes.values()):
        raise ModelError(f"{plain.source}: nothing says which tool wrote it, on which spikes depend", hint=ASK)
    _check_step(found)
    for node in plain.nodes.values():
        _judge(found, node, reset)
    if not found.table().refused:
        _find_links(found)
    if not found.table().refused:
        _find_depths(found)
        _name_written_out(found)
    return found


def _name_written_out(found: Read) -> None:
    """Say at a layer that its convolution has a weight for each connection here, as a grid has one stride."""
    for link in found.links:
        if link.target in found.cells and link.map.kernel is not None and _grid(link.map) is None:
            old, weights = found.verdicts[link.target], link.map.sparse().nnz
            how = f"{old.how}; its convolution is {some(weights, 'weight')}, as a grid has one stride for both axes"
            found.verdicts[link.target] = replace(old, how=how)


def _measure(found: Read) -> None:
    """By how much approximate nodes differ: those of a kind together, since the tool has all of them so."""
    kinds: dict[str, list[str]] = {}
    for name, verdict in found.verdicts.items():
        if verdict.verdict == APPROXIMATE and not verdict.measured:
            kinds.setdefault(verdict.kind, []).append(name)
    if not kinds:
        return
    net = _network(found)
    for names in kinds.values():
        measured = measure(found, net, found.names, found.depths, names)
        for name in names:
            found.verdicts[name] = replace(found.verdicts[name], measured=measured)


def _check_step(found: Read) -> None:
    """Refuse a step that was meant in seconds, as NIR's times are."""
    words = () if found.tool in ("sinabs", "snntorch") else ("tau", "tau_mem", "tau_syn")
    nodes = found.graph.nodes.values()
    taus = [node.array(w).min() for node in nodes for w in words if w in node.fields and not node.problem[0]]
    steps = float(min(taus)) / found.step if taus else 0.0
    if LONG < steps < math.inf:
        said = f"dt = {found.step * 1e3:g} ms"
        message = f"{found.graph.source}: {said}: the shortest time constant is {steps:,.0f} steps"
        raise ModelError(message, hint=f"dt is in ms: dt={found.step * 1e6:g} for steps of {found.step * 1e3:g} s")


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
            _read_out(found, node)
    _mark_recurrent(found)
    for link in found.links:
        silent = link.source in found.cells and found.cells[link.source].threshold is None
        if silent and link.target in found.cells:
            found.refuse(link.source, "its potential is sent on, and only spikes are sent here", "let it fire")


def _mark_recurrent(found: Read) -> None:
    """Recurrent weights that are no subgraph, which snnTorch reads otherwise than it writes them."""
    graph = found.graph
    for name, node in graph.nodes.items():
        loop = node.recurrent and node.kind in ("Linear", "Affine")
        if found.tool == "snntorch" and loop and not _in_subgraph(graph, name):
            how = (
                "recurrent weights, as RLeaky and RSynaptic have them; snnTorch 1.0's importer, where it does not fail"
            )
            how += " with nirtorch 2.6, sends the input of the neurons through them, too"
            found.verdicts[name] = Verdict(name, node.kind, APPROXIMATE, how)


def _in_subgraph(graph: Graph, name: str) -> bool:
    prefix = name.rpartition(".")[0]
    return any(n.kind == "Identity" and n.name.rpartition(".")[0] == prefix for n in graph.nodes.values() if prefix)


def _is_plain(found: Read, link: Link) -> bool:
    """Whether it sends on what it receives."""
    own = found.step * found.cells[link.source].late if link.source in found.cells else 0.0
    same = link.map.diagonal is not None and np.all(link.map.diagonal == 1.0)
    return bool(same and np.all(link.lag == own))


def _read_out(found: Read, node: Node) -> None:
    """An Output of weighted spikes is the potential of neurons that keep nothing and never fire."""
    zero = np.zeros(node.shape)
    cell = Cell(zero, zero, zero + 1.0, "V_m of neurons that keep nothing and never fire")
    found.cells[node.name], found.made[node.name] = cell, model_of(cell, found.step * 1e3)
    found.verdicts[node.name] = Verdict(node.name, node.kind, EXACT, f"a probe of {cell.how}")


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
    depths.update({name: max(2, depths[name]) for name, made in found.made.items() if _has_current(found, name, made)})
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


def _has_current(found: Read, name: str, made: Made) -> bool:
    return bool(made.offset.any()) or (made.per_input is not None and bool(found.bias[name].any()))


def _network(found: Read) -> Network:
    graph, h = found.graph, found.step * 1e3
    net = Network(_name(graph.source.rpartition("/")[2].removesuffix(".nir"), set()), resolution=round(h, 12))
    names = found.names = {}
    for name, node in sorted(graph.nodes.items(), key=lambda item: found.depths.get(item[0], 0)):
        if node.kind == "Input":
            names[name] = _name(name, names.values())
            net.population(names[name], _laid(node.shape), spike_generator())
        if name in found.cells:
            names[name] = _name(name, names.values())
            made = found.made[name]
            net.population(names[name], _laid(node.shape), made.model, initial=made.initial)
    for link in sorted(found.links, key=lambda link: found.depths.get(link.target, 0)):
        if link.target in found.cells:
            _connect(net, found, link, names, h)
    _connect_biases(net, found, names, h)
    for name, node in graph.nodes.items():
        if node.kind == "Output":
            _probe(net, found, name, names)
    return net


def _name(name: str, taken: Iterable[str]) -> str:
    """A name that a part may have."""
    plain = re.sub(r"[^\w.-]", "_", name)[:LONGEST] or "node"
    names = (plain if k == 1 else f"{plain}_{k}" for k in range(1, MOST_PATHS))
    return next(each for each in names if each not in set(taken))


def _laid(shape: Shape) -> Shape:
    """The shape of a population, with the axes of a sheet where it has two or three."""
    return sheet(shape) if len(shape) in (2, 3) else shape


def _delay(found: Read, link: Link, h: float) -> Any:
    back = link.source == link.target
    steps = found.depths[link.target] - found.depths[link.source] + (1 if back else 0)
    lags = steps + np.rint(link.lag.reshape(-1) / found.step)
    return round(h * lags[0], 9) if np.all(lags == lags[0]) else np.round(h * lags, 9)


def _connect(net: Network, found: Read, link: Link, names: dict[str, str], h: float) -> None:
    source, target = names[link.source], names[link.target]
    part, gain = link.map, found.made[link.target].gain
    delay = _delay(found, link, h)
    label = _name(f"{source}_{target}", net.projections)
    if part.kernel is not None and np.isscalar(delay):
        per_map, rule = same_in_each_map(gain.reshape(part.target)), _grid(part)
        if per_map is not None and rule is not None:
            weight = part.kernel.weight * per_map[:, None, None, None]
            net.connect(source, target, rule, weight=weight, delay=delay, name=label)
            return
    if part.diagonal is not None:
        weight = part.diagonal.reshape(-1) * gain.reshape(-1)
        net.connect(source, target, one_to_one(), weight=one_or_all(weight), delay=delay, name=label)
        return
    matrix = part.sparse()
    if np.isscalar(delay) and matrix.nnz >= DENSE * math.prod(matrix.shape):
        weight = matrix.toarray().T * gain.reshape(-1)
        net.connect(source, target, all_to_all(), weight=weight, delay=delay, name=label)
        return
    matrix = matrix.tocoo()
    post, pre = matrix.coords
    weight = matrix.data * gain.reshape(-1)[post]
    delay = delay if np.isscalar(delay) else delay[pre]
    net.connect(source, target, pairs(pre, post), weight=weight, delay=delay, name=label)


def _grid(part: Map) -> grid | None:
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
            return grid(**words, padding=SAME)
    return None


def _connect_biases(net: Network, found: Read, names: dict[str, str], h: float) -> None:
    """Constant input, which begins with the first step of the tool, `depth` steps later here.

    A generator of currents acts two steps after it begins. Input that a synapse filters comes as spikes, from a neuron
    that fires in every step.
    """
    constant, ticks = (_name(source, net.populations) for source in (CURRENT, TICKS))
    every_step = iaf_psc_delta(tau_m=math.inf, C_m=h, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0, I_e=1.0)
    for name, made in found.made.items():
        offset, depth = made.offset, found.depths[name]
        for bias, begin in ((found.bias[name], depth), (found.late[name], depth + 1)):
            current = offset if made.per_input is None else offset + bias * made.per_input
            if current.any():
                _from_one(net, constant, dc_generator(amplitude=1.0), names[name], current, h * (begin - 1))
            if made.per_input is None and bias.any():
                _from_one(net, ticks, every_step, names[name], bias * made.gain, h * begin)
            offset = np.zeros_like(offset)


def _from_one(net: Network, source: str, model: Model, target: str, values: Floats, delay: float) -> None:
    if source not in net.populations:
        net.population(source, 1, model)
    label = _name(f"{source}_{target}", net.projections)
    net.connect(source, target, all_to_all(), weight=values.reshape(1, -1), delay=round(delay, 9), name=label)


def _probe(net: Network, found: Read, name: str, names: dict[str, str]) -> None:
    """Record what an Output gives."""
    of = name if name in found.cells else next(link.source for link in found.links if link.target == name)
    fires = of not in found.cells or found.cells[of].threshold is not None
    net.probe(_name(name, net.probes), names[of], "spikes" if fires else "V_m")
