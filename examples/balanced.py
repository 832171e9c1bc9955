"""Excitation and inhibition in balance: neurons fire irregularly although nothing in them is random.

Brunel's network with 1,000 neurons. Source: Brunel, J. Comput. Neurosci. 8:183, 2000. Writes balanced.png.
"""

import numpy as np

import neuro

EXCITATORY, INHIBITORY = 800, 200
neuron = neuro.iaf_psc_delta(tau_m=20.0, t_ref=2.0, E_L=0.0, V_reset=10.0, V_th=20.0)

net = neuro.Network("balanced", resolution=0.1)
noise = net.population("noise", EXCITATORY + INHIBITORY, neuro.poisson_generator(rate=4000.0))
exc = net.population("exc", EXCITATORY, neuron, initial={"V_m": neuro.uniform(low=0.0, high=20.0)})
inh = net.population("inh", INHIBITORY, neuron, initial={"V_m": neuro.uniform(low=0.0, high=20.0)})
everyone = np.arange(EXCITATORY + INHIBITORY)
net.connect(noise, exc, neuro.pairs(everyone[:EXCITATORY], everyone[:EXCITATORY]), weight=0.5, delay=1.5)
net.connect(noise, inh, neuro.pairs(everyone[EXCITATORY:], everyone[:INHIBITORY]), weight=0.5, delay=1.5)
for target in (exc, inh):
    net.connect(exc, target, neuro.fixed_indegree(160), weight=0.5, delay=1.5)
    net.connect(inh, target, neuro.fixed_indegree(40), weight=-2.5, delay=1.5)

sim = neuro.compile(net, seed=1)
sim.run(1000.0)

times, ids = sim.spikes("exc", since=200.0)
intervals = [np.diff(times[ids == i]) for i in range(EXCITATORY)]
irregularity = np.mean([t.std() / t.mean() for t in intervals if t.size > 4])
print(f"rate {times.size / EXCITATORY / 0.8:.1f} Hz, coefficient of variation of the intervals {irregularity:.2f}")
counts = sim.counts()
print(f"{counts.synaptic_ops:,} synaptic events in {counts.steps:,} steps")

sim.plot(["exc", "inh"], window=(800.0, 1000.0)).savefig("balanced.png", dpi=100)
