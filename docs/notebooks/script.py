
import numpy as np
import pyNN.nest as sim

sim.setup(timestep=0.1, min_delay=0.5, spike_precision="on_grid")
rng = np.random.default_rng(1)
trains = [np.sort(rng.choice(np.arange(1.0, 500.0, 0.1), 25, replace=False)).round(1) for _ in range(20)]
stimulus = sim.Population(20, sim.SpikeSourceArray(spike_times=trains), label="stimulus")
cells = sim.Population(10, sim.IF_curr_exp(tau_m=10.0), label="cells")
sim.Projection(stimulus, cells, sim.AllToAllConnector(), sim.StaticSynapse(weight=0.6, delay=1.2))
sim.Projection(cells, cells, sim.FixedProbabilityConnector(0.5, rng=sim.NumpyRNG(seed=3)),
               sim.StaticSynapse(weight=-0.4, delay=0.8), receptor_type="inhibitory")
cells.record("spikes")
sim.run(500.0)
trains = cells.get_data().segments[0].spiketrains
