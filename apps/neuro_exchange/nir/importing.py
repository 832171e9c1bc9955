"""Build a `Network` from a NIR graph."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError, Network, all_to_all, dc_generator, iaf_psc_delta, one_to_one, pairs, spike_generator
from neuro.extend import Generator, Neuron
from neuro_exchange.nir.cells import (
    TOOLS,
    find_tool,
    one_or_all,
)
from neuro_exchange.nir.graph import (
    Floats,
    Shape,
    same_in_each_map,
    sheet,
)
from neuro_exchange.nir.judging import MOST_PATHS, STEP, Analysis, Link, grid_of, judge
from neuro_exchange.nir.measured import differences, measure
from neuro_exchange.nir.reading import read
from neuro_exchange.verdict import APPROXIMATE, Verdicts

LONGEST = 200
"""Largest length of a name in characters. YAML allows 1024 for a key."""

CURRENT, TICKS = "bias", "every_step"
"""Names of the population that sends constant currents, and of the neuron that fires in every step."""

DENSE = 0.5
"""Share of nonzero weights from which a projection connects all pairs instead of listing its synapses."""


def from_nir(graph: Any, dt: float, from_: str | None = None, *, reset: str | None = None) -> Network:
    """Return a network with the spikes of the tool that wrote a NIR graph.

    Spikes take at least one step per layer here, and no step in the tools. So the spikes of a population d layers
    behind the input are d steps later than in the tool (one more if the first layer has a bias), and otherwise equal.
    The verdict of each node names this d. An Input becomes a `spike_generator`; a count of events becomes a spike of
    that multiplicity. An Output becomes a probe of the same name.

    Args:
        graph: a `nir.NIRGraph`, or the name of a file.
        dt: length of a step in ms. NIR has no steps, and its times are in seconds.
        from_: the tool whose convention holds: "norse", "snntorch", "sinabs", "spikingjelly", "spyx", "rockpool", or
            "nir" for the equations of NIR. Not needed for a graph that `to_nir` wrote.
        reset: "to_value", "to_value_next", "subtract" or "subtract_next": the reset of the network that was exported,
            if the tool's importer uses another. "to_value_next" resets V in the step after the spike, and ignores the
            input of that step; "subtract_next" lowers V by V_th after the decay of the next step, as snnTorch does by
            default.

    Returns:
        The network. Its attribute `verdicts` has a verdict for each node.

    Raises:
        ModelError: the file is damaged, no convention is known, or nodes are refused. The error lists every refused
            node with the way out.
    """
    return network_of(examine(graph, dt, from_, reset))


def network_of(analysis: Analysis) -> Network:
    """Build the network of an analysed graph, with its verdicts.

    Raises:
        ModelError: a node is refused.
    """
    table = analysis.table()
    table.check()
    net = _network(analysis)
    net.verdicts = table
    return net


def check_nir(graph: Any, dt: float, from_: str | None = None, *, reset: str | None = None) -> Verdicts:
    """Return the verdict that `from_nir` would give each node of a graph. The arguments are those of `from_nir`.

    Raises:
        ModelError: the file is damaged, or no convention is known.
    """
    return examine(graph, dt, from_, reset).table()


def examine(graph: Any, dt: float, from_: str | None, reset: str | None) -> Analysis:
    """Analyse a graph, and measure by how many spikes approximate nodes differ from the tool.

    Nodes of one type are measured together, since a tool treats all nodes of a type alike.
    """
    analysis = judge(graph, dt, from_, reset)
    kinds: dict[str, list[str]] = {}
    for name, verdict in analysis.verdicts.items():
        if verdict.verdict == APPROXIMATE and not verdict.measured:
            kinds.setdefault(verdict.kind, []).append(name)
    if kinds and not analysis.table().refused:
        net = _network(analysis)
        for names in kinds.values():
            measured = measure(analysis, net, analysis.names, analysis.depths, names)
            for name in names:
                analysis.verdicts[name] = replace(analysis.verdicts[name], measured=measured)
    return analysis


def examine_file(path: Path, dt: float | None, from_: str | None, reset: str | None) -> tuple[Analysis, str]:
    """Analyse a file whose step and convention may be unknown.

    Step and convention are those of the arguments, else of the file's metadata, else 1 ms and the equations of NIR.

    Returns:
        The analysis, and a note that names the defaults in use and compares the tools; "" without defaults.
    """
    graph = read(path)
    file_step, tool = graph.metadata.get(STEP), find_tool(from_, graph.metadata)
    step = dt if dt is not None else 1.0 if file_step is None else float(file_step)
    analysis = examine(graph, step, tool or "nir", reset)
    assumptions = []
    if tool is None:
        assumptions.append("the equations of NIR, since the file does not name its tool (--from TOOL)")
    if dt is None and file_step is None:
        assumptions.append(f"steps of {step:g} ms, since NIR has no steps (--resolution MS)")
    if not assumptions:
        return analysis, ""
    note = f"{path}: assuming {'; '.join(assumptions)}."
    if tool is not None or analysis.table().refused:
        return analysis, note
    other_analyses: dict[str, Analysis | str] = {}
    for name in TOOLS:
        if name != analysis.tool:
            try:
                other_analyses[name] = judge(graph, step, name, reset)
            except ModelError as error:
                other_analyses[name] = error.message
    return analysis, f"{note}\n{differences(analysis, other_analyses)}"


def _network(analysis: Analysis) -> Network:
    graph, h = analysis.graph, analysis.step * 1e3
    net = Network(_name(graph.source.rpartition("/")[2].removesuffix(".nir"), set()), resolution=round(h, 12))
    names = analysis.names = {}
    for name, node in sorted(graph.nodes.items(), key=lambda item: analysis.depths.get(item[0], 0)):
        if node.kind == "Input":
            names[name] = _name(name, names.values())
            net.population(names[name], _population_shape(node.shape), spike_generator())
        if name in analysis.cells:
            names[name] = _name(name, names.values())
            cell_model = analysis.models[name]
            net.population(names[name], _population_shape(node.shape), cell_model.model, initial=cell_model.initial)
    for link in sorted(analysis.links, key=lambda link: analysis.depths.get(link.target, 0)):
        if link.target in analysis.cells:
            _connect(net, analysis, link, names, h)
    _connect_biases(net, analysis, names, h)
    for name, node in graph.nodes.items():
        if node.kind == "Output":
            links = analysis.links
            probed_node = name if name in analysis.cells else next(link.source for link in links if link.target == name)
            fires = probed_node not in analysis.cells or analysis.cells[probed_node].threshold is not None
            net.probe(_name(name, net.probes), names[probed_node], "spikes" if fires else "V_m")
    return net


def _name(name: str, used: Iterable[str]) -> str:
    """Return a valid name of a part that is not used yet, e.g. "conv_1_2" for "conv/1" if "conv_1" is used."""
    valid_name = re.sub(r"[^\w.-]", "_", name)[:LONGEST] or "node"
    names = (valid_name if k == 1 else f"{valid_name}_{k}" for k in range(1, MOST_PATHS))
    return next(candidate for candidate in names if candidate not in set(used))


def _population_shape(shape: Shape) -> Shape:
    """Return the shape of a population; two or three axes become (channels, height, width)."""
    return sheet(shape) if len(shape) in (2, 3) else shape


def _connect(net: Network, analysis: Analysis, link: Link, names: dict[str, str], h: float) -> None:
    source, target = names[link.source], names[link.target]
    part, gain = link.map, analysis.models[link.target].gain
    steps = analysis.depths[link.target] - analysis.depths[link.source] + (link.source == link.target)
    lags = steps + np.rint(link.lag.reshape(-1) / analysis.step)
    delay: Any = round(h * lags[0], 9) if np.all(lags == lags[0]) else np.round(h * lags, 9)
    label = _name(f"{source}_{target}", net.projections)
    if part.kernel is not None and np.isscalar(delay):
        per_map, rule = same_in_each_map(gain.reshape(part.target)), grid_of(part)
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


def _connect_biases(net: Network, analysis: Analysis, names: dict[str, str], h: float) -> None:
    """Connect the constant inputs, which begin in the first step in the tool, and `depth` steps later here.

    A current generator acts two steps after it starts. Where a synapse filters the input, the constant input is made of
    spikes, from a neuron that fires in every step.
    """
    constant, ticks = (_name(source, net.populations) for source in (CURRENT, TICKS))
    every_step = iaf_psc_delta(tau_m=math.inf, C_m=h, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0, I_e=1.0)
    for name, cell_model in analysis.models.items():
        offset, depth = cell_model.offset, analysis.depths[name]
        for bias, start in ((analysis.bias[name], depth), (analysis.late_bias[name], depth + 1)):
            current = offset if cell_model.per_input is None else offset + bias * cell_model.per_input
            if current.any():
                _connect_from_one(net, constant, dc_generator(amplitude=1.0), names[name], current, h * (start - 1))
            if cell_model.per_input is None and bias.any():
                _connect_from_one(net, ticks, every_step, names[name], bias * cell_model.gain, h * start)
            offset = np.zeros_like(offset)


def _connect_from_one(
    net: Network, source: str, model: Neuron | Generator, target: str, values: Floats, delay: float
) -> None:
    """Connect a population of one neuron to all neurons of the target. A missing population is added."""
    if source not in net.populations:
        net.population(source, 1, model)
    label = _name(f"{source}_{target}", net.projections)
    net.connect(source, target, all_to_all(), weight=values.reshape(1, -1), delay=round(delay, 9), name=label)
