"""Networks for benchmarks. The scripts of NEST and Brian2 in `peers/` also have `NETWORKS` and `loop`.

`feedforward` and `recurrent` are for chip emulators, with values in registers. `peers/chip_networks.py` has them, too.
"""

from __future__ import annotations

import numpy as np
from peers import chip_networks

import neuro


def brunel(neurons: int = 10_000) -> neuro.Network:
    """Return model A of Brunel 2000 at g = 5, eta = 2, with 10,000 neurons and 10 million static synapses.

    Larger networks have 1000 synapses per neuron.
    """
    return _balanced("brunel", inputs=(800, 200), weight=0.1, excitatory=neuro.static(), neurons=neurons)


def stdp() -> neuro.Network:
    """Return the neurons of `brunel` with a tenth of the synapses, of which 640,000 learn by additive STDP."""
    rule = neuro.stdp(Wmax=1.0, lambda_=0.01, alpha=1.1, mu_plus=0.0, mu_minus=0.0, tau_plus=20.0)
    return _balanced("stdp", inputs=(80, 20), weight=0.5, excitatory=rule)


def triplets() -> neuro.Network:
    """Return the network of `stdp` with `stdp_triplet`. Its slow traces add nothing, so the spikes are the same."""
    rule = neuro.stdp_triplet(
        Wmax=1.0, tau_plus=20.0, Aplus=0.01, Aplus_triplet=0.0, Aminus=0.011, Aminus_triplet=0.0
    )  # fmt: skip
    return _balanced("triplets", inputs=(80, 20), weight=0.5, excitatory=rule)


def driven(model: neuro.Model, weight: float) -> neuro.Network:
    """Return 10,000 neurons of a model, each with its own noise of 2 kHz."""
    net = neuro.Network("driven", resolution=0.1)
    net.population("noise", 10_000, neuro.poisson_generator(rate=2000.0))
    net.population("cells", 10_000, model)
    net.connect("noise", "cells", neuro.one_to_one(), weight=weight, delay=1.0)
    return net


def _balanced(
    name: str, inputs: tuple[int, int], weight: float, excitatory: neuro.Synapse, neurons: int = 10_000
) -> neuro.Network:
    """Return a network with four excitatory neurons for each inhibitory neuron, at twice the threshold rate.

    `excitatory` is the synapse among excitatory neurons.
    """
    net = neuro.Network(name, resolution=0.1)
    cell = neuro.iaf_psc_delta(C_m=1.0, tau_m=20.0, t_ref=2.0, E_L=0.0, V_reset=0.0, V_th=20.0, tau_minus=20.0)
    noise = neuro.poisson_generator(rate=2.0 * 20.0 / (weight * 20.0) * 1000.0)
    for kind, size in (("exc", neurons - neurons // 5), ("inh", neurons // 5)):
        net.population(kind, size, cell)
        net.population(f"noise_{kind}", size, noise)
        net.connect(f"noise_{kind}", kind, neuro.one_to_one(), weight=weight, delay=1.5)
    for source, target, count, strength, synapse in (
        ("exc", "exc", inputs[0], weight, excitatory),
        ("exc", "inh", inputs[0], weight, neuro.static()),
        ("inh", "exc", inputs[1], -5.0 * weight, neuro.static()),
        ("inh", "inh", inputs[1], -5.0 * weight, neuro.static()),
    ):
        net.connect(source, target, neuro.fixed_indegree(count), synapse, weight=strength, delay=1.5)
    return net


def cuba() -> neuro.Network:
    """Return the CUBA benchmark (Brette et al. 2007; Vogels & Abbott 2005): 4,000 neurons, 2 % connected."""
    net = neuro.Network("cuba", resolution=0.1)
    cell = neuro.iaf_psc_exp(
        C_m=200.0, tau_m=20.0, tau_syn_ex=5.0, tau_syn_in=10.0, t_ref=5.0, E_L=-49.0, V_reset=-60.0, V_th=-50.0
    )
    v = np.random.default_rng(1).uniform(-60.0, -50.0, 4000)
    net.population("exc", 3200, cell, initial={"V_m": v[:3200]})
    net.population("inh", 800, cell, initial={"V_m": v[3200:]})
    for source, weight in (("exc", 16.2), ("inh", -90.0)):
        for target in ("exc", "inh"):
            net.connect(source, target, neuro.pairwise_bernoulli(0.02), weight=weight, delay=0.1)
    return net


def many_projections(rate: float, populations: int = 100, size: int = 100) -> neuro.Network:
    """Return populations that are all connected with each other, with drawn delays. Each neuron fires at `rate` Hz."""
    net = neuro.Network("many_projections", resolution=0.1)
    delay = neuro.normal(mean=1.5, std=0.75, low=0.05)
    names = [f"cells{k}" for k in range(populations)]
    for name in names:
        net.population(name, size, neuro.iaf_psc_exp())
        if rate:
            net.population(f"noise_{name}", size, neuro.poisson_generator(rate=rate))
            net.connect(f"noise_{name}", name, neuro.one_to_one(), weight=3000.0, delay=1.5)
    for target in names:
        for source in names:
            net.connect(source, target, neuro.fixed_indegree(10), weight=0.01, delay=delay)
    return net


def loop(resolution: float = 0.1) -> neuro.Network:
    """Return a closed loop: 64 Poisson generators -> 64 parrots -> 4 neurons, with 256 `stdp_dopa` synapses.

    Rates and dopamine come from outside.
    """
    net = neuro.Network("loop", resolution=resolution)
    noise = net.population("noise", 64, neuro.poisson_generator())
    parrots = net.population("parrots", 64, neuro.parrot_neuron())
    out = net.population("out", 4, neuro.iaf_psc_exp(tau_minus=20.0))
    net.signal("reward", to=out)
    rule = neuro.stdp_dopa(
        A_plus=0.5, A_minus=0.6, tau_c=200.0, tau_n=50.0, Wmax=300.0, deliver_interval=10, signal="reward"
    )
    net.connect(noise, parrots, neuro.one_to_one(), delay=resolution)
    net.connect(parrots, out, neuro.all_to_all(), rule, weight=120.0, delay=1.0, name="learnt")
    return net


def learning(plastic: bool) -> neuro.Network:
    """Return 100,000 synapses between 1,000 and 1,000 neurons at 20 Hz. If `plastic`, they learn.

    The synapses are too weak to change the spikes.
    """
    net = neuro.Network("learning", resolution=0.1)
    pre = net.population("pre", 1000, neuro.parrot_neuron())
    post = net.population("post", 1000, neuro.iaf_psc_delta(C_m=1.0, t_ref=0.1, E_L=0.0, V_reset=0.0, V_th=20.0))
    for target in (pre, post):
        noise = net.population(f"noise_{target.name}", 1000, neuro.poisson_generator(rate=20.0))
        net.connect(noise, target, neuro.one_to_one(), weight=100.0, delay=1.0)
    rule = neuro.stdp(Wmax=1e-12, mu_plus=0.0, mu_minus=0.0) if plastic else neuro.static()
    net.connect(pre, post, neuro.fixed_indegree(100), rule, weight=neuro.uniform(low=0.0, high=1e-12), delay=1.0)
    return net


def silent(where: str, active: int = 1000, times: int = 100) -> neuro.Network:
    """Return busy neurons, and `times` as many silent neurons without input.

    Args:
        where: place of the silent neurons: "nowhere" (there are none), "beside" (after the busy neurons in their
            population), "between" (`times` silent neurons around each busy neuron) or "elsewhere" (in another
            population).
        active: number of busy neurons.
        times: number of silent neurons for each busy neuron.
    """
    net = neuro.Network(f"silent {where}".replace(" ", "_"), resolution=0.1)
    cell = neuro.iaf_psc_exp()
    inside = where in ("beside", "between")
    net.population("noise", active, neuro.poisson_generator(rate=1000.0))
    net.population("cells", active * (times + 1) if inside else active, cell)
    if where == "elsewhere":
        net.population("others", active * times, cell)
    busy = np.arange(active) * (times + 1 if where == "between" else 1)
    for shift in range(10):
        post = np.roll(busy, shift)
        net.connect(
            "noise", "cells", neuro.pairs(np.arange(active), post), weight=60.0, delay=1.0, name=f"drive{shift}"
        )
    return net


def digits() -> neuro.Network:
    """Return a shared-kernel layer for object recognition, which decides by its first spike and learns by reward."""
    net = neuro.Network("digits", resolution=1.0)
    net.population("c1", (4, 17, 17), neuro.spike_generator())
    cell = neuro.iaf_psc_delta(tau_m=float("inf"), E_L=0.0, V_reset=0.0, V_th=30.0)
    net.population("s2", (20, "auto", "auto"), cell)
    weight = neuro.normal(mean=0.8, std=0.05)
    net.connect("c1", "s2", neuro.grid((11, 11)), neuro.r_stdp(), weight=weight, delay=1.0)
    net.group("choice", neuro.winner_take_all(of="s2"))
    net.trials(
        input="c1",
        duration=64.0,
        labels=neuro.labels(of="s2", maps_per_label=2),
        reward=neuro.reward(),
        dropout=neuro.dropout(of="s2", p=0.25),
    )
    return net


def feed_forward(model: type[neuro.Model] = neuro.iaf_psc_exp) -> neuro.Network:
    """Return dense layers of 2312 inputs, 128 and 10 neurons, with weights of both signs.

    A recording has 310 ticks.
    """
    net, rng = neuro.Network("feed_forward", resolution=1.0), np.random.default_rng(0)
    cell = model(tau_m=20.0, t_ref=1.0, E_L=0.0, V_reset=0.0, V_th=15.0)
    unit = 12.0 if model is neuro.iaf_psc_exp else 0.4  # pA, mV
    net.population("input", 2312, neuro.spike_generator())
    net.population("hidden", 128, cell)
    net.population("out", 10, cell)
    weight = rng.normal(0.1 * unit, unit, 2312 * 128)
    net.connect("input", "hidden", neuro.all_to_all(), weight=weight, delay=1.0)
    net.connect("hidden", "out", neuro.all_to_all(), weight=rng.normal(0.2 * unit, 2.0 * unit, 1280), delay=1.0)
    net.group("choice", neuro.winner_take_all(of="out", first_to_fire=True))
    net.trials(input="input", duration=310.0, stop="full", labels={"of": "out"})
    return net


def feedforward(n: int = 1000) -> neuro.Network:
    """Return n sources that fire in 5 % of the steps, connected with n neurons all to all."""
    layer = chip_networks.FEEDFORWARD
    net = neuro.Network("feedforward", resolution=1.0)
    net.population("sources", n, neuro.spike_generator())
    net.population("cells", n, neuro.loihi_lif(du=layer.du, dv=layer.dv, vth=layer.vth))
    weights = chip_networks.feedforward(n).astype(float)
    net.connect("sources", "cells", neuro.all_to_all(), neuro.loihi_static(), weight=weights, delay=1.0)
    return net


def sources(n: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and neurons of the input spikes of `feedforward`."""
    rows, ids = chip_networks.fired(steps, n)
    return rows + 1.0, ids


def recurrent(n: int = 10_240, fan_in: int = 100) -> neuro.Network:
    """Return neurons with a bias for ten cores. Each has `fan_in` inputs, and four of five neurons are excitatory."""
    layer = chip_networks.RECURRENT
    pre, post, weights, bias = chip_networks.recurrent(n, fan_in)
    net = neuro.Network("recurrent", resolution=1.0)
    cell = neuro.loihi_lif(du=layer.du, dv=layer.dv, vth=layer.vth, bias_mant=bias.astype(float))
    net.population("cells", n, cell)
    synapses = {"weight": weights.astype(float), "delay": 1.0}
    net.connect("cells", "cells", neuro.pairs(pre, post), neuro.loihi_static(), **synapses)
    return net


NETWORKS = {"brunel": brunel, "cuba": cuba, "stdp": stdp}
CHIP_NETWORKS = {"ff": feedforward, "rec": recurrent}
