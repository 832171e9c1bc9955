"""Strategies of hypothesis for small networks whose values are exact in floats and in integers, to test backends.

Weights, thresholds and currents are whole numbers of mV, no neuron leaks, and a source neuron spikes at most once in a
step. Requires the package hypothesis.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from neuro.model.distributions import uniform
from neuro.model.network import Network
from neuro.model.neurons import (
    parrot_neuron,
    spike_generator,
)
from neuro.model.parts import lateral_reset, winner_take_all
from neuro.model.rules import (
    Rule,
    all_to_all,
    fixed_indegree,
    fixed_outdegree,
    grid,
    one_to_one,
    pairs,
)
from neuro.testing.exact import cell

LONGEST = 60
"""Longest delay, steps."""


@st.composite
def exact_networks(draw: st.DrawFn, largest: int = 7) -> Network:
    """Draw a network of up to three populations with listed spikes, and sometimes parrots, a grid or a group.

    Args:
        draw: function that hypothesis provides.
        largest: largest number of neurons of a population.
    """
    net = Network("random", resolution=draw(st.sampled_from([0.1, 0.5, 1.0])))
    n = draw(st.integers(1, largest))
    net.population("source", n, spike_generator(spike_times=draw(_times(n, net.resolution))))
    if draw(st.booleans()):
        net.population("parrots", n, parrot_neuron())
        net.connect("source", "parrots", one_to_one(), delay=draw(_delay(net, n)), name="copied")
    sources = list(net.populations)
    cells = [f"cells{k}" for k in range(draw(st.integers(1, 3)))]
    for name in cells:
        n = draw(st.integers(1, largest))
        net.population(name, n, draw(_cells(net, draw(st.sampled_from([1, n])))))
    for name in cells:
        _connect_whole(draw, net, draw(st.sampled_from(sources)), name)
    for _ in range(draw(st.integers(0, 5))):
        _connect_whole(draw, net, draw(st.sampled_from([*sources, *cells])), draw(st.sampled_from(cells)))
    if draw(st.booleans()):
        _add_grid(draw, net)
    if draw(st.booleans()):
        net.group("choice", draw(groups(net, [*cells, *(["maps"] if "maps" in net.populations else [])])))
    return net


def groups(net: Network, names: list[str]) -> st.SearchStrategy[Any]:
    """Return a strategy for a group of any kind in one of the named populations."""
    axes = [(name, axis) for name in names for axis in range(len(net.populations[name].shape))]
    return st.one_of(
        st.builds(winner_take_all, of=st.sampled_from(names), first_to_fire=st.booleans()),
        st.sampled_from(axes).map(lambda pair: lateral_reset(of=pair[0], axis=pair[1])),
    )


@st.composite
def _times(draw: st.DrawFn, n: int, h: float) -> list[list[float]]:
    steps = [draw(st.sets(st.integers(1, 80), max_size=30)) for _ in range(n)]
    return [[step * h for step in sorted(row)] for row in steps]


@st.composite
def _cells(draw: st.DrawFn, net: Network, n: int = 1) -> Any:
    rest = draw(st.sampled_from([0.0, -70.0]))
    vth = rest + np.array([draw(st.integers(3, 12)) for _ in range(n)], dtype=np.float64)
    t_ref = draw(st.integers(0, 5)) * net.resolution
    return cell(V_th=vth if n > 1 else float(vth[0]), E_L=rest, V_reset=rest, C_m=net.resolution, t_ref=t_ref)


def _delay(net: Network, size: int) -> st.SearchStrategy[Any]:
    """Return a strategy for one delay, or a delay for each synapse."""
    h = net.resolution
    delay = st.integers(1, LONGEST)
    delays = st.lists(delay, min_size=size, max_size=size)
    return st.one_of(delay.map(lambda k: k * h), delays.map(lambda ks: np.array(ks) * h))


def _weight(size: int) -> st.SearchStrategy[Any]:
    """Return a strategy for one weight, or a weight for each synapse; most weights are excitatory."""
    weights = st.lists(st.integers(-1, 4), min_size=size, max_size=size)
    return st.one_of(
        st.integers(1, 5).map(float), st.just(-1.0), weights.map(lambda ws: np.array(ws, dtype=np.float64))
    )


def _connect_whole(draw: st.DrawFn, net: Network, pre: str, post: str) -> None:
    n_pre, n_post = (int(net.populations[name].shape[0]) for name in (pre, post))
    ids = st.tuples(st.integers(0, n_pre - 1), st.integers(0, n_post - 1))
    edges = draw(st.lists(ids, min_size=1, max_size=12))
    rules: list[tuple[Rule, int]] = [
        (all_to_all(), n_pre * n_post),
        (pairs(pre=[i for i, _ in edges], post=[j for _, j in edges]), len(edges)),
        (fixed_indegree(n=draw(st.integers(1, 4))), 0),
        (fixed_outdegree(n=draw(st.integers(1, 4))), 0),
    ]
    if n_pre == n_post:
        rules.append((one_to_one(), n_pre))
    rule, size = draw(st.sampled_from(rules))
    if size:
        weight, delay = draw(_weight(size)), draw(_delay(net, size))
        if isinstance(rule, all_to_all):
            weight, delay = (np.reshape(v, (n_pre, n_post)) if np.size(v) > 1 else v for v in (weight, delay))
    else:
        h = net.resolution
        weight = draw(st.sampled_from([1.0, 2.0, 4.0, -1.0]))
        delay = draw(st.one_of(st.integers(1, LONGEST).map(lambda k: k * h), st.just(uniform(low=h, high=9 * h))))
    net.connect(pre, post, rule, weight=weight, delay=delay, name=f"wires{len(net.projections)}")


def _add_grid(draw: st.DrawFn, net: Network) -> None:
    """Add a sheet with listed spikes, and maps with a shared kernel."""
    channels, height, width = draw(st.integers(1, 2)), draw(st.integers(3, 5)), draw(st.integers(3, 5))
    n, h = channels * height * width, net.resolution
    fired = np.random.default_rng(draw(st.integers(0, 99))).random((n, 60)) < 0.05
    times = [((np.flatnonzero(row) + 1) * h).tolist() for row in fired]
    net.population("sheet", (channels, height, width), spike_generator(spike_times=times))
    net.population("maps", (2, "auto", "auto"), draw(_cells(net)))
    size = (draw(st.integers(1, 3)), draw(st.integers(1, 3)))
    padding = draw(st.one_of(st.integers(0, min(size) - 1), st.just("same")))
    rule = grid(kernel=size, stride=draw(st.integers(1, 2)), padding=padding, depthwise=draw(st.booleans()))
    shape = (2, 1 if rule.depthwise else channels, *size)
    weight = draw(_weight(math.prod(shape)))
    shaped = np.reshape(weight, shape) if np.size(weight) > 1 else weight
    net.connect("sheet", "maps", rule, weight=shaped, delay=draw(st.integers(1, LONGEST)) * h, name="kernels")
