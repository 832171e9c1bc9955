"""The difference that approximate nodes make: a short run of the network beside the tool's equations in NumPy."""

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
from neuro_exchange.nir.judging import Analysis

Counts = NDArray[np.int64]
"""Numbers of spikes, shape (steps, neurons)."""

STEPS, CHANCE, SEED = 200, 0.3, 0
"""Steps of the run, the probability of a spike of an input per step, and the seed of the inputs."""

MOST = 500_000
"""Largest number of weights that is simulated in a short run, and largest number of spikes of a neuron in a step."""


def measure(
    analysis: Analysis,
    net: Network,
    names: Mapping[str, str],
    depths: Mapping[str, int],
    differing: Container[str] = (),
) -> str:
    """Compare the spikes of a network with the spikes of its graph in the tool.

    Args:
        analysis: the analysis of the graph.
        net: the network.
        names: the population of each Input and of each stateful node.
        depths: delay of each node here, in steps.
        differing: nodes that the tool's importer interprets differently from the graph's definition.

    Returns:
        A phrase with both numbers of spikes and the share at the same step, or the reason why nothing was measured.
    """
    if sum(_weights(link.map) for link in analysis.links) > MOST:
        return "not measured: the network is too large for a short run"
    layers = [Layer(analysis, name, differing) for name in names if _fires(analysis, name)]
    layers.sort(key=lambda layer: analysis.depths[layer.name])
    inputs = [name for name in names if analysis.graph.nodes[name].kind == "Input"]
    spikes = {name: names[name] for name in (*inputs, *(layer.name for layer in layers))}
    try:
        counts_here = run_here(net, spikes, depths)
    except ModelError as error:
        return f"not measured: the network does not run: {error.message}"
    counts_there = run_there(layers, {name: counts_here[name] for name in inputs})
    pairs = [(counts_there[layer.name], counts_here[layer.name]) for layer in layers]
    counts = [sum(int(array.sum()) for array in side) for side in zip(*pairs, strict=True)]
    if not any(counts):
        return f"not measured: no neuron fires in {STEPS} steps of random input"
    percent = 100.0 * sum(int(np.minimum(*pair).sum()) for pair in pairs) / max(counts)
    spikes_text = f"{counts[0]:,} spikes in {analysis.tool} and {counts[1]:,} here"
    return f"in {STEPS} steps of random input {spikes_text}, {percent:.1f} % of them at the same step"


def differences(analysis: Analysis, others: Mapping[str, Analysis | str]) -> str:
    """Return a text that compares the spikes of a graph under several conventions.

    Args:
        analysis: the graph under one convention, without refused nodes.
        others: for each tool, the analysis of the graph by its convention, or the reason why the tool cannot read the
            graph.
    """
    refusals = {
        tool: reader
        if isinstance(reader, str)
        else next((f"node '{verdict.node}' ({verdict.kind}): {verdict.how}" for verdict in reader.table().refused), "")
        for tool, reader in others.items()
    }
    readers = {tool: reader for tool, reader in others.items() if isinstance(reader, Analysis) and not refusals[tool]}
    lines = [f"{tool} refuses it: {reason}" for tool, reason in refusals.items() if reason]
    if sum(_weights(link.map) for link in analysis.links) > MOST:
        return "\n".join(["The network is too large for a short run: other tools may have other spikes.", *lines])
    rng = np.random.default_rng(SEED)
    inputs = {
        name: (rng.random((STEPS, math.prod(node.shape))) < CHANCE).astype(np.int64)
        for name, node in analysis.graph.nodes.items()
        if node.kind == "Input"
    }
    expected = _spikes_of(analysis, inputs)
    total = sum(int(counts.sum()) for counts in expected.values())
    runs = []
    for tool, reader in readers.items():
        spikes = _spikes_of(reader, inputs)
        n_same = sum(int(np.minimum(counts, spikes[name]).sum()) for name, counts in expected.items())
        runs.append(
            f"{tool} {sum(int(counts.sum()) for counts in spikes.values()):,} spikes, {n_same:,} at the same step"
        )
    if runs:
        lines.insert(0, f"In {STEPS} steps of random input {analysis.tool} has {total:,} spikes, {'; '.join(runs)}.")
    return "\n".join(lines)


def _spikes_of(analysis: Analysis, inputs: Mapping[str, Counts]) -> dict[str, Counts]:
    """Return the spikes of all nodes that fire, in the tool."""
    layers = [Layer(analysis, name, ()) for name in analysis.cells if _fires(analysis, name)]
    layers.sort(key=lambda layer: analysis.depths[layer.name])
    spikes = run_there(layers, inputs)
    return {layer.name: spikes[layer.name] for layer in layers}


def _fires(analysis: Analysis, name: str) -> bool:
    return name in analysis.cells and analysis.cells[name].threshold is not None


def _weights(part: Map) -> int:
    if part.kernel is not None:
        return int(part.kernel.weight.size) * math.prod(part.target[1:])
    return part.diagonal.size if part.diagonal is not None else part.matrix.nnz


def run_here(net: Network, names: Mapping[str, str], depths: Mapping[str, int]) -> dict[str, Counts]:
    """Run the network with random input. Return the spikes by node, shifted back by the node's delay in steps."""
    probed_net, h, rng = copy.copy(net), net.resolution, np.random.default_rng(SEED)
    probed_net.probes = {}
    for population in names.values():
        probed_net.probe(f"{population}.spikes", population)
    sim = compile(probed_net, seed=SEED)
    for population in names.values():
        part = net.populations[population]
        if isinstance(part.model, spike_generator):
            steps, ids = np.nonzero(rng.random((STEPS, len(part))) < CHANCE)
            sim.inject(population, (steps + 1) * h, ids)
    sim.run(h * (STEPS + max(depths[name] for name in names)))
    counts = {}
    for name, population in names.items():
        times, ids = sim.spikes(population)
        steps = np.rint(times / h).astype(np.int64) - 1 - depths[name]
        is_inside = (steps >= 0) & (steps < STEPS)
        counts[name] = np.zeros((STEPS, len(net.populations[population])), dtype=np.int64)
        np.add.at(counts[name], (steps[is_inside], ids[is_inside]), 1)
    return counts


def run_there(layers: Sequence[Layer], inputs: Mapping[str, Counts]) -> dict[str, Counts]:
    """Step the equations of the tool, in which all layers fire one after the other in the same step."""
    spikes = {**inputs, **{layer.name: np.zeros((STEPS, layer.v.size), dtype=np.int64) for layer in layers}}
    with np.errstate(all="ignore"):  # potentials may diverge
        for step in range(STEPS):
            for layer in layers:
                spikes[layer.name][step] = layer.step(step, spikes)
    return spikes


class Layer:
    """The neurons of a node, stepped by the equations of a tool.

    Args:
        analysis: the analysis of the graph.
        name: name of the node.
        differing: nodes that the tool's importer interprets differently from the graph's definition.
    """

    def __init__(self, analysis: Analysis, name: str, differing: Container[str]) -> None:
        cell, graph = analysis.cells[name], analysis.graph
        self.name = name
        values = ((f.name, getattr(cell, f.name)) for f in fields(cell))
        flat: dict[str, Any] = {word: v.reshape(-1) if isinstance(v, np.ndarray) else v for word, v in values}
        self.cell = Cell(**flat)
        self.rises = cell.rises or name in differing
        self.inputs = [(link, link.map.sparse()) for link in analysis.links if link.target == name]
        self.lags = [np.rint(link.lag.reshape(-1) / analysis.step).astype(int) for link, _ in self.inputs]
        self.bias, self.late_bias = analysis.bias[name].reshape(-1), analysis.late_bias[name].reshape(-1)
        # snnTorch's importer sends all input through the recurrent weights, and its neurons do not hold the reset.
        recurrent = [n for n in graph.before(name) if n in differing and graph.before(n) == [name]]
        recurrent_fields = graph.nodes[recurrent[0]].fields if recurrent else {}
        self.recurrent_weights = np.asarray(recurrent_fields["weight"], dtype=float) if recurrent else None
        self.hold = 0 if recurrent else cell.hold
        bias = recurrent_fields.get("bias")
        self.recurrent_bias = np.zeros(self.bias.size) if bias is None else np.asarray(bias, dtype=float).reshape(-1)
        self.v = np.array((self.cell.rest if self.cell.start is None else self.cell.start), dtype=float)
        self.i, self.above = np.zeros(self.v.size), np.zeros(self.v.size, dtype=bool)
        self.steps_on_hold = np.zeros(self.v.size)

    def _input(self, step: int, spikes: Mapping[str, Counts]) -> Floats:
        recurrent = self.recurrent_bias
        feedforward = self.bias - recurrent + (self.late_bias if step else 0.0)
        for (link, matrix), lags in zip(self.inputs, self.lags, strict=True):
            emission = step - lags - (link.source == self.name)
            source = spikes[link.source]
            arriving_spikes = np.where(emission >= 0, source[np.maximum(emission, 0), np.arange(source.shape[1])], 0)
            if link.source == self.name:
                recurrent = recurrent + matrix @ arriving_spikes
            else:
                feedforward = feedforward + matrix @ arriving_spikes
        return recurrent + (feedforward if self.recurrent_weights is None else self.recurrent_weights @ feedforward)

    def step(self, step: int, spikes: Mapping[str, Counts]) -> Counts:
        """Advance the neurons by one step, and return the number of spikes of each neuron."""
        cell, x = self.cell, self._input(step, spikes)
        assert cell.threshold is not None
        if cell.i_keep is not None and cell.i_gain is not None:
            x = self.i = cell.i_keep * self.i + cell.i_gain * x
        x = x if cell.offset is None else x + cell.offset
        is_free = self.steps_on_hold == 0
        self.steps_on_hold -= ~is_free
        self.v = np.where(is_free, cell.rest + cell.keep * (self.v - cell.rest) + cell.gain * x, self.v)
        limit = cell.threshold * (1 + self.above)
        fires = is_free & ((self.v > limit) if cell.strict else (self.v >= limit))
        fall = cell.threshold if cell.fall is None else cell.fall
        multiples = np.minimum(np.floor((self.v - cell.threshold) / fall), MOST) if cell.several else 0.0
        counts = np.where(fires, 1.0 + multiples, 0.0).astype(np.int64)
        self.v = self.v - counts * fall if cell.reset is None else np.where(fires, cell.reset, self.v)
        self.v = self.v if cell.lowest is None else np.maximum(self.v, cell.lowest)
        self.above = self.rises & (self.v > cell.threshold)
        self.steps_on_hold[fires] = self.hold
        return counts
