"""10,000 neurons with conductances, RKF45 and RK4 beside NEST: `python benchmarks/coba.py [adex] [--ms 1000]`.

`lif`: the COBA benchmark with `iaf_cond_exp` (Vogels & Abbott, J. Neurosci. 25:10786, 2005; Brette et al., J. Comput.
Neurosci. 23:349, 2007). `adex`: the same connections between `aeif_cond_exp` with the weak adaptation of Destexhe,
J. Comput. Neurosci. 27:493, 2009, under lasting noise. It fires asynchronously and irregularly, at 27 Hz, with CV 1.3.

Each simulator has one thread. The figures are seconds of processor time, without building and compilation. With
`--repeat` the simulators take turns, and the least time of each is printed. `coba_brian2.py` has the same networks in
Brian2.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

import neuro

NEURONS = 10_000
INPUTS = 80
SYNAPSES = {"E_ex": 0.0, "E_in": -80.0, "tau_syn_ex": 5.0, "tau_syn_in": 10.0}
MEMBRANE = {"C_m": 200.0, "g_L": 10.0, "E_L": -60.0, "V_th": -50.0, "V_reset": -60.0, "t_ref": 5.0}
ADAPTATION = {"Delta_T": 2.5, "V_peak": 0.0, "a": 1.0, "tau_w": 600.0}
B = {"exc": 5.0, "inh": 0.0}


def coba(cells: str = "lif", rk4_substeps: int = 0) -> neuro.Network:
    """Return the network. 4 of 5 neurons excite, and each has 80 random inputs (2 % of 4,000).

    Noise drives `lif` for 50 ms and `adex` without end.
    """
    net = neuro.Network(f"coba_{cells}", resolution=0.1)
    shared = {**MEMBRANE, **SYNAPSES, "rk4_substeps": rk4_substeps}
    excitatory = NEURONS * 4 // 5
    for name, size in (("exc", excitatory), ("inh", NEURONS - excitatory)):
        lif = cells == "lif"
        cell = neuro.iaf_cond_exp(**shared) if lif else neuro.aeif_cond_exp(**shared, **ADAPTATION, b=B[name])
        net.population(name, size, cell, initial={"V_m": neuro.uniform(low=-60.0, high=-50.0)})
    net.population("kick", 20, neuro.poisson_generator(rate=300.0, stop=50.0 if cells == "lif" else np.inf))
    net.connect("kick", "exc", neuro.pairwise_bernoulli(p=0.1), weight=6.0, delay=0.1)
    for source, share, weight in (("exc", 0.8, 6.0), ("inh", 0.2, -67.0)):
        for target in ("exc", "inh"):
            net.connect(source, target, neuro.fixed_indegree(round(INPUTS * share)), weight=weight, delay=0.1)
    return net


def timed(cells: str, backend: str, rk4_substeps: int, ms: float) -> tuple[float, np.ndarray]:
    """Return the processor time in s of `ms` after the first step, and the spikes."""
    sim = neuro.compile(coba(cells, rk4_substeps), backend, seed=1)
    sim.run(0.1)
    begin = time.process_time()
    sim.run(ms)
    taken = time.process_time() - begin
    return taken, np.concatenate([np.stack(sim.spikes(name)) for name in ("exc", "inh")], axis=1)


def main() -> None:
    """Print a line for each simulator and solver."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("cells", nargs="?", choices=["lif", "adex"], default="lif")
    options.add_argument("--ms", type=float, default=1000.0)
    options.add_argument("--repeat", type=int, default=1)
    options.add_argument("--without-nest", action="store_true")
    asked = options.parse_args()
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; run alone for figures worth keeping", flush=True)
    ways = {"NEST": ("nest", 0), "event RKF45": ("event", 0), "event RK4": ("event", 1)}
    if asked.without_nest:
        del ways["NEST"]
    taken = dict.fromkeys(ways, np.inf)
    spikes: dict[str, np.ndarray] = {}
    for _ in range(asked.repeat):
        for name, (backend, substeps) in ways.items():
            seconds, spikes[name] = timed(asked.cells, backend, substeps, asked.ms)
            taken[name] = min(taken[name], seconds)
    for name, least in taken.items():
        told = f"{name:<12} {least:8.3f} s  {spikes[name].shape[1]} spikes"
        if not asked.without_nest and name != "NEST":
            told += f", {taken['NEST'] / least:.1f} times NEST"
            told += ", spikes equal NEST's" if np.array_equal(spikes["NEST"], spikes[name]) else ""
        print(told, flush=True)


if __name__ == "__main__":
    main()
