"""SpiNNaker's kernels equal a twin written from the description of its traces, on random networks in registers."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.program.backend import OverflowWarning
from neuro.run.compiled import ApproximationWarning

INPUTS, CELLS, TICKS = 3, 4, 40


def cut(x: int) -> int:
    """To 32 bits, two's complement."""
    return (x + 2**31) % 2**32 - 2**31


def product(a: int, b: int) -> int:
    """s16.15, floor."""
    return (a * b) >> 15


class Twin:
    """Neurons as dictionaries of Python integers."""

    def __init__(self, registers, shifts, synapses):
        self.r, self.shifts, self.synapses = registers, shifts, synapses
        self.v = [r["v_init"] for r in registers]
        self.g = [[0, 0] for _ in registers]
        self.held = [0] * len(registers)
        self.ring: dict[tuple[int, int, int], int] = {}

    def run(self, inputs, ticks):
        rows = []
        for t in range(ticks):
            states = [self.tick(t, i) for i in range(len(self.r))]
            for kind, pre, post, add, delay in self.synapses:
                if pre in inputs.get(t, ()) if kind == "in" else states[pre][3]:
                    slot = (t + delay, post, int(add < 0))
                    self.ring[slot] = min(65535, self.ring.get(slot, 0) + abs(add))
            rows.append(list(zip(*states, strict=True)))
        return tuple(np.array(column) for column in zip(*rows, strict=True))

    def tick(self, t, i):
        r, g = self.r[i], self.g[i]
        for k, word in enumerate(("exc", "inh")):
            arrived = self.ring.get((t, i, k), 0) << self.shifts[k]
            g[k] = cut(g[k] + (arrived * r[f"{word}_init"] >> 32))
        used = tuple(g)
        if self.held[i] <= 0:
            alpha = cut(product(cut(g[0] - g[1] + r["i_offset"]), r["r_m"]) + r["v_rest"])
            self.v[i] = cut(alpha - product(r["exp_tc"], cut(alpha - self.v[i])))
        else:
            self.held[i] -= 1
        spike = self.v[i] >= r["v_thresh"]
        if spike:
            self.v[i], self.held[i] = r["v_reset"], r["t_refract"]
        for k, word in enumerate(("exc", "inh")):
            g[k] = cut((g[k] * r[f"{word}_decay"]) >> 32)
        return self.v[i], *used, spike


def edge(low: int, high: int):
    return st.one_of(st.integers(low, high), st.sampled_from([low, high]))


mV = 32768
FRACTION = 2**32 - 1
USUAL = {
    "v_rest": st.integers(-80 * mV, -60 * mV),
    "v_reset": st.integers(-80 * mV, -60 * mV),
    "v_thresh": st.integers(-58 * mV, -40 * mV),
    "v_init": st.integers(-80 * mV, -50 * mV),
    "i_offset": st.integers(-mV, 2 * mV),
    "r_m": st.integers(0, 60 * mV),
    "exp_tc": edge(0, 32768),
    "t_refract": st.one_of(st.just(0), st.integers(0, 30)),
}
WILD = {name: edge(-(2**31) + 1, 2**31 - 1) for name in ("v_rest", "v_reset", "v_thresh", "v_init", "i_offset")}
DECAYS = {f"{word}_{name}": edge(0, FRACTION) for word in ("exc", "inh") for name in ("decay", "init")}
REGISTERS = st.one_of(
    st.fixed_dictionaries(USUAL | DECAYS),
    st.fixed_dictionaries(USUAL | WILD | DECAYS | {"r_m": edge(0, 2**31 - 1)}),
)


@st.composite
def projections(draw, source, size):
    count = draw(st.integers(1, 8))
    ends = st.tuples(st.integers(0, size - 1), st.integers(0, CELLS - 1))
    pairs = draw(st.lists(ends, min_size=count, max_size=count))
    words = draw(st.lists(st.one_of(edge(-65535, 65535), st.integers(-9000, 9000)), min_size=count, max_size=count))
    delays = draw(st.lists(st.one_of(st.integers(1, 16), edge(1, 144)), min_size=count, max_size=count))
    return source, pairs, words, delays


PROJECTIONS = st.lists(
    st.sampled_from([("in", INPUTS), ("cells", CELLS)]).flatmap(lambda end: projections(*end)), min_size=1, max_size=4
)
SPIKES = st.lists(st.frozensets(st.integers(0, INPUTS - 1)), min_size=TICKS, max_size=TICKS)


def built(registers, shifts, wires, spikes):
    net = neuro.Network("random", resolution=1.0)
    times = [[t + 1.0 for t, fired in enumerate(spikes) if i in fired] for i in range(INPUTS)]
    net.population("in", INPUTS, neuro.spike_generator(spike_times=times))
    arrays = {key: np.array([r[key] for r in registers]) for key in registers[0]}
    net.population("cells", CELLS, neuro.spinnaker_lif(**arrays, exc_shift=shifts[0], inh_shift=shifts[1]))
    for n, (source, ends, words, delays) in enumerate(wires):
        pre, post = np.array(ends).T
        weight, delay = np.array(words, dtype=float), np.array(delays, dtype=float)
        net.connect(source, "cells", neuro.pairs(pre=pre, post=post), weight=weight, delay=delay, name=f"p{n}")
    for state in ("v", "g_exc", "g_inh"):
        net.probe(state, "cells", state)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        return neuro.compile(net, "spinnaker")


def same(registers, shifts, wires, spikes, ticks):
    synapses = [
        (source, pre, post, word, delay)
        for source, ends, words, delays in wires
        for (pre, post), word, delay in zip(ends, words, delays, strict=True)
    ]
    v, g_exc, g_inh, fired = Twin(registers, shifts, synapses).run(dict(enumerate(spikes)), ticks)
    sim = built(registers, shifts, wires, spikes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)
        sim.run(float(ticks))
    times, ids = sim.spikes("cells")
    found = np.zeros_like(fired)
    found[np.rint(times).astype(int) - 1, ids] = True
    for name, wanted in (("g_exc", g_exc), ("g_inh", g_inh), ("v", v)):
        np.testing.assert_array_equal(sim.trace(name)[1], wanted, err_msg=name)
    np.testing.assert_array_equal(found, fired)
    return sim, (v, g_exc, g_inh, fired)


@settings(max_examples=60, deadline=None)
@given(st.lists(REGISTERS, min_size=CELLS, max_size=CELLS), st.tuples(edge(0, 15), edge(0, 15)), PROJECTIONS, SPIKES)
def test_random_networks_equal_the_twin(registers, shifts, wires, spikes):
    same(registers, shifts, wires, spikes, TICKS)


QUIET = {"v_rest": 0, "v_reset": 0, "v_thresh": 2**31 - 1, "v_init": 0, "i_offset": 0, "r_m": mV, "exp_tc": 16384}
PLAIN = {**QUIET, "t_refract": 0, "exc_decay": 0, "exc_init": FRACTION, "inh_decay": 0, "inh_init": FRACTION}


@pytest.mark.parametrize(("sign", "name"), [(1, "g_exc"), (-1, "g_inh")])
def test_a_slot_saturates(sign, name):
    ends, words = [(0, 0), (1, 0), (2, 0)], [40000 * sign, 20000 * sign, 20000 * sign]
    sim, rows = same([PLAIN] * CELLS, (0, 0), [("in", ends, words, [1, 1, 1])], [frozenset({0, 1, 2})] * 3, 6)
    g = rows[{"g_exc": 1, "g_inh": 2}[name]]
    assert g.max() == (65535 * FRACTION) >> 32
    assert sim.counts().native["slot saturations of cells"] == 3


@pytest.mark.parametrize("delay", [1, 16, 17, 144])
def test_a_spike_lands_after_its_delay(delay):
    ends = [(0, 0)]
    _, rows = same([PLAIN] * CELLS, (0, 0), [("in", ends, [1000], [delay])], [frozenset({0})], 150)
    assert np.flatnonzero(rows[1][:, 0]).tolist() == [delay]


def test_the_threshold_is_reached_by_equality():
    held = {**PLAIN, "v_init": 500, "v_rest": 500, "v_thresh": 500}
    _, rows = same([held] * CELLS, (0, 0), [("in", [(0, 0)], [1], [1])], [frozenset()], 3)
    assert rows[3][0].all()
