"""Loihi's kernels equal a twin written from the chip's description, on random networks in registers."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.program.backend import OverflowWarning
from neuro.run.compiled import ApproximationWarning

MODES = {"mixed": (-256, 254), "excitatory": (0, 255), "inhibitory": (-255, 0)}
INPUTS, CELLS, STEPS = 3, 4, 70


def word(m: int, exponent: int, bits: int, mode: str) -> int:
    """What a spike adds to u: the lowest bits of |m| are dropped, m is shifted (floor), then x 64 and clipped."""
    lost = 8 - bits + (mode == "mixed")
    kept = (abs(m) >> lost) << lost
    kept = kept if m >= 0 else -kept
    shifted = kept * 2**exponent if exponent >= 0 else kept // 2**-exponent
    return max(-(2**21) + 64, min(2**21 - 64, shifted * 64))


def decayed(x: int, keep: int) -> int:
    """x keep / 4096, cut towards 0."""
    return (1 if x >= 0 else -1) * ((abs(x) * keep) >> 12)


def wrapped(x: int, bits: int) -> int:
    """x as a two's complement of so many bits."""
    return (x + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)


class Twin:
    """Compartments as dictionaries of Python integers, which cannot overflow."""

    def __init__(self, registers: list[dict[str, int]], synapses: list[tuple[str, int, int, int, int]]):
        self.r, self.synapses = registers, synapses
        self.u, self.v, self.held = ([0] * len(registers) for _ in range(3))
        self.due: dict[int, list[tuple[int, int]]] = {}

    def run(self, inputs: dict[int, set[int]], steps: int):
        """States and spikes of steps 0..; `inputs` are the sources that spike in each step."""
        rows = []
        for k in range(steps):
            fired = [self.step(k, i) for i in range(len(self.r))]
            for kind, pre, post, add, delay in self.synapses:
                if pre in inputs.get(k, ()) if kind == "in" else fired[pre]:
                    self.due.setdefault(k + 1 + delay, []).append((post, add))
            rows.append((list(self.u), list(self.v), fired))
        return tuple(np.array(column) for column in zip(*rows, strict=True))

    def step(self, k: int, i: int) -> bool:
        r = self.r[i]
        arrived = wrapped(sum(add for post, add in self.due.get(k, ()) if post == i), 22)
        self.u[i] = wrapped(decayed(self.u[i], 4096 - (r["du"] + 1)) + arrived, 24)
        drive = wrapped(self.u[i] + r["bias_mant"] * 2 ** r["bias_exp"], 24)
        v = decayed(self.v[i], 4096 - r["dv"]) + drive
        v = max(-(2**23) + 1, min(2**23 - 1, v))
        if self.held[i]:
            self.held[i], v = self.held[i] - 1, 0
        spike = v > r["vth"] * 64
        self.v[i] = 0 if spike else v
        if spike:
            self.held[i] = r["refractory"] - 1
        return spike


def edge(low: int, high: int):
    """Whole numbers in which both ends are common."""
    return st.one_of(st.integers(low, high), st.sampled_from([low, high]))


REGISTERS = st.fixed_dictionaries(
    {
        "du": edge(0, 4095),
        "dv": edge(0, 4095),
        "vth": st.one_of(edge(0, 131071), st.integers(0, 3000)),
        "bias_mant": st.one_of(st.just(0), edge(-4096, 4095)),
        "bias_exp": edge(0, 7),
        "refractory": st.one_of(st.just(1), edge(1, 64)),
    }
)


@st.composite
def projections(draw, source: str, size: int):
    mode, bits, exponent = draw(st.sampled_from([*MODES])), draw(edge(1, 8)), draw(edge(-8, 7))
    count = draw(st.integers(1, 8))
    ends = st.tuples(st.integers(0, size - 1), st.integers(0, CELLS - 1))
    pairs = draw(st.lists(ends, min_size=count, max_size=count))
    mantissas = draw(st.lists(edge(*MODES[mode]), min_size=count, max_size=count))
    delays = draw(st.lists(edge(0, 62), min_size=count, max_size=count))
    if draw(st.booleans()):  # one for all, which takes other ways through the kernels
        mantissas, delays = mantissas[:1] * count, delays[:1] * count
    return source, mode, bits, exponent, pairs, mantissas, delays


PROJECTIONS = st.lists(
    st.sampled_from([("in", INPUTS), ("cells", CELLS)]).flatmap(lambda end: projections(*end)), min_size=1, max_size=4
)
SPIKES = st.lists(st.frozensets(st.integers(0, INPUTS - 1)), min_size=STEPS, max_size=STEPS)


def built(registers, wires, spikes, name="loihi"):
    """The same network by the public interface."""
    net = neuro.Network("random", resolution=1.0)
    times = [[k + 1.0 for k, fired in enumerate(spikes) if i in fired] for i in range(INPUTS)]
    net.population("in", INPUTS, neuro.spike_generator(spike_times=times))
    arrays = {key: np.array([r[key] for r in registers]) for key in registers[0]}
    net.population("cells", CELLS, neuro.loihi_lif(**arrays))
    for n, (source, mode, bits, exponent, ends, mantissas, delays) in enumerate(wires):
        pre, post = np.array(ends).T
        synapse = neuro.loihi_static(weight_exp=exponent, num_weight_bits=bits, sign_mode=mode)
        same = len({*mantissas}) == 1, len({*delays}) == 1
        net.connect(
            source,
            "cells",
            neuro.pairs(pre=pre, post=post),
            synapse,
            weight=float(mantissas[0]) if same[0] else np.array(mantissas, dtype=float),
            delay=delays[0] + 1.0 if same[1] else np.array(delays) + 1.0,
            name=f"p{n}",
        )
    for state in "uv":
        net.probe(state, "cells", state)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        return neuro.compile(net, name)


def same(sim, rows, steps):
    """Demand equal registers and spikes; an overflow is allowed, and is the twin's, too."""
    u, v, fired = rows
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)
        sim.run(float(steps))
    times, ids = sim.spikes("cells")
    found = np.zeros_like(fired)
    found[np.rint(times).astype(int) - 1, ids] = True
    np.testing.assert_array_equal(sim.trace("u")[1], u)
    np.testing.assert_array_equal(sim.trace("v")[1], v)
    np.testing.assert_array_equal(found, fired)


@settings(max_examples=60, deadline=None)
@given(st.lists(REGISTERS, min_size=CELLS, max_size=CELLS), PROJECTIONS, SPIKES)
def test_random_networks_equal_the_twin(registers, wires, spikes):
    synapses = [
        (source, pre, post, word(m, exponent, bits, mode), delay)
        for source, mode, bits, exponent, ends, mantissas, delays in wires
        for (pre, post), m, delay in zip(ends, mantissas, delays, strict=True)
    ]
    rows = Twin(registers, synapses).run(dict(enumerate(spikes)), STEPS)
    same(built(registers, wires, spikes), rows, STEPS)


def driven(mantissa: int, exponent: int, steps: int, **registers):
    """Four compartments driven by one input in every step."""
    told = {"du": 0, "dv": 4095, "vth": 131071, "bias_mant": 0, "bias_exp": 0, "refractory": 1} | registers
    mode = "mixed" if mantissa < 0 else "excitatory"
    wires = [("in", mode, 8, exponent, [(0, 0)], [mantissa], [0])]
    spikes = [frozenset([0])] * steps
    synapses = [("in", 0, 0, word(mantissa, exponent, 8, mode), 0)]
    rows = Twin([told] * CELLS, synapses).run(dict(enumerate(spikes)), steps)
    sim = built([told] * CELLS, wires, spikes)
    same(sim, rows, steps)
    return rows, sim


@pytest.mark.parametrize("mantissa", [255, -256])
def test_u_wraps(mantissa):
    (u, _, _), sim = driven(mantissa, 7, 12)
    assert (np.sign(u[4:, 0]) == -np.sign(mantissa)).any()
    assert sim.counts().native["current wraps of cells"] > 0


def test_v_is_clipped_below():
    (_, v, _), sim = driven(-200, 5, 40, dv=0)
    assert v.min() == -(2**23) + 1
    assert sim.counts().native["voltage clips of cells"] > 0


def test_the_threshold_is_strict():
    (_, v, fired), _ = driven(100, 0, 2, du=4095, dv=4095, vth=100)
    assert v[1, 0] == 6400
    assert not fired.any()
    (_, v, fired), _ = driven(100, 0, 2, du=4095, dv=4095, vth=100, bias_mant=1)
    assert fired[1].tolist() == [True, False, False, False]


def test_a_refractory_register_of_64_holds_v_for_63_steps():
    (_, v, fired), _ = driven(255, 0, 140, du=4095, dv=4095, vth=10, refractory=64)
    assert np.flatnonzero(fired[:, 0]).tolist() == [1, 65, 129]
    assert not v[2:65, 0].any()


def test_the_largest_delay_register():
    net = neuro.Network("late", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("cells", 1, neuro.loihi_lif(vth=131071))
    net.connect("in", "cells", neuro.one_to_one(), neuro.loihi_static(), weight=2.0, delay=63.0)
    net.probe("u", "cells", "u")
    sim = neuro.compile(net, "loihi")
    sim.run(70.0)
    assert np.flatnonzero(sim.trace("u")[1][:, 0])[0] == 0 + 1 + 62
