"""Time training and inference of three networks in spikingjelly, snnTorch, Norse and sinabs beside neuro.

    python benchmarks/peers/compare_torch.py [dense|recurrent|conv ...]

`dense` has 2312 inputs, 128 neurons and 10; `recurrent` and `conv` are the networks of these names of neuro_models: the
128 neurons also receive their own spikes of the step before, or 8 maps read the picture by kernels of 5 x 5 with a
stride of 2. All have delta input, 310 steps, 4,200 events a recording, batches of 20, one thread, no GPU. All packages
run in one process in turn, so that each sees the same machine; the time is that of the processor, the least of several
rounds. `make bench-peers` makes an environment that has all of them.

Each peer gets its inputs as a dense tensor that is there already, and what its documentation calls its fastest way
without a GPU; all use a reset to 0, a surrogate of one kind where they have it, the same loss and the same optimiser.
Peers compute in float32, neuro in float64. Parallel neurons that have no reset are other networks, and `torch.compile`
is left out: on one thread it had not compiled a layer of 310 steps of spikingjelly within four minutes. A recurrent
layer of a peer is a loop over the steps around its cell for one step; sinabs, whose layers take all steps, has none.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

INPUTS, HIDDEN, CLASSES, STEPS, BATCH, EVENTS = 2312, 128, 10, 310, 20, 4200
TAU, THRESHOLD = 20.0, 15.0
ROUNDS, REPEATS = 5, 4
PACKAGES = {"spikingjelly": "spikingjelly", "snntorch": "snnTorch", "norse": "Norse", "sinabs": "sinabs"}

CASES = ("dense", "recurrent", "conv")
SIDE, MAPS, KERNEL, STRIDE = 34, 8, 5, 2

Layers = Callable[[Any], Any]
"""Function from a batch to the counts of the output's spikes, shape (batch, classes)."""


class Peer(NamedTuple):
    """A package.

    Attributes:
        cells: a function that returns the neurons of a layer with a threshold.
        all_steps: a function of a layer's neurons and their input at all steps, which returns all spikes.
        step: a function of a layer's neurons, their input at one step and their state (None at the first step), which
            returns the spikes and the state; None if the package has no such call.
        time_first: whether time is the first axis, before the batch.
    """

    cells: Callable[[float], Any]
    all_steps: Callable[[Any, Any], Any]
    step: Callable[[Any, Any, Any], tuple[Any, Any]] | None = None
    time_first: bool = True


def main() -> int:
    """Print a table and a JSON line for each network."""
    import torch

    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; torch {torch.__version__}", flush=True)
    for case in sys.argv[1:] or CASES:
        measure(case)
    return 0


def measure(case: str) -> None:
    """Time a network in all packages, and print its table and its JSON line."""
    runs = {"neuro": ours(case), **{name: peer for name in PACKAGES if (peer := theirs(name, case)) is not None}}
    best = {name: dict.fromkeys(("training", "inference"), math.inf) for name in runs}
    for _ in range(ROUNDS):
        for name, kinds in runs.items():
            for kind, work in kinds.items():
                best[name][kind] = min(best[name][kind], least(work, REPEATS))
    print(f"\n{case:<16}{'training':>10}{'inference':>11}  recordings/s{'neuro is faster by':>26}")
    for name, kinds in best.items():
        rates = [BATCH / kinds[kind] for kind in kinds]
        ratio = "  ".join(f"{kinds[kind] / best['neuro'][kind]:.1f}" for kind in kinds) if name != "neuro" else ""
        print(f"{called(name):<16}{rates[0]:>10.0f}{rates[1]:>11.0f}{ratio:>40}")
    rates_by_package = {
        name: {kind: BATCH / seconds for kind, seconds in kinds.items()} for name, kinds in best.items()
    }
    print(json.dumps({"case": case, **rates_by_package}), flush=True)


def called(name: str) -> str:
    """The name of a package and its version."""
    return f"{PACKAGES[name]} {version(name)}" if name in PACKAGES else name


def least(work: Callable[[], Any], times: int) -> float:
    """Seconds of the processor, the least of several."""
    best = math.inf
    for _ in range(times):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return best


def spikes() -> tuple[Any, Any, Any]:
    """The recording, the step and the input of each event of a batch."""
    rng = np.random.default_rng(1)
    recording = np.repeat(np.arange(BATCH), EVENTS)
    return recording, rng.integers(0, STEPS, BATCH * EVENTS), rng.integers(0, INPUTS, BATCH * EVENTS)


def first_weights() -> tuple[Any, Any]:
    """Weights of both layers, mV, rows by source."""
    rng = np.random.default_rng(0)
    return rng.normal(0.04, 0.4, (INPUTS, HIDDEN)), rng.normal(0.08, 0.8, (HIDDEN, CLASSES))


def works(network: Layers, parameters: Any) -> dict[str, Callable[[], Any]]:
    """What is timed."""
    import torch

    optimiser = torch.optim.AdamW(parameters, lr=1e-5)
    labels = torch.arange(BATCH) % CLASSES

    def train() -> None:
        optimiser.zero_grad()
        torch.nn.functional.cross_entropy(network(None), labels).backward()
        optimiser.step()

    def infer() -> Any:
        with torch.no_grad():
            return network(None)

    train()
    infer()
    return {"training": train, "inference": infer}


def ours(case: str) -> dict[str, Callable[[], Any]]:
    """Return the work of neuro, from sparse events."""
    import neuro
    import neuro_models
    import neuro_torch

    if case == "dense":
        net = neuro.Network("feed_forward", resolution=1.0)
        cell = neuro.iaf_psc_delta(tau_m=TAU, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=THRESHOLD)
        net.population("pixels", INPUTS, neuro.spike_generator())
        net.population("hidden", HIDDEN, cell)
        net.population("out", CLASSES, cell)
        first, second = first_weights()
        net.connect("pixels", "hidden", neuro.all_to_all(), weight=first)
        net.connect("hidden", "out", neuro.all_to_all(), weight=second)
    else:
        net = neuro.load(neuro_models.path(case), params={"resolution": 1.0})
    module = neuro_torch.Module(net, list(net.projections))
    events = neuro_torch.Events(BATCH, STEPS, {"pixels": spikes()})
    return works(lambda _: module(events).counts["out"], module.parameters())


def theirs(name: str, case: str) -> dict[str, Callable[[], Any]] | None:
    """Return the work of a peer, from a dense tensor; None, and print the reason, if it is skipped."""
    import torch

    try:
        peer = BUILDERS[name]()
    except ImportError as error:
        print(f"skipped: {name}: {error}", flush=True)
        return None
    if case == "recurrent" and peer.step is None:
        print(f"skipped: {name}: it has no cell for one step", flush=True)
        return None
    dense = torch.zeros(STEPS, BATCH, INPUTS)
    recording, step, neuron = spikes()
    dense[step, recording, neuron] = 1.0
    dense = dense if peer.time_first else dense.transpose(0, 1).contiguous()
    threshold = THRESHOLD if case == "dense" else 1.0
    hidden, out = peer.cells(threshold), peer.cells(threshold)
    layers = modules(case)

    def network(_: Any) -> Any:
        if case == "conv":
            pixels = dense.reshape(-1, 2, SIDE, SIDE)
            x = peer.all_steps(hidden, layers[0](pixels).reshape(*dense.shape[:2], -1))
        elif case == "recurrent":
            x = with_itself(peer, hidden, layers[0](dense), layers[2])
        else:
            x = peer.all_steps(hidden, layers[0](dense))
        return peer.all_steps(out, layers[1](x)).sum(0 if peer.time_first else 1)

    return works(network, [parameter for layer in layers for parameter in layer.parameters()])


def modules(case: str) -> list[Any]:
    """Return the layers of synapses: onto the hidden layer, onto the output, and of the hidden layer onto itself."""
    import torch
    from torch.nn import Conv2d, Linear, init

    if case == "dense":
        linear = [Linear(INPUTS, HIDDEN, bias=False), Linear(HIDDEN, CLASSES, bias=False)]
        for layer, weights in zip(linear, first_weights(), strict=True):
            layer.weight.data = torch.tensor(weights.T, dtype=torch.float32).contiguous()
        return linear
    torch.manual_seed(0)
    if case == "conv":
        places = (SIDE - KERNEL) // STRIDE + 1
        layers = [Conv2d(2, MAPS, KERNEL, STRIDE, bias=False), Linear(MAPS * places**2, CLASSES, bias=False)]
        spread = (0.3, 0.05)
    else:
        sizes = ((INPUTS, HIDDEN), (HIDDEN, CLASSES), (HIDDEN, HIDDEN))
        layers = [Linear(*size, bias=False) for size in sizes]
        spread = (0.1, 0.1, 0.05)
    for layer, std in zip(layers, spread, strict=True):
        init.normal_(layer.weight, 0.0, std)
    return layers


def with_itself(peer: Peer, cells: Any, x: Any, back: Any) -> Any:
    """Return all spikes of a layer whose neurons also receive the layer's spikes of the step before."""
    import torch

    assert peer.step is not None
    state, fired, spikes_of_steps = None, torch.zeros_like(x[0]), []
    for now in x:
        fired, state = peer.step(cells, now + back(fired), state)
        spikes_of_steps.append(fired)
    return torch.stack(spikes_of_steps)


def one_by_one(step: Callable[[Any, Any, Any], tuple[Any, Any]]) -> Callable[[Any, Any], Any]:
    """Return a function that takes all steps of a layer, of the call for one step."""

    def all_steps(cells: Any, x: Any) -> Any:
        import torch

        state, spikes_of_steps = None, []
        for now in x:
            fired, state = step(cells, now, state)
            spikes_of_steps.append(fired)
        return torch.stack(spikes_of_steps)

    return all_steps


def _spikingjelly() -> Peer:
    from spikingjelly.activation_based import functional, neuron, surrogate

    def cells(threshold: float) -> Any:
        return neuron.LIFNode(
            tau=TAU,
            decay_input=False,
            v_threshold=threshold,
            v_reset=0.0,
            surrogate_function=surrogate.ATan(),
            detach_reset=True,
            step_mode="m",
        )

    def all_steps(layer: Any, x: Any) -> Any:
        layer.step_mode = "m"
        functional.reset_net(layer)
        return layer(x)

    def step(layer: Any, now: Any, state: Any) -> tuple[Any, Any]:
        if state is None:
            layer.step_mode = "s"
            functional.reset_net(layer)
        return layer(now), layer

    return Peer(cells, all_steps, step)


def _snntorch() -> Peer:
    import snntorch
    from snntorch import surrogate

    def cells(threshold: float) -> Any:
        beta = math.exp(-1.0 / TAU)
        return snntorch.Leaky(
            beta=beta, threshold=threshold, spike_grad=surrogate.fast_sigmoid(), reset_mechanism="zero"
        )

    def step(layer: Any, now: Any, state: Any) -> tuple[Any, Any]:
        fired, state = layer(now, layer.init_leaky() if state is None else state)
        return fired, state

    return Peer(cells, one_by_one(step), step)


def _norse() -> Peer:
    import torch
    from norse.torch import LIFBoxCell, LIFBoxParameters

    def cells(threshold: float) -> Any:
        rate = torch.tensor(1000.0 / TAU)
        return LIFBoxCell(LIFBoxParameters(tau_mem_inv=rate, v_th=torch.tensor(threshold / TAU), method="super"))

    def step(layer: Any, now: Any, state: Any) -> tuple[Any, Any]:
        fired, state = layer(now, state)
        return fired, state

    return Peer(cells, one_by_one(step), step)


def _sinabs() -> Peer:
    import torch
    from sinabs.activation import MembraneReset, SingleExponential, SingleSpike
    from sinabs.layers import LIF

    def cells(threshold: float) -> Any:
        return LIF(
            tau_mem=TAU,
            spike_threshold=torch.tensor(threshold),
            spike_fn=SingleSpike,
            reset_fn=MembraneReset(),
            surrogate_grad_fn=SingleExponential(),
            norm_input=False,
        )

    def all_steps(layer: Any, x: Any) -> Any:
        layer.reset_states()
        return layer(x)

    return Peer(cells, all_steps, time_first=False)


BUILDERS: dict[str, Callable[[], Peer]] = {
    "spikingjelly": _spikingjelly,
    "snntorch": _snntorch,
    "norse": _norse,
    "sinabs": _sinabs,
}
"""Function that makes each peer."""


if __name__ == "__main__":
    raise SystemExit(main())
