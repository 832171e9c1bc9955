"""Time Brian2Loihi: `on_brian2_loihi.py ff|rec STEPS`, one JSON line.

It needs numpy below 2. It has no bias, so that `rec` adds that of each neuron before each step.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from typing import Any

import brian2
import brian2_loihi as loihi
import chip_networks as networks
import numpy as np


def neurons(layer: networks.Layer) -> Any:
    """A group; its decay of the current is given as what a step multiplies by, one 4096th more."""
    return loihi.LoihiNeuronGroup(layer.size, threshold_v_mant=layer.vth, decay_v=layer.dv, decay_I=layer.du + 1)


def feedforward(steps: int) -> list[Any]:
    """All sources onto all neurons."""
    rows, columns = networks.fired(steps + networks.WARM_UP)
    sources = loihi.LoihiSpikeGeneratorGroup(networks.SOURCES, columns, rows)
    cells = neurons(networks.FEEDFORWARD)
    synapses = loihi.LoihiSynapses(sources, cells, sign_mode=1)
    synapses.connect()
    synapses.w = networks.feedforward().T.ravel()
    return [cells, sources, synapses]


def recurrent(steps: int) -> list[Any]:
    """Each neuron hears a hundred others."""
    pre, post, weights, bias = networks.recurrent()
    cells = neurons(networks.RECURRENT)
    synapses = loihi.LoihiSynapses(cells, cells, sign_mode=1)
    synapses.connect(i=pre, j=post)
    synapses.w = weights

    def drive() -> None:
        cells.v_[:] = np.asarray(cells.v) + bias

    return [cells, synapses, brian2.NetworkOperation(drive, dt=1 * brian2.ms, when="start")]


def main() -> None:
    """Print the line."""
    net, steps = sys.argv[1], int(sys.argv[2])
    warnings.simplefilter("ignore")
    brian2.BrianLogger.log_level_error()
    brian2.prefs.codegen.target = "numpy"
    began = time.perf_counter()
    parts = {"ff": feedforward, "rec": recurrent}[net](steps)
    monitor = loihi.LoihiSpikeMonitor(parts[0])
    network = loihi.LoihiNetwork(*parts, monitor)
    setup_s = time.perf_counter() - began
    network.run(networks.WARM_UP)
    before, began = monitor.num_spikes, time.perf_counter()
    network.run(steps)
    seconds = time.perf_counter() - began
    print(json.dumps(networks.line("Brian2Loihi", net, steps, seconds, setup_s, int(monitor.num_spikes - before))))


if __name__ == "__main__":
    main()
