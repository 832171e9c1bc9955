"""The cortical microcircuit in NEST, by NEST's own connection rules.

    python benchmarks/microcircuit_nest.py [--scale 1] [--ms 1000] [--threads 1] [--out NEST.npz]
    mpirun -n 2 python benchmarks/microcircuit_nest.py --scale 0.2 --indegree 1

All numbers are read from microcircuit.yaml of `neuro_models`. Each process prints a JSON line: seconds of building,
seconds per biological second, memory, and number of its synapses. One of the processes writes the spikes after `--warm`
ms to `--out`, in the format of `benchmarks/microcircuit.py run`. A run at full scale needs 14.7 GB.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import nest
import numpy as np
from microcircuit import circuit, peak_gb
from spike_statistics import Recording, Train

from neuro.model.distributions import normal
from neuro.model.network import Network

CELL = ("C_m", "tau_m", "tau_syn_ex", "tau_syn_in", "t_ref", "E_L", "V_reset", "V_th", "I_e")


def drawn(value: float | normal, low: float | None = None) -> Any:
    """Return NEST's parameter for a number or a normal distribution of ours."""
    if not isinstance(value, normal):
        return value
    huge = float(np.finfo(np.float64).max)
    least = max(value.low, -huge) if low is None else low
    return nest.math.redraw(nest.random.normal(mean=value.mean, std=value.std), min=least, max=min(value.high, huge))


def populations(net: Network) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return NEST's nodes by population: neurons, and one generator for each population with one-to-one connections."""
    cells, sources = {}, {}
    for part in net.populations.values():
        if part.model.name == "poisson_generator":
            sources[part.name] = nest.Create("poisson_generator", params={"rate": float(part.model.rate)})
            continue
        values = {word: getattr(part.model, word) for word in CELL}
        cells[part.name] = nest.Create("iaf_psc_exp", int(np.prod(part.shape)), values)
        cells[part.name].V_m = drawn(part.initial["V_m"])
        # a model of NEST holds at most 134 million connections of a thread
        nest.CopyModel("static_synapse", f"from_{part.name}")
    return cells, sources


def connect(net: Network, cells: dict[str, Any], sources: dict[str, Any]) -> None:
    """Connect all projections. A generator of NEST sends a different spike train to each target."""
    for part in net.projections.values():
        if part.source in sources:
            words = {"weight": part.weight, "delay": part.delay}
            nest.Connect(sources[part.source], cells[part.target], syn_spec=words)
            continue
        words = {
            "synapse_model": f"from_{part.source}",
            "weight": drawn(part.weight),
            "delay": drawn(part.delay, nest.resolution / 2),
        }
        rule = {"rule": "fixed_total_number", "N": part.rule.n}
        nest.Connect(cells[part.source], cells[part.target], rule, words)


def resident_gb() -> float:
    """Return the present memory of this process, GB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**30


def main() -> None:
    """Build and run the network, write the spikes and print the line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--indegree", type=float)
    parser.add_argument("--ms", type=float, default=1000.0)
    parser.add_argument("--warm", type=float, default=500.0, help="ms before")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.set(resolution=0.1, local_num_threads=asked.threads, rng_seed=asked.seed)
    if asked.out and nest.num_processes > 1:
        parser.error("--out needs one process")

    net = circuit(asked.scale, asked.indegree)
    cells, sources = populations(net)
    empty, wall, cpu = resident_gb(), time.perf_counter(), time.process_time()
    connect(net, cells, sources)
    recorders = {name: nest.Create("spike_recorder", params={"start": asked.warm}) for name in cells}
    for name, nodes in cells.items():
        nest.Connect(nodes, recorders[name])
    nest.Simulate(nest.resolution)  # the first one finishes the tables of connections
    told = {"build_s": time.perf_counter() - wall, "build_cpu_s": time.process_time() - cpu}
    told |= {"synapses_gb": resident_gb() - empty, "build_peak_gb": peak_gb() - empty}
    nest.Simulate(asked.warm - nest.resolution)
    wall, cpu = time.perf_counter(), time.process_time()
    nest.Simulate(asked.ms)
    told |= {
        "s_per_bio_s": (time.perf_counter() - wall) / asked.ms * 1e3,
        "cpu_s_per_bio_s": (time.process_time() - cpu) / asked.ms * 1e3,
        "peak_gb": peak_gb(),
        "synapses": nest.num_connections,
        "rates": {name: recorders[name].n_events / len(nodes) / asked.ms * 1e3 for name, nodes in cells.items()},
    }
    if asked.out:
        events = {name: recorder.events for name, recorder in recorders.items()}
        trains = {
            name: Train(len(nodes), events[name]["times"], events[name]["senders"] - nodes[0].global_id)
            for name, nodes in cells.items()
        }
        Recording(asked.warm, asked.warm + asked.ms, trains).save(asked.out)
    head = {"nest": nest.__version__, "rank": nest.Rank(), "ranks": nest.num_processes}
    print(json.dumps(head | {"scale": asked.scale, "threads": asked.threads} | told), flush=True)


if __name__ == "__main__":
    main()
