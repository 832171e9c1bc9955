"""Between what a bill lies, and what of it is extrapolated."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips import chip, chips, place, price
from neuro.chips.description import Figure
from neuro.chips.pricing import run_of
from refused import refusals_of

STEPS = 20


@pytest.fixture(scope="module")
def sim():
    net = neuro.Network("pair", resolution=1.0)
    net.population("in", 3, neuro.spike_generator(spike_times=((1.0, 4.0, 9.0), (2.0,), ())))
    net.population("out", 4, neuro.iaf_psc_delta(V_th=-60.0, t_ref=0.0))
    net.connect("in", "out", neuro.all_to_all(), weight=20.0, delay=1.0, name="w")
    sim = neuro.compile(net, "reference")
    sim.run(float(STEPS))
    return sim


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def written(text):
        Path("my.yaml").write_text(text)
        return "my.yaml"

    return written


PRICED = [name for name in chips() if chip(name).costs]


@pytest.mark.parametrize("name", PRICED)
def test_a_range_has_the_best_estimate(sim, name):
    energy = sim.energy(name)
    assert 0.0 <= energy.low_j <= energy.total_j <= energy.high_j
    assert all(item.low <= item.joules <= item.high for item in energy.items if item.joules is not None)
    assert (energy.low_j < energy.high_j) == (name != "arm")
    told = json.loads(json.dumps(energy.as_dict()))
    for word in ("total", "dynamic", "static"):
        if told[f"{word}_j"] is not None:
            assert told[f"{word}_low_j"] <= told[f"{word}_j"] <= told[f"{word}_high_j"]
    assert told["total_low_j"] == energy.low_j
    assert told["chip_time_s"] is None or told["chip_time_low_s"] <= told["chip_time_s"] <= told["chip_time_high_s"]


@pytest.mark.parametrize("name", PRICED)
def test_a_range_says_where_it_comes_from(name):
    found = chip(name)
    for figure in (*found.costs.values(), *([found.step_s] if found.step_s else [])):
        low, high = figure.range(extrapolated=True)
        assert low <= figure.value <= high
        assert bool(figure.spread) == (low != high)


def test_by_hand(sim, table):
    figures = "synaptic_op: {value: 4, low: 3, high: 7, source: x}, neuron_update_inactive: {value: 2, source: x}"
    energy = sim.energy(table(f"costs: {{{figures}}}"))
    ops, updates = 4 * 4, 4 * STEPS - sim.counts().neuron_updates_active
    assert (energy.low_j, energy.total_j, energy.high_j) == (
        3 * ops + 2 * updates,
        4 * ops + 2 * updates,
        7 * ops + 2 * updates,
    )
    part = energy.per(4, "part")
    assert (part.low_j, part.high_j) == (energy.low_j / 4, energy.high_j / 4)
    (total,) = (line for line in str(energy).splitlines() if line.startswith("total"))
    assert total.endswith(f"  > {energy.total_j:g} J ({energy.low_j:g} to {energy.high_j:g} J)")


@settings(max_examples=20, deadline=None)
@given(low=st.floats(0, 1), high=st.floats(1, 1e6), n=st.integers(1, 100))
def test_parts_keep_the_range(sim, low, high, n):
    found = chip("loihi")
    costs = {**found.costs, "synaptic_op": Figure(1.0, "x", low=low, high=high)}
    part = price(sim.program, sim._engine.counts(), place(sim.program, found), replace(found, costs=costs)).per(n, "x")
    assert part.low_j <= part.total_j * (1 + 1e-12)
    assert part.total_j <= part.high_j * (1 + 1e-12)


# what is extrapolated


def test_outside_of_what_a_figure_holds_for(sim, table):
    path = table(
        "costs:\n"
        "  synaptic_op: {value: 2, source: x, holds: {resolution: [0.1, 0.5]}, beyond: [1, 9], spread: y}\n"
        "  neuron_update_inactive: {value: 1, source: x, holds: {resolution: [0.5, 1.0], rate: [0, 1000]}}\n"
    )
    energy = sim.energy(path)
    why = "resolution 1 ms, published for 0.1 to 0.5 ms"
    assert energy.extrapolated == {why: ("synaptic_op",)}
    assert [(item.low, item.high) for item in energy.items if item.what == "synaptic_op"] == [(16.0, 144.0)]
    assert [item.extrapolated for item in energy.items if item.what == "neuron_update_inactive"] == [""]
    assert f"- extrapolated (*): synaptic_op: {why}" in str(energy)
    assert "synaptic_op *" in str(energy)
    assert energy.as_dict()["extrapolated"] == [{"why": why, "costs": ["synaptic_op"]}]


def test_our_marks(sim):
    assert sim.energy("loihi").extrapolated == {}
    assert sim.energy("truenorth").extrapolated == {}
    several = sim.energy("loihi", chips=1000).extrapolated
    assert several["chips 1000, published for 1 to 768"] == ("static_per_chip",)
    notes = sim.energy("loihi", chips=1000).notes
    why = "chips 1000, published for 1 to 768"
    assert f"chip time is extrapolated: barrier_768_chips_time: {why}" in notes
    prototype = sim.energy("spinnaker2").extrapolated
    assert list(prototype) == ["a prototype of 4 cores in 28 nm, not the chip of 22 nm"]


def test_hops_between_chips_are_extrapolated():
    net = neuro.Network("far", resolution=1.0)
    net.population("in", 1, neuro.spike_generator(spike_times=((1.0,),)))
    net.population("out", 132_000, neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.all_to_all(), weight=20.0, delay=1.0, name="w")
    sim = neuro.compile(net, "event")
    sim.run(5.0)
    energy = sim.energy("loihi")
    assert energy.chips == 2
    assert energy.extrapolated == {"chips 2, published for 1": ("hop_east_west", "hop_north_south")}


def test_steps_that_are_not_1_ms_on_spinnaker(sim):
    net = neuro.Network("fine", resolution=0.1)
    net.population("out", 2, neuro.iaf_psc_delta())
    fine = neuro.compile(net, "reference")
    fine.run(2.0)
    energy = fine.energy("spinnaker")
    assert energy.chip_time_s == pytest.approx(20e-3)
    assert energy.chip_time_range_s == pytest.approx((2e-3, 40e-3))  # Rhodes et al., and van Albada et al.
    assert "chip time is extrapolated: step_s: resolution 0.1 ms, published for 1 ms" in energy.notes
    assert sim.energy("spinnaker").chip_time_range_s == pytest.approx((STEPS * 1e-3, STEPS * 1e-3))


# the barrier of several chips


def test_the_barrier_of_several_chips(sim):
    one, few, all_of_them = (sim.energy("loihi", chips=n).chip_time_s for n in (1, 32, 768))
    placement = place(sim.program, chip("loihi"))
    assert placement.tiles_used == 1
    assert all_of_them - one == pytest.approx(STEPS * (16.2e-6 - 113e-9))
    assert few - one == pytest.approx(STEPS * (465e-9 + (16.2e-6 - 465e-9) * 31 / 767 - 113e-9))


# the machine as given


def test_the_machine_as_given(sim):
    energy = sim.energy("loihi", step_s=1e-3, chips=2)
    assert (energy.chip_time_s, energy.chips) == (pytest.approx(STEPS * 1e-3), 2)
    assert energy.static_j == pytest.approx(2 * STEPS * 1e-3 * 0.104)
    assert energy.dynamic_j == sim.energy("loihi").dynamic_j


def test_a_machine_that_cannot_be(sim, messages):
    messages(refusals_of(messages.cases, locals()))


def test_the_rate_of_a_run_is_in_hertz(sim):
    counts = sim.counts()
    spikes = len(sim.spikes("out")[0])
    assert spikes > 0
    assert run_of(sim.program, counts, None, 1)["rate"] == pytest.approx(spikes / (4 * STEPS * 1e-3))
