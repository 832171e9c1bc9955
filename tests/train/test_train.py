"""neuro train: learns, shows what chips make of it, goes on after a kill, and keeps what was good."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro.events import recordings
from neuro_torch import Events
from neuro_train import trainer
from neuro_train.data import moved, show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import by_module, on_backend

pytestmark = [
    pytest.mark.filterwarnings("ignore:backend 'spinnaker'"),  # no released binary has iaf_psc_delta
    pytest.mark.filterwarnings("ignore:backend 'loihi'"),  # what rounding loses
]
QUICK = ("--for", 60, "--epochs", 8, "--batch", 6)
PLAN = {"input": "pixels", "output": "out", "duration": 60.0, "epochs": 8, "batch": 6}


@pytest.fixture
def told(folder, file):
    """A network, recordings to learn from and a plan with some words."""

    def of(**words):
        net, plan = snn.load(file), TrainingPlan(**(PLAN | words))
        return net, show(net, recordings(folder, part="Train"), plan, lambda *told: None), plan

    return of


def test_it_learns_and_every_backend_decides_alike(told, folder):
    net, shown, plan = told(epochs=20, bits=8)
    trained = trainer.learn(net, shown, plan)
    unseen = show(net, recordings(folder, part="Test"), plan, lambda *told: None)
    by_torch = by_module(trained.module, unseen, plan)
    assert by_torch.own.accuracy >= 8 / 9
    assert trained.curves["loss"][-1] < 0.5 * trained.curves["loss"][0]
    for backend, spikes in (("event", 9), ("reference", 9), ("loihi", 8), ("spinnaker", 8)):
        tried = on_backend(trained.net, backend, unseen, plan)
        assert tried.agrees(by_torch) == 1.0
        assert tried.same_spikes(by_torch) >= spikes
        assert (tried.bill is not None) == (backend in ("loihi", "spinnaker"))
        if tried.bill is not None:
            # 6 operations an event of the first 60 ms, 2 a spike of the output, 4 a class.
            times = [item.load().t for item in recordings(folder, part="Test")]
            events, neurons = sum(np.count_nonzero(t - t[0] < 60_000) for t in times), tried.spikes.shape[2]
            assert {item.of: 9 * item.count for item in tried.bill.items if item.what == "host"} == pytest.approx(
                {"pixels of pixels, cpu": 6 * events, "counts of out, cpu": 2 * tried.spikes.sum() + 9 * 4 * neurons}
            )


def test_the_command_writes_a_network_and_a_page_and_tests_on_chips(neuro, folder, file):
    more = ("--test", folder, "--augment", "shift=1", "--cost", "loihi=0.1")
    status, out, err = neuro(file, "--data", folder, *QUICK, *more)
    assert (status, err, out.splitlines()[-2:]) == (0, "", ["trained.yaml: written", "trained.html: written"])
    assert all(word in out for word in ("torch", "event", "loihi", "spinnaker", "9 recordings", "uJ"))
    net, before = snn.load("trained.yaml"), snn.load(file)
    assert net.populations == before.populations
    assert not np.array_equal(net.projections["in_hidden"].weight, before.projections["in_hidden"].weight)
    page = Path("trained.html").read_text()
    words = ("loss by epoch", "right, % by epoch", "uJ by epoch", "loihi=0.1<", str(file), "one scan over all steps")
    assert [word for word in words if word not in page] == []
    assert sorted(os.listdir()) == ["trained.h5", "trained.html", "trained.yaml"]


SHIPPED = {
    "dense": (("hidden=10",), ()),
    "conv": (("maps=3", "kernel=3"), ()),
    "recurrent": (("hidden=10",), ()),
    "learnt_delays": (("hidden=10",), ("--learn", "in_hidden", "--learn", "hidden_out=weight,delay")),
}


def listed(values):
    """Values, also those of a file."""
    return getattr(values, "values", values)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_network_that_ships_learns_by_the_command(neuro, folder, name):
    values, words = SHIPPED[name]
    small = ("height=12", "width=12", "classes=3", "resolution=5", "in_std=0.3", "out_std=0.3", *values)
    sets = [word for value in small for word in ("--set", value)]
    words += ("--epochs", 15, "--rate", 0.03, "--test", folder, "--backends", "event")
    status, out, err = neuro(name, "--data", folder, "--for", 60, "--batch", 6, *sets, *words)
    assert (status, err) == (0, "")
    rows = [line.split() for line in out.splitlines() if line.split()[:1] in (["torch"], ["event"])]
    assert len(rows) == 2
    assert all(float(row[1].rstrip("%")) >= 66.0 for row in rows)
    assert "9 of 9" in out
    net = snn.load("trained.yaml")
    assert all(np.isfinite(listed(part.weight)).all() for part in net.projections.values())
    if name == "learnt_delays":
        assert len(np.unique(listed(net.projections["hidden_out"].delay))) > 3


def test_sigma_delta_neurons_learn_for_loihi_2(neuro, folder):
    small = ("height=12", "width=12", "classes=3", "maps=4", "kernel=3", "stride=2", "hidden=8", "resolution=10")
    small += ("hidden_vth=500", "hidden_std=30", "out_std=60")
    sets = [word for value in small for word in ("--set", value)]
    how = ("--chip", "loihi2", "--bits", 8, "--temperature", 1e6, "--rate", 0.06, "--epochs", 12, "--batch", 6)
    test = ("--test", folder, "--backends", "event,loihi2", "--for", 60)
    status, out, err = neuro("sigma", "--data", folder, *sets, *how, *test)
    assert (status, err) == (0, "")
    rows = [line.split() for line in out.splitlines() if "9 of 9" in line]
    assert [row[0] for row in rows] == ["torch", "event", "loihi2"]
    assert float(rows[0][1].rstrip("%")) >= 66.0
    sent = [line.split(":")[1] for line in out.splitlines() if "spikes in a recording" in line]
    assert sent[0] == sent[1]
    net, unseen = snn.load("trained.yaml"), snn.events.recordings(folder, part="Test")
    asked = [snn.predict(net, unseen, backend=backend) for backend in ("event", "loihi2")]
    assert (asked[0].agrees(asked[1]), f"{np.mean(asked[0].decided == unseen.labels):.1%}") == (1.0, rows[0][1])


@pytest.mark.slow
def test_the_same_bits_after_kills():
    script = Path(__file__).parents[1] / "helpers" / "kills.py"
    subprocess.run([sys.executable, script, "training", "3", "0"], check=True)


def test_a_loss_that_is_nan_stops_and_keeps_what_was_good(neuro, folder, file, monkeypatch):
    calls = []

    def bad(*told, **words):
        calls.append(None)
        return loss(*told, **words) * (float("nan") if len(calls) == 11 else 1.0)

    loss = trainer.neuro_torch.losses.count_cross_entropy
    with monkeypatch.context() as patch:
        patch.setattr(trainer.neuro_torch.losses, "count_cross_entropy", bad)
        status, _, err = neuro(file, "--data", folder, *QUICK)
    told = "epoch 3, batch 3 of 4: the loss is nan: expected a number; what was learnt until the end of epoch 2 is kept"
    assert (status, f"{told} in trained.yaml.training\n" in err) == (2, True)
    assert "hint: lower --rate or --cost, with another --out" in err
    assert neuro(file, "--data", folder, *QUICK)[0] == 0
    assert neuro(file, "--data", folder, *QUICK, "--out", "other.yaml")[0] == 0
    assert snn.load("trained.yaml") == snn.load("other.yaml")


@pytest.mark.filterwarnings("default::neuro.ModelWarning")
@pytest.mark.parametrize(
    ("option", "reason"),
    [("V_th=1e5", "check the unit of `weight`"), ("out_delay=500 ms", "a spike takes up to 500 ms")],
)
def test_an_output_that_cannot_fire_is_reported_with_the_reason(neuro, folder, tmp_path, option, reason):
    net = snn.Network("mute", resolution=5.0)
    values = {"V_th": 1.0, "out_delay": 5.0} | dict([option.removesuffix(" ms").split("=")])
    cells = snn.iaf_psc_delta(tau_m=20.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=float(values["V_th"]))
    net.population("pixels", (2, 12, 12), snn.spike_generator())
    net.population("out", 3, cells)
    weight = snn.normal(mean=0.05, std=0.05)
    net.connect("pixels", "out", snn.all_to_all(), weight=weight, delay=float(values["out_delay"]))
    net.save(tmp_path / "mute.yaml")
    status, _, err = neuro(tmp_path / "mute.yaml", "--data", folder / "Train", "--epochs", 2, "--out", "o.yaml")
    assert status == 0
    first = "warning: population 'out': no neuron fired in epochs 1 to 2, so no recording is decided: "
    (line,) = [line for line in err.splitlines() if line.startswith(first)]
    assert reason in line


@pytest.mark.filterwarnings("ignore:population 'out'. no neuron fired")  # spikes cost too much
def test_joules_that_cost_something_are_fewer(told):
    taken = {}
    for price in (0.0, 500.0):
        net, shown, plan = told(cost={"loihi": price}, epochs=15)
        taken[price] = trainer.learn(net, shown, plan).curves["joules"][-1]
    assert 0.0 < taken[500.0] < 0.95 * taken[0.0]


@pytest.mark.parametrize("loss", ["potential", "first_spike"])
def test_other_losses_learn_too(told, loss):
    net, shown, plan = told(loss=loss, epochs=20)
    trained = trainer.learn(net, shown, plan)
    assert trained.curves["loss"][-1] < 0.8 * trained.curves["loss"][0]
    if loss == "first_spike":
        assert trained.curves["right"][-1] >= 0.8


def test_folds_are_trained_once(neuro, folder, file, tmp_path, monkeypatch):
    words = ("--data", folder, *QUICK, "--folds", 2, "--backends", "event")
    status, out, err = neuro(file, *words)
    assert (status, err) == (0, "")
    told = json.loads((tmp_path / "trained-1.json").read_text())
    assert (told["n"], told["same_spikes"]["event"]) == (12, 12)
    assert "of 24 right (95 % interval" in out
    monkeypatch.setattr(trainer._Training, "epoch", lambda self: pytest.fail("it is there already"))
    assert neuro(file, *words)[1] == out
    with pytest.raises(pytest.fail.Exception):
        neuro(file, *words, "--rate", 0.02)


def test_no_epochs_and_recordings_left_out(neuro, folder, file):
    words = ("--for", 60, "--epochs", 0, "--test", folder, "--backends", "event")
    status, out, _ = neuro(file, "--data", folder, *words)
    assert (status, "9 of 9" in out) == (0, True)
    before, after = (snn.compile(snn.load(each)).weights("in_hidden")[2] for each in (file, "trained.yaml"))
    np.testing.assert_array_equal(after, before.astype(np.float32))
    left_out = ("--without", "*/1*.npz", "--without", "*/2*.npz")  # 1, 2, 10 ... 23
    status, out, err = neuro(file, "--data", folder, *QUICK, "--epochs", 1, *left_out)
    assert (status, err) == (0, "")
    assert "% of 8 right" in out


def test_a_batch_beyond_memory_is_refused_before_any_is_taken(neuro, folder, file, monkeypatch, tmp_path):
    monkeypatch.setattr("neuro_torch.memory.free_memory", lambda: 12000)
    status, out, err = neuro(file, "--data", folder, *QUICK)
    assert (status, out, list(tmp_path.iterdir())) == (2, "", [])
    assert "error: a batch of 6 recordings of 12 steps needs about" in err
    assert "expected at most what is free, 1.2e-05 GB\n  hint: use a batch of 1, which needs half of that" in err


def test_augmentations():
    dense = np.random.default_rng(2).random((5, 7, 2, 6, 4)) < 0.2
    events = Events(5, 7, {"pixels": np.nonzero(dense.reshape(5, 7, 48))})
    found = moved(events, "pixels", (2, 6, 4), 2, 0.0, np.random.default_rng(8)).dense("pixels", 48)
    down, right = np.random.default_rng(8).integers(-2, 3, (2, 5))
    expected = np.zeros(dense.shape)
    for b, t, p, y, x in zip(*np.nonzero(dense), strict=True):
        if 0 <= y + down[b] < 6 and 0 <= x + right[b] < 4:
            expected[b, t, p, y + down[b], x + right[b]] = 1.0
    np.testing.assert_array_equal(found.reshape(dense.shape), expected)
    assert len({*down, *right}) > 2
    y, x = np.mgrid[3:18, 3:18].reshape(2, -1)
    batch = np.repeat(np.arange(40), y.size)
    events = Events(40, 1, {"pixels": (batch, 0 * batch, np.tile(y * 21 + x, 40))})
    found = moved(events, "pixels", (21, 21), 0, 0.2, np.random.default_rng(5)).dense("pixels", 441).reshape(40, 21, 21)
    assert np.all(found[:, 10, 10] == 1.0)  # the middle does not move
    sizes = found.sum(axis=(1, 2))
    assert 0.6 * 225 < sizes.min() < 225 <= sizes.max() < 1.5 * 225
    assert len({image.tobytes() for image in found}) == 40
    dense = np.random.default_rng(2).random((60, 7, 2, 6, 4)) < 0.2
    events = Events(60, 7, {"pixels": np.nonzero(dense.reshape(60, 7, 48))})
    found = moved(events, "pixels", (2, 6, 4), 0, 0.0, np.random.default_rng(8), mirror=0.5).dense("pixels", 48)
    pairs = [*zip(found.reshape(dense.shape), dense, strict=True)]
    mirrored = np.array([np.array_equal(one, other[..., ::-1]) for one, other in pairs])
    assert np.all(mirrored ^ np.array([np.array_equal(one, other) for one, other in pairs]))
    assert 15 < mirrored.sum() < 45


def test_the_file_says_how_it_is_asked_and_answers_as_it_was_tested(neuro, answer, folder, file):
    words = (file, "--data", folder, *QUICK, "--test", folder, "--start", 5, "--window", "0,0")
    status, _, _ = neuro(*words, "--backends", "event,loihi")
    assert status == 0
    section = snn.load("trained.yaml").readout_section
    assert section.classes == ("lying", "oblique", "upright")
    assert (section.input, section.output, section.decide) == ("pixels", "out", "counts")
    assert (section.duration, section.start, section.window, section.merge) == (60.0, 5.0, (0, 0), True)
    asked = answer(
        "predict", "trained.yaml", folder, "--part", "Test", "--labels", "--backends", "event,loihi", "--json"
    )
    told, plan = json.loads(asked.out)["backends"], TrainingPlan(**PLAN, start=5.0, window="0,0")
    net, unseen = snn.load("trained.yaml"), recordings(folder, part="Test")
    shown = show(net, unseen, plan, lambda *told: None)
    for backend in ("event", "loihi"):
        tried = on_backend(net, backend, shown, plan)
        assert told[backend]["confusion"] == tried.own.confusion.tolist()
        assert np.array_equal(snn.predict(net, unseen, backend=backend).scores, tried.spikes.sum(axis=1))
    assert told["loihi"]["energy"]["total_j"] == tried.bill.total_j
