"""Time the networks of `benchmarks/loihi2.py` with lava's own fixed-point models on the CPU.

    PYTHON benchmarks/loihi2_lava.py lif [--steps N]
    PYTHON benchmarks/loihi2_lava.py pilotnet [--net FILE] [--steps N]

PYTHON is an interpreter (Python 3.10) with lava-nc 0.10.0 and h5py. Layers are made as in lava-dl's netx. The script
prints one JSON line.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import zlib
from typing import Any

import h5py
import numpy as np
from lava.magma.core.run_conditions import RunSteps
from lava.magma.core.run_configs import Loihi2SimCfg
from lava.proc.conv.process import Conv
from lava.proc.dense.process import Dense
from lava.proc.lif.process import LIF
from lava.proc.sdn.process import ActivationMode, Sigma, SigmaDelta
from lava.utils.weightutils import SignMode

NEURONS = 1000
PILOTNET = "../shared/reference/loihi2/gts_pilotnet_sdnn_network.net"


def lif() -> tuple[Any, Any]:
    """Return 1,000 LIF neurons that are all connected with each other: the process to run, and the variable to read."""
    rng = np.random.RandomState(7)
    bias, weights = rng.randint(0, 4000, NEURONS), 2 * rng.randint(-5, 5, (NEURONS, NEURONS))
    cells = LIF(shape=(NEURONS,), du=400, dv=200, vth=4000, bias_mant=bias, bias_exp=4)
    dense = Dense(weights=weights, sign_mode=SignMode.MIXED)
    cells.s_out.connect(dense.s_in)
    dense.a_out.connect(cells.a_in)
    return cells, cells.v


def arrays(group: Any) -> dict[str, np.ndarray]:
    """Return the arrays and numbers of a group of the file by name."""
    return {word: np.asarray(item) for word, item in group.items() if isinstance(item, h5py.Dataset)}


def pilotnet(file: str) -> tuple[Any, Any]:
    """Return PilotNet with sigma-delta neurons: the process to run, and the variable to read."""
    with h5py.File(file, "r") as opened:
        layers = [opened[f"layer/{k}"] for k in sorted(opened["layer"], key=int)]
        found = [(arrays(each), arrays(each.get("neuron", {}))) for each in layers]
    before, shape = None, ()
    for layer, neuron in found:
        kind = layer["type"].ravel()[0].decode()
        if kind == "flatten":
            continue
        own = tuple(int(n) for n in layer["shape"].ravel())
        own = own[::-1] if len(own) == 3 else own  # channels, rows, columns: lava has columns, rows, channels
        bias = layer.get("bias", np.zeros(1)).astype(int).ravel()
        if kind == "input":
            picture = np.random.RandomState(7).randint(0, 256, int(np.prod(own)))
            bias = picture.reshape(own[::-1]).transpose(2, 1, 0)
        if "sigma_output" in neuron:
            cells = Sigma(shape=own)
        else:
            mode = ActivationMode.UNIT if kind == "input" else ActivationMode.RELU
            vth = int(neuron["vThMant"])
            cells = SigmaDelta(shape=own, vth=vth, bias=bias, act_mode=mode, spike_exp=6, state_exp=6)
        if before is not None:
            weight = layer["weight"].astype(int)
            if kind == "conv":
                kernel = weight.reshape(weight.shape[:4])[:, :, ::-1, ::-1].transpose(0, 3, 2, 1)
                two = {word: tuple(np.broadcast_to(layer[word], 2)[::-1]) for word in ("stride", "padding", "dilation")}
                groups = int(layer["groups"])
                wires = Conv(weight=kernel, input_shape=shape, groups=groups, num_message_bits=16, **two)
                before.s_out.connect(wires.s_in)
            else:
                flat = weight.reshape(own[0], -1)
                wires = Dense(weights=2 * flat, weight_exp=-1, num_message_bits=16, sign_mode=SignMode.MIXED)
                source = before.s_out if len(shape) == 1 else before.s_out.transpose([2, 1, 0]).flatten()
                source.connect(wires.s_in)
            wires.a_out.connect(cells.a_in)
        before, shape = cells, own
    return before, before.sigma


def main() -> None:
    """Time one network after a warm-up, and print the figures."""
    asked_for = argparse.ArgumentParser(description=__doc__)
    asked_for.add_argument("net", choices=("lif", "pilotnet"))
    asked_for.add_argument("--net", dest="file", default=PILOTNET)
    asked_for.add_argument("--steps", type=int, default=200)
    asked = asked_for.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    network, state = lif() if asked.net == "lif" else pilotnet(asked.file)
    config = Loihi2SimCfg(select_tag="fixed_pt")
    network.run(RunSteps(1), config)
    began = time.perf_counter()
    network.run(RunSteps(asked.steps - 1), config)
    taken = time.perf_counter() - began
    final = np.asarray(state.get()).ravel()
    network.stop()
    found = {"net": asked.net, "final": zlib.crc32(final.astype(np.int64).tobytes()), "steps": asked.steps}
    print(json.dumps(found | {"steps_per_s": (asked.steps - 1) / taken}))


if __name__ == "__main__":
    main()
