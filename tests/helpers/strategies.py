"""Random small networks, for hypothesis: several populations, models, rules, synapses and delays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from built_in import INTEGRATED, NEURONS
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    Model,
    Neuron,
    dc_generator,
    iaf_psc_alpha,
    iaf_psc_delta,
    iaf_psc_exp,
    izhikevich,
    parrot_neuron,
    poisson_generator,
    spike_generator,
)
from neuro.model.parts import Population
from neuro.model.rules import (
    Rule,
    all_to_all,
    fixed_indegree,
    fixed_outdegree,
    one_to_one,
    pairs,
    pairwise_bernoulli,
)
from neuro.model.synapses import Synapse, static, stdp, stdp_dopa
from neuro.model.views import View
from neuro.testing.strategies import groups

_WEIGHT = {"iaf_psc_delta": 4.0, "izhikevich": 6.0, "parrot_neuron": 1.0}
_CURRENT = {"iaf_psc_delta": 500.0, "izhikevich": 8.0}


@st.composite
def networks(draw: st.DrawFn, largest: int = 12) -> Network:
    """A network of up to four populations of neurons, with sources of spikes and currents.

    Args:
        draw: given by hypothesis.
        largest: neurons of a population.
    """
    h = draw(st.sampled_from([0.1, 0.5, 1.0]))
    net = Network("random", resolution=h)
    _add_sources(draw, net, largest)
    sources = list(net.populations)
    for index in range(draw(st.integers(1, 4))):
        n = draw(st.integers(1, largest))
        net.population(f"cells{index}", n, draw(_neurons(n, h)))
    cells = [name for name in net.populations if name not in sources]
    for name in cells:
        if draw(st.booleans()):
            net.signal(f"signal_{name}", to=name)
    for name in sources:
        _connect(draw, net, name, draw(st.sampled_from(cells)), static())
    for _ in range(draw(st.integers(0, 5))):
        post = draw(st.sampled_from(cells))
        pre = draw(st.sampled_from(_partners(net, post)))
        _connect(draw, net, pre, post, draw(_synapses(net, post)))
    _add_group(draw, net, cells)
    seen = net.populations[draw(st.sampled_from(cells))]
    if seen.model.states:
        net.probe("seen", draw(views(seen)), "V_m", every=5 * h)
    return net


@st.composite
def views(draw: st.DrawFn, population: Population) -> View:
    """Some neurons of a row of them, or all."""
    n = len(population)
    if draw(st.booleans()):
        return population[draw(st.lists(st.integers(0, n - 1), min_size=1, unique=True))]
    first, last = sorted(draw(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1))))
    step = draw(st.integers(1, 3))
    return population[first : last + 1 : step] if draw(st.booleans()) else population[first : last + 1][::-step]


def _add_sources(draw: st.DrawFn, net: Network, largest: int) -> None:
    n, h = draw(st.integers(1, largest)), net.resolution
    rate = draw(st.one_of(st.floats(100.0, 2000.0), st.just(uniform(low=0.0, high=3000.0))))
    net.population("noise", n, poisson_generator(rate=rate))
    if draw(st.booleans()):
        steps = draw(st.lists(st.lists(st.integers(1, 60), max_size=8), min_size=1, max_size=3))
        times = [[step * h for step in sorted(row)] for row in steps]
        net.population("listed", len(times), spike_generator(spike_times=times))
    if draw(st.booleans()):
        window = {"start": draw(st.integers(0, 20)) * h, "stop": draw(st.integers(20, 200)) * h}
        net.population("current", draw(st.integers(1, 3)), dc_generator(amplitude=1.0, **window))


@st.composite
def _neurons(draw: st.DrawFn, n: int, h: float) -> Model:
    t_ref = draw(st.integers(0, 5)) * h
    tau_m = draw(st.sampled_from([5.0, 10.0, float("inf")]))
    tau_minus = draw(st.sampled_from([20.0, uniform(low=5.0, high=40.0)]))
    shared: dict[str, Any] = {"t_ref": t_ref, "tau_m": tau_m, "tau_minus": tau_minus}
    bias = draw(st.sampled_from([0.0, 150.0, uniform(low=0.0, high=500.0)]))
    match draw(st.integers(0, 4)):
        case 0:
            bound = draw(st.sampled_from([-80.0, -float("inf")]))
            return iaf_psc_delta(**shared, V_min=bound, I_e=bias, refractory_input=draw(st.booleans()))
        case 1:
            tau = draw(st.sampled_from([0.5, 2.0, 10.0]))
            return iaf_psc_exp(**shared, tau_syn_ex=tau, V_th=uniform(low=-58.0, high=-50.0), I_e=bias)
        case 2:
            return iaf_psc_alpha(**shared, tau_syn_in=draw(st.sampled_from([1.0, 10.0])), I_e=bias)
        case 3:
            return izhikevich(I_e=np.linspace(0.0, 12.0, n), tau_minus=tau_minus)
    return parrot_neuron()


@st.composite
def _synapses(draw: st.DrawFn, net: Network, post: str) -> Synapse:
    kind = draw(st.integers(0, 3))
    if kind == 1:
        mu = draw(st.sampled_from([0.0, 0.4, 1.0]))
        return stdp(lambda_=draw(st.floats(0.0, 0.3)), mu_plus=mu, mu_minus=mu, Wmax=8.0)
    if kind >= 2:
        source: dict[str, Any] = {}
        if f"signal_{post}" in net.signals and draw(st.booleans()):
            source = {"signal": f"signal_{post}"}
        elif draw(st.booleans()):
            late = draw(st.integers(1, 4)) * net.resolution
            spiking = [name for name in net.populations if name != "current"]
            source = {"dopamine": draw(st.sampled_from(spiking)), "dopamine_delay": late}
        b, grid = draw(st.sampled_from([0.0, 0.01] if source else [0.01])), draw(st.sampled_from([1, 7]))
        return stdp_dopa(A_plus=0.3, A_minus=0.2, tau_n=30.0, b=b, Wmax=8.0, deliver_interval=grid, **source)
    return static()


@st.composite
def _rules(draw: st.DrawFn, n_pre: int, n_post: int) -> Rule:
    autapses = draw(st.booleans())
    choices: list[Rule] = [all_to_all(autapses=autapses), pairwise_bernoulli(p=draw(st.floats(0.0, 1.0)))]
    choices += [fixed_indegree(n=draw(st.integers(1, 5))), fixed_outdegree(n=draw(st.integers(1, 5)))]
    ids = st.tuples(st.integers(0, n_pre - 1), st.integers(0, n_post - 1))
    listed = draw(st.lists(ids, max_size=12))
    choices.append(pairs(pre=[pre for pre, _ in listed], post=[post for _, post in listed]))
    if n_pre == n_post:
        choices.append(one_to_one())
    return draw(st.sampled_from(choices))


def _connect(draw: st.DrawFn, net: Network, pre: str, post: str, synapse: Synapse) -> None:
    model = net.populations[post].model
    if pre == "current" and not model.states:
        return
    whole = [net.populations[name] for name in (pre, post)]
    ends: list[Population | View] = [draw(st.one_of(st.just(end), views(end))) for end in whole]
    h = net.resolution
    delay: Any = draw(st.one_of(st.integers(1, 20).map(lambda k: k * h), st.just(uniform(low=h, high=15 * h))))
    unit = _WEIGHT.get(model.name, 400.0) if pre != "current" else _CURRENT.get(model.name, 300.0)
    drawn: Distribution = normal(mean=unit / 2, std=unit)
    weight: Any = draw(st.sampled_from([unit, -unit / 2, drawn, lognormal(mean=float(np.log(unit)), std=0.5)]))
    if synapse.learns:
        weight = draw(st.sampled_from([4.0, uniform(low=0.0, high=8.0)]))
    name = f"wires{len(net.projections)}"
    rule = draw(_rules(*map(len, ends)))
    net.connect(ends[0], ends[1], rule, synapse, weight=weight, delay=delay, name=name)


def _partners(net: Network, post: str) -> list[str]:
    """Populations whose spikes may reach another; parrots that hear each other would multiply spikes without end."""
    parrots = [name for name, part in net.populations.items() if part.model.name == "parrot_neuron"]
    excluded = ["current", *(parrots if post in parrots else [])]
    return [name for name in net.populations if name not in excluded]


def _add_group(draw: st.DrawFn, net: Network, cells: list[str]) -> None:
    able = [name for name in cells if net.populations[name].model.states]
    wanted = draw(st.booleans())
    if able and wanted:
        net.group("choice", draw(groups(net, able)))


SILENCE = 2000
"""Steps of the longest silence that is drawn."""

_SLOW = (0.3, 1.0, 7.0)
"""Factors of time constants."""


@st.composite
def quiet_networks(draw: st.DrawFn) -> Network:
    """A network of up to three populations of any neurons, whose only input are a few spikes long after each other.

    Neurons that are integrated step by step in plain Python come alone.
    """
    h = draw(st.sampled_from([0.1, 0.5, 1.0]))
    net = Network("quiet", resolution=h)
    silences = draw(st.lists(st.one_of(st.integers(1, 40), st.integers(17, SILENCE)), min_size=1, max_size=6))
    steps = [step for step in np.cumsum(silences).tolist() if step <= SILENCE]
    rows = [[step * h for step in steps if draw(st.integers(0, 3))] for _ in range(draw(st.integers(1, 3)))]
    net.population("listed", len(rows), spike_generator(spike_times=rows))
    quick = [model for model in NEURONS if model not in INTEGRATED]
    alone = draw(st.integers(0, 11)) == 0
    several = st.lists(st.sampled_from(quick), min_size=1, max_size=3)
    kinds = [draw(st.sampled_from(INTEGRATED))] if alone else draw(several)
    for index, kind in enumerate(kinds):
        name = f"cells{index}"
        net.population(name, 1 if alone else draw(st.integers(1, 4)), draw(_quiet_neurons(kind)))
        # Payloads are refused by relays, conductances and signs that choose a receptor.
        sources = [each for each, part in net.populations.items() if each != name and not part.model.graded]
        for source in dict.fromkeys(["listed", draw(st.sampled_from(sources))]):
            _connect_quietly(draw, net, source, name)
        for state in net.populations[name].model.states:
            if not state.hidden:
                net.probe(f"{state.name}_of_{name}", name, state.name, every=h)
    return net


@st.composite
def _quiet_neurons(draw: st.DrawFn, kind: type[Neuron]) -> Neuron:
    """A model with other time constants and a small constant current."""
    words: dict[str, Any] = {}
    for word, value in kind.defaults().items():
        if word.startswith("tau_") and isinstance(value, float) and value > 0.0:
            words[word] = value * draw(st.sampled_from(_SLOW))
        elif word in ("eta_sum", "refractory_input", "reset_by_subtraction"):
            words[word] = draw(st.booleans())
        elif word == "I_e":
            words[word] = draw(st.sampled_from([0.0, 0.0, 100.0, uniform(low=0.0, high=200.0)]))
        elif word == "tau_m" and kind.linear:
            words[word] = draw(st.sampled_from([value, math.inf]))
    return kind(**words)


def _connect_quietly(draw: st.DrawFn, net: Network, pre: str, post: str) -> None:
    model = net.populations[post].model
    assert isinstance(model, Neuron)
    names = model.named_receptors() if model.receptors > 2 or not model.signed else ("",)
    for name in names:
        weight = draw(st.sampled_from([1.0, 15.0, 80.0, 400.0, -30.0, uniform(low=0.0, high=300.0)]))
        if name in model.conductances and isinstance(weight, float):
            weight = abs(weight)
        synapse = static(receptor=name) if name else static()
        delay = draw(st.integers(1, 20)) * net.resolution
        rule = draw(st.sampled_from([all_to_all(), fixed_indegree(n=2)]))
        net.connect(pre, post, rule, synapse, weight=weight, delay=delay, name=f"{pre}_{post}_{name or 'all'}")
