"""By how much approximate nodes differ: a short run of the network beside the tool's difference equations in NumPy."""

from __future__ import annotations

import copy
import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError, Network, compile, spike_generator
from neuro_exchange.nir.cells import Cell
from neuro_exchange.nir.graph import Floats, Map
from neuro_exchange.nir.judging import Read

Counts = NDArray[np.int64]
"""Of spikes, shape (steps, neurons)."""

STEPS, CHANCE, SEED = 200, 0.3, 0
"""Steps of the run, and the chance that an input has a spike in one."""

MOST = 500_000
"""Weights with which a run takes well below a second."""


def measure(
    found: Read, net: Network, names: Mapping[str, str], depths: Mapping[str, int], differing: Container[str] = ()
) -> str:
    """Compare the spikes of a network with those of a graph in the tool.

    Args:
        found: the graph.
        net: the network.
        names: the population of each Input and of each stateful node.
        depths: by how many steps each is later here.
        differing: the nodes that the tool has otherwise than the graph says.

    Returns:
        in words, how many spikes are at the same step; or why nothing is measured.
    """
    if sum(_weights(link.map) for link in found.links) > MOST:
        return "not measured: the network is too large for a short run"
    layers = [Layer(found, name, differing) for name in names if _fires(found, name)]
    layers.sort(key=lambda layer: found.depths[layer.name])
    inputs = [name for name in names if found.graph.nodes[name].kind == "Input"]
    spikes = {name: names[name] for name in (*inputs, *(layer.name for layer in layers))}
    try:
        here = run_here(net, spikes, depths)
    except ModelError as error:
        return f"not measured: the network does not run: {error.message}"
    there = run_there(layers, {name: here[name] for name in inputs})
    pairs = [(there[layer.name], here[layer.name]) for layer in layers]
    counts = [sum(int(one.sum()) for one in side) for side in zip(*pairs, strict=True)]
    if not any(counts):
        return f"not measured: no neuron fires in {STEPS} steps of random input"
    same = 100.0 * sum(int(np.minimum(*pair).sum()) for pair in pairs) / max(counts)
    said = f"{counts[0]:,} spikes in {found.tool} and {counts[1]:,} here, {same:.1f} % of them at the same step"
    return f"in {STEPS} steps of random input {said}"


def differences(found: Read, others: Mapping[str, Read | str]) -> str:
    """Say how many spikes a graph has by other conventions, and how many of them at the same steps.

    Args:
        found: the graph by one convention, no node of which is refused.
        others: the graph by the conventions of other tools, or why one cannot read it.
    """
    refused = {
        tool: other
        if isinstance(other, str)
        else next((f"node '{each.node}' ({each.kind}): {each.how}" for each in other.table().refused), "")
        for tool, other in others.items()
    }
    readers = {tool: other for tool, other in others.items() if isinstance(other, Read) and not refused[tool]}
    lines = [f"{tool} refuses it: {why}" for tool, why in refused.items() if why]
    if sum(_weights(link.map) for link in found.links) > MOST:
        return "\n".join(["It is too large for a short run: other tools may have other spikes.", *lines])
    rng = np.random.default_rng(SEED)
    inputs = {
        name: (rng.random((STEPS, math.prod(node.shape))) < CHANCE).astype(np.int64)
        for name, node in found.graph.nodes.items()
        if node.kind == "Input"
    }
    own = _spikes_of(found, inputs)
    total = sum(int(counts.sum()) for counts in own.values())
    runs = []
    for tool, other in readers.items():
        spikes = _spikes_of(other, inputs)
        same = sum(int(np.minimum(counts, spikes[name]).sum()) for name, counts in own.items())
        runs.append(
            f"{tool} {sum(int(counts.sum()) for counts in spikes.values()):,} spikes, {same:,} at the same step"
        )
    if runs:
        lines.insert(0, f"In {STEPS} steps of random input {found.tool} has {total:,} spikes, {'; '.join(runs)}.")
    return "\n".join(lines)


def _spikes_of(found: Read, inputs: Mapping[str, Counts]) -> dict[str, Counts]:
    """The spikes of the neurons in a tool."""
    layers = [Layer(found, name, ()) for name in found.cells if _fires(found, name)]
    layers.sort(key=lambda layer: found.depths[layer.name])
    spikes = run_there(layers, inputs)
    return {layer.name: spikes[layer.name] for layer in layers}


def _fires(found: Read, name: str) -> bool:
    return name in found.cells and found.cells[name].threshold is not None


def _weights(part: Map) -> int:
    if part.kernel is not None:
        return int(part.kernel.weight.size) * math.prod(part.target[1:])
    return part.diagonal.size if part.diagonal is not None else part.matrix.nnz


def run_here(net: Network, names: Mapping[str, str], depths: Mapping[str, int]) -> dict[str, Counts]:
    """The spikes of the network, by node and by the step of the tool to which they belong."""
    probed, h, rng = copy.copy(net), net.resolution, np.random.default_rng(SEED)
    probed.probes = {}
    for population in names.values():
        probed.probe(f"{population}.spikes", population)
    sim = compile(probed, seed=SEED)
    for population in names.values():
        part = net.populations[population]
        if isinstance(part.model, spike_generator):
            steps, ids = np.nonzero(rng.random((STEPS, len(part))) < CHANCE)
            sim.inject(population, (steps + 1) * h, ids)
    sim.run(h * (STEPS + max(depths[name] for name in names)))
    found = {}
    for name, population in names.items():
        times, ids = sim.spikes(population)
        steps = np.rint(times / h).astype(np.int64) - 1 - depths[name]
        inside = (steps >= 0) & (steps < STEPS)
        found[name] = np.zeros((STEPS, len(net.populations[population])), dtype=np.int64)
        np.add.at(found[name], (steps[inside], ids[inside]), 1)
    return found


def run_there(layers: Sequence[Layer], inputs: Mapping[str, Counts]) -> dict[str, Counts]:
    """The spikes of the inputs and of all layers, which fire one after the other in the same step."""
    spikes = {**inputs, **{layer.name: np.zeros((STEPS, layer.v.size), dtype=np.int64) for layer in layers}}
    with np.errstate(all="ignore"):  # of potentials that run away
        for step in range(STEPS):
            for layer in layers:
                spikes[layer.name][step] = layer.step(step, spikes)
    return spikes


class Layer:
    """The neurons of a node, as a tool steps them.

    Args:
        found: the graph.
        name: of the node.
        differing: the nodes that the tool has otherwise than the graph says.
    """

    def __init__(self, found: Read, name: str, differing: Container[str]) -> None:
        cell, graph = found.cells[name], found.graph
        self.name = name
        # The cell with arrays of one axis.
        values = ((each.name, getattr(cell, each.name)) for each in fields(cell))
        words: dict[str, Any] = {word: v.reshape(-1) if isinstance(v, np.ndarray) else v for word, v in values}
        self.cell = Cell(**words)
        self.rises = cell.rises or name in differing
        self.inputs = [(link, link.map.sparse()) for link in found.links if link.target == name]
        self.lags = [np.rint(link.lag.reshape(-1) / found.step).astype(int) for link, _ in self.inputs]
        self.bias, self.late = found.bias[name].reshape(-1), found.late[name].reshape(-1)
        # snnTorch's importer sends all input through recurrent weights, and makes neurons of it that hold no reset.
        back = [n for n in graph.before(name) if n in differing and graph.before(n) == [name]]
        self.back = np.asarray(graph.nodes[back[0]].fields["weight"], dtype=float) if back else None
        self.hold = 0 if back else cell.hold
        bias = graph.nodes[back[0]].fields.get("bias") if back else None
        self.back_bias = np.zeros(self.bias.size) if bias is None else np.asarray(bias, dtype=float).reshape(-1)
        self.v = np.array((self.cell.rest if self.cell.start is None else self.cell.start), dtype=float)
        self.i, self.held, self.above = np.zeros(self.v.size), np.zeros(self.v.size), np.zeros(self.v.size, dtype=bool)

    def _input(self, step: int, spikes: Mapping[str, Counts]) -> Floats:
        x, own = self.bias - self.back_bias + (self.late if step else 0.0), self.back_bias
        for (link, matrix), lags in zip(self.inputs, self.lags, strict=True):
            at = step - lags - (link.source == self.name)
            source = spikes[link.source]
            arrives = matrix @ np.where(at >= 0, source[np.maximum(at, 0), np.arange(source.shape[1])], 0)
            if link.source == self.name:
                own = own + arrives
            else:
                x = x + arrives
        return own + (x if self.back is None else self.back @ x)

    def step(self, step: int, spikes: Mapping[str, Counts]) -> Counts:
        """The spikes of a step."""
        cell, x = self.cell, self._input(step, spikes)
        assert cell.threshold is not None
        if cell.i_keep is not None and cell.i_gain is not None:
            x = self.i = cell.i_keep * self.i + cell.i_gain * x
        x = x if cell.offset is None else x + cell.offset
        free = self.held == 0
        self.held -= ~free
        self.v = np.where(free, cell.rest + cell.keep * (self.v - cell.rest) + cell.gain * x, self.v)
        needed = cell.threshold * (1 + self.above)
        fires = free & ((self.v > needed) if cell.strict else (self.v >= needed))
        fall = cell.threshold if cell.fall is None else cell.fall
        more = np.minimum(np.floor((self.v - cell.threshold) / fall), MOST) if cell.several else 0.0
        counts = np.where(fires, 1.0 + more, 0.0).astype(np.int64)
        self.v = self.v - counts * fall if cell.reset is None else np.where(fires, cell.reset, self.v)
        self.v = self.v if cell.lowest is None else np.maximum(self.v, cell.lowest)
        self.above = self.rises & (self.v > cell.threshold)
        self.held[fires] = self.hold
        return counts
