"""The kernels of both chips equal twins in plain Python, written from the chips' descriptions, on random networks."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from loihi_twin import Compartments, loihi_word
from neuro.program.backend import OverflowWarning
from neuro.run.compiled import ApproximationWarning
from spinnaker_twin import Neurons

MODES = {"mixed": (-256, 254), "excitatory": (0, 255), "inhibitory": (-255, 0)}
INPUTS, CELLS = 3, 4


def edge(low: int, high: int):
    """Whole numbers in which both ends are common."""
    return st.one_of(st.integers(low, high), st.sampled_from([low, high]))


def spikes_of(steps: int):
    return st.lists(st.frozensets(st.integers(0, INPUTS - 1)), min_size=steps, max_size=steps)


@st.composite
def wires(draw, source: str, size: int, chip: str):
    """Source, pairs, weights, delay registers, and registers of the synapses on Loihi."""
    count = draw(st.integers(1, 8))
    ends = st.tuples(st.integers(0, size - 1), st.integers(0, CELLS - 1))
    pairs = draw(st.lists(ends, min_size=count, max_size=count))
    registers = {}
    weight, delay = (
        st.one_of(edge(-65535, 65535), st.integers(-9000, 9000)),
        st.one_of(st.integers(1, 16), edge(1, 144)),
    )
    if chip == "loihi":
        mode, bits, exponent = draw(st.sampled_from([*MODES])), draw(edge(1, 8)), draw(edge(-8, 7))
        registers = {"weight_exp": exponent, "num_weight_bits": bits, "sign_mode": mode}
        weight, delay = edge(*MODES[mode]), edge(0, 62)
    weights, delays = (draw(st.lists(each, min_size=count, max_size=count)) for each in (weight, delay))
    if draw(st.booleans()):  # one for all, which takes other ways through the kernels
        weights, delays = weights[:1] * count, delays[:1] * count
    return source, pairs, weights, delays, registers


def several(chip: str):
    ends = st.sampled_from([("in", INPUTS), ("cells", CELLS)])
    return st.lists(ends.flatmap(lambda end: wires(*end, chip)), min_size=1, max_size=4)


def synapses_of(projections, word):
    """(source, pre, post, what a spike adds, delay register) of every synapse."""
    return [
        (source, pre, post, word(weight, **registers), delay)
        for source, ends, weights, delays, registers in projections
        for (pre, post), weight, delay in zip(ends, weights, delays, strict=True)
    ]


def same(chip, model, projections, spikes, rows, steps, first=0):
    """Run the network by the public interface; demand equal registers and spikes. An overflow is the twin's, too.

    `rows` has the registers by name and who fired; a delay register of `first` is a delay of 1 ms.
    """
    net = neuro.Network("random", resolution=1.0)
    times = [[k + 1.0 for k, fired in enumerate(spikes) if i in fired] for i in range(INPUTS)]
    net.population("in", INPUTS, neuro.spike_generator(spike_times=times))
    net.population("cells", CELLS, model)
    for n, (source, ends, weights, delays, registers) in enumerate(projections):
        pre, post = np.array(ends).T
        weight, delay = (
            float(values[0]) if len({*values}) == 1 else np.array(values, dtype=float) for values in (weights, delays)
        )
        synapse = neuro.loihi_static(**registers) if registers else neuro.static()
        rule = neuro.pairs(pre=pre, post=post)
        net.connect(source, "cells", rule, synapse, weight=weight, delay=delay + 1.0 - first, name=f"p{n}")
    *states, _ = rows
    for state in states:
        net.probe(state, "cells", state)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        warnings.simplefilter("ignore", OverflowWarning)
        sim = neuro.compile(net, chip)
        sim.run(float(steps))
    fired, ids = sim.spikes("cells")
    found = np.zeros_like(rows["fired"])
    found[np.rint(fired).astype(int) - 1, ids] = True
    for state in states:
        np.testing.assert_array_equal(sim.trace(state)[1], rows[state], err_msg=state)
    np.testing.assert_array_equal(found, rows["fired"])
    return sim


def arrays(registers: list[dict[str, int]]):
    return {key: np.array([r[key] for r in registers]) for key in registers[0]}


# Loihi


COMPARTMENT = st.fixed_dictionaries(
    {
        "du": edge(0, 4095),
        "dv": edge(0, 4095),
        "vth": st.one_of(edge(0, 131071), st.integers(0, 3000)),
        "bias_mant": st.one_of(st.just(0), edge(-4096, 4095)),
        "bias_exp": edge(0, 7),
        "refractory": st.one_of(st.just(1), edge(1, 64)),
    }
)


def on_loihi(registers, projections, spikes):
    rows = Compartments(registers, synapses_of(projections, loihi_word)).run(spikes, len(spikes))
    return same("loihi", neuro.loihi_lif(**arrays(registers)), projections, spikes, rows, len(spikes)), rows


@settings(max_examples=25, deadline=None)
@given(st.lists(COMPARTMENT, min_size=CELLS, max_size=CELLS), several("loihi"), spikes_of(70))
def test_random_networks_on_loihi(registers, projections, spikes):
    on_loihi(registers, projections, spikes)


def driven(mantissa: int, exponent: int, steps: int, delay: int = 0, **registers: int):
    """Four compartments of which one is driven by one input in every step."""
    told = {"du": 0, "dv": 4095, "vth": 131071, "bias_mant": 0, "bias_exp": 0, "refractory": 1} | registers
    mode = {"weight_exp": exponent, "num_weight_bits": 8, "sign_mode": "mixed" if mantissa < 0 else "excitatory"}
    sim, rows = on_loihi([told] * CELLS, [("in", [(0, 0)], [mantissa], [delay], mode)], [frozenset([0])] * steps)
    return sim.counts().native, rows


def test_the_threshold_of_loihi_is_strict():
    _, rows = driven(100, 0, 2, du=4095, dv=4095, vth=100)
    assert rows["v"][1, 0] == 6400
    assert not rows["fired"].any()
    _, rows = driven(100, 0, 2, du=4095, dv=4095, vth=100, bias_mant=1)
    assert rows["fired"][1].tolist() == [True, False, False, False]


def test_a_refractory_register_of_64_holds_v_for_63_steps():
    _, rows = driven(255, 0, 140, du=4095, dv=4095, vth=10, refractory=64)
    assert np.flatnonzero(rows["fired"][:, 0]).tolist() == [1, 65, 129]
    assert not rows["v"][2:65, 0].any()


def test_the_largest_delay_register_of_loihi():
    _, rows = driven(2, 0, 70, delay=62)
    assert np.flatnonzero(rows["u"][:, 0])[0] == 0 + 1 + 62


# SpiNNaker


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
NEURON = st.one_of(
    st.fixed_dictionaries(USUAL | DECAYS), st.fixed_dictionaries(USUAL | WILD | DECAYS | {"r_m": edge(0, 2**31 - 1)})
)


def on_spinnaker(registers, shifts, projections, spikes):
    rows = Neurons(registers, shifts, synapses_of(projections, lambda word: word)).run(spikes, len(spikes))
    model = neuro.spinnaker_lif(**arrays(registers), exc_shift=shifts[0], inh_shift=shifts[1])
    return same("spinnaker", model, projections, spikes, rows, len(spikes), first=1), rows


@settings(max_examples=25, deadline=None)
@given(
    st.lists(NEURON, min_size=CELLS, max_size=CELLS),
    st.tuples(edge(0, 15), edge(0, 15)),
    several("spinnaker"),
    spikes_of(40),
)
def test_random_networks_on_spinnaker(registers, shifts, projections, spikes):
    on_spinnaker(registers, shifts, projections, spikes)


QUIET = {"v_rest": 0, "v_reset": 0, "v_thresh": 2**31 - 1, "v_init": 0, "i_offset": 0, "r_m": mV, "exp_tc": 16384}
PLAIN = {**QUIET, "t_refract": 0, "exc_decay": 0, "exc_init": FRACTION, "inh_decay": 0, "inh_init": FRACTION}
SILENT = [frozenset()]


@pytest.mark.parametrize(("sign", "name"), [(1, "g_exc"), (-1, "g_inh")])
def test_a_slot_saturates(sign, name):
    wires = ("in", [(0, 0), (1, 0), (2, 0)], [40000 * sign, 20000 * sign, 20000 * sign], [1, 1, 1], {})
    sim, rows = on_spinnaker([PLAIN] * CELLS, (0, 0), [wires], [frozenset({0, 1, 2})] * 3 + SILENT * 3)
    assert rows[name].max() == (65535 * FRACTION) >> 32
    assert sim.counts().native["slot saturations of cells"] == 3


@pytest.mark.parametrize("delay", [1, 16, 17, 144])
def test_a_spike_lands_after_its_delay(delay):
    wires = ("in", [(0, 0)], [1000], [delay], {})
    _, rows = on_spinnaker([PLAIN] * CELLS, (0, 0), [wires], [frozenset({0})] + SILENT * 149)
    assert np.flatnonzero(rows["g_exc"][:, 0]).tolist() == [delay]


def test_the_threshold_of_spinnaker_is_reached_by_equality():
    held = {**PLAIN, "v_init": 500, "v_rest": 500, "v_thresh": 500}
    _, rows = on_spinnaker([held] * CELLS, (0, 0), [("in", [(0, 0)], [1], [1], {})], SILENT * 3)
    assert rows["fired"][0].all()
