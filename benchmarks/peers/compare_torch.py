"""Time training and inference of one network in spikingjelly, snnTorch, Norse and sinabs beside neuro.

2312 inputs, 128 neurons and 10, dense, delta input, 310 steps, 4,200 events a recording, batches of 20, one thread, no
GPU. All run in one process in turns, so that each sees the same machine; the time is that of the processor, the least
of several rounds. `make bench-peers` makes an environment that has all of them.

Each peer gets its inputs as a dense tensor that is there already, and what its documentation calls its fastest way
without a GPU; all use a reset to 0, a surrogate of one kind where they have it, the same loss and the same optimiser.
Peers compute in float32, neuro in float64. Parallel neurons that have no reset are other networks, and `torch.compile`
is left out: on one thread it had not compiled a layer of 310 steps of spikingjelly within four minutes.
"""

from __future__ import annotations

import json
import math
import os
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

INPUTS, HIDDEN, CLASSES, STEPS, BATCH, EVENTS = 2312, 128, 10, 310, 20, 4200
TAU, THRESHOLD = 20.0, 15.0
ROUNDS, REPEATS = 5, 4
PACKAGES = {"spikingjelly": "spikingjelly", "snntorch": "snnTorch", "norse": "Norse", "sinabs": "sinabs"}

Layers = Callable[[Any], Any]
"""From a batch to spikes of the output, whose sum over time is (batch, classes)."""


def main() -> int:
    """Print a table and one JSON line."""
    import torch

    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; torch {torch.__version__}", flush=True)
    runs = {"neuro": ours(), **{name: peer for name in PACKAGES if (peer := theirs(name)) is not None}}
    best = {name: dict.fromkeys(("training", "inference"), math.inf) for name in runs}
    for _ in range(ROUNDS):
        for name, kinds in runs.items():
            for kind, work in kinds.items():
                best[name][kind] = min(best[name][kind], least(work, REPEATS))
    print(f"\n{'':<16}{'training':>10}{'inference':>11}  recordings/s{'neuro is faster by':>26}")
    for name, kinds in best.items():
        rates = [BATCH / kinds[kind] for kind in kinds]
        ratio = "  ".join(f"{kinds[kind] / best['neuro'][kind]:.1f}" for kind in kinds) if name != "neuro" else ""
        print(f"{called(name):<16}{rates[0]:>10.0f}{rates[1]:>11.0f}{ratio:>40}")
    print(
        json.dumps(
            {"case": "2312-128-10", **{name: {k: BATCH / s for k, s in each.items()} for name, each in best.items()}}
        )
    )
    return 0


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


def ours() -> dict[str, Callable[[], Any]]:
    """neuro, from sparse events."""
    import neuro
    import neuro_torch

    net = neuro.Network("feed_forward", resolution=1.0)
    cell = neuro.iaf_psc_delta(tau_m=TAU, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=THRESHOLD)
    net.population("input", INPUTS, neuro.spike_generator())
    net.population("hidden", HIDDEN, cell)
    net.population("out", CLASSES, cell)
    first, second = first_weights()
    net.connect("input", "hidden", neuro.all_to_all(), weight=first)
    net.connect("hidden", "out", neuro.all_to_all(), weight=second)
    module = neuro_torch.Module(net, ["input_hidden", "hidden_out"])
    events = neuro_torch.Events(BATCH, STEPS, {"input": spikes()})
    return works(lambda _: module(events).counts["out"], module.parameters())


def theirs(name: str) -> dict[str, Callable[[], Any]] | None:
    """A peer, from a dense tensor; None, and the reason told, where it cannot be imported."""
    import torch

    try:
        neurons, time_first, all_steps = BUILDERS[name]()
    except ImportError as error:
        print(f"skipped: {name}: {error}", flush=True)
        return None
    dense = torch.zeros(STEPS, BATCH, INPUTS)
    recording, step, neuron = spikes()
    dense[step, recording, neuron] = 1.0
    dense = dense if time_first else dense.transpose(0, 1).contiguous()
    linear = [torch.nn.Linear(*sizes, bias=False) for sizes in ((INPUTS, HIDDEN), (HIDDEN, CLASSES))]
    for layer, weights in zip(linear, first_weights(), strict=True):
        layer.weight.data = torch.tensor(weights.T, dtype=torch.float32).contiguous()

    def network(_: Any) -> Any:
        x = all_steps(neurons[0], linear[0](dense))
        return all_steps(neurons[1], linear[1](x)).sum(0 if time_first else 1)

    return works(network, [p for layer in linear for p in layer.parameters()])


def _spikingjelly() -> tuple[list[Any], bool, Any]:
    from spikingjelly.activation_based import functional, neuron, surrogate

    def layer() -> Any:
        return neuron.LIFNode(
            tau=TAU,
            decay_input=False,
            v_threshold=THRESHOLD,
            v_reset=0.0,
            surrogate_function=surrogate.ATan(),
            detach_reset=True,
            step_mode="m",
        )

    def all_steps(cells: Any, x: Any) -> Any:
        functional.reset_net(cells)
        return cells(x)

    return [layer(), layer()], True, all_steps


def _snntorch() -> tuple[list[Any], bool, Any]:
    import snntorch
    from snntorch import surrogate

    def layer() -> Any:
        beta = math.exp(-1.0 / TAU)
        return snntorch.Leaky(
            beta=beta, threshold=THRESHOLD, spike_grad=surrogate.fast_sigmoid(), reset_mechanism="zero"
        )

    return [layer(), layer()], True, lambda cells, x: one_by_one(cells, x, cells.init_leaky())


def one_by_one(cells: Any, x: Any, state: Any) -> Any:
    """All steps of a layer whose call is one of them."""
    import torch

    out = []
    for now in x:
        fired, state = cells(now, state)
        out.append(fired)
    return torch.stack(out)


def _norse() -> tuple[list[Any], bool, Any]:
    import torch
    from norse.torch import LIFBoxCell, LIFBoxParameters

    def layer() -> Any:
        rate = torch.tensor(1000.0 / TAU)
        return LIFBoxCell(LIFBoxParameters(tau_mem_inv=rate, v_th=torch.tensor(THRESHOLD / TAU), method="super"))

    return [layer(), layer()], True, lambda cells, x: one_by_one(cells, x, None)


def _sinabs() -> tuple[list[Any], bool, Any]:
    import torch
    from sinabs.activation import MembraneReset, SingleExponential, SingleSpike
    from sinabs.layers import LIF

    def layer() -> Any:
        return LIF(
            tau_mem=TAU,
            spike_threshold=torch.tensor(THRESHOLD),
            spike_fn=SingleSpike,
            reset_fn=MembraneReset(),
            surrogate_grad_fn=SingleExponential(),
            norm_input=False,
        )

    def all_steps(cells: Any, x: Any) -> Any:
        cells.reset_states()
        return cells(x)

    return [layer(), layer()], False, all_steps


BUILDERS: dict[str, Callable[[], tuple[list[Any], bool, Any]]] = {
    "spikingjelly": _spikingjelly,
    "snntorch": _snntorch,
    "norse": _norse,
    "sinabs": _sinabs,
}
"""How each peer is built: its two layers, whether time is the first axis, and how a layer goes through all steps."""


if __name__ == "__main__":
    raise SystemExit(main())
