"""Many areas (`neuro_models.areas`): build time, memory and speed on `event`, on NEST, and with NEST's own rules.

    python benchmarks/areas.py [--on event] [--areas 32] [--scale 0.02] [--indegree 0.1] [--ms 200] [--threads 1]
    mpirun -n 2 python benchmarks/areas.py --on nest

Each process prints a JSON line. `event` and `nest` have the same synapses, so `spikes`, a digest of all spikes, is the
same for both and for any number of ranks. `rules` draws the same numbers of synapses in NEST.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from typing import Any

import numpy as np
from microcircuit import peak_gb

import neuro
from neuro_models import areas


def ours(net: neuro.Network, asked: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a run on one of our backends."""
    wall = time.perf_counter()
    sim = neuro.compile(net, asked.on, seed=asked.seed, threads=asked.threads)
    sim.run(net.resolution)
    told: dict[str, Any] = {"build_s": time.perf_counter() - wall, "build_peak_gb": peak_gb()}
    sim.run(asked.warm - net.resolution)
    wall, cpu = time.perf_counter(), time.process_time()
    sim.run(asked.ms)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    digest, rates = hashlib.sha256(), {}
    for part in sim.program.populations:
        if part.kind == "neuron":
            times, ids = sim.spikes(part.name)
            digest.update(times.tobytes() + ids.astype(np.int64).tobytes())
            rates[part.name] = np.count_nonzero(times > asked.warm) / part.size / asked.ms * 1e3
    return told | _times(wall, cpu, asked.ms) | {"rates": by_layer(rates), "spikes": digest.hexdigest()[:12]}


def by_rules(net: neuro.Network, asked: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a run in NEST, which draws the synapses itself."""
    import nest
    from microcircuit_nest import connect, populations

    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.set(resolution=net.resolution, local_num_threads=asked.threads, rng_seed=asked.seed)
    wall = time.perf_counter()
    cells, sources = populations(net)
    connect(net, cells, sources)
    recorders = {name: nest.Create("spike_recorder", params={"start": asked.warm}) for name in cells}
    for name, nodes in cells.items():
        nest.Connect(nodes, recorders[name])
    nest.Simulate(nest.resolution)
    told: dict[str, Any] = {"build_s": time.perf_counter() - wall, "build_peak_gb": peak_gb()}
    nest.Simulate(asked.warm - nest.resolution)
    wall, cpu = time.perf_counter(), time.process_time()
    nest.Simulate(asked.ms)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    rates = {name: recorders[name].n_events / len(nodes) / asked.ms * 1e3 for name, nodes in cells.items()}
    return told | _times(wall, cpu, asked.ms) | {"rates": by_layer(rates)}


def _times(wall: float, cpu: float, ms: float) -> dict[str, float]:
    return {"s_per_bio_s": wall / ms * 1e3, "cpu_s_per_bio_s": cpu / ms * 1e3, "peak_gb": peak_gb()}


def by_layer(rates: dict[str, float]) -> dict[str, list[float]]:
    """Return the least, mean and largest rate of the areas in Hz, by population.

    With NEST's own rules, the rates are those of a single rank.
    """
    every = {layer: [rate for name, rate in rates.items() if name.endswith(f"_{layer}")] for layer in areas.LAYERS}
    return {
        layer: [round(float(f(found)), 2) for f in (np.min, np.mean, np.max)] for layer, found in every.items() if found
    }


def ranks(on: str) -> dict[str, int]:
    """Return the index of this process and the number of processes."""
    if on == "event":
        return {"rank": 0, "ranks": 1}
    import nest

    return {"rank": nest.Rank(), "ranks": nest.num_processes}


def main() -> None:
    """Describe, build and run the network, and print the line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--on", choices=("event", "nest", "rules"), default="event")
    parser.add_argument("--areas", type=int, default=32)
    parser.add_argument("--scale", type=float, default=0.02)
    parser.add_argument("--indegree", type=float, default=0.1)
    parser.add_argument("--density", type=float, default=0.66)
    parser.add_argument("--ms", type=float, default=200.0)
    parser.add_argument("--warm", type=float, default=100.0, help="ms before")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    wall = time.perf_counter()
    net = areas.network(areas=asked.areas, scale=asked.scale, indegree=asked.indegree, density=asked.density)
    drawn = [p for p in net.projections.values() if isinstance(p.rule, neuro.fixed_total_number)]
    sizes = {"describe_s": time.perf_counter() - wall, "projections": len(net.projections)}
    sizes |= {"between": sum(p.source[:3] != p.target[:3] for p in drawn), "synapses": sum(p.rule.n for p in drawn)}
    told = by_rules(net, asked) if asked.on == "rules" else ours(net, asked)
    head = {word: getattr(asked, word) for word in ("on", "areas", "scale", "indegree", "threads", "seed", "ms")}
    print(json.dumps(head | ranks(asked.on) | sizes | told), flush=True)


if __name__ == "__main__":
    main()
