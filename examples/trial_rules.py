"""What one trial changes by each rule for trials, over the arrival of an input before or after the decision.

Each input arrives once. The first of two neurons decides after 35 ms, which is right or wrong, or no neuron does. The
second, which would have been right, is drawn dotted where it is taught, too. Lines are thicker for larger weights and
delays. Writes trial_rules.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro.extend import DelayRule, Synapse

DECISION, DURATION = 35.0, 61.0  # ms
WEIGHTS = (0.2, 0.5, 0.8)  # of three inputs that arrive together
DELAYS = (3.0, 6.0, 9.0)  # ms, of a rule that changes them
TIMES = np.repeat(np.arange(10.0, DURATION), len(WEIGHTS))  # of arrivals
RULES = {
    "r_stdp": neuro.r_stdp(),
    "mozafari": neuro.mozafari(misses=0.5, hits=0.5),
    "tempotron": neuro.tempotron(),
    "first_spike_stdp": neuro.first_spike_stdp(),
    "normalised_stdp": neuro.normalised_stdp(total=WEIGHTS[1] * TIMES.size),
    "r_stddp": neuro.r_stddp(),
}
OUTCOMES = {"right": (0, "C0"), "wrong": (1, "C3"), "silent": (1, "0.5")}  # the right label, and a colour


def changes(rule: Synapse, outcome: str) -> np.ndarray:
    """What a trial adds to the weight or delay of each input: (arrivals, weights, neurons)."""
    inputs = TIMES.size
    of_delays = isinstance(rule, DelayRule)
    delays = np.tile(DELAYS if of_delays else [1.0] * len(WEIGHTS), inputs // len(WEIGHTS))
    weights = np.full(inputs, WEIGHTS[1]) if of_delays else np.tile(WEIGHTS, inputs // len(WEIGHTS))
    net = neuro.Network("trial", resolution=1.0)
    net.population("input", inputs + 1, neuro.spike_generator())
    net.population("cells", (2, 1), neuro.iaf_psc_delta(tau_m=15.0, E_L=0.0, V_reset=0.0, V_th=1e6))
    every = neuro.pairs(pre=np.repeat(np.arange(inputs), 2), post=np.tile([0, 1], inputs))
    net.connect("input", "cells", every, rule, weight=np.repeat(weights, 2), delay=np.repeat(delays, 2), name="learnt")
    net.connect("input", "cells", neuro.pairs(pre=[inputs], post=[0]), weight=1e8, delay=1.0, name="decides")
    net.group("first", neuro.winner_take_all(of="cells", first_to_fire=True))
    net.trials(input="input", duration=DURATION, stop="full", labels=neuro.labels(of="cells"))
    sim = neuro.compile(net, seed=1)
    state = "delay" if of_delays else "weight"
    before = sim.get("learnt", state)
    sent = np.append(TIMES - delays, DECISION - 1.0)
    order = np.argsort(sent[: inputs if outcome == "silent" else None], kind="stable")
    sim.trials(sent[order], order, [0, order.size], [OUTCOMES[outcome][0]], learn=True)
    return (sim.get("learnt", state) - before).reshape(-1, len(WEIGHTS), 2)


figure, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained", sharex=True)
after = TIMES[:: len(WEIGHTS)] - DECISION
for (name, rule), axis in zip(RULES.items(), axes.flat, strict=True):
    for outcome, (_, colour) in OUTCOMES.items():
        found = changes(rule, outcome)
        for k, width in enumerate((0.7, 1.3, 2.0)):
            axis.plot(after, found[:, k, 0], color=colour, linewidth=width, label=outcome if k == 1 else None)
            if found[:, :, 1].any():
                axis.plot(after, found[:, k, 1], ":", color=colour, linewidth=width)
        lowest, highest = found.min(axis=(0, 1)), found.max(axis=(0, 1))
        rows = [f"{low:.4g} to {high:.4g}" for low, high in zip(lowest, highest, strict=True)]
        print(f"{name}, {outcome}: inputs of the first neuron change by {rows[0]}, of the second by {rows[1]}")
    axis.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axis.set(title=name, xlabel="arrival after the decision (ms)")
    axis.set_ylabel("change of the delay (ms)" if isinstance(rule, DelayRule) else "change of the weight (mV)")
figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
figure.savefig("trial_rules.png", dpi=80)
