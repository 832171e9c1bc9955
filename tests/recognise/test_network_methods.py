"""Every method that shows frames to a network: it learns, goes on after a stop, runs on chips, and has a bill.

The network that is shown events at their times is in test_hfirst_method.py.
"""

import numpy as np
import pytest

import neuro
from neuro.chips import Energy
from neuro.events import Events
from neuro_models import path
from neuro_recognise.method import METHODS, choose
from neuro_recognise.methods.framewise import Framewise
from neuro_recognise.parts.layers import Inputs, Layer, Shares
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features

FRONT_END = {"segmenter": "msd", "bank": "gabors", "pool": "max", "encoder": "log_latency"}
SMALL = {
    "edhmax_tempotron": {**FRONT_END, "per_class": 3, "epochs": 5, "share": 0.6},
    "masquelier_thorpe": {"field": 5, "theta": 8.0, "maps": 8, "epochs": 3},
    "mozafari": {"field": 7, "theta": 16.0, "per_class": 2, "epochs": 3},
    "must": {"neurons": 30, "theta": 8.0, "rise": 1.0, "total": 100.0, "epochs": 3},
    "remus": {"field": 7, "theta": 16.0, "per_class": 2, "epochs": 3},
}


def small(name, **more):
    """A method with settings that go with `letters`."""
    return method_of(name, "", {"size": [16, 16], "window": 10.0, **SMALL[name], **more})


@pytest.fixture(scope="module", params=SMALL)
def made(request, letters):
    return learn(small(request.param), letters, "letters", seed=1)


def test_all_of_them_are_here():
    assert set(SMALL) == {name for name, method in METHODS.items() if issubclass(method, Framewise)}


@pytest.mark.parametrize("backend", ["event", "loihi", "spinnaker"])
@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_it_decides_and_has_a_bill(made, letters, backend):
    """Learnt from floats, asked on chips; recordings without frames are silent everywhere."""
    answer = made.method.answer(made.learnt, letters, backend)
    assert made.method.vote in answer.votes
    for scores in answer.votes.values():
        assert np.mean(choose(scores)[:24] == letters.labels[:24]) >= 0.9
        assert np.isnan(scores[24:]).all()
    sim, results = answer.run()
    assert len(results) == 72
    assert isinstance(sim.energy("loihi", of=results), Energy)


def test_event_equals_reference(made, letters):
    part = letters.take(range(3))
    one, other = (made.method.answer(made.learnt, part, backend) for backend in ("event", "reference"))
    np.testing.assert_allclose(one.scores, other.scores, rtol=0, atol=1e-9)
    for vote, scores in one.votes.items():
        assert np.array_equal(choose(scores), choose(other.votes[vote])), vote


class Stop(Exception):
    pass


def test_a_training_goes_on(made, letters, tmp_path):
    """After a stop in the second epoch to the same bits, from a file as without one."""

    def stop(progress):
        if progress.what.startswith("epoch 2"):
            raise Stop

    out = tmp_path / "model.h5"
    with pytest.raises(Stop):
        learn(made.method, letters, "letters", seed=1, out=out, report=stop)
    again = learn(made.method, letters, "letters", seed=1, out=out)
    assert again.learnt.keys() == made.learnt.keys()
    for name, part in made.learnt.items():
        assert np.array_equal(again.learnt[name], part, equal_nan=name in ("history", "mistakes")), name
    assert learn(made.method, letters, "letters", seed=1, out=out, report=pytest.fail).training == made.training


@pytest.fixture(scope="module")
def bars():
    rng = np.random.default_rng(0)
    made = []
    for k in range(16):
        along, across = rng.integers(4, 13, 900), 6 + np.arange(900) // 180 + rng.integers(0, 2, 900)
        x, y = (along, across) if k % 2 else (across, along)
        made.append(Events(np.arange(900) * 100, x, y, rng.integers(0, 2, 900), (16, 16)))
    return made


@pytest.mark.parametrize("front_end", [{}, {"segmenter": "ses", "bank": "leaky_gabors", "pool": "local_maximum"}])
@pytest.mark.parametrize("name", SMALL)
def test_scores_on_the_way(name, front_end, bars):
    """At the end they are the scores; what comes later has no influence; before the first frame nobody speaks."""
    method = small(name, **front_end)
    labels = np.arange(len(bars)) % 2
    shown = Features([method.observe(one) for one in bars], labels, tuple(map(str, labels)), ("upright", "lying"))
    made = learn(method, shown, "bars", seed=1)
    events = bars[0]
    at = made.scores_at(events, [0.0, 60.0, 90.0, 1000.0])
    assert np.isnan(at[0]).all()
    np.testing.assert_allclose(at[-1:], made.scores(events), rtol=1e-12)
    assert front_end or not np.isnan(at[-1]).any()
    other = bars[1]
    changed = Events(
        events.t, np.where(events.t > 60_000, other.x, events.x), np.where(events.t > 60_000, other.y, events.y),
        events.p, events.sensor_size,
    )  # fmt: skip
    np.testing.assert_allclose(made.scores_at(changed, [60.0]), at[1:2], rtol=1e-12)


def test_files_of_networks_have_the_settings_defaults():
    """What a layer sets beside its input are the numbers of its file, unless it tells why."""
    inputs = {"tempotron": Inputs((16, 34, 34), 64.0, 1.0), "mozafari": Inputs((4, 17, 17), 64.0, 1.0)}
    for file, shape in inputs.items():
        layer = Layer.named(file)
        layer = layer.changed({"per_class": neuro.load(path(file)).trials_section.labels.maps_per_label})
        net, made = neuro.load(path(file)), layer.network(shape, classes=10)
        assert (net.populations.keys(), net.trials_section) == (made.populations.keys(), made.trials_section)
        for name, one in net.projections.items():
            assert one.synapse.parameters() == pytest.approx(made.projections[name].synapse.parameters())
            assert one.weight == made.projections[name].weight


def test_a_spike_raises_a_tempotron_by_its_weight():
    """It fires if the weight is its threshold, and not if it is a little less."""
    for weight, fires in ((0.5001, True), (0.4999, False)):
        layer = Layer.named("tempotron").changed({"theta": 0.5, "spread": 0.0, "weight": weight})
        told = neuro.compile(layer.network(Inputs((1, 1, 1), 64.0, 0.01), 2)).trials([0.0], [0], [0, 1])
        assert (told.winner[0] >= 0) == fires


def test_mozafari_learns_less_from_what_it_knows():
    """Right in all of the last epoch, rewards have the smallest factor and punishments the largest; after silence both
    have the smallest."""
    layer = small("mozafari").layer
    sim = neuro.compile(layer.network(Inputs((4, 8, 8), 10.0, 1.0), 3))
    seen = []
    for last in (None, Shares(right=1.0, wrong=0.0), Shares(right=0.25, wrong=0.5), Shares(right=0.0, wrong=0.0)):
        layer.begin(sim, 1, last)
        rule = sim.network().projections["c1_s2"].synapse
        seen.append((rule.misses, rule.hits))
    np.testing.assert_allclose(seen, [(0.2 + 0.8 * 2 / 3, 0.2 + 0.8 / 3), (0.2, 1.0), (0.6, 0.4), (0.2, 0.2)])


def test_silence_is_no_mistake(letters):
    """With a threshold that no input reaches all frames are silent: neither right nor wrong in any epoch."""
    learnt = learn(small("mozafari", theta=1e4), letters, "letters").learnt
    assert learnt["history"].tolist() == learnt["mistakes"].tolist() == [0.0] * 3


def test_masquelier_thorpe_doubles_its_rates():
    layer = small("masquelier_thorpe").layer
    sim = neuro.compile(layer.network(Inputs((4, 8, 8), 10.0, 1.0), 3))
    for seen, rate in ((0, 2**-6), (399, 2**-6), (400, 2**-5), (1600, 0.25), (10**6, 0.25)):
        layer.pace(sim, seen)
        rule = sim.network().projections["c1_s2"].synapse
        assert (rule.A_plus, rule.A_minus) == (rate, -0.75 * rate)


def test_must_names_neurons_by_what_they_win(letters):
    method = small("must")
    made = learn(method, letters, "letters", seed=1)
    labels = made.learnt["labels"]
    assert set(labels[labels >= 0]) == {0, 1, 2}
    thresholds = made.learnt["thresholds"]
    assert (thresholds >= 8.0).all()
    assert thresholds.max() > 8.5
    model = made.network().populations["excited"].model
    assert np.array_equal(model.V_th, thresholds)
