"""A `Network` from a NIR graph."""

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
from neuro_exchange.nir.judging import MOST_PATHS, STEP, Link, Read, grid_of, judge
from neuro_exchange.nir.measured import differences, measure
from neuro_exchange.nir.reading import read
from neuro_exchange.verdict import APPROXIMATE, Verdicts

LONGEST = 200
"""Letters of a name; YAML has none of more than 1024."""

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
    """Read a graph, decide on each node, and measure by how much approximate nodes differ.

    Nodes of one kind are measured together, since the tool has all of them so.
    """
    found = judge(graph, dt, from_, reset)
    kinds: dict[str, list[str]] = {}
    for name, verdict in found.verdicts.items():
        if verdict.verdict == APPROXIMATE and not verdict.measured:
            kinds.setdefault(verdict.kind, []).append(name)
    if kinds and not found.table().refused:
        net = _network(found)
        for names in kinds.values():
            measured = measure(found, net, found.names, found.depths, names)
            for name in names:
                found.verdicts[name] = replace(found.verdicts[name], measured=measured)
    return found


def examine_file(path: Path, dt: float | None, from_: str | None, reset: str | None) -> tuple[Read, str]:
    """Read a file by what is known of it, else by the equations of NIR in steps of 1 ms.

    Returns:
        the graph with its verdicts, and what was assumed: "" if nothing was.
    """
    plain = read(path)
    known_step, tool = plain.metadata.get(STEP), find_tool(from_, plain.metadata)
    step = dt if dt is not None else 1.0 if known_step is None else float(known_step)
    found = examine(plain, step, tool or "nir", reset)
    assumed = []
    if tool is None:
        assumed.append("nothing names the tool that wrote it (--from TOOL), so the equations of NIR hold")
    if dt is None and known_step is None:
        assumed.append(f"NIR has no steps (--resolution MS), so a step has {step:g} ms")
    if not assumed:
        return found, ""
    note = f"{path}: {'; '.join(assumed)}."
    if tool is not None or found.table().refused:
        return found, note
    others: dict[str, Read | str] = {}
    for name in TOOLS:
        if name != found.tool:
            try:
                others[name] = judge(plain, step, name, reset)
            except ModelError as error:
                others[name] = error.message
    return found, f"{note}\n{differences(found, others)}"


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
            of = name if name in found.cells else next(link.source for link in found.links if link.target == name)
            fires = of not in found.cells or found.cells[of].threshold is not None
            net.probe(_name(name, net.probes), names[of], "spikes" if fires else "V_m")
    return net


def _name(name: str, taken: Iterable[str]) -> str:
    """A name that a part may have."""
    plain = re.sub(r"[^\w.-]", "_", name)[:LONGEST] or "node"
    names = (plain if k == 1 else f"{plain}_{k}" for k in range(1, MOST_PATHS))
    return next(each for each in names if each not in set(taken))


def _laid(shape: Shape) -> Shape:
    """The shape of a population, with the axes of a sheet where it has two or three."""
    return sheet(shape) if len(shape) in (2, 3) else shape


def _connect(net: Network, found: Read, link: Link, names: dict[str, str], h: float) -> None:
    source, target = names[link.source], names[link.target]
    part, gain = link.map, found.made[link.target].gain
    steps = found.depths[link.target] - found.depths[link.source] + (link.source == link.target)
    lags = steps + np.rint(link.lag.reshape(-1) / found.step)
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


def _from_one(net: Network, source: str, model: Neuron | Generator, target: str, values: Floats, delay: float) -> None:
    if source not in net.populations:
        net.population(source, 1, model)
    label = _name(f"{source}_{target}", net.projections)
    net.connect(source, target, all_to_all(), weight=values.reshape(1, -1), delay=round(delay, 9), name=label)
