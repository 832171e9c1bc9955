"""Learning with three factors on Loihi 2: lava's engine, and what a described rule becomes for it."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import neuro
import random_learning
from neuro.model.synapses import loihi2_learning
from neuro.model.synapses.loihi_rule import POST, PRE, LearningRule, Outgoing, Trace
from neuro_chip.plastic import ThreeFactors

GOLDEN = Path(__file__).parent / "loihi2_three_factors"
CASES = json.loads((GOLDEN / "lava_0_10_0.json").read_text())
HELD = Trace(0, 1, 1)


class Given(ThreeFactors):
    """Its targets send what `sent` holds."""

    def outgoing(self, step):
        return self.sent[1:]


def engine(case, weights):
    """A projection that learns by the rule of a case; nothing but the test changes what its targets send."""
    dw, dt = (loihi2_learning.parse_products(case[word], word) for word in ("dw", "dt"))
    rule = LearningRule(dw, dt, dict.fromkeys((*PRE, *POST), HELD), case["t_epoch"], outgoing=Outgoing(0, 0))
    own = {"graded": GRADED[case["graded"]], "sign_mode": case["sign_mode"].lower()}
    n_post, n_pre = weights.shape
    ends, targets = np.arange(0, weights.size + 1, n_post), np.tile(np.arange(n_post, dtype=np.int32), n_pre)
    return Given("p", 0, rule, case | own, ends, targets, n_post, weights.T.ravel())


GRADED = {
    "USE_REGULAR_IMPULSE": "impulse",
    "OVERWRITE": "overwrite",
    "ADD_WITH_SATURATION": "add_with_saturation",
    "ADD_WITHOUT_SATURATION": "add_without_saturation",
}


@pytest.mark.parametrize("name", CASES)
def test_the_engine_equals_lava(name):
    with np.load(GOLDEN / "lava_0_10_0.npz") as file:
        arrays = {key.removeprefix(f"{name}__"): file[key] for key in file.files if key.startswith(f"{name}__")}
    plastic = engine(CASES[name], arrays["W0"])
    shape = arrays["W0"].shape
    for k, x in enumerate(arrays["x"]):
        plastic.sent = np.array([arrays[trace][k] for trace in POST])
        plastic.ys[0] = plastic.sent[0]
        pre = np.flatnonzero(x)
        plastic.step(k + 1, pre, np.flatnonzero(arrays["post"][k]), x[pre])
        np.testing.assert_array_equal(plastic.weights.reshape(shape[::-1]).T, arrays["weights"][k])
        np.testing.assert_array_equal(plastic.tags.reshape(shape[::-1]).T, arrays["tag_1"][k])
        np.testing.assert_array_equal(plastic.xs, [arrays[trace][k] for trace in PRE])


@pytest.mark.parametrize("seed", range(12))
def test_networks_that_learn_equal_a_twin(seed):
    net, signals = random_learning.network(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "loihi2", seed=seed)
        for k, (learnt, fired) in enumerate(random_learning.twin(net, signals, seed), 1):
            sim.run(1.0)
            if k in signals:
                for part in (1, 2):
                    sim.signal(f"n{part}", signals[k][: net.populations[str(part)].shape[0]])
            for name, (weights, tags) in zip(net.projections, learnt, strict=True):
                assert sim.get(name, "weight", raw=True).tolist() == np.ravel(weights).tolist(), (k, name)
                assert sim.get(name, "t", raw=True).tolist() == np.ravel(tags).tolist(), (k, name)
            for part in (1, 2):
                times, ids = sim.spikes(str(part))
                assert ids[times == k].tolist() == fired[part]


def rewarded(seed=0):
    """Pairs of spikes and a signal of both signs onto two neurons."""
    net = neuro.Network("rewarded", resolution=1.0)
    net.population("in", 3, neuro.spike_generator(spike_times=[np.arange(3.0 + i, 400.0, 17.0 + i) for i in range(3)]))
    net.population("out", 2, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=10.0, t_ref=0.0, I_e=[200.0, 260.0]))
    net.signal("reward", to="out")
    rule = neuro.stdp_dopa(A_minus=0.5, tau_c=100.0, tau_n=50.0, Wmax=4.0, signal="reward")
    net.connect("in", "out", neuro.all_to_all(), rule, weight=2.0, delay=1.0, name="rule")
    with pytest.warns(neuro.ApproximationWarning, match="n is y2 - y3"):
        return neuro.compile(net, "loihi2", seed=seed, signals={"rule": 0.004})


def taught(sim, steps):
    """Weights and eligibilities after some rewards."""
    for value in steps:
        sim.signal("reward", [value, -value])
        sim.run(50.0)
    return np.concatenate([sim.get("rule", name) for name in ("weight", "c", "n", "K_plus")])


def test_reward_and_punishment_move_weights_apart(tmp_path):
    sim = rewarded()
    sim.run(100.0)
    assert sim.weights("rule")[2].tolist() == pytest.approx([2.0] * 6, abs=0.01)  # no dopamine, no change
    sim.signal("reward", [0.003, -0.003])
    n = sim.get("rule", "n")
    assert n.tolist() == pytest.approx([0.003, -0.003] * 3, abs=0.0001)
    sim.save(tmp_path / "state.h5")
    whole = taught(sim, (0.003, 0.004, 0.003))
    rule = sim.weights("rule")[2].reshape(3, 2)
    assert (rule[:, 0] > 2.05).all()
    assert (rule[:, 1] < 1.95).all()
    other = rewarded()
    other.restore(tmp_path / "state.h5")
    assert np.array_equal(taught(other, (0.003, 0.004, 0.003)), whole)
    assert not np.array_equal(taught(rewarded(seed=1), (0.0, 0.0, 0.003, 0.004, 0.003)), whole)
    bill = sim.energy("loihi2")
    assert "learning_update" in bill.missing
    assert "> " in str(bill)
