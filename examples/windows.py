"""What a pair of spikes changes by each rule, over the time between them, and what tsodyks2 sends: `windows.png`."""

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro.extend import DelayRule, Synapse

H = 0.5  # ms, the step
LAGS = np.arange(-79.5, 80.0, 1.0)  # of the post spike after the pre spike, when both have come to the synapse
WEIGHTS = (25.0, 50.0, 75.0)
FIRST, LAST = 500.0, 4000.0  # the pre spike of a pair, and the one by which a post spike before it shows
TRAIN = 10  # spikes, or pairs of them, at 20 Hz
RULES = {  # with the state of the synapse that is drawn
    "stdp, additive": (neuro.stdp(mu_plus=0.0, mu_minus=0.0), "weight"),
    "stdp, soft bounds": (neuro.stdp(), "weight"),
    "stdp, van Rossum": (neuro.stdp(mu_plus=0.0, mu_minus=1.0), "weight"),
    "stdp_literal": (neuro.stdp_literal(), "weight"),
    "stdp_pl_hom": (neuro.stdp_pl_hom(alpha=0.1), "weight"),
    "stdp_nn_symm": (neuro.stdp_nn_symm(), "weight"),
    "stdp_nn_pre_centered": (neuro.stdp_nn_pre_centered(), "weight"),
    "stdp_nn_restr": (neuro.stdp_nn_restr(), "weight"),
    "stdp_triplet": (neuro.stdp_triplet(), "weight"),
    "vogels_sprekeler": (neuro.vogels_sprekeler(), "weight"),
    "stdp_dopa: eligibility": (neuro.stdp_dopa(tau_c=1e9, signal="teacher"), "c"),
    "mstdpet: under a reward of 1": (neuro.mstdpet(signal="teacher"), "weight"),
    "td_ltp: under an error of 1": (neuro.td_ltp(signal="teacher"), "weight"),
    "stddp: delay": (neuro.stddp(), "delay"),
    "stddp, by_step: delay": (neuro.stddp(by_step=True), "delay"),
}
DRAWN = {"weight": "change of |w|", "c": "change of c", "delay": "change (ms)"}
RELEASES = {"depression": neuro.tsodyks2(), "facilitation": neuro.tsodyks2(U=0.1, tau_rec=100.0, tau_fac=1000.0)}


def changes(rule: Synapse, state: str, start: float, pairs: int, lags: np.ndarray) -> np.ndarray:
    """What each of so many pairs at 20 Hz does, for each lag; without what the last pre spike does alone."""
    size = lags.size + 1
    at = FIRST + 50.0 * np.arange(pairs)
    pre = [*([*at, LAST] for _ in lags), [LAST]]
    # Rules of weights count the delay as the dendrite's, which the post spike takes; those of delays as the axon's.
    delay, later = (10.0, 10.0) if isinstance(rule, DelayRule) else (H, -H)
    post = [*((at + lag + later - H).tolist() for lag in lags), []]
    net = neuro.Network("pairs", resolution=H)
    net.population("pre", size, neuro.spike_generator(spike_times=pre))
    net.population("drive", size, neuro.spike_generator(spike_times=post))
    net.population("post", size, neuro.iaf_psc_delta(V_th=1e6, t_ref=0.0))
    net.connect("drive", "post", neuro.one_to_one(), weight=1e8, delay=H)
    net.connect("pre", "post", neuro.one_to_one(), rule, weight=start, delay=delay, name="learnt")
    if rule.modulated:
        net.signal("teacher", to="post")
    sim = neuro.compile(net)
    if rule.modulated and state == "weight":
        sim.signal("teacher", 1.0)
    before = sim.get("learnt", state)
    # An eligibility has changed at once; a weight shows it when the next pre spike has been sent.
    sim.run(LAST - H if state == "c" else LAST + H)
    moved = sim.get("learnt", state) - before
    return (moved[:-1] - moved[-1]) / pairs


def window(axis: plt.Axes, rule: Synapse, state: str) -> np.ndarray:
    """Draw the changes by a pair at three weights and, of weights, by a train; return those at the last weight."""
    sides = (LAGS < 0.0, LAGS > 0.0)
    sign = np.sign(getattr(rule, "Wmax", 1.0))
    for shade, weight in zip(("C9", "C0", "k"), WEIGHTS, strict=True):
        lone = sign * changes(rule, state, sign * weight, 1, LAGS)
        for side in sides:
            axis.plot(LAGS[side], lone[side], color=shade, label=f"w = {weight:g}" if side[0] else "")
    if state != "delay":
        train = sign * changes(rule, state, sign * WEIGHTS[1], TRAIN, LAGS)
        for side in sides:
            near = side & (np.abs(LAGS) < 25.0)
            label = f"each of {TRAIN} at 20 Hz, w = {WEIGHTS[1]:g}" if side[0] else ""
            axis.plot(LAGS[near], train[near], "--", color="C3", label=label)
    axis.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axis.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axis.set(xlabel="post after pre (ms)", ylabel=DRAWN[state])
    return lone


def released(rule: Synapse, times: np.ndarray) -> np.ndarray:
    """The share of the weight that each spike sends."""
    net = neuro.Network("train", resolution=H)
    net.population("pre", 1, neuro.spike_generator(spike_times=[times]))
    net.population("post", 1, neuro.iaf_psc_delta())
    net.connect("pre", "post", neuro.one_to_one(), rule, weight=1.0, delay=H, name="sent")
    sim = neuro.compile(net)
    shares = []
    for time in times:
        sim.run(time + H - sim.time)
        shares.append((sim.get("sent", "u") * sim.get("sent", "x"))[0])
    return np.array(shares)


figure, axes = plt.subplots(4, 4, figsize=(13, 10), layout="constrained")
for axis, (name, (rule, state)) in zip(axes.flat, RULES.items(), strict=False):
    found = window(axis, rule, state)
    axis.set_title(name)
    print(f"{name}: a pair changes {WEIGHTS[-1]:g} by {found.min():.4g} to {found.max():.4g}")
times = np.array([*(50.0 * np.arange(1, TRAIN + 1)), 1000.0])
for name, rule in RELEASES.items():
    shares = released(rule, times)
    axes.flat[-1].plot(times, shares, "o", markersize=4, label=name)
    print(f"tsodyks2, {name}: the spikes send {np.array2string(shares, precision=3)}")
axes.flat[-1].set(title="tsodyks2: spikes send", xlabel="time (ms)", ylabel="share of w", ylim=(0.0, 0.75))
axes.flat[-1].legend(fontsize=8, loc="upper right")
figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
figure.savefig("windows.png", dpi=80)
