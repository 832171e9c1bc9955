"""Delays that learn on Loihi: whole steps in the register, 1/256 steps in the tag."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import neuro
from neuro.testing import observe
from neuro.testing.case import differences
from neuro_models import orders
from neuro_models.delays import BETWEEN, drawn_onsets, gathering, spread
from refused import refused

pytestmark = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")


def gathered(onsets, presentations, by_step=False, **rule):
    """The network of `gathering` with a refractory period that a register holds."""
    net = gathering(onsets, presentations, by_step)
    cells, wires = net.populations["cells"], net.projections["gathered"]
    net.populations["cells"] = replace(cells, model=replace(cells.model, t_ref=60.0))
    net.projections["gathered"] = replace(wires, synapse=replace(wires.synapse, **rule))
    return net


def twin(delay, low, high, window, pre, post, last):
    """One synapse in whole numbers of 1/256 steps: each post spike, then each pre spike, of every step."""
    last_pre = last_post = None
    for step in range(1, last + 1):
        if step in post and last_pre is not None:
            delay = min(high, max(low, delay + window(256 * (step - last_pre) - delay)))
        if step in pre and last_post is not None:
            delay = min(high, max(low, delay + window(256 * (last_post - step) - delay)))
        last_pre, last_post = (step if step in pre else last_pre), (step if step in post else last_post)
    return delay


def by_step(late):
    return int(math.copysign(min(256, abs(late)), late)) if abs(late) <= 50 * 256 else 0


def smooth(late):
    return math.floor(0.1 * late * math.exp(-abs(late) / 256 / 20.0) + 0.5)


@pytest.mark.parametrize(("stepwise", "window"), [(True, by_step), (False, smooth)])
def test_registers_and_tags_are_those_of_a_twin_in_whole_numbers(stepwise, window):
    onsets = drawn_onsets(seed=8, cells=3)
    sim = neuro.compile(gathered(onsets, 12, stepwise, d_max=40.0), "loihi", seed=1)
    sim.run(12 * BETWEEN)
    register, tag = (sim.get("gathered", name, raw=True) for name in ("delay", "tag"))
    steps = register + 1  # the register of a spike that acts after one step is 0
    assert (np.abs(tag) <= 128).all()
    assert np.array_equal(sim.get("gathered", "delay"), steps + tag / 256)
    times, ids = sim.spikes("cells")
    for k, onset in enumerate(onsets.ravel().tolist()):
        pre = {int(onset + 1 + BETWEEN * n) for n in range(12)}
        post = {int(time) for time, neuron in zip(times, ids, strict=True) if neuron == k // 8}
        assert 256 * steps[k] + tag[k] == twin(31 * 256, 256, 40 * 256, window, pre, post, 2400)


@pytest.mark.parametrize("stepwise", [True, False])
def test_inputs_come_to_arrive_together(stepwise):
    onsets = drawn_onsets(seed=5, cells=20)
    found = []
    for backend in ("loihi", "event"):
        sim = neuro.compile(gathered(onsets, 70, stepwise), backend, seed=1)
        sim.run(70 * BETWEEN)
        assert spread(onsets, sim.get("gathered", "delay")).tolist() == [0.0] * 20
        found.append(observe(sim))
    if stepwise:  # of whole steps nothing is rounded
        delays = "delay of gathered"
        assert found[0][delays].tolist() == found[1][delays].tolist()
        assert np.array_equal(found[0]["spikes of cells: steps"], found[1]["spikes of cells: steps"])


def test_learnt_delays_are_saved_kept_and_handed_on(tmp_path):
    net = gathered(drawn_onsets(seed=2, cells=2), 10)
    sim = neuro.compile(net, "loihi", seed=1)
    sim.run(2.5 * BETWEEN)
    sim.save(tmp_path / "state.h5")
    learnt = sim.get("gathered", "delay")
    assert np.abs(learnt - 31.0).max() > 1.0
    handed = neuro.compile(sim.network(), "loihi", seed=1)
    assert handed.get("gathered", "delay").tolist() == np.floor(learnt + 0.5).tolist()
    sim.run(BETWEEN)
    further = observe(sim)
    sim.reset()
    assert sim.get("gathered", "delay").tolist() == further["delay of gathered"].tolist()
    sim.reset(weights=True)
    assert sim.get("gathered", "delay").tolist() == [31.0] * 16
    again = neuro.compile(net, "loihi", seed=1)
    again.restore(tmp_path / "state.h5")
    assert again.get("gathered", "delay").tolist() == learnt.tolist()
    again.run(BETWEEN)
    assert not differences(further, observe(again), exact=True)


def ordered(rule):
    """The network of `orders` in steps of which a register holds enough."""
    net = orders.network(rule)
    net.resolution = 0.5
    return net


def test_reward_orders_delays_as_on_event():
    times, inputs, begins, labels = orders.batch(1, 150, orders=4)
    times, cut = np.rint(2.0 * times) / 2.0, 40 * orders.INPUTS
    found = []
    for backend in ("loihi", "event"):
        sim = neuro.compile(ordered(neuro.r_stddp()), backend, seed=4)
        first = sim.trials(times[:cut], inputs[:cut], begins[:41], labels[:40], learn=True)
        found.append((first.winner, sim.get("learnt", "delay")))
        if backend == "loihi":
            assert (sim.get("learnt", "tag", raw=True) != 0).mean() > 0.5
        told = sim.trials(times[cut:], inputs[cut:], begins[40:] - cut, labels[40:], learn=True)
        assert (told.winner == labels[40:])[-60:].mean() >= 0.95
    assert np.array_equal(found[0][0], found[1][0])
    assert np.abs(found[0][1] - found[1][1]).max() < 0.05


def test_what_a_chip_cannot_is_refused(messages):
    onsets = drawn_onsets(seed=2, cells=1)
    nets = {"loihi": gathered(onsets, 1, d_max=70.0), "spinnaker": gathered(onsets, 1)}
    told = {name: refused(neuro.compile, net, name) for name, net in nets.items()}
    told = {name: re.sub(r"\w+\.py:[0-9]+: ", "", text) for name, text in told.items()}
    sim = neuro.compile(gathered(onsets, 1), "loihi")
    told |= {"set": refused(sim.set, "gathered", A=0.5), "get": refused(sim.get, "gathered", "late", raw=True)}
    messages(told)


def test_what_is_approximated_is_told():
    onsets = drawn_onsets(seed=2, cells=1)
    kept = "delays are whole steps in the register and 1/256 of a step in the tag; the host changes them by "
    with pytest.warns(neuro.ApproximationWarning, match=f"stddp: {kept}times of spikes, which its learning engine"):
        neuro.compile(gathered(onsets, 1), "loihi")
    with pytest.warns(neuro.ApproximationWarning, match=f"r_stddp: {kept}the ends of trials"):
        neuro.compile(ordered(neuro.r_stddp()), "loihi")
