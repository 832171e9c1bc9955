"""Processor time of single parts: `python benchmarks/parts.py triplets|equations|neurons`.

`triplets` compares `stdp_triplet` with `stdp`, and `equations` compares `iaf_psc_exp` as equations with the built-in
model. The two networks take turns of 20 ms. The figure is the median of the ratios of processor time in each turn,
because other work on the machine slows both.

`neurons` times each neuron model on backend `event` with one thread. A thousand neurons fire under a current, so that
no neuron sleeps.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import yaml
from networks import driven, stdp, triplets

import neuro
from neuro.model.neurons import Neuron, builtin

MODELS = Path(__file__).parents[1] / "tests" / "equations" / "models.yaml"
TURN_MS = 20.0
SIZE, MS = 1000, 100.0
CURRENTS = {"izhikevich": 10.0, "aeif_cond_exp": 800.0, "aeif_psc_exp": 800.0, "hh_psc_alpha": 650.0}


def equations() -> neuro.Model:
    """Return `iaf_psc_exp` as equations in text."""
    words = yaml.safe_load(MODELS.read_text())["models"]["own_iaf_psc_exp"]
    model: neuro.Model = neuro.equations("own_iaf_psc_exp", **words)()
    return model


CASES = {
    "triplets": lambda: (triplets(), stdp()),
    "equations": lambda: (driven(equations(), 100.0), driven(neuro.iaf_psc_exp(), 100.0)),
}


def spent(sim: neuro.Simulation, ms: float) -> float:
    """Run for `ms` and return the processor time in s."""
    began = time.process_time()
    sim.run(ms)
    return time.process_time() - began


def ratios(first: neuro.Network, second: neuro.Network, turns: int) -> np.ndarray:
    """Return the ratio of the processor times of the first and the second network, (turns,), after 100 ms."""
    sims = [neuro.compile(net, seed=12345, threads=1) for net in (first, second)]
    for sim in sims:
        sim.run(100.0)
    taken = np.zeros((turns, 2))
    for turn in range(turns):
        for k in (0, 1) if turn % 2 else (1, 0):
            taken[turn, k] = spent(sims[k], TURN_MS)
    return taken[:, 0] / taken[:, 1]


def cost(model: type[Neuron]) -> float:
    """Return the processor time per neuron and step in ns, the best of three runs."""
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
    return min(spent(sim, MS) for _ in range(3)) * 1e9 / (SIZE * MS / net.resolution)


def main() -> None:
    """Print a line for the part, or a line for each neuron model."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("case", choices=[*CASES, "neurons"])
    options.add_argument("--turns", type=int, default=60)
    asked = options.parse_args()
    if asked.case == "neurons":
        models = (each for each in vars(builtin).values() if isinstance(each, type) and issubclass(each, Neuron))
        for model in (each for each in models if not each.chip):
            print(f"{model.__name__:32} {cost(model):6.1f} ns", flush=True)
        return
    low, median, high = np.percentile(ratios(*CASES[asked.case](), asked.turns), [25, 50, 75])
    print(f"{asked.case}: {median:.3f} times as long; quartiles {low:.3f} and {high:.3f}")


if __name__ == "__main__":
    main()
