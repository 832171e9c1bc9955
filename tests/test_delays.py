"""Delays that learn: what a spike takes, what the backends give, and inputs that come to arrive together."""

import numpy as np
import pytest

import neuro
from neuro import ModelError
from neuro.extend import Neuron
from neuro.testing import check_part, observe
from neuro.testing.case import differences
from neuro_models.delays import BETWEEN, drawn_onsets, gathering, spread

BACKENDS = ("reference", "event")


@pytest.mark.parametrize(
    "rule", [neuro.stddp(), neuro.stddp(by_step=True, tau=8.0), neuro.stddp(A=1.0, tau=3.0, d_min=1.3, d_max=5.0)]
)
def test_a_rule_is_the_same_on_both_backends(rule):
    check_part(rule)


def pair(target: Neuron, pre: list[float], post: list[float], **rule: float) -> neuro.Network:
    """A synapse of 5 ms between a parrot and a target, both told when to spike."""
    net = neuro.Network("pair", resolution=0.5)
    net.population("pre", 1, neuro.parrot_neuron())
    net.population("post", 1, target)
    for name, times in (("pre", pre), ("post", post)):
        net.population(f"tell_{name}", 1, neuro.spike_generator(spike_times=[[t - 0.5 for t in times]]))
        net.connect(f"tell_{name}", name, neuro.one_to_one(), weight=10.0, delay=0.5)
    net.connect("pre", "post", neuro.one_to_one(), neuro.stddp(**rule), weight=0.1, delay=5.0, name="late")
    return net


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("post", "late"), [(18.0, 3.0), (11.0, -4.0), (15.0, 0.0), (8.0, -7.0)])
def test_a_pair_changes_the_delay_by_the_window(backend, post, late):
    quiet = neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=5.0)
    for rule, change in (
        ({"A": 0.2, "tau": 20.0}, 0.2 * late * np.exp(-abs(late) / 20.0)),
        ({"by_step": True, "tau": 4.0}, 0.5 * np.sign(late) * (abs(late) <= 4.0)),
    ):
        sim = neuro.compile(pair(quiet, [10.0], [post], **rule), backend, seed=1)
        sim.run(30.0)
        assert sim.spikes("post")[0].tolist() == [post]
        assert sim.get("late", "delay") == pytest.approx([5.0 + change], abs=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_spike_under_way_keeps_its_steps(backend):
    sim = neuro.compile(pair(neuro.parrot_neuron(), [10.0], [11.0], A=1.0, tau=1e9), backend, seed=1)
    sim.run(12.0)
    assert sim.get("late", "delay") == pytest.approx([1.0], abs=1e-7)
    sim.run(10.0)
    assert sim.spikes("post")[0].tolist() == [11.0, 15.0]


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_delay_stays_within_its_bounds(backend):
    sim = neuro.compile(pair(neuro.parrot_neuron(), [10.0], [11.0], A=1.0, tau=1e9, d_min=3.0), backend, seed=1)
    sim.run(12.0)
    assert sim.get("late", "delay").tolist() == [3.0]
    sim = neuro.compile(pair(neuro.parrot_neuron(), [10.0], [17.0], A=1.0, tau=1e9, d_max=6.25), backend, seed=1)
    sim.run(14.0)
    sim.run(4.0)
    assert sim.get("late", "delay").tolist() == [6.25]


@pytest.mark.parametrize("by_step", [True, False])
def test_inputs_come_to_arrive_together(by_step):
    onsets, presentations = drawn_onsets(seed=5, cells=20), 70
    sim = neuro.compile(gathering(onsets, presentations, by_step), seed=1)
    assert spread(onsets, sim.get("gathered", "delay")).mean() > 7.0
    sim.run(presentations * BETWEEN)
    assert spread(onsets, sim.get("gathered", "delay")).tolist() == [0.0] * 20


@pytest.mark.parametrize("backend", BACKENDS)
def test_delays_are_saved_kept_and_handed_on(backend, tmp_path):
    net = gathering(drawn_onsets(seed=2, cells=2), 10)
    sim = neuro.compile(net, backend, seed=1)
    sim.run(2.5 * BETWEEN)
    sim.save(tmp_path / "state.h5")
    learnt = sim.get("gathered", "delay")
    handed = neuro.compile(sim.network(), backend, seed=1)
    assert handed.get("gathered", "delay").tolist() == np.floor(learnt + 0.5).tolist()
    sim.run(BETWEEN)
    further = observe(sim) | {"delay": sim.get("gathered", "delay")}
    sim.reset()
    assert sim.get("gathered", "delay").tolist() == further["delay"].tolist()
    sim.reset(weights=True)
    assert sim.get("gathered", "delay").tolist() == [31.0] * 16
    again = neuro.compile(net, backend, seed=1)
    again.restore(tmp_path / "state.h5")
    assert again.get("gathered", "delay").tolist() == learnt.tolist()
    again.run(BETWEEN)
    assert not differences(further, observe(again) | {"delay": again.get("gathered", "delay")}, exact=True)


def refusal(act) -> str:
    with pytest.raises(ModelError) as told:
        act()
    return str(told.value)


def test_mistakes_are_told():
    target = neuro.parrot_neuron()
    assert refusal(lambda: neuro.stddp(d_min=4.0, d_max=3.0)) == "stddp.d_min = 4: expected at most d_max = 3"
    assert (
        "projection 'late': delay[0] = 5 ms: expected 6 to 50 ms, the bounds of stddp\n"
        "  hint: set stddp.d_min and d_max"
    ) in refusal(lambda: neuro.compile(pair(target, [1.0], [1.0], d_min=6.0)))
    assert "stddp.d_max = 50000 ms: expected at most 32768 ms, 2^16 steps" in refusal(
        lambda: neuro.compile(pair(target, [1.0], [1.0], d_max=50000.0))
    )
    sim = neuro.compile(pair(target, [1.0], [1.0]))
    sim.set("late", A=0.5)
    assert (
        refusal(lambda: sim.set("late", d_max=60.0))
        == "stddp.d_max of 'late' is fixed: change the network and compile again"
    )


@pytest.mark.parametrize("chip", ["loihi", "spinnaker"])
def test_chips_refuse_delays_that_learn(chip):
    assert (
        f"projection 'late': stddp: delays do not change while {chip} runs\n"
        "  hint: learn on event, then give the delays of sim.network() to static synapses"
    ) in refusal(lambda: neuro.compile(pair(neuro.parrot_neuron(), [1.0], [1.0]), chip))
