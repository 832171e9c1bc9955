"""Time nengo-loihi's emulator with integers set block by block: `on_nengo_loihi.py ff|rec STEPS`, one JSON line.

It needs numpy below 2. Limits of the chip are not enforced.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from itertools import pairwise
from typing import Any

import chip_networks as networks
import numpy as np
from nengo_loihi.block import Axon, LoihiBlock, Synapse
from nengo_loihi.builder import Model
from nengo_loihi.emulator import EmulatorInterface
from nengo_loihi.inputs import SpikeInput

CORE = 1024
UNIT = 6
"""Weights and thresholds are shifted by so many bits."""


def block(layer: networks.Layer, size: int, bias: Any = 0) -> LoihiBlock:
    """Neurons of a core."""
    made = LoihiBlock(size)
    cell = made.compartment
    cell.decay_u = np.full(size, layer.du, np.int32)
    cell.decay_v = np.full(size, layer.dv, np.int32)
    cell.vth = np.full(size, layer.vth << UNIT, np.int32)
    cell.bias = np.array(np.broadcast_to(bias, size), np.int32)
    cell.refract_delay = np.ones(size, np.int32)
    cell.vmin, cell.vmax = 1 - 2**23, 2**23 - 1
    cell.scale_u = cell.scale_v = False
    cell.noise_exp = cell.noise_offset = 0
    return made


def connect(source: Any, size: int, target: LoihiBlock, weights: list[Any], indices: list[Any] | None = None) -> None:
    """Give each neuron of a source its row of weights onto a block."""
    synapse = Synapse(size)
    more = {} if indices is None else {"indices": [row[None] for row in indices]}
    synapse._set_weights_indices([row[None] for row in weights], weight_dtype=np.int32, **more)
    target.add_synapse(synapse)
    axon = Axon(size)
    axon.target = synapse
    axon.set_compartment_axon_map(np.arange(size))
    source.add_axon(axon)


def feedforward(model: Model, steps: int) -> None:
    """All sources onto all neurons."""
    layer = networks.FEEDFORWARD
    sources, cells = SpikeInput(networks.SOURCES), block(layer, layer.size)
    weights = (networks.feedforward() << UNIT).astype(np.int32)
    connect(sources, networks.SOURCES, cells, list(weights.T))
    rows, columns = networks.fired(steps + networks.WARM_UP + 1)
    for step, ids in enumerate(
        np.split(columns, np.cumsum(np.bincount(rows, minlength=steps + networks.WARM_UP + 1))[:-1])
    ):
        sources.add_spikes(step + 1, ids)
    model.add_block(cells)
    model.add_input(sources)


def recurrent(model: Model, steps: int) -> None:
    """Ten cores, each of which hears all."""
    layer = networks.RECURRENT
    pre, post, weights, bias = networks.recurrent()
    cores = [block(layer, CORE, bias[first : first + CORE]) for first in range(0, layer.size, CORE)]
    order = np.lexsort((pre, post // CORE))
    pre, post, weights = pre[order], post[order], (weights[order] << UNIT).astype(np.int32)
    ends = np.searchsorted(post // CORE * layer.size + pre, np.arange(layer.size * len(cores) + 1))
    for number, target in enumerate(cores):
        for first in range(0, layer.size, CORE):
            at = ends[number * layer.size + first : number * layer.size + first + CORE + 1]
            rows = [slice(begin, end) for begin, end in pairwise(at)]
            connect(cores[first // CORE], CORE, target, [weights[r] for r in rows], [post[r] % CORE for r in rows])
    for core in cores:
        model.add_block(core)


def main() -> None:
    """Print the line."""
    net, steps = sys.argv[1], int(sys.argv[2])
    warnings.simplefilter("ignore")
    began = time.perf_counter()
    model = Model()
    {"ff": feedforward, "rec": recurrent}[net](model, steps)
    emulator = EmulatorInterface(model, seed=0)
    setup_s = time.perf_counter() - began
    emulator.run_steps(networks.WARM_UP)
    before, began = emulator.compartment.spike_count.sum(), time.perf_counter()
    emulator.run_steps(steps)
    seconds = time.perf_counter() - began
    spikes = int(emulator.compartment.spike_count.sum() - before)
    print(json.dumps(networks.line("nengo-loihi", net, steps, seconds, setup_s, spikes)))


if __name__ == "__main__":
    main()
