"""Many microcircuits wired by distance: numbers, a ground state, the same spikes on three simulators, refusals."""

import numpy as np
import pytest

import neuro
from neuro.testing import observe
from neuro.testing.case import differences
from neuro_models import areas

WHOLE = {"areas": 32, "scale": 0.02}


def between(net):
    """The projections from one area to another."""
    return [p for p in net.projections.values() if p.source[:3] != p.target[:3]]


@pytest.fixture(scope="module")
def whole():
    return areas.network(**WHOLE)


def test_32_areas_have_thousands_of_projections_between_them(whole):
    found = between(whole)
    assert len(found) > 4000
    assert len(whole.projections) - len(found) == 32 * 63
    assert len(whole.populations) == 32 * 16
    synapses = sum(p.rule.n for p in whole.projections.values() if p.rule.name == "fixed_total_number")
    assert sum(p.rule.n for p in found) / synapses == pytest.approx(0.2, abs=0.01)


def test_delays_follow_from_distance_and_speed(whole):
    wired = areas.wiring()
    assert wired.distances.max() > 35.0
    late = {p.name: p.delay for p in between(whole)}["A01_L23E_A02_L4E"]
    assert late.mean == pytest.approx(wired.distances[0, 1] / 3.5)
    assert late.std == pytest.approx(late.mean / 2)
    slower = areas.network(areas=3, speed=0.35, density=1.0)
    faster = areas.network(areas=3, density=1.0)
    for one, other in zip(between(slower), between(faster), strict=True):
        assert one.delay.mean == pytest.approx(10 * other.delay.mean)


def test_a_share_of_pairs_is_connected_both_ways_and_the_near_ones_first():
    wired = areas.wiring(areas=20, density=0.3)
    assert (wired.connected == wired.connected.T).all()
    assert wired.connected.sum() == 2 * round(0.3 * 190)
    assert (np.diff(wired.centres[:, 0]) > 0).all()
    apart = ~np.eye(20, dtype=bool)
    assert wired.distances[wired.connected].mean() < 0.8 * wired.distances[apart].mean()


def test_input_goes_forward_to_layer_4_and_back_to_the_others(whole):
    for p in between(whole):
        forward = p.source[:3] < p.target[:3]
        assert (p.source[4:] == "L23E") == forward
        assert p.target[4:].startswith("L4") == forward


def test_input_from_areas_replaces_poisson_input_of_the_same_mean(whole):
    rates = {"L23E": 0.903, "L5E": 7.569, "L6E": 1.105}
    alone = areas.network(**WHOLE, between=0.0)
    assert between(alone) == []
    for name in ("A01_L23E", "A16_L4I", "A32_L4E", "A01_L4E"):
        heard = sum(p.rule.n * rates[p.source[4:]] for p in between(whole) if p.target == name)
        left = whole.populations[f"{name}_in"].model.rate
        size = alone.populations[name].shape[0]
        assert left + heard / size == pytest.approx(alone.populations[f"{name}_in"].model.rate)
        assert (heard == 0.0) == (name == "A01_L4E")  # nothing comes forward to the first


def test_a_small_one_is_neither_silent_nor_in_step():
    net = areas.network(areas=3, density=1.0)
    sim = neuro.compile(net, seed=1)
    sim.run(600.0)
    for name in areas.LAYERS:
        size = net.populations[f"A01_{name}"].shape[0]
        counts = [np.histogram(sim.spikes(f"A{k:02d}_{name}")[0], np.arange(99.0, 601.0, 3.0))[0] for k in (1, 2, 3)]
        assert 0.5 < np.mean(counts) / size / 3e-3 < 20.0, name
        # the mean correlation of two neurons from the variance of the counts of all, as if their rates were the same
        correlation = [(each.var() / each.mean() - 1.0) / (size - 1.0) for each in counts]
        assert np.mean(correlation) < 0.15, name


@pytest.mark.usefixtures("nest")
def test_three_simulators_give_the_same_spikes():
    net = areas.network(areas=2, scale=0.01, indegree=0.05, density=1.0)
    found = []
    for backend in ("reference", "event", "nest"):
        sim = neuro.compile(net, backend, seed=3)
        sim.run(12.0)
        found.append({name: told for name, told in observe(sim).items() if "spikes" in name or "V_m" in name})
    assert sum(told.size for name, told in found[0].items() if "spikes" in name) > 100
    for other in found[1:]:
        assert differences(found[0], other, exact=False) == []


def test_a_number_that_cannot_be_used_is_refused(messages):
    messages.calls(globals())
