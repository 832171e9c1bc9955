"""COBA (Vogels & Abbott 2005; Brette et al. 2007) with 10,000 `iaf_cond_exp`: RKF45 and RK4 beside NEST, in one run.

`python benchmarks/coba.py [--ms 1000] [--without-nest]`. One thread each; to build and to compile is not counted.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

import neuro

NEURONS = 10_000
INPUTS = 80


def coba(rk4_substeps: int = 0) -> neuro.Network:
    """4 of 5 neurons excite, 80 random inputs each (2 % of 4,000); noise for 50 ms starts it."""
    net = neuro.Network("coba", resolution=0.1)
    cell = neuro.iaf_cond_exp(
        C_m=200.0, g_L=10.0, E_L=-60.0, V_th=-50.0, V_reset=-60.0, t_ref=5.0, E_ex=0.0, E_in=-80.0,
        tau_syn_ex=5.0, tau_syn_in=10.0, rk4_substeps=rk4_substeps,
    )  # fmt: skip
    excitatory = NEURONS * 4 // 5
    for name, size in (("exc", excitatory), ("inh", NEURONS - excitatory)):
        net.population(name, size, cell, initial={"V_m": neuro.uniform(low=-60.0, high=-50.0)})
    net.population("kick", 20, neuro.poisson_generator(rate=300.0, stop=50.0))
    net.connect("kick", "exc", neuro.pairwise_bernoulli(p=0.1), weight=6.0, delay=0.1)
    for source, share, weight in (("exc", 0.8, 6.0), ("inh", 0.2, -67.0)):
        for target in ("exc", "inh"):
            net.connect(source, target, neuro.fixed_indegree(round(INPUTS * share)), weight=weight, delay=0.1)
    return net


def timed(backend: str, rk4_substeps: int, ms: float) -> tuple[float, np.ndarray]:
    """Seconds for `ms` after the first step, and the spikes."""
    sim = neuro.compile(coba(rk4_substeps), backend, seed=1)
    sim.run(0.1)
    begin = time.perf_counter()
    sim.run(ms)
    taken = time.perf_counter() - begin
    return taken, np.concatenate([np.stack(sim.spikes(name)) for name in ("exc", "inh")], axis=1)


def main() -> None:
    """Print a line for each."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--ms", type=float, default=1000.0)
    options.add_argument("--without-nest", action="store_true")
    asked = options.parse_args()
    print(f"load {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores; run alone for figures worth keeping", flush=True)
    nest, judged = (None, None) if asked.without_nest else timed("nest", 0, asked.ms)
    if nest is not None and judged is not None:
        print(f"NEST         {nest:8.3f} s  {judged.shape[1]} spikes", flush=True)
    for told, substeps in (("RKF45", 0), ("RK4", 1)):
        taken, spikes = timed("event", substeps, asked.ms)
        ratio = f", {nest / taken:.1f} times NEST" if nest else ""
        same = ", spikes equal NEST's" if judged is not None and np.array_equal(judged, spikes) else ""
        print(f"event {told:<6} {taken:8.3f} s  {spikes.shape[1]} spikes{ratio}{same}", flush=True)


if __name__ == "__main__":
    main()
