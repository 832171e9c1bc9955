"""How each neuron answers to a step of current and to a few spikes, as a figure: `neurons.png`.

The potential is blue, a threshold that moves orange; red marks are the spikes emitted. The last input inhibits, by a
third of the weight.
"""

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro.extend import Neuron

SPIKES = [20.0, *np.arange(60.0, 84.0, 4.0), 130.0]
INHIBITION = 160.0
STEP = (20.0, 170.0)
END = 200.0
NEURONS = (  # with the current of the step in pA, and the weight of a spike in the unit of the model's input
    (neuro.parrot_neuron(), None, 1.0),
    (neuro.iaf_psc_delta(), 450.0, 5.5),
    (neuro.iaf_psc_exp(), 450.0, 900.0),
    (neuro.cuba_lif(), 450.0, 900.0),
    (neuro.iaf_psc_alpha(), 450.0, 350.0),
    (neuro.iaf_linear_leak(leak=0.2), 280.0, 4.5),
    (neuro.iaf_psc_exp_adaptive_threshold(theta_plus=2.0, tau_theta=100.0), 700.0, 1200.0),
    (neuro.srm0(), 450.0, 900.0),
    (neuro.mat2_psc_exp(), 500.0, 1600.0),
    (neuro.iaf_cond_exp(), 400.0, 130.0),
    (neuro.iaf_cond_alpha(), 400.0, 50.0),
    (neuro.izhikevich(), 10.0, 12.0),
    (neuro.aeif_cond_exp(), 800.0, 300.0),
    (neuro.aeif_psc_exp(), 800.0, 20000.0),
    (neuro.hh_psc_alpha(), 650.0, 4000.0),
    (neuro.pp_psc_delta(c_2=5.0, c_3=0.5), 250.0, 5.5),
)


def answers(model: Neuron, current: float | None, weight: float) -> neuro.Simulation:
    """One such neuron under the current, population `step`, and one under the spikes, `spikes`."""
    net = neuro.Network("answers")
    net.population("excite", 1, neuro.spike_generator(spike_times=[SPIKES]))
    net.population("inhibit", 1, neuro.spike_generator(spike_times=[[INHIBITION]]))
    for name in ("step", "spikes"):
        net.population(name, 1, model)
        for state in shown(model):
            net.probe(f"{name}.{state}", name, state, every=0.2)
    net.connect("excite", "spikes", neuro.one_to_one(), weight=weight)
    if current is not None:
        net.population("current", 1, neuro.dc_generator(amplitude=current, start=STEP[0], stop=STEP[1]))
        net.connect("current", "step", neuro.one_to_one(), weight=1.0)
        net.connect("inhibit", "spikes", neuro.one_to_one(), weight=-weight / 3.0)
    sim = neuro.compile(net)
    sim.run(END)
    return sim


def shown(model: Neuron) -> set[str]:
    """The potential, and the threshold or its rise where that moves."""
    return {"V_m", "V_th", "theta"} & {state.name for state in model.states}


def draw(axis: plt.Axes, sim: neuro.Simulation, model: Neuron, name: str, title: str) -> int:
    """These states and, above them, the spikes that it emits; return how many."""
    for state in shown(model):
        times, values = sim.trace(f"{name}.{state}")
        axis.plot(times, values + (model.V_th if state == "theta" else 0.0), "C0" if state == "V_m" else "C1", lw=1.0)
    emitted = sim.spikes(name)[0]
    above = axis.get_xaxis_transform()
    marks = axis.plot(emitted, np.full(emitted.size, 1.07), "|", color="C3", transform=above, clip_on=False)
    marks[0].set_in_layout(False)
    axis.set_title(title, loc="left", fontsize=9, pad=12)
    axis.set_xlim(0.0, END)
    if not shown(model):
        axis.set_yticks([])
    return emitted.size


half = (len(NEURONS) + 1) // 2
figure, axes = plt.subplots(half, 4, figsize=(15, 1.9 * half), sharex=True, layout="constrained")
places = [row[pair : pair + 2] for pair in (0, 2) for row in axes]
for (by_step, by_spikes), (model, current, weight) in zip(places, NEURONS, strict=False):
    sim = answers(model, current, weight)
    title = f"{model.name}, " + ("takes no current" if current is None else f"{current:g} pA")
    counts = draw(by_step, sim, model, "step", title), draw(by_spikes, sim, model, "spikes", f"weight {weight:g}")
    by_step.axvspan(*STEP, color="0.93")
    for time in (*SPIKES, INHIBITION):
        by_spikes.axvline(time, color="C4" if time == INHIBITION else "C2", linewidth=0.6)
    print(f"{title}: {counts[0]} spikes; input of weight {weight:g}: {counts[1]} spikes")
for place in places[len(NEURONS) :]:
    for axis in place:
        axis.axis("off")
figure.supxlabel("time (ms)")
figure.supylabel("potential (mV)")
figure.savefig("neurons.png", dpi=80)
