"""Random NIR graphs, and their spikes here, for comparison with the tools that wrote such graphs."""

from __future__ import annotations

from typing import Any

import numpy as np

import neuro

Rng = np.random.Generator


def _neuron(nir: Any, rng: Rng, kind: str, shape: tuple[int, ...], step: float, tool: str) -> Any:
    one = np.ones(shape)
    alike = tool == "snntorch" or rng.random() < 0.5

    def some(low: float, high: float) -> np.ndarray:
        return one * rng.uniform(low, high) if alike else rng.uniform(low, high, shape)

    threshold = some(0.3, 1.5)
    if kind == "IF":
        return nir.IF(r=one, v_threshold=threshold, v_reset=0 * one)
    leak = 0 * one if tool == "snntorch" or rng.random() < 0.6 else some(-0.2, 0.2)
    tau = step * some(1.5, 30.0)
    if kind == "LIF":
        r = tau / step if tool == "snntorch" or rng.random() < 0.5 else some(0.5, 2.0)
        return nir.LIF(tau=tau, r=r, v_leak=leak, v_threshold=threshold, v_reset=0 * one)
    tau_syn = step * some(1.5, 20.0)
    r = tau / step if tool == "snntorch" or rng.random() < 0.5 else some(0.5, 2.0)
    w_in = tau_syn / step if tool == "snntorch" or rng.random() < 0.5 else some(0.5, 2.0)
    words = {"tau_syn": tau_syn, "tau_mem": tau, "r": r, "v_leak": leak, "w_in": w_in}
    return nir.CubaLIF(**words, v_threshold=threshold, v_reset=0 * one)


def _dense(nir: Any, rng: Rng, before: int, after: int) -> Any:
    weight = rng.normal(0.15, 0.8, (after, before)) * rng.choice([0.5, 1.0, 3.0])
    return nir.Affine(weight, rng.normal(0, 0.1, after)) if rng.random() < 0.5 else nir.Linear(weight)


def random_graph(nir: Any, seed: int, tool: str) -> Any:
    """One to three layers of neurons behind weights or a convolution, some with recurrent weights."""
    rng, step = np.random.default_rng(seed), 1e-4 if tool == "snntorch" else 1e-3
    nodes: dict[str, Any] = {}
    edges: list[tuple[str, str]] = []
    last = "input"

    def add(name: str, node: Any) -> None:
        nonlocal last
        nodes[name] = node
        edges.append((last, name))
        last = name

    if rng.random() < 0.3:
        channels, height, width = int(rng.integers(1, 3)), int(rng.integers(4, 8)), int(rng.integers(4, 8))
        nodes["input"] = nir.Input({"input": np.array([channels, height, width])})
        maps, k, stride, padding = (
            int(rng.integers(1, 4)),
            int(rng.integers(2, 4)),
            int(rng.integers(1, 3)),
            int(rng.integers(0, 2)),
        )
        weight = rng.normal(0.1, 0.6, (maps, channels, k, k))
        bias = rng.normal(0, 0.05, maps)
        places = [(n + 2 * padding - k) // stride + 1 for n in (height, width)]
        add("conv", nir.Conv2d((height, width), weight, stride, padding, 1, 1, bias))
        shape: tuple[int, ...] = (maps, *places)
        add("neurons0", _neuron(nir, rng, rng.choice(["IF", "LIF"]), shape, step, tool))
        if tool == "norse" and min(places) >= 2 and rng.random() < 0.5:
            add("pool", nir.SumPool2d(np.array([2, 2]), np.array([2, 2]), np.array([0, 0])))
            shape = (maps, *(n // 2 for n in places))
        add("flatten", nir.Flatten({"input": np.array(shape)}, 0, -1))
        size = int(np.prod(shape))
    else:
        size = int(rng.integers(2, 12))
        nodes["input"] = nir.Input({"input": np.array([size])})
    for layer in range(1, int(rng.integers(2, 4))):
        after = int(rng.integers(2, 12))
        add(f"w{layer}", _dense(nir, rng, size, after))
        kind = rng.choice(["IF", "LIF", "CubaLIF"])
        add(f"layer{layer}.lif", _neuron(nir, rng, kind, (after,), step, tool))
        if rng.random() < 0.3:
            nodes[f"layer{layer}.w_rec"] = _dense(nir, rng, after, after)
            edges += [(f"layer{layer}.lif", f"layer{layer}.w_rec"), (f"layer{layer}.w_rec", f"layer{layer}.lif")]
        size = after
    add("output", nir.Output({"output": np.array([size])}))
    return nir.NIRGraph(nodes, edges)


def input_of(graph: Any, seed: int, steps: int) -> np.ndarray:
    """Random spikes, shape (steps, *shape of the input)."""
    rng = np.random.default_rng(seed + 10_000)
    shape = tuple(int(n) for n in graph.nodes["input"].input_type["input"])
    return (rng.random((steps, *shape)) < rng.choice([0.05, 0.2, 0.5])).astype(np.float32)


def spikes_here(net: neuro.Network, counts: np.ndarray, output: str = "output") -> np.ndarray:
    """The counts of spikes that an Output shows, by step of the tool, for counts of input spikes by step."""
    of = net.probes[output].of
    depth = int(net.verdicts[of].how.rpartition("; ")[2].split()[0])
    sim = neuro.compile(net, backend="event", seed=0)
    steps, ids = np.nonzero(counts.reshape(len(counts), -1))
    repeats = counts.reshape(len(counts), -1)[steps, ids].astype(int)
    h = net.resolution
    source = next(name for name, part in net.populations.items() if part.model.name == "spike_generator")
    sim.inject(source, np.repeat((steps + 1) * h, repeats), np.repeat(ids, repeats))
    sim.run(h * (len(counts) + depth))
    times, ids = sim.spikes(of)
    out = np.zeros((len(counts) + depth + 1, len(net.populations[of])), int)
    np.add.at(out, (np.rint(times / h).astype(int), ids), 1)
    return out[depth + 1 :]
