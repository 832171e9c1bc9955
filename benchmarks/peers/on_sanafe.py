"""Time SANA-FE with its Loihi: `on_sanafe.py ff|rec STEPS`, one JSON line. Its neurons compute in floats."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator
from typing import Any

import chip_networks as networks
import numpy as np
import sanafe

HARDWARE = {"default_synapse_hw_name": "loihi_sparse_synapse", "default_dendrite_hw_name": "loihi_dendrites"}
CORE = 1024


def neurons(network: Any, layer: networks.Layer) -> Any:
    """A group of leaky neurons with the chip's decays as factors."""
    attributes = {
        "threshold": float(layer.vth),
        "leak_decay": 1 - layer.dv / 4096,
        "input_decay": 1 - (layer.du + 1) / 4096,
        "reset": 0.0,
    }
    return network.create_neuron_group(
        "cells", layer.size, model_attributes=attributes, soma_hw_name="loihi_lif", **HARDWARE
    )


def feedforward(network: Any, cores: list[Any], steps: int) -> None:
    """All sources, which fire from lists, onto all neurons."""
    rows, columns = networks.fired(steps + networks.WARM_UP)
    fires = np.zeros((networks.SOURCES, steps + networks.WARM_UP), bool)
    fires[columns, rows] = True
    sources = network.create_neuron_group("sources", networks.SOURCES, **HARDWARE)
    cells = neurons(network, networks.FEEDFORWARD)
    for number, neuron in enumerate(sources.neurons):
        spikes = {"spikes": [bool(fire) for fire in fires[number]]}
        neuron.set_attributes(soma_hw_name=f"loihi_inputs[{number}]", model_attributes=spikes)
        neuron.map_to_core(cores[0])
    for neuron in cells.neurons:
        neuron.map_to_core(cores[1])
    sources.connect_neurons_dense(cells, {"weight": networks.feedforward().T.ravel().astype(float).tolist()})


def recurrent(network: Any, cores: list[Any], steps: int) -> None:
    """Each neuron hears a hundred others; the bias is in units of the voltage."""
    pre, post, weights, bias = networks.recurrent()
    cells = neurons(network, networks.RECURRENT)
    for number, neuron in enumerate(cells.neurons):
        neuron.set_attributes(model_attributes={"bias": float(bias[number]) / 64})
        neuron.map_to_core(cores[number // CORE])
    pairs = list(zip(pre.tolist(), post.tolist(), strict=True))
    cells.connect_neurons_sparse(cells, {"weight": weights.astype(float).tolist()}, pairs)


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Nothing on standard output meanwhile, also of compiled code, which reports its progress there."""
    sys.stdout.flush()
    output, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(output, 1)


def main() -> None:
    """Print the line."""
    net, steps = sys.argv[1], int(sys.argv[2])
    began = time.perf_counter()
    chip, network = sanafe.load_loihi(), sanafe.Network()
    cores = [core for tile in chip.tiles for core in tile.cores]
    {"ff": feedforward, "rec": recurrent}[net](network, cores, steps)
    with silence():
        simulator = sanafe.SpikingChip(chip)
        simulator.load(network)
        setup_s = time.perf_counter() - began
        simulator.sim(networks.WARM_UP, timing_model="simple")
        began = time.perf_counter()
        simulator.sim(steps, timing_model="simple")
        seconds = time.perf_counter() - began
    print(json.dumps(networks.line("SANA-FE", net, steps, seconds, setup_s)))


if __name__ == "__main__":
    main()
