"""The doctor on networks that ship and on random ones: no false alarm and no error; a simulation stays as it is."""

import json
import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro.compiler import compile_network
from neuro.model.network import Network
from neuro_doctor.wiring import Cell
from neuro_models import areas, delays, hedonists, motion, orders
from strategies import networks


def named(found):
    """Names of the findings."""
    return [each.name for each in found]


def fed(times):
    """Cells that follow spikes of a generator."""
    net = Network("fed", resolution=1.0)
    net.population("input", len(times), neuro.spike_generator(spike_times=times))
    net.population("cells", len(times), neuro.iaf_psc_delta())
    net.connect("input", "cells", neuro.one_to_one(), weight=20.0)
    return net


def test_injected_spikes_are_given_again_and_merge_on_a_chip():
    sim = neuro.compile(fed([[]] * 3))
    assert named(sim.doctor(ms=20.0)) == ["no-input"]
    sim.inject("input", [5.0, 7.0])
    sim.run(10.0)
    assert len(sim.doctor(ms=20.0)) == 0
    sim = neuro.compile(fed([[3.0, 3.0], [4.0]]))
    sim.inject("input", [5.0, 5.0, 7.0])
    sim.run(10.0)
    (merged,) = [each for each in sim.doctor(ms=20.0, chip="loihi") if each.name == "spikes-merged"]
    assert merged.evidence.startswith("33.3% of its 9 spikes")


def test_what_cannot_run_is_a_finding():
    net = Network("refused")
    net.population("cells", 2, neuro.loihi_lif())
    found = neuro.doctor(net, ms=10.0)
    assert named(found.faults) == ["refused"]
    assert "loihi" in found.faults[0].remedy
    net = Network("away")
    net.population("cells", 2, neuro.hh_psc_alpha(), initial={"V_m": 1e4})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        assert named(neuro.doctor(net, ms=2.0, backend="reference").faults) == ["unstable"]


ROOT = Path(__file__).parents[2]
CLI = ROOT / "neuro" / "cli"
FILES = [
    *sorted((ROOT / "models" / "neuro_models").glob("*.yaml")),
    *sorted((ROOT / "examples").glob("*.yaml")),
    *sorted(CLI.glob("examples/*.yaml")),
    *sorted(CLI.glob("templates/*/network.yaml")),
]
SMALLER = {"microcircuit": {"scale": 0.02}}
"""Parameters with which large networks are examined in a second."""
DESERVED = {
    ("pair", "neurons-alike"): "5 neurons hear the same 10 by equal weights, and learn alike",
    ("hfirst", "no-path"): "its templates are to be learnt: as it ships, every weight onto s2 inhibits",
}
"""Warnings about networks that ship, and why they are right."""


def name_of(file: Path) -> str:
    return file.parent.name if file.stem == "network" else file.stem


def check(found: neuro.Diagnosis) -> None:
    """No fault, and no warning that is not deserved."""
    alarms = [each for each in found if each.severity != "note" and (found.network, each.name) not in DESERVED]
    assert alarms == [], str(found)


@pytest.mark.parametrize("file", FILES, ids=name_of)
def test_no_false_alarm_on_files_that_ship(file, tmp_path):
    if name_of(file) == "event-camera":
        shutil.copy(CLI / "examples" / "walk.dat", tmp_path)
        file = Path(shutil.copy(file, tmp_path))
    net = neuro.load(file, params=SMALLER.get(file.stem, {}))
    check(neuro.doctor(net, ms=300.0))


BUILT = {
    "areas": lambda: areas.network(areas=2, density=1.0),
    "delays": lambda: delays.gathering(delays.drawn_onsets(0, 4), 3),
    "hedonists": hedonists.network,
    "motion": motion.network,
    "orders": orders.network,
}


@pytest.mark.parametrize("name", BUILT)
def test_no_false_alarm_on_networks_made_in_python(name):
    check(neuro.doctor(BUILT[name](), ms=300.0))


@settings(max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(net=networks(), seed=st.integers(0, 5))
def test_no_error_on_random_networks(net: Network, seed: int):
    found = neuro.doctor(net, ms=50.0 if net.resolution == 1.0 else 20.0, seed=seed, train=True, drive=20.0)
    json.dumps(found.as_dict())
    assert str(found).endswith(found.verdict)


def follower() -> neuro.Simulation:
    sim = neuro.compile(neuro.load(ROOT / "examples" / "follower.yaml"), seed=3)
    sim.set("cells", rate=40.0)
    sim.run(100.0)
    return sim


def test_a_simulation_stays_as_it_is():
    asked, alone = follower(), follower()
    for each in (asked, alone):
        before = each._engine.snapshot()
        found = asked.doctor(ms=200.0) if each is asked else None
        after = each._engine.snapshot()
        assert before.keys() == after.keys()
        assert all(np.array_equal(before[word], after[word], equal_nan=True) for word in before)
    assert found is None
    for each in (asked, alone):
        each.signal("reward", 0.1)
        each.run(100.0)
    assert asked.steered == alone.steered
    assert np.array_equal(asked.weights("cells_motors")[2], alone.weights("cells_motors")[2])
    assert all(np.array_equal(a, b) for a, b in zip(asked.spikes("motors"), alone.spikes("motors"), strict=True))


def test_a_simulation_is_judged_as_it_is_now():
    sim = follower()
    found = sim.doctor(ms=200.0)
    assert "no-input" not in named(found)
    unset = next(each for each in found if each.name == "signal-not-set")
    assert unset.severity == "warning"
    assert "100 ms" in unset.evidence
    sim.set_weights("cells_motors", 1.0)
    sim.signal("reward", 0.1)
    found = named(sim.doctor(ms=200.0))
    assert "silent" in found
    assert "signal-not-set" not in found


def test_events_that_come_once_are_not_taken():
    events = neuro.events.load(CLI / "examples" / "walk.dat")
    net = Network("once", resolution=1.0)
    camera = net.population("camera", [2, 48, 64], neuro.event_camera(events=iter([events])))
    net.population("cells", 5, neuro.iaf_psc_exp())
    net.connect(camera, "cells", neuro.all_to_all(), weight=300.0)
    assert [each.name for each in neuro.doctor(net, ms=100.0)] == ["no-input"]
    sim = neuro.compile(net)
    sim.run(100.0)
    assert sim.counts().populations["camera"].spikes > 0


def test_the_factor_of_a_remedy_suffices():
    def fed(weight: float) -> neuro.Diagnosis:
        net = Network("fed", resolution=0.1)
        net.population("noise", 100, neuro.poisson_generator(rate=20.0))
        net.population("cells", 20, neuro.iaf_psc_exp())
        net.connect("noise", "cells", neuro.fixed_indegree(50), weight=weight)
        return neuro.doctor(net)

    (silent,) = fed(20.0)
    factor = float(re.search(r"to about ([\d.,]+) times", silent.remedy)[1])
    assert factor == pytest.approx(375.0 / (50 * 20.0 * 2e-3 * 20.0), rel=0.1)  # rheobase over the mean current
    assert len(fed(20.0 * factor)) == 0


def test_one_spike_is_measured():
    for model, peak, weight in (
        (neuro.iaf_psc_delta(), 1.0, 15.0),
        (neuro.iaf_psc_exp(), 0.00535, 2804.0),  # mV/pA: at its peak 4.02 ms after the spike
        (neuro.izhikevich(), 1.0, 13.4),
        (neuro.iaf_cond_exp(), 0.0527, 340.0),  # 300 nS would do if the reversal potential were far
    ):
        net = Network("one")
        net.population("cells", 1, model)
        cell = Cell(compile_network(net, 0).populations[0], net.resolution)
        assert cell.slope(0) == pytest.approx(peak, rel=0.01), model.name
        assert cell.to_fire(0) == pytest.approx(weight, rel=0.1), model.name


def test_wrong_arguments_are_refused():
    net = neuro.load(CLI / "examples" / "net.yaml")
    for words in ({"ms": 0.0}, {"drive": -1.0}, {"chip": "lohi"}, {"backend": "evnt"}, {"reward_after": -1.0}):
        with pytest.raises(neuro.ModelError):
            neuro.doctor(net, **words)
    with pytest.raises(neuro.ModelError):
        neuro.doctor("net.yaml")


def test_a_diagnosis_is_shown_in_a_notebook_and_as_a_page():
    net = neuro.load(CLI / "examples" / "net.yaml", params={"w": 30.0})
    found = neuro.doctor(net)
    assert "silent" in found._repr_html_()
    page = found.page()
    assert page.count("<canvas") == 2
    for text in ("rheobase", "largest V_m of exc"):
        assert text in page
    assert [each["name"] for each in found.as_dict()["findings"]] == named(found)


def test_a_projection_without_synapses_whose_weights_are_drawn():
    net = Network("few")
    cells, others = (net.population(name, 10, neuro.iaf_psc_exp()) for name in ("cells", "others"))
    net.connect(cells, others, neuro.one_to_one(), weight=10.0, delay=1.0)
    weight = neuro.normal(mean=1.0, std=0.1)
    net.connect(cells, others, neuro.fixed_total_number(n=0), weight=weight, delay=1.0, name="none")
    found = {(each.name, each.what) for each in neuro.doctor(net, ms=10.0)}
    assert ("no-synapses", "projection 'none'") in found


def test_a_page_shows_weights_that_ran_to_their_bound():
    net = Network("learns", resolution=1.0)
    net.population("noise", 20, neuro.poisson_generator(rate=50.0))
    net.population("cells", 5, neuro.iaf_psc_exp())
    rule = neuro.stdp(lambda_=0.2, alpha=0.01, mu_plus=0.0, mu_minus=0.0, Wmax=900.0)
    net.connect("noise", "cells", neuro.pairwise_bernoulli(p=0.7), rule, weight=500.0)
    found = neuro.doctor(net)
    assert "weights-at-bounds" in {each.name for each in found}
    assert "at the beginning" in found.page()
