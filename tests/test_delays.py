"""Delays that learn: what a spike takes, what the backends give, and inputs that come to arrive together."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

import neuro
from neuro.compare import cells, compare
from neuro.extend import Neuron, Synapse
from neuro.files.results import read, write
from neuro.model.synapses import complete
from neuro.run.collect import collect
from neuro.testing import check_part, observe
from neuro.testing.case import differences
from neuro_models import orders
from neuro_models.delays import BETWEEN, drawn_onsets, gathering, spread

BACKENDS = ("reference", "event")


@pytest.mark.parametrize(
    "rule", [neuro.stddp(by_step=True, tau=8.0), neuro.stddp(A=1.0, tau=3.0, d_min=1.3, d_max=5.0)]
)
def test_a_rule_is_the_same_on_both_backends(rule):
    check_part(rule, ms=10.0)


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


def test_results_and_comparisons_have_delays(tmp_path):
    net = gathering(drawn_onsets(seed=2, cells=2), 10)
    sim = neuro.compile(net, seed=1)
    sim.run(2.5 * BETWEEN)
    write(collect(sim, net), tmp_path / "out.h5")
    found = read(tmp_path / "out.h5").projections
    assert found["gathered"].delay_ms.tolist() == sim.get("gathered", "delay").tolist()
    assert [name for name, part in found.items() if part.delay_ms is not None] == ["gathered"]
    comparison = compare(net, ["event", "reference"], ms=2.5 * BETWEEN, seed=1)
    assert comparison.as_dict()["backends"]["reference"]["delays"] == {
        "gathered": {"largest": 0.0, "rms": 0.0, "relative": 0.0}
    }
    assert ("gathered: delays", "reference", "0 ms", "0 ms", "0.000%", "-") in list(cells.projections(comparison))


TARGET = neuro.parrot_neuron()


def test_mistakes_are_told(messages):
    sim = neuro.compile(pair(TARGET, [1.0], [1.0]))
    sim.set("late", A=0.5)
    messages.calls(globals() | {"s": sim})


@pytest.mark.parametrize(
    "rule", [neuro.r_stddp(), neuro.r_stddp(Ar_plus=-0.3, Ap_minus=0.7, d_max=7.0)], ids=["by default", "to the bounds"]
)
def test_a_rule_for_trials_is_the_same_on_both_backends(rule):
    check_part(rule, ms=10.0)


def one_of_three(reward: float) -> neuro.Network:
    """A neuron that fires at the second arrival; its inputs are 2, 4 and 6 ms late."""
    net = neuro.Network("three", resolution=0.5)
    net.population("inputs", 4, neuro.spike_generator())
    net.population("cells", (2, 1), neuro.iaf_psc_delta(tau_m=np.inf, E_L=0.0, V_reset=0.0, V_th=1.5))
    rule, late = neuro.r_stddp(d_min=1.5, d_max=6.25), np.array([[2.0], [4.0], [6.0], [2.0]])
    ends = neuro.pairs(pre=[0, 1, 2, 3], post=[0, 0, 0, 0])
    net.connect("inputs", "cells", ends, rule, weight=1.0, delay=late.ravel(), name="learnt")
    net.group("choice", neuro.winner_take_all(of="cells", first_to_fire=True))
    net.trials(input="inputs", duration=20.0, labels={"of": "cells"}, reward={"correct": reward, "wrong": -1.0})
    return net


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_trial_changes_delays_by_shares_of_them(backend):
    """The spikes of three inputs arrive at 2, 4 and 6 ms; that at 4 ms decides, and the fourth input is silent."""
    inputs = (np.zeros(3), np.arange(3), np.array([0, 3]))
    sim = neuro.compile(one_of_three(1.0), backend, seed=1)
    decided = sim.trials(*inputs, labels=[0], learn=True)
    assert decided.winner.tolist() == [0]
    assert sim.get("learnt", "delay") == pytest.approx([2.0 * 0.95, 4.0 * 0.95, 6.25, 2.0 * 1.05])
    assert sim.get("learnt", "weight").tolist() == [1.0] * 4
    sim.trials(*inputs, labels=[1], learn=True)
    punished = [2.0 * 0.95 * 1.1, 4.0 * 0.95 * 1.1, 6.25 * 0.98, 2.0 * 1.05 * 0.98]
    assert sim.get("learnt", "delay") == pytest.approx(punished)


@pytest.mark.parametrize("backend", BACKENDS)
def test_delays_of_trials_are_saved_kept_and_handed_on(backend, tmp_path):
    first, second = orders.batch(1, 12), orders.batch(2, 6)
    sim = neuro.compile(orders.network(), backend, seed=1)
    begun = sim.get("learnt", "delay")
    sim.trials(*first, learn=True)
    learnt = sim.get("learnt", "delay")
    assert np.abs(learnt - begun).max() > 0.5
    sim.save(tmp_path / "state.h5")
    handed = neuro.compile(sim.network(), backend, seed=1)
    assert handed.get("learnt", "delay") == pytest.approx(np.floor(learnt * 10.0 + 0.5) / 10.0)
    told = sim.trials(*second, learn=True)
    further = observe(sim)
    again = neuro.compile(orders.network(), backend, seed=1)
    again.restore(tmp_path / "state.h5")
    assert again.get("learnt", "delay").tolist() == learnt.tolist()
    assert again.trials(*second, learn=True).step.tolist() == told.step.tolist()
    assert not differences(further, observe(again), exact=True)
    sim.reset()
    assert sim.get("learnt", "delay").tolist() == further["delay of learnt"].tolist()
    sim.reset(weights=True)
    assert sim.get("learnt", "delay").tolist() == begun.tolist()


def right(rule: neuro.r_stddp, seed: int, trials: int, swapped: int) -> NDArray[np.bool_]:
    """Which trials are decided rightly, whose labels are swapped from one on."""
    times, inputs, begins, labels = orders.batch(1, trials, orders=seed)
    labels = np.where(np.arange(trials) < swapped, labels, 1 - labels)
    sim = neuro.compile(orders.network(rule), seed=seed)
    return sim.trials(times, inputs, begins, labels, learn=True).label == labels


def test_orders_are_told_apart_and_learnt_anew_when_labels_are_swapped():
    found = np.array([right(neuro.r_stddp(), seed, 900, 300) for seed in range(10)])
    assert found[:, 250:300].mean() >= 0.99
    assert found[:, 300:310].mean() < 0.5
    assert (found[:, -50:].mean(axis=1) >= 0.95).sum() >= 9


def test_the_signs_of_rates_of_weights_unlearn():
    signs = neuro.r_stddp(Ar_plus=0.05, Ar_minus=-0.05, Ap_plus=0.02, Ap_minus=-0.1)
    found = np.array([right(signs, seed, 200, 200) for seed in range(4)])
    assert found[:, -50:].mean() < 0.3


@pytest.mark.parametrize("rule", [neuro.r_stddp(), neuro.r_stdp()], ids=lambda rule: rule.name)
def test_bars_of_a_spiking_grid_are_told_apart_by_delays_and_by_weights(rule):
    times, inputs, begins, labels = orders.bars(3, 600)
    assert all(
        set(np.argsort(one)[:3]) == set(orders.BARS[label])
        for one, label in zip(times.reshape(-1, 9), labels, strict=True)
    )
    sim = neuro.compile(orders.network(rule, 4, 1.5), seed=3)
    rightly = sim.trials(times, inputs, begins, labels, learn=True).label == labels
    assert rightly[:8].mean() < 0.7
    assert rightly[-50:].mean() >= 0.96
    fixed = "weight" if rule.delays else "delay"
    assert len(np.unique(sim.get("learnt", fixed))) == 1


def onto_a_kernel() -> None:
    net = neuro.Network("shared")
    net.population("sheet", (1, 4, 4), neuro.spike_generator())
    net.population("maps", (2, "auto", "auto"), neuro.iaf_psc_delta())
    net.connect("sheet", "maps", neuro.grid(kernel=(2, 2)), neuro.r_stddp(), weight=1.0, delay=1.0, name="kernels")
    neuro.compile(net)


def test_what_a_rule_of_ones_own_must_have():
    class no_range(Synapse):
        delays = True

    class no_delay(neuro.stddp):
        states = ()

    teaching = neuro.r_stddp.arithmetic

    class of_weights(neuro.r_stddp):
        arithmetic = SimpleNamespace(
            __name__="own", constants=teaching.constants, teach=teaching.teach, settle=teaching.teach
        )

    for model, told in (
        (no_range, "expected a subclass of DelayRule, which has bounds of delays"),
        (
            no_delay,
            "changes delays: expected learns 'pairs' or 'trials', no dopamine, first state 'delay'",
        ),
        (of_weights, "changes delays: expected no function 'settle', which is for weights"),
    ):
        with pytest.raises(TypeError, match=told):
            complete(model)
