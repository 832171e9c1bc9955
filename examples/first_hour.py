"""Records, pictures and tables of a network: two sheets of neurons in balance under noise, whose synapses learn.

The program records states and sent weights, draws them, writes a page, and exports the run for other tools.

    python examples/first_hour.py
"""

import subprocess
import sys
from importlib.util import find_spec

import neuro
from neuro import plots

net = neuro.Network("first-hour", resolution=0.1)
lif = neuro.iaf_psc_exp(tau_m=20.0, E_L=-65.0, V_reset=-65.0, V_th=-50.0)
start = {"V_m": neuro.uniform(low=-65.0, high=-50.0)}
exc = net.population("exc", [20, 40], lif, initial=start, extent=[1.0, 2.0])
inh = net.population("inh", [10, 20], lif, initial=start, extent=[1.0, 2.0])
noise = net.population("noise", 1, neuro.noise_generator(mean=200.0, std=300.0))
net.connect(noise, exc, neuro.all_to_all())
net.connect(noise, inh, neuro.all_to_all())
near = neuro.distance_dependent(p=neuro.gaussian(a=0.3, std=0.3), autapses=False)
later = neuro.of_distance(neuro.linear(c=0.5, a=2.0))
ee = net.connect(exc, exc, near, neuro.stdp(Wmax=60.0), weight=30.0, delay=later)
net.connect(exc, inh, near, weight=30.0, delay=1.0)
net.connect(inh, exc, near, weight=-150.0, delay=1.0)
net.connect(inh, inh, near, weight=-150.0, delay=1.0)
net.probe("cells", exc[0, :10], ["V_m", "I_syn_ex"], every=1.0)
net.probe("w", ee, "weight", at="pre_spikes")
sim = neuro.compile(net, seed=1)
sim.run(500.0, out="run.h5")
times, ids = sim.spikes(exc, since=100.0)
recorded, sent = sim.trace("w")

print(net)
print(
    f"{times.size / len(exc) / 0.4:.1f} Hz; {sent['weight'].size:,} weights sent, mean {sent['weight'].mean():.2f} pA"
)
corner = sim.weights(ee, pre=exc[:5, :5], post=exc[:5, :5])[2]
print(f"{corner.size} synapses within a corner, mean {corner.mean():.2f} pA")

sim.plot(window=(200.0, 400.0)).savefig("glance.png")
plots.weights(sim, ee).savefig("weights.png")
subprocess.run([sys.executable, "-m", "neuro", "report", "run.h5"], check=True)
if find_spec("neo"):
    print(sim.to_neo().segments[0].spiketrains[0])
