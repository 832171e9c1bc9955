"""Time NEST with the networks of `networks.py`: `on_nest.py brunel|cuba|stdp|loop`, one JSON line.

The clock starts after the first 100 ms. The buffer of spikes is never made smaller: NEST would else do so, and report
it, in each slice of some of these networks, which makes each access to synapses slower than the last.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from typing import Any

import nest
import numpy as np

WARM_UP_MS = 100.0
STEP_MS = 50.0
LOOP_STEPS = 1000


def balanced(excitatory: int, inhibitory: int, weight: float, plastic: bool) -> tuple[Any, Any]:
    """Brunel's network at g = 5 and twice the rate of threshold; a group of neurons and a recorder."""
    cell = {"C_m": 1.0, "tau_m": 20.0, "t_ref": 2.0, "E_L": 0.0, "V_reset": 0.0, "V_m": 0.0, "V_th": 20.0}
    cells = nest.Create("iaf_psc_delta", 10_000, params=cell | {"tau_minus": 20.0})
    exc, inh = cells[:8000], cells[8000:]
    noise = nest.Create("poisson_generator", params={"rate": 2.0 * 20.0 / (weight * 20.0) * 1000.0})
    nest.CopyModel("static_synapse", "excite", {"weight": weight, "delay": 1.5})
    nest.CopyModel("static_synapse", "inhibit", {"weight": -5.0 * weight, "delay": 1.5})
    rule = {"Wmax": 2.0 * weight, "lambda": 0.01, "alpha": 1.1, "mu_plus": 0.0, "mu_minus": 0.0, "tau_plus": 20.0}
    nest.CopyModel("stdp_synapse", "learn", {"weight": weight, "delay": 1.5} | rule)
    nest.Connect(noise, cells, syn_spec="excite")
    nest.Connect(exc, exc, fixed(excitatory), "learn" if plastic else "excite")
    nest.Connect(exc, inh, fixed(excitatory), "excite")
    nest.Connect(inh, cells, fixed(inhibitory), "inhibit")
    return cells, recorder(cells)


def cuba() -> tuple[Any, Any]:
    """The CUBA benchmark: 4,000 neurons, 2 % connected."""
    cell = {"C_m": 200.0, "tau_m": 20.0, "tau_syn_ex": 5.0, "tau_syn_in": 10.0, "t_ref": 5.0}
    cells = nest.Create("iaf_psc_exp", 4000, params=cell | {"E_L": -49.0, "V_reset": -60.0, "V_th": -50.0})
    cells.V_m = np.random.default_rng(1).uniform(-60.0, -50.0, 4000)
    drawn = {"rule": "pairwise_bernoulli", "p": 0.02}
    nest.Connect(cells[:3200], cells, drawn, {"weight": 16.2, "delay": 0.1})
    nest.Connect(cells[3200:], cells, drawn, {"weight": -90.0, "delay": 0.1})
    return cells, recorder(cells)


def fixed(indegree: int) -> dict[str, Any]:
    """The rule by which each target draws so many sources."""
    return {"rule": "fixed_indegree", "indegree": indegree}


def recorder(cells: Any) -> Any:
    """A recorder in memory of all spikes of some neurons."""
    made = nest.Create("spike_recorder", params={"record_to": "memory"})
    nest.Connect(cells, made)
    return made


def running(cells: Any, spikes: Any, began: float, ms: float = 1000.0) -> dict[str, Any]:
    """Time a network that runs by itself."""
    nest.Simulate(0.1)  # builds the tables of connections
    build_s = time.perf_counter() - began
    nest.Simulate(WARM_UP_MS - 0.1)
    before, clock, cpu = spikes.n_events, time.perf_counter(), time.process_time()
    nest.Simulate(ms)
    clock, cpu = time.perf_counter() - clock, time.process_time() - cpu
    emitted = spikes.n_events - before
    return {
        "build_s": build_s,
        "sim_s_per_bio_s": clock / ms * 1e3,
        "cpu_s_per_bio_s": cpu / ms * 1e3,
        "spikes": emitted,
        "rate_hz": emitted / len(cells) / ms * 1e3,
        "synapses": nest.num_connections,
    }


class Loop:
    """The closed loop of 64 inputs and 4 neurons, each with a volume transmitter of its own.

    NEST has no dopamine from outside: the concentration of each neuron's synapses is set by hand.
    """

    def __init__(self) -> None:
        self.noise = nest.Create("poisson_generator", 64)
        parrots = nest.Create("parrot_neuron", 64)
        cells = nest.Create("iaf_psc_exp", 4, params={"tau_minus": 20.0})
        nest.Connect(self.noise, parrots, "one_to_one", {"delay": 0.1})
        rule = {"A_plus": 0.5, "A_minus": 0.6, "tau_c": 200.0, "tau_n": 50.0, "b": 0.0, "Wmin": 0.0, "Wmax": 300.0}
        for number, cell in enumerate(cells):
            transmitter = nest.Create("volume_transmitter", params={"deliver_interval": 10})
            nest.CopyModel("stdp_dopamine_synapse", f"learn{number}", rule | {"volume_transmitter": transmitter})
            nest.Connect(parrots, cell, syn_spec={"synapse_model": f"learn{number}", "weight": 120.0, "delay": 1.0})
        self.spikes = recorder(cells)
        self.synapses = [nest.GetConnections(parrots, cell) for cell in cells]
        self.first = cells[0].global_id
        self.rng = np.random.default_rng(3)

    def step(self) -> tuple[Any, Any]:
        """Set rates and dopamine, run, read spikes and weights."""
        self.noise.rate = self.rng.uniform(0.0, 80.0, 64)
        for synapses, reward in zip(self.synapses, self.rng.uniform(-0.02, 0.02, 4), strict=True):
            synapses.n = reward
        nest.Simulate(STEP_MS)
        counts = np.bincount(np.asarray(self.spikes.events["senders"], int) - self.first, minlength=4)
        self.spikes.n_events = 0
        return counts, [synapses.weight for synapses in self.synapses]


def looping(began: float) -> dict[str, Any]:
    """Time the closed loop after 20 steps."""
    loop = Loop()
    nest.Simulate(1.0)
    build_s = time.perf_counter() - began
    for _ in range(20):
        loop.step()
    clock, cpu = time.perf_counter(), time.process_time()
    for _ in range(LOOP_STEPS):
        loop.step()
    clock, cpu = time.perf_counter() - clock, time.process_time() - cpu
    biological_s = LOOP_STEPS * STEP_MS / 1e3
    figures = {"build_s": build_s, "steps_per_s": LOOP_STEPS / clock, "ms_per_step": clock / LOOP_STEPS * 1e3}
    return figures | {"sim_s_per_bio_s": clock / biological_s, "cpu_s_per_bio_s": cpu / biological_s}


def main() -> None:
    """Print the line."""
    case = sys.argv[1]
    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.set(resolution=0.1, local_num_threads=1, rng_seed=12345, spike_buffer_shrink_limit=0.0)
    began = time.perf_counter()
    if case == "loop":
        figures = looping(began)
    else:
        nets = {"brunel": (balanced, 800, 200, 0.1, False), "stdp": (balanced, 80, 20, 0.5, True), "cuba": (cuba,)}
        build, *arguments = nets[case]
        figures = running(*build(*arguments), began)
    figures["rss_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    line = {"peer": "nest", "version": nest.__version__, "case": case, "threads": 1, **figures}
    print(json.dumps({name: round(value, 4) if isinstance(value, float) else value for name, value in line.items()}))


if __name__ == "__main__":
    main()
