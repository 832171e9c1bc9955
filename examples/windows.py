"""The window of each rule of spike pairs, the change by a pair over the time between its spikes: `windows.png`."""

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro.extend import Synapse

H = 0.5  # ms, the step, which is also the delay of the synapses
LAGS = np.arange(-79.5, 80.0, 1.0)  # of the post spike, as it arrives at the synapse, after the pre spike
WEIGHTS = (25.0, 50.0, 75.0)
FIRST, LAST = 500.0, 4000.0  # the pre spike of a pair, and the one by which a post spike before it shows
TRAIN = 10  # pairs at 20 Hz
RULES = {
    "stdp, additive": neuro.stdp(mu_plus=0.0, mu_minus=0.0),
    "stdp, soft bounds": neuro.stdp(),
    "stdp, van Rossum": neuro.stdp(mu_plus=0.0, mu_minus=1.0),
    "stdp_literal": neuro.stdp_literal(),
    "stdp_pl_hom": neuro.stdp_pl_hom(alpha=0.1),
    "stdp_nn_symm": neuro.stdp_nn_symm(),
    "stdp_nn_pre_centered": neuro.stdp_nn_pre_centered(),
    "stdp_nn_restr": neuro.stdp_nn_restr(),
    "stdp_triplet": neuro.stdp_triplet(),
    "vogels_sprekeler": neuro.vogels_sprekeler(),
    "stdp_dopa, eligibility": neuro.stdp_dopa(tau_c=1e9, signal="reward"),
}


def changes(rule: Synapse, start: float, pairs: int, lags: np.ndarray) -> np.ndarray:
    """What each of so many pairs at 20 Hz does, for each lag; without what the last pre spike does alone."""
    size = lags.size + 1
    at = FIRST + 50.0 * np.arange(pairs)
    pre = [*([*at, LAST] for _ in lags), [LAST]]
    post = [*((at + lag - 2.0 * H).tolist() for lag in lags), []]
    net = neuro.Network("pairs", resolution=H)
    net.population("pre", size, neuro.spike_generator(spike_times=pre))
    net.population("drive", size, neuro.spike_generator(spike_times=post))
    net.population("post", size, neuro.iaf_psc_delta(V_th=1e6, t_ref=0.0))
    net.connect("drive", "post", neuro.one_to_one(), weight=1e8, delay=H)
    net.connect("pre", "post", neuro.one_to_one(), rule, weight=start, delay=H, name="learnt")
    if rule.modulated:
        net.signal("reward", to="post")
    sim = neuro.compile(net)
    sim.run(LAST - H if rule.modulated else LAST + H)
    found = sim.get("learnt", "c") if rule.modulated else sim.weights("learnt")[2]
    alone = found[-1] if rule.modulated else found[-1] - start
    return (found[:-1] - (0.0 if rule.modulated else start) - alone) / pairs


figure, axes = plt.subplots(3, 4, figsize=(13, 8), sharex=True, layout="constrained")
sides = (LAGS < 0.0, LAGS > 0.0)
for axis, (name, rule) in zip(axes.flat, RULES.items(), strict=False):
    sign = np.sign(getattr(rule, "Wmax", 1.0))
    for shade, weight in zip(("C9", "C0", "k"), WEIGHTS, strict=True):
        lone = sign * changes(rule, sign * weight, 1, LAGS)
        for side in sides:
            axis.plot(LAGS[side], lone[side], color=shade, label=f"w = {weight:g}" if side[0] else "")
    train = sign * changes(rule, sign * WEIGHTS[1], TRAIN, LAGS)
    for side in sides:
        near = side & (np.abs(LAGS) < 25.0)
        label = f"each of {TRAIN} at 20 Hz, w = {WEIGHTS[1]:g}" if side[0] else ""
        axis.plot(LAGS[near], train[near], "--", color="C3", label=label)
    axis.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axis.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axis.set_title(name)
    print(f"{name}: a pair changes {WEIGHTS[-1]:g} by {lone.min():.4g} to {lone.max():.4g}")
for axis in axes[:, 0]:
    axis.set_ylabel("change of |w|")
for axis in axes[-1]:
    axis.set_xlabel("post after pre (ms)")
axes.flat[len(RULES)].axis("off")
axes.flat[len(RULES)].legend(*axes.flat[0].get_legend_handles_labels(), loc="center")
figure.savefig("windows.png", dpi=80)
