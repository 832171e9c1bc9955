"""Time networks of Loihi 2 on the emulated chip, in steps per second on one core.

    python benchmarks/loihi2.py lif [--steps N]
    python benchmarks/loihi2.py pilotnet [--net FILE] [--steps N]

`benchmarks/loihi2_lava.py` times the same networks with lava's own models. `final` is equal in both if the last states
are equal. Each script prints one JSON line.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import zlib
from typing import Any

import numpy as np

import neuro

NEURONS = 1000
LIF = {"du": 400, "dv": 200, "vth": 4000}
PILOTNET = "../shared/reference/loihi2/gts_pilotnet_sdnn_network.net"


def recurrent() -> tuple[np.ndarray, np.ndarray]:
    """Return biases (neurons,) and mantissas (post, pre) of all pairs. Both scripts have the same."""
    rng = np.random.RandomState(7)
    return rng.randint(0, 4000, NEURONS), 2 * rng.randint(-5, 5, (NEURONS, NEURONS))


def image(n: int) -> np.ndarray:
    """Return the n values of the input picture of PilotNet."""
    return np.random.RandomState(7).randint(0, 256, n)


def lif() -> neuro.Simulation:
    """Return 1,000 LIF neurons that are all connected with each other."""
    bias, weights = recurrent()
    net = neuro.Network("lif", resolution=1.0)
    net.population("lif", NEURONS, neuro.loihi2_lif(**LIF, bias_mant=bias.astype(float), bias_exp=4))
    dense = neuro.loihi2_static(sign_mode="mixed")
    net.connect("lif", "lif", neuro.all_to_all(), dense, weight=weights.T.ravel().astype(float), delay=1.0)
    return neuro.compile(net, "loihi2")


def pilotnet(file: str) -> neuro.Simulation:
    """Return PilotNet with sigma-delta neurons. Its input is a picture at the first step."""
    sim = neuro.compile(neuro.from_netx(file), "loihi2")
    sim.set("input", bias=image(sim.program.populations[0].size).astype(float))
    return sim


def main() -> None:
    """Time one network after a warm-up, and print the figures."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("net", choices=("lif", "pilotnet"))
    words.add_argument("--net", dest="file", default=PILOTNET)
    words.add_argument("--steps", type=int, default=200)
    asked = words.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    sim = lif() if asked.net == "lif" else pilotnet(asked.file)
    last = sim.program.populations[-1].name
    sim.run(float(asked.steps))
    final = sim.get(last, "v" if asked.net == "lif" else "sigma")
    found: dict[str, Any] = {"net": asked.net, "final": zlib.crc32(final.astype(np.int64).tobytes())}
    sim.reset()
    began = time.perf_counter()
    sim.run(float(asked.steps))
    taken = time.perf_counter() - began
    found |= {"steps": asked.steps, "steps_per_s": asked.steps / taken}
    found["spikes_per_step"] = sum(int(p.spikes) for p in sim.counts().populations.values()) / asked.steps
    print(json.dumps(found))


if __name__ == "__main__":
    main()
