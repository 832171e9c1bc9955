"""Experiments whose outcome is known beforehand, in closed form or from a paper: tests run them short, benchmarks long.

Each runs on backend `event` and gives what was measured; what is expected stands beside it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.model.distributions import Distribution
from neuro.model.network import Network
from neuro.model.neurons import (
    Neuron,
    iaf_psc_delta,
    iaf_psc_exp_adaptive_threshold,
    parrot_neuron,
    poisson_generator,
    spike_generator,
    srm0,
)
from neuro.model.rules import all_to_all, one_to_one
from neuro.model.synapses import Synapse, hedonistic, stdp, stdp_pl_hom, stdp_triplet, vogels_sprekeler
from neuro.run.compiled import compile
from neuro.run.simulation import Simulation

Floats = NDArray[np.float64]

TOLD = 2e12
"""mV, with which a neuron is made to fire."""


def deaf(**words: Any) -> iaf_psc_delta:
    """A neuron that fires when a spike of `TOLD` mV arrives, whatever other input it gets."""
    return iaf_psc_delta(tau_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=0.5 * TOLD, **words)


FIXED_POINTS: dict[str, tuple[Synapse, float]] = {
    "soft": (stdp(lambda_=0.01), 50.0),
    "van_Rossum": (stdp(lambda_=0.01, mu_plus=0.0, alpha=1.5), 100.0 / 1.5),
    "Guetig": (stdp(lambda_=0.01, mu_plus=0.4, mu_minus=0.4, alpha=1.2), 100.0 / (1.0 + 1.2**2.5)),
    "power_law": (stdp_pl_hom(lambda_=0.1, alpha=0.11), (1.0 / 0.11) ** (1.0 / 0.6)),
}
"""Rules, and the weight at which independent spikes hold them, for steps that are small."""


def independent(rate: float, post_rate: float, cells: int, h: float, **words: Any) -> Network:
    """Neurons `pre` and `post` of independent Poisson spikes, Hz, that rules can be tried between."""
    net = Network("drift", resolution=h)
    net.population("noise_pre", cells, poisson_generator(rate=rate))
    net.population("noise_post", cells, poisson_generator(rate=post_rate))
    net.population("pre", cells, parrot_neuron())
    net.population("post", cells, deaf(**words))
    net.connect("noise_pre", "pre", one_to_one(), delay=1.0)
    net.connect("noise_post", "post", one_to_one(), weight=TOLD, delay=1.0)
    return net


def drifted(
    rules: dict[str, tuple[Synapse, float]], settle: float, reads: int, h: float = 1.0, seed: int = 2, **words: Any
) -> dict[str, float]:
    """Mean weights under independent spikes of 20 Hz, from 0.8 of the fixed points.

    Args:
        rules: by name of a projection, each with its fixed point.
        settle: s before the first read.
        reads: how many, 1 s apart.
        h: the resolution, ms.
        seed: of the spikes.
        words: of the post neurons.
    """
    net = independent(20.0, 20.0, 45, h, **words)
    for name, (rule, point) in rules.items():
        net.connect("pre", "post", all_to_all(), rule, weight=0.8 * point, delay=1.0, name=name)
    sim = compile(net, seed=seed)
    sim.run(1000.0 * settle)
    read = []
    for _ in range(reads):
        sim.run(1000.0)
        read.append([sim.weights(name)[2].mean() for name in rules])
    return dict(zip(rules, np.mean(read, axis=0).tolist(), strict=True))


def drift_of_inhibition(post_rate: float, seconds: float, h: float, cells: int = 60, seed: int = 2) -> float:
    """What `vogels_sprekeler` adds to |w| in a second, for pre spikes of 20 Hz: 20 eta (2 tau post_rate - alpha)."""
    net = independent(20.0, post_rate, cells, h)
    net.connect("pre", "post", all_to_all(), vogels_sprekeler(), weight=-50.0, delay=1.0, name="learnt")
    sim = compile(net, seed=seed)
    sim.run(1000.0 * seconds)
    return float(-50.0 - sim.weights("learnt")[2].mean()) / seconds


def triplets(rates: Floats) -> Floats:
    """The change of w by 60 pairs of `stdp_triplet`, as Pfister & Gerstner fitted it to visual cortex.

    Args:
        rates: of the pairs, Hz.

    Returns:
        for a post spike 10 ms after the pre spike, and before it, shape (rates, 2).
    """
    n = 2 * len(rates)
    begin = 100.0 + np.round(1000.0 / rates)[:, None, None] * np.arange(60)
    pre = np.broadcast_to(begin, (len(rates), 2, 60)).reshape(n, 60)
    post = (begin + np.array([[10.0], [-10.0]])).reshape(n, 60)
    net = Network("triplets", resolution=1.0)
    end = float(pre.max()) + 2000.0
    closing = np.hstack((pre, np.full((n, 1), end)))  # a post spike acts when the next pre spike comes
    net.population("pre", n, spike_generator(spike_times=list(closing)))
    net.population("told", n, spike_generator(spike_times=list(post - 2.0)))
    net.population("post", n, deaf(tau_minus=33.7))
    net.connect("told", "post", one_to_one(), weight=TOLD, delay=1.0)
    net.connect("pre", "post", one_to_one(), stdp_triplet(), weight=1.0, delay=1.0, name="learnt")
    sim = compile(net)
    sim.run(end + 10.0)
    found: Floats = sim.weights("learnt")[2].reshape(-1, 2) - 1.0
    return found


def expected_triplets(rates: Floats) -> Floats:
    """What `triplets` are: sums over the traces of the rule, which are geometric series of the spikes before."""
    rule = stdp_triplet()
    period, k = np.round(1000.0 / rates)[:, None], np.arange(60)

    def trace(tau: float, late: Floats, before: int) -> Floats:
        """A trace of a side whose last spike was `late` ms ago, as the 60 spikes of the other side find it."""
        q, n = np.exp(-period / tau), k + 1 - before
        left: Floats = np.exp(-late / tau) * (1.0 - q**n) / (1.0 - q)
        return left

    def own(tau: float) -> Floats:
        """A trace of a side as its own spikes find it."""
        return trace(tau, period, before=1)

    ahead, behind = np.full_like(period, 10.0), period - 10.0
    found = []
    for to_post, to_pre, first in ((ahead, behind, 0), (behind, ahead, 1)):
        up = trace(rule.tau_plus, to_post, before=first) * (
            rule.Aplus + rule.Aplus_triplet * own(rule.tau_minus_triplet)
        )
        down = trace(33.7, to_pre, before=1 - first) * (rule.Aminus + rule.Aminus_triplet * own(rule.tau_plus_triplet))
        found.append((up - down).sum(axis=1))
    return np.stack(found, axis=1)


def settled(current: float, theta_plus: float = 0.05, tau_theta: float = 1e4) -> float:
    """The theta in mV at which the rate of a neuron keeps it: the root of theta = theta_plus tau_theta rate(theta)."""
    low, high = 0.0, current - 15.0
    for _ in range(200):
        theta = 0.5 * (low + high)
        interval = 5.0 + 100.0 * math.log(current / (current - 15.0 - theta))
        low, high = (theta, high) if theta < theta_plus * tau_theta / interval else (low, theta)
    return theta


def held_rate(current: float, seconds: float, theta_plus: float = 0.05, tau_theta: float = 1e4) -> float:
    """The rate in Hz at which `iaf_psc_exp_adaptive_threshold` settles, over the last third, from half of its theta."""
    words = {"tau_m": 100.0, "C_m": 100.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 15.0, "t_ref": 5.0, "I_e": current}
    model = iaf_psc_exp_adaptive_threshold(**words, theta_plus=theta_plus, tau_theta=tau_theta)
    sim = _alone(model, 1, 0.1, theta=0.5 * settled(current, theta_plus, tau_theta))
    sim.run(1000.0 * seconds)
    times = sim.spikes("cells")[0]
    late = times[times > 2000.0 * seconds / 3.0]
    return 1000.0 * (len(late) - 1) / float(late[-1] - late[0])


NOISY = srm0(E_L=-57.0, V_th=-55.0, eta_0=0.0, t_ref=0.0, lambda_0=60.0, Delta_V=2.0)
"""2 mV below threshold: 60 Hz / e = 0.02207 spikes a ms."""


def escapes(neurons: int, ms: float, h: float = 0.1) -> NDArray[np.int64]:
    """How often each of some neurons `NOISY` fires."""
    sim = _alone(NOISY, neurons, h, V_m=-57.0)
    sim.run(ms)
    return np.bincount(sim.spikes("cells")[1], minlength=neurons)


def _alone(model: Neuron, n: int, h: float, **initial: float | Distribution) -> Simulation:
    net = Network("alone", resolution=h)
    net.population("cells", n, model, initial=initial)
    return compile(net)


def expected_lesson(n: int, theta: int, p: float) -> float:
    """What `lessons` are in the mean: E[R c] = p (1 - p) C(n-1, theta-1) p^(theta-1) (1-p)^(n-theta)."""
    return p * (1.0 - p) * math.comb(n - 1, theta - 1) * p ** (theta - 1) * (1.0 - p) ** (n - theta)


def lessons(n: int, theta: int, p: float, neurons: int, seed: int = 3) -> Floats:
    """What `hedonistic` synapses learn by one spike of each, rewarded by 1 where at least theta release.

    Returns:
        means over the n synapses of each neuron, shape (neurons,).
    """
    net = Network("lesson", resolution=1.0)
    net.population("pre", n, spike_generator(spike_times=[[1.0]] * n))
    net.population("post", neurons, iaf_psc_delta())
    net.signal("reward", to="post")
    rule = hedonistic(signal="reward", q_0=math.log(p / (1.0 - p)), tau_c=1e9, eta=1.0)
    net.connect("pre", "post", all_to_all(), rule, weight=0.1, delay=1.0, name="w")
    sim = compile(net, seed=seed)
    sim.run(2.0)
    released = sim.get("w", "released").reshape(n, neurons).sum(axis=0)
    sim.signal("reward", (released >= theta).astype(float))
    sim.run(1.0)
    found: Floats = sim.get("w", "q").reshape(n, neurons).mean(axis=0)
    return found
