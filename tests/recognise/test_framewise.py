"""Methods that show frames to a network: they learn, go on after a stop, are kept, asked often, and have a bill."""

import hashlib
import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from neuro.apps import evaluate
from neuro.chips import Energy
from neuro.core import hdf5
from neuro.events import Events, recordings
from neuro_models import names, path
from neuro_recognise.energy import bills
from neuro_recognise.method import METHODS, SILENT, choose
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.methods.framewise import Framewise, Inputs, Layer, Shares, frames_to_learn_from
from neuro_recognise.observations import observe
from neuro_recognise.parts.frames import Frames
from neuro_recognise.recogniser import AT_MOST, Ready, Recogniser, learn, method_of
from neuro_recognise.shown import Features
from neuro_recognise.telling.report import Tried, training_summary
from refused import refused

FRONT_END = {"segmenter": "msd", "bank": "gabors", "pool": "max", "encoder": "log_latency"}
SMALL = {
    "layered": {
        "features.maps": 10,
        "features.field": 3,
        "features.theta": 2.5,
        "layer.field": 3,
        "layer.theta": 3.0,
        "per_class": 2,
        "epochs": 3,
    },
    "edhmax_tempotron": {**FRONT_END, "per_class": 3, "epochs": 5, "share": 0.6},
    "masquelier_thorpe": {"field": 5, "theta": 8.0, "maps": 8, "epochs": 3},
    "mozafari": {"field": 7, "theta": 16.0, "per_class": 2, "epochs": 3},
    "must": {"neurons": 30, "theta": 8.0, "rise": 1.0, "total": 100.0, "epochs": 3},
    "remus": {"field": 7, "theta": 16.0, "per_class": 2, "epochs": 3},
}
CHIPS = ("loihi", "spinnaker")
approximates = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")


def with_small(name, **more):
    """A method with settings that go with `letters`."""
    return method_of(name, "", {"size": [16, 16], "window": 10.0, **SMALL[name], **more})


@pytest.fixture(scope="module", params=SMALL)
def made(request, letters):
    return learn(with_small(request.param), letters, "letters", seed=1)


@pytest.fixture(scope="module")
def model(letters, small, train):
    """ReMuS with the preset `adapted`."""
    return train(letters, small, seed=1)


@pytest.fixture(scope="module")
def better(letters, small, train):
    """ReMuS with more maps, epochs and rescue."""
    return train(letters, small.changed({"per_class": 3, "rescue": True, "order": "frames", "epochs": 6}), seed=1)


def same(a, b):
    """Whether two recognisers are the same to the bit."""
    arrays = all(np.array_equal(a.learnt[name], b.learnt[name]) for name in ("c1_s2", "history", "seed"))
    texts = a.learnt["network"] == b.learnt["network"] and a.learnt.keys() == b.learnt.keys()
    return arrays and texts and (a.method, a.classes, a.training) == (b.method, b.classes, b.training)


def same_votes(one, other):
    assert one.votes.keys() == other.votes.keys()
    return all(np.array_equal(one.votes[name], other.votes[name], equal_nan=True) for name in one.votes)


class Stop(Exception):
    pass


def stop_in(epoch):
    """A report that stops a training in an epoch."""

    def stop(progress):
        if progress.what.startswith(f"epoch {epoch}"):
            raise Stop

    return stop


def test_all_of_them_are_here():
    assert set(SMALL) == {name for name, method in METHODS.items() if issubclass(method, Framewise)}


@pytest.mark.parametrize("backend", ["event", *CHIPS])
@approximates
def test_each_decides_alike_and_has_a_bill(made, letters, backend):
    """Learnt from floats, asked on chips; recordings without frames are silent everywhere."""
    answer = made.method.answer(made.learnt, letters, backend)
    assert made.method.vote in answer.votes
    for scores in answer.votes.values():
        assert np.mean(choose(scores)[:24] == letters.labels[:24]) >= 0.9
        assert np.isnan(scores[24:]).all()
    if made.method.network(made.learnt) is None:  # layers that run one after the other have no common bill
        assert answer.run is None
        return
    sim, results = answer.run()
    assert len(results) == 72
    assert isinstance(sim.energy("loihi", of=results), Energy)


def test_a_training_of_each_goes_on_draws_and_decides_on_the_reference_alike(made, letters, tmp_path):
    name, n = made.method.called(), {"masquelier_thorpe": 8, "must": 3 * 8, "mozafari": 6, "remus": 6, "layered": 10}
    drawn = made.method.pictures(made.learnt, made.classes)
    assert ("learning" in drawn) == made.method.layer.supervised
    if name in n:
        figure = drawn.get("features") or drawn["prototypes"]
        key = 1 if "prototypes" in drawn else 0  # to the colours of prototypes
        assert len(figure.axes) == n[name] + key
    else:
        assert list(drawn) == ["learning"]
    part = letters.take(range(3))
    one, other = (made.method.answer(made.learnt, part, backend) for backend in ("event", "reference"))
    np.testing.assert_allclose(one.scores, other.scores, rtol=0, atol=1e-9)
    for vote, scores in one.votes.items():
        assert np.array_equal(choose(scores), choose(other.votes[vote])), vote
    words, out = {"seed": 1, "out": tmp_path / "model.h5"}, []
    with pytest.raises(Stop):
        learn(made.method, letters, "letters", **words, report=stop_in(2))
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5.training"]
    again = learn(made.method, letters, "letters", **words, report=lambda progress: out.append(progress.what))
    assert not any(what.startswith("epoch 1 ") for what in out)
    assert again.learnt.keys() == made.learnt.keys()
    for name, part in made.learnt.items():
        assert np.array_equal(again.learnt[name], part, equal_nan=name in ("history", "mistakes")), name
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5"]
    assert learn(made.method, letters, "letters", **words, report=pytest.fail).training == made.training


def pooled_by_hand(weights, theta, codes, ids, last):
    """Tick by (feature, row, column) of a cell of 2 x 2 places: the first of its places to choose that feature."""
    maps, _, side, _ = weights.shape
    rows = 8 - side + 1
    potential, chosen = np.zeros((maps, rows, rows)), np.zeros((rows, rows), bool)
    ticks = {}
    for tick in range(last):  # a spike arrives one tick later
        for channel, y, x in zip(*np.unravel_index(ids[codes == tick], (4, 8, 8)), strict=True):
            for i, j in np.ndindex(side, side):
                if 0 <= y - i < rows and 0 <= x - j < rows:
                    potential[:, y - i, x - j] += weights[:, channel, i, j]
        for y, x in zip(*np.nonzero((potential.max(axis=0) >= theta) & ~chosen), strict=True):
            ticks.setdefault((int(potential[:, y, x].argmax()), int(y) // 2, int(x) // 2), tick + 1)
            chosen[y, x] = True
    return ticks


def test_the_upper_layer_sees_the_first_feature_of_each_place_once_in_a_cell(letters):
    made = learn(with_small("layered", epochs=1), letters, "letters", seed=1)
    entered = made.method.entering(made.learnt)(letters)
    for recording in (0, 1, 2, 24):
        shown, above = (Frames.of(one.take([recording])) for one in (letters, entered))
        assert len(shown) == len(above)
        for k in range(len(shown)):
            one, other = shown.take(np.array([k])), above.take(np.array([k]))
            by_hand = pooled_by_hand(made.learnt["features"], 2.5, one.codes, one.ids, last=9)
            cells = zip(*np.unravel_index(other.ids.astype(int), (10, 3, 3)), strict=True)
            assert dict(zip(((int(m), int(y), int(x)) for m, y, x in cells), other.codes, strict=True)) == by_hand
            assert len(by_hand) > 9
            assert (np.diff(other.codes.astype(int)) >= 0).all()


def test_layers_refuse_parts_that_cannot_be_joined():
    assert refused(method_of, "layered", "", {"features": "must"}) == (
        "method 'layered': features = must: expected masquelier_thorpe"
    )
    assert refused(method_of, "layered", "", {"encoder": "latency"}) == (
        "method 'layered': encoder = latency: expected log_latency"
    )
    assert refused(method_of("layered", "", {"features.field": 19}).fitting, (34, 34)) == (
        "method 'layered': features.field = 19: expected at most 17, the cells of the front end"
    )


def test_remus_learns_on_the_reference_alike(letters, small, train):
    part = letters.take(range(6))
    models = [train(part, replace(small, epochs=2), seed=3, backend=backend) for backend in ("event", "reference")]
    np.testing.assert_allclose(models[0].learnt["c1_s2"], models[1].learnt["c1_s2"], rtol=0, atol=1e-9)
    assert np.array_equal(models[0].learnt["history"], models[1].learnt["history"])


def test_seeds_batches_rates_and_files(letters, small, train, model, monkeypatch, tmp_path):
    assert not same(train(letters, small, seed=6), model)
    decayed = train(letters, small.changed({"rate_decay": 0.1}), seed=1).learnt
    assert not np.array_equal(model.learnt["c1_s2"], decayed["c1_s2"])
    assert model.learnt["history"][0] == decayed["history"][0]
    reports = []
    monkeypatch.setattr("neuro_recognise.methods.framewise.Layer.batch", 10)
    assert same(train(letters, small, seed=1, report=reports.append), model)
    assert [(r.what, r.done, r.total) for r in reports[:2]] == [("epoch 1 of 3", n, 72) for n in (10, 20)]
    assert (reports[-1].done, reports[-1].right) == (72, model.learnt["history"][-1])
    out = tmp_path / "model.h5"
    with pytest.raises(Stop):
        train(letters, small, seed=2, out=out, report=stop_in(2))
    assert refused(train, letters, small, seed=3, out=out) == (
        f"{out}.training: an unfinished training with seed = 2: found 3 now\n"
        "  hint: give the same options to continue it, or delete the file"
    )
    longer = train(letters, replace(small, epochs=4), seed=2, out=out)  # more epochs are the same training
    assert same(longer, train(letters, replace(small, epochs=4), seed=2))


@pytest.mark.slow
def test_the_same_bits_after_kills():
    script = Path(__file__).parents[1] / "helpers" / "kills.py"
    subprocess.run([sys.executable, script, "remus", "3", "0"], check=True)


@pytest.mark.parametrize("segmenter", ["msd", "counts", "hes"])
def test_the_proposed_setting_gives_frames(shapes_folder, segmenter):
    """A segmenter that never cuts proposes a value of its setting with which the same recordings have some frames."""
    none = {"msd": {"threshold": 1e6}, "counts": {"count": 1 << 30}, "hes": {"segmenter.window": 1e6}}[segmenter]
    events = recordings(shapes_folder)[0].load()
    method = method_of("remus", "", {"segmenter": segmenter, "size": list(events.sensor_size), **none})
    features = Features([method.observe(events)], np.array([0]), ("shape",), ("shape",))
    with pytest.raises(neuro.ModelError, match="long enough for a frame: found") as error:
        frames_to_learn_from(features, method.segmenter)
    name, value = re.match(r"--set segmenter\.(\w+)=(\S+) gives", error.value.hint).groups()
    better = method.changed({f"segmenter.{name}": type(getattr(method.segmenter, name))(value)})
    assert 2 <= len(Frames.of(replace(features, evidence=[better.observe(events)]))) <= 8


def test_a_training_that_stays_at_chance_is_named(model):
    assert "chance" not in training_summary(model)
    learnt = {**model.learnt, "history": np.array([0.9, 0.3])}
    text = training_summary(Recogniser(model.method, model.classes, learnt, model.training))
    assert "\nwarning: 30.0% of the frames were decided rightly in the last epoch; chance is 33.3%" in text


def test_a_model_file_and_others(letters, model, tmp_path):
    model.save(tmp_path / "model.h5")
    again = Recogniser.load(tmp_path / "model.h5")
    assert same(model, again)
    assert (again.method.inputs.shape, model.network()) == ((4, 8, 8), again.network())
    with h5py.File(tmp_path / "model.h5") as file:
        assert file.attrs["neuro"] == neuro.__version__
        assert "winner_take_all" in file["learnt/network"].asstr()[()]
    assert same_votes(*(m.method.answer(m.learnt, letters) for m in (model, again)))
    file = tmp_path / "other.h5"
    assert refused(Recogniser.load, file) == f"{file}: no such file: expected a neuro recogniser 1"
    file.write_bytes(b"text")
    assert refused(Recogniser.load, file) == f"{file}: not a neuro recogniser 1"
    with hdf5.writing(file, "neuro recogniser 1", replace=True) as f:
        f.attrs["method"], f.attrs["settings"] = "remus", "{}"
    assert refused(Recogniser.load, file) == f"{file}: damaged neuro recogniser 1: 'size'"


def test_recordings_without_frames(letters, small, train, model):
    nothing = (
        "no recording is long enough for a frame: found 0 events in 0 ms (median); segmenter msd, tau = 0.02, "
        "threshold = 150: expected a frame\n  hint: the settings of the segmenter, "
        "as neuro recognise list METHOD shows them, decide where frames end"
    )
    assert refused(train, letters.take([24, 25]), small) == nothing
    for scores in model.method.answer(model.learnt, letters).votes.values():
        assert (choose(scores)[:24] >= 0).all()
        assert choose(scores)[24:].tolist() == [SILENT, SILENT]
    for part in (letters.take([24, 25]), letters.take([])):
        for scores in model.method.answer(model.learnt, part).votes.values():
            assert scores.shape == (len(part), 3)
            assert np.isnan(scores).all()


@pytest.mark.parametrize("backend", ["event", *CHIPS])
@approximates
def test_what_was_asked_before_changes_nothing(letters, model, backend):
    ask = model.method.asker(model.learnt, backend)
    for part in (letters, letters.take([3]), letters.take([24, 7]), letters, letters.take([])):
        told, alone = ask(part), model.method.answer(model.learnt, part, backend)
        assert same_votes(told, alone)
        assert told.scores.shape == (len(part), 3)
        (sim, taken), (_, once) = told.run(), alone.run()
        assert (taken.counts, sim.energy("loihi", of=taken)) == (once.counts, sim.energy("loihi", of=once))


def test_batches_change_nothing(letters, monkeypatch):
    method = with_small("must", epochs=1)
    whole = learn(method, letters, "letters")
    answer = method.answer(whole.learnt, letters)
    monkeypatch.setattr("neuro_recognise.methods.framewise.AT_ONCE", 5)
    parts = learn(method, letters, "letters")
    for word in whole.learnt:
        np.testing.assert_array_equal(parts.learnt[word], whole.learnt[word])
    in_batches = method.answer(whole.learnt, letters)
    assert same_votes(in_batches, answer)
    assert len(in_batches.run()[1]) == len(answer.run()[1]) == 72
    told = [Tried(evaluate(choose(a.scores), letters.labels, letters.classes), {}, a) for a in (answer, in_batches)]
    assert bills(told[0], ["loihi", "gpu"]).bills == bills(told[1], ["loihi", "gpu"]).bills


def test_a_network_is_compiled_once_few_are_kept_and_copies_begin_anew(letters, model, monkeypatch):
    compiled, compile_ = [], neuro.compile
    monkeypatch.setattr(neuro, "compile", lambda *args, **words: compiled.append(1) or compile_(*args, **words))
    ready = Ready()
    ask = [ready.asker(model.method, model.learnt, backend) for backend in ("event", "event", "reference", "event")]
    assert ask[0] is ask[1] is ask[3]
    assert len(compiled) == 2
    assert same_votes(ask[0](letters), model.method.answer(model.learnt, letters))
    learnt = [dict(model.learnt) for _ in range(AT_MOST + 1)]
    made = [ready.asker(model.method, one, "event") for one in learnt]
    assert all(ready.asker(model.method, one, "event") is ask for one, ask in zip(learnt[1:], made[1:], strict=True))
    assert ready.asker(model.method, learnt[0], "event") is not made[0]
    model._cache.asker(model.method, model.learnt, "event")
    assert pickle.loads(pickle.dumps(model)).classes == model.classes


@approximates
@pytest.mark.parametrize("chip", CHIPS)
def test_a_chip_decides_alike_and_learns_to_the_same_bits(letters, better, chip, train, tmp_path):
    one, other = (better.method.answer(better.learnt, letters, backend) for backend in ("event", chip))
    event, there = (
        better.method.present(better.method.simulation(better.learnt, backend), better.learnt, letters)[0]
        for backend in ("event", chip)
    )
    assert np.mean(there.label == event.label) >= 0.98
    same = (there.step == event.step) & (there.winner == event.winner)
    assert np.mean(same) >= 0.9
    np.testing.assert_allclose(there.potential[same], event.potential[same], rtol=0, atol=0.15)  # 34 x half a step
    assert all(np.mean(choose(scores) == choose(other.votes[vote])) >= 0.96 for vote, scores in one.votes.items())
    assert np.count_nonzero(event.label >= 0) > 60
    model = train(letters, better.method, seed=1, backend=chip)
    kernels = model.learnt["c1_s2"]
    assert model.learnt["history"][-1] > model.learnt["history"][0]
    decided = choose(model.method.answer(model.learnt, letters, chip).votes["potentials"])
    assert np.mean(decided[:24] == letters.labels[:24]) >= 0.9
    assert not np.array_equal(kernels, better.learnt["c1_s2"])
    words, epochs = {"seed": 1, "backend": chip, "out": tmp_path / "model.h5"}, []
    with pytest.raises(Stop):
        train(letters, better.method, **words, report=stop_in(2))
    ended = train(letters, better.method, **words, report=lambda p: epochs.append(p.what))
    assert set(epochs) == {f"epoch {k} of 6" for k in range(2, 7)}
    assert np.array_equal(ended.learnt["c1_s2"], kernels)
    if chip == "loihi":
        values = np.unique(kernels)
        assert 20 < len(values) <= 256
        step = np.diff(values).min()
        np.testing.assert_allclose(values / step, np.rint(values / step), atol=1e-9)
        assert (values.min() >= 0.0, values.max() <= 1.0) == (True, True)
        assert np.array_equal(model.method.simulation(model.learnt, chip).weights("c1_s2"), kernels)


def test_what_is_approximated_names_no_file(model):
    """A model's network came from a text, so there is no file in which to look."""
    with pytest.warns(neuro.ApproximationWarning) as told:
        model.method.simulation(model.learnt, "spinnaker")
    assert str(told[0].message) == (
        "backend 'spinnaker': population 's2': iaf_psc_delta: no released SpiNNaker binary has it: "
        "it is emulated in the same arithmetic, slots added to v"
    )


@pytest.mark.parametrize(
    ("settings", "history", "kernels"),
    [("adapted", [32 / 48, 1.0, 1.0], "4a791ceea5f144de"), ("best", [34 / 48, 38 / 48, 46 / 48], "036bc5f4c2d820bd")],
)
def test_remus_learns_the_kernels_that_it_always_did(settings, history, kernels):
    """The digests are of kernels that version 0.1.0 learnt, rounded to what no machine adds differently."""
    rng, bars = np.random.default_rng(0), []
    for k in range(24):
        along, across = rng.integers(8, 27, 900), 14 + np.arange(900) // 180 + rng.integers(0, 2, 900)
        x, y = (along, across) if k % 2 else (across, along)
        bars.append(Events(np.arange(900) * 100, x, y, rng.integers(0, 2, 900), (34, 34)))
    method = method_of("remus", settings, {"theta": 40, "per_class": 2, "epochs": 3}).fitting((34, 34))
    order = sorted(range(16), key=lambda k: (k % 2 == 0, k))  # as in a folder: by class, then by name
    evidence, labels = [method.observe(bars[k]) for k in order], np.array([0 if k % 2 else 1 for k in order])
    made = learn(method, Features(evidence, labels, tuple(map(str, order)), ("lying", "upright")), "bars", seed=3)
    rounded = np.round(made.learnt["c1_s2"], 9) + 0.0
    assert made.learnt["history"].tolist() == history
    assert hashlib.blake2b(rounded.tobytes(), digest_size=8).hexdigest() == kernels
    unseen = Features([method.observe(one) for one in bars[16:]], np.full(8, -1), tuple("abcdefgh"), made.classes)
    assert choose(method.answer(made.learnt, unseen).scores).tolist() == [1, 0] * 4


def test_files_of_networks_have_the_settings_defaults():
    net = neuro.load(path("remus"))
    rule = net.projections["c1_s2"].synapse
    rates = rule.Ar_plus, rule.Ar_minus, rule.Ap_plus, rule.Ap_minus, rule.rescue
    assert (rates, net.trials_section.labels.maps_per_label) == ((0.075, -0.025, 0.005, -0.04, False), 2)
    assert (net.trials_section.dropout.p, net.trials_section.dropout.decay) == (0.25, 0.7)
    assert net == Remus().preset("adapted").layer.network(Inputs((4, 17, 17), 64.0, 1.0), classes=10)
    assert refused(path, "resnet") == f"unknown network 'resnet': expected one of {', '.join(names())}"
    inputs = {"tempotron": Inputs((16, 34, 34), 64.0, 1.0), "mozafari": Inputs((4, 17, 17), 64.0, 1.0)}
    for file, shape in inputs.items():
        net = neuro.load(path(file))
        layer = Layer.named(file).changed({"per_class": net.trials_section.labels.maps_per_label})
        made = layer.network(shape, classes=10)
        assert (net.populations.keys(), net.trials_section) == (made.populations.keys(), made.trials_section)
        for name, one in net.projections.items():
            assert one.synapse.parameters() == pytest.approx(made.projections[name].synapse.parameters())
            assert one.weight == made.projections[name].weight


@pytest.mark.parametrize("settings", Remus.presets)
def test_the_network_follows_the_front_end_and_the_classes(settings):
    method = Remus().preset(settings).changed({"size": [40, 30], "orientations": [0, 60, 120]})
    net = method.layer.network(method.inputs, classes=3)
    assert net.populations["c1"].shape == (3, 15, 20)
    assert net.populations["s2"].shape[0] == 3 * net.trials_section.labels.maps_per_label
    assert neuro.compile(net).weights("c1_s2").shape[1:] == (3, 11, 11)
    assert Remus.from_words(json.loads(json.dumps(method.as_words()))) == method


def test_a_spike_raises_a_tempotron_by_its_weight():
    """It fires if the weight is its threshold, and not if it is a little less."""
    for weight, fires in ((0.5001, True), (0.4999, False)):
        layer = Layer.named("tempotron").changed({"theta": 0.5, "spread": 0.0, "weight": weight})
        told = neuro.compile(layer.network(Inputs((1, 1, 1), 64.0, 0.01), 2)).trials([0.0], [0], [0, 1])
        assert (told.winner[0] >= 0) == fires


def test_mozafari_learns_less_from_what_it_knows_and_masquelier_thorpe_doubles_its_rates():
    """Right in all of the last epoch, rewards have the smallest factor and punishments the largest; after silence both
    have the smallest."""
    layer = with_small("mozafari").layer
    sim, seen = neuro.compile(layer.network(Inputs((4, 8, 8), 10.0, 1.0), 3)), []
    for last in (None, Shares(right=1.0, wrong=0.0), Shares(right=0.25, wrong=0.5), Shares(right=0.0, wrong=0.0)):
        layer.begin(sim, 1, last)
        rule = sim.network().projections["c1_s2"].synapse
        seen.append((rule.misses, rule.hits))
    np.testing.assert_allclose(seen, [(0.2 + 0.8 * 2 / 3, 0.2 + 0.8 / 3), (0.2, 1.0), (0.6, 0.4), (0.2, 0.2)])
    layer = with_small("masquelier_thorpe").layer
    sim = neuro.compile(layer.network(Inputs((4, 8, 8), 10.0, 1.0), 3))
    for seen, rate in ((0, 2**-6), (399, 2**-6), (400, 2**-5), (1600, 0.25), (10**6, 0.25)):
        layer.pace(sim, seen)
        rule = sim.network().projections["c1_s2"].synapse
        assert (rule.A_plus, rule.A_minus) == (rate, -0.75 * rate)


def test_silence_is_no_mistake(letters):
    """With a threshold that no input reaches all frames are silent: neither right nor wrong in any epoch."""
    message = (
        r"no neuron fired in any of the \d+ frames of the last 3 epochs, .* lower values than --set \S*theta=10000"
    )
    with pytest.warns(neuro.ModelWarning, match=message) as warned:
        learnt = learn(with_small("mozafari", theta=1e4), letters, "letters").learnt
    assert len(warned) == 1
    assert learnt["history"].tolist() == learnt["mistakes"].tolist() == [0.0] * 3


def test_must_names_neurons_by_what_they_win(letters):
    made = learn(with_small("must"), letters, "letters", seed=1)
    labels, thresholds = made.learnt["labels"], made.learnt["thresholds"]
    assert set(labels[labels >= 0]) == {0, 1, 2}
    assert (thresholds >= 8.0).all()
    assert thresholds.max() > 8.5
    assert np.array_equal(made.network().populations["excited"].model.V_th, thresholds)


def test_must_of_the_thesis_cuts_at_peaks_and_decides_by_mean_rates(letters):
    thesis = method_of("must", "thesis")
    assert (thesis.segmenter.called(), thesis.vote) == ("ses", "rate")
    made = learn(with_small("must", segmenter="ses", vote="rate"), letters, "letters", seed=1)
    scores, labels = made.method.answer(made.learnt, letters).scores, made.learnt["labels"]
    results, frames = made.method.present(made.method.simulation(made.learnt), made.learnt, letters)
    for k in range(24):
        wins = labels[results.winner[(frames.recording == k) & (results.winner >= 0)]]
        np.testing.assert_allclose(scores[k], [np.sum(wins == c) / np.sum(labels == c) for c in range(3)])


@pytest.mark.parametrize("name", ["mozafari", "masquelier_thorpe"])
def test_pictures_are_learnt_as_one_frame_each(name, tmp_path):
    """Bars in three directions, whose shades and places differ."""
    rng, images = np.random.default_rng(3), np.zeros((60, 16, 16), np.uint8)
    for k, image in enumerate(images):
        at, shade = rng.integers(5, 11), rng.integers(60, 256)
        line = (np.full(12, at), np.arange(2, 14), np.arange(2, 14))
        image[line[k % 3], line[(k % 3 + 1) % 3]] = shade
    np.savez(tmp_path / "bars.npz", images=images, labels=np.arange(60) % 3)
    maps = {"maps": 8} if name == "masquelier_thorpe" else {"per_class": 2}
    small = {"field": 5, "theta": 12.0, "epochs": 4, **maps}
    method, data = method_of(name, "pictures", small), recordings(tmp_path / "bars.npz")
    assert (method.segmenter.called(), method.bank.sizes) == ("whole", (5,))
    shown = observe(method.fitting(data.sensor_size()), data)
    assert all(len(one["lengths"]) == 1 for one in shown.evidence)
    made = learn(method.fitting(data.sensor_size()), shown.take(range(30)), "bars", seed=1)
    answer = made.method.answer(made.learnt, shown.take(range(30, 60)))
    assert np.mean(choose(answer.scores) == shown.labels[30:]) > 0.8
