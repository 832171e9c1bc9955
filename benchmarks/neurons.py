"""What each neuron costs on backend `event`, one thread: `python benchmarks/neurons.py`.

A thousand of each under a current that makes them fire, so that none sleeps.
"""

from __future__ import annotations

import time

import neuro
from neuro.model.neurons import NEURONS, Neuron

SIZE, MS = 1000, 100.0
CURRENTS = {"izhikevich": 10.0, "aeif_cond_exp": 800.0, "aeif_psc_exp": 800.0, "hh_psc_alpha": 650.0}


def cost(model: type[Neuron]) -> float:
    """Nanoseconds of the processor a neuron and step, the best of three."""
    net = neuro.Network("cost", resolution=0.1)
    given = {} if model.relay else {"initial": {"V_m": neuro.uniform(low=-70.0, high=-60.0)}}
    net.population("cells", SIZE, model(), **given)
    if model.relay:
        net.population("noise", SIZE, neuro.poisson_generator(rate=50.0))
        net.connect("noise", "cells", neuro.one_to_one(), weight=1.0)
    else:
        net.population("current", 1, neuro.dc_generator(amplitude=CURRENTS.get(model.__name__, 500.0)))
        net.connect("current", "cells", neuro.all_to_all(), weight=1.0)
    sim = neuro.compile(net, seed=1)
    sim.run(50.0)
    taken = []
    for _ in range(3):
        began = time.process_time()
        sim.run(MS)
        taken.append(time.process_time() - began)
    return min(taken) * 1e9 / (SIZE * MS / net.resolution)


def main() -> None:
    """Print a line for each."""
    for model in NEURONS:
        print(f"{model.__name__:32} {cost(model):6.1f} ns", flush=True)


if __name__ == "__main__":
    main()
