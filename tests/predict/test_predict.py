"""neuro predict: any network answers about recordings, on every backend, with its joules."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro as snn
from neuro.apps import number
from neuro.events import Dataset, Events, recordings, save
from neuro_predict.tables import show
from refused import refused

SHARED = Path(__file__).resolve().parents[3] / "shared"
NETWORK = """\
neuro: 1
name: halves
resolution: 1.0
populations:
  pixels: {model: spike_generator, shape: [2, 6, 8]}
  hidden: {model: {iaf_psc_delta: {t_ref: 0.0, E_L: 0.0, V_reset: 0.0, V_th: 1.0}}, shape: 2}
  out: {model: {iaf_psc_delta: {t_ref: 0.0, E_L: 0.0, V_reset: 0.0, V_th: 1.0}}, shape: 2}
projections:
  left: {from: {pixels: ":, :, 0:4"}, to: {hidden: 0}, rule: all_to_all, weight: 0.6, delay: 1.0}
  right: {from: {pixels: ":, :, 4:8"}, to: {hidden: 1}, rule: all_to_all, weight: 0.6, delay: 1.0}
  hidden_out: {from: hidden, to: out, rule: one_to_one, weight: 1.5, delay: 2.0}
"""
READOUT = "readout: {input: pixels, output: out, classes: [left, right]}\n"
CHIPS = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
pytestmark = [CHIPS, pytest.mark.filterwarnings("always::neuro.OverflowWarning")]


def events(side, n=60, width=8, seed=0):
    """Events of 30 ms, most of them in the left or the right half."""
    rng = np.random.default_rng(seed)
    other = rng.random(n) < 0.2
    x = rng.integers(0, width // 2, n) + np.where(other, side == "left", side == "right") * (width // 2)
    return Events(5000 + np.arange(n) * 500, x, rng.integers(0, 6, n), rng.integers(0, 2, n), (width, 6))


@pytest.fixture
def run(answer, monkeypatch, tmp_path):
    """Run `neuro predict` with some words in a folder with a network and recordings; exit status, output and error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NETWORK)
    (tmp_path / "named.yaml").write_text(NETWORK + READOUT)
    for k in range(6):
        side = ("left", "right")[k % 2]
        path = tmp_path / "data" / side / f"{k}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(events(side, seed=k), path)
    return partial(answer, "predict")


def cells(out):
    """Rows of a table as lists of cells."""
    return [line.split() for line in out.splitlines() if line.strip()]


def test_recordings_are_answered_by_number_where_classes_have_no_names(run):
    status, out, err = run("net.yaml", "data/left/0.npz", "data/right/1.npz")
    assert (status, err) == (0, "")
    rows = cells(out)
    assert rows[0] == ["shown", "by", "'pixels',", "'out'", "decides", "by", "counts"]
    assert [row[1] for row in rows if row[0].startswith("data/")] == ["0", "1"]
    assert rows[-1][:2] == ["event", "0"]


def test_labels_give_accuracy_and_backends_equal_decisions_and_joules(run):
    status, out, err = run("named.yaml", "data", "--labels", "--backends", "event,reference,loihi,spinnaker", "--json")
    assert (status, err) == (0, "")
    told = json.loads(out)
    heading = told["format"], told["network"], told["readout"]["classes"]
    assert heading == ("neuro predictions 1", "halves", ["left", "right"])
    for name, one in told["backends"].items():
        assert (one["accuracy"], one["n"], one["equal_decisions"], one["silent"]) == (1.0, 6, 1.0, 0)
        assert (one["energy"] is not None) == (name in ("loihi", "spinnaker"))
    joules = told["backends"]["loihi"]["energy"]
    assert joules["of"] == "recording"
    # An event takes 6 operations, a spike of the output 2, and the choice between two neurons 4 each.
    seen, spikes = 6 * 60, sum(each["decided"]["loihi"]["spikes"] for each in told["recordings"])
    assert {item["of"]: item["count"] for item in joules["items"] if item["what"] == "host"} == pytest.approx(
        {"pixels of pixels, cpu": 6 * seen / 6, "counts of out, cpu": 2 * spikes / 6 + 4 * 2}
    )
    assert 0.0 < joules["total_low_j"] < joules["total_j"] < joules["total_high_j"]
    assert [each["label"] for each in told["recordings"]] == ["left"] * 3 + ["right"] * 3
    decided = told["recordings"][0]["decided"]
    assert decided["event"] == decided["reference"]
    assert decided["event"]["spikes"] == sum(decided["event"]["scores"].values())
    rows = cells(run("named.yaml", "data", "--labels", "--backends", "event,loihi").out)
    assert ["left", "3", ".", "."] in rows
    assert rows[-1][0] == "loihi"
    assert ["event", "6", "6", "100.0%"] in [row[:4] for row in rows]


def test_a_zip_a_data_set_and_single_files_are_the_same_recordings(run, tmp_path):
    with zipfile.ZipFile("data.zip", "w") as packed:
        for path in sorted(Path("data").rglob("*.npz")):
            packed.write(path, path.relative_to("data"))
    Dataset("data").to_hdf5("data.h5", jobs=1)
    answers = []
    for data in (["data"], ["data.zip"], ["data.h5"], sorted(Path("data").rglob("*.npz"))):
        status, out, _ = run("named.yaml", *data, "--labels", "--json")
        assert status == 0
        answers.append([(each["label"], each["decided"]) for each in json.loads(out)["recordings"]])
    assert all(each == answers[0] for each in answers)
    assert run("named.yaml", "data/left", "data/right")[0] == 2  # no class folders


def test_the_decision_is_the_one_that_a_simulation_shows(run):
    """Each recording from the beginning, until its last event has come to the output."""
    net = snn.load("named.yaml")
    samples = recordings("data")
    found = snn.predict(net, samples, labels=[samples.classes[k] for k in samples.labels])
    sim = snn.compile(net)
    for k, item in enumerate(samples):
        one = item.load()
        step = (one.t - one.t[0]) // 1000
        sim.reset()
        sim.inject("pixels", step + 1.0, (one.p * 6 + one.y.astype(int)) * 8 + one.x)
        sim.run(float(step[-1] + 1 + 3))
        assert np.array_equal(found.scores[k], np.bincount(sim.spikes("out")[1], minlength=2))
    assert isinstance(found, snn.Predictions)
    assert found.own.accuracy == 1.0
    assert found.class_of(0) == "left"
    assert found.names[0] == "data/left/0.npz"


def test_words_of_the_command_come_before_those_of_the_file():
    net = snn.Network("one", resolution=1.0)
    net.population("pixels", (2, 6, 8), snn.spike_generator(spike_times=[]))
    for name in ("a", "b"):
        net.population(name, 2, snn.iaf_psc_delta(t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0))
        net.connect("pixels", name, snn.all_to_all(), weight=[[0.6, 0.0] if name == "a" else [0.0, 0.6]] * 96)
    net.readout(input="pixels", output="a", duration=20.0, decide="first")
    shown = [events("left")]
    found = snn.predict(net, shown)
    assert (found.readout.duration, found.decided.tolist(), found.scores[0, 0]) == (20.0, [0], 2.0)
    assert np.isnan(found.scores[0, 1])
    other = snn.predict(net, shown, output="b", decide="counts", classes=["x", "y"])
    assert other.class_of(0) == "y"
    longer = snn.predict(net, shown, output="b", decide="counts", duration=40.0)
    assert longer.scores[0, 1] > other.scores[0, 1]


def test_the_best_score_comes_first(capsys):
    net = snn.Network("one", resolution=1.0)
    net.population("pixels", (2, 6, 8), snn.spike_generator(spike_times=[]))
    net.population("a", 2, snn.iaf_psc_delta(t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0))
    net.connect("pixels", "a", snn.all_to_all(), weight=[[0.2, 0.6]] * 96)
    for decide in ("first", "counts"):
        net.readout(input="pixels", output="a", duration=20.0, decide=decide)
        found = snn.predict(net, [events("left")])
        scores = found.scores[0]
        assert (scores[1] < scores[0]) == (decide == "first")
        show([found])
        assert f"1 {number(scores[1])}, 0 {number(scores[0])}" in capsys.readouterr().out


def test_equal_counts_silence_and_equal_potentials():
    from neuro_predict.decisions import by_counts, by_first, by_potential

    times, ids = np.array([1.0, 2.0, 2.0, 3.0, 3.0]), np.array([2, 1, 0, 1, 2])
    assert by_counts(times, ids, 3)[0] == 2  # two spikes as neuron 1, but it was first
    assert by_counts(times[1:], ids[1:], 3)[0] == 1
    assert by_first(times[1:4], ids[1:4], 3)[0] == 1  # with neuron 0 in one step, but it fires twice
    assert np.array_equal(by_first(times[:1], ids[:1], 3)[1], [np.nan, np.nan, 1.0], equal_nan=True)
    nothing = np.zeros(0), np.zeros(0, int)
    assert by_counts(*nothing, 3)[0] == by_first(*nothing, 3)[0] == -1
    assert by_potential(np.zeros((4, 3)))[0] == -1
    assert by_potential(np.array([[0.0, 2.0], [1.0, -2.0]]))[0] == 0


def test_what_is_no_recording_is_refused_in_python(messages):
    net = snn.Network("one", resolution=1.0)
    net.population("pixels", (2, 6, 8), snn.spike_generator(spike_times=[]))
    net.population("out", 2, snn.iaf_psc_delta())
    net.connect("pixels", "out", snn.all_to_all())
    one = [events("left")]
    messages(
        {repr(data): refused(snn.predict, net, data) for data in ("Test.zip", [])}
        | {"no network": refused(snn.predict, "net.yaml", one)}
        | {"labels": refused(snn.predict, net, one * 2, labels=["0"])}
        | {"window": refused(net.readout, input="pixels", output="out", window=[3])}
        | {"output": refused(net.readout, input="pixels", output="ot")}
    )


def test_no_recording_teaches_the_network_for_the_next(tmp_path):
    learning = "weight: 1.5, delay: 2.0, synapse: {stdp: {lambda: 0.5, Wmax: 5.0}}}"
    (tmp_path / "stdp.yaml").write_text(NETWORK.replace("weight: 1.5, delay: 2.0}", learning))
    net, shown = snn.load(tmp_path / "stdp.yaml"), [events("left"), events("right"), events("left")]
    found = snn.predict(net, shown)
    assert found.spikes[0] > 0
    assert np.array_equal(found.scores, [snn.predict(net, [each]).scores[0] for each in shown])


def test_silence_is_nothing_and_a_recording_may_be_empty(run, tmp_path):
    save(Events([], [], [], [], (8, 6)), tmp_path / "none.npz")
    status, out, err = run("named.yaml", "none.npz")
    assert (status, err) == (0, "")
    assert [row[1] for row in cells(out) if row[0] == "none.npz"] == ["nothing"]


def test_a_window_of_a_larger_sensor_and_events_that_merge(run, tmp_path):
    """As `neuro train` shows recordings, which writes these words."""
    one = events("right", seed=3)
    twice = Events(np.repeat(one.t, 2), np.repeat(one.x, 2), np.repeat(one.y, 2), np.repeat(one.p, 2), one.sensor_size)
    net = snn.load("named.yaml")
    plain, doubled = (snn.predict(net, [each]) for each in (one, twice))
    assert doubled.scores.sum() > plain.scores.sum()
    assert np.array_equal(*(snn.predict(net, [each], merge=True).scores for each in (one, twice)))
    far = Events(one.t, one.x + 20, one.y + 30, one.p, (64, 48))
    assert np.array_equal(snn.predict(net, [far], window=(20, 30)).scores, plain.scores)
    assert snn.predict(net, [far], window="centred").decided.tolist() == [1]
    large = Events(one.t, 2 * one.x, 2 * one.y, one.p, (16, 12))
    assert np.array_equal(snn.predict(net, [large], scale=2).scores, plain.scores)


def test_a_picture_is_drawn(run):
    status, out, _ = run("named.yaml", "data", "--picture", "out.png")
    assert (status, out.splitlines()[-1]) == (0, "out.png: written")
    assert Path("out.png").read_bytes()[:4] == b"\x89PNG"
    assert run("named.yaml", "data", "--decide", "potential", "--picture", "out.svg")[0] == 0


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))


def test_mistakes(run, tmp_path, messages):
    save(events("left", width=64), tmp_path / "large.npz")
    for name in ("empty", "up"):
        Path(name).mkdir()
    save(events("left"), tmp_path / "up" / "1.npz")
    for name in ("model.h5", "cnn.nir"):
        Path(name).write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(500))
    flat = NETWORK.replace("shape: [2, 6, 8]", "shape: 96").replace('":, :, 0:4"', '"0:4"')
    more = "  more: {model: spike_generator, shape: 3}\n  hidden: {"
    networks = {
        "apart": "".join(line for line in NETWORK.splitlines(True) if "hidden_out" not in line),
        "two": NETWORK.replace("  hidden: {", more),
        "flat": flat.replace('":, :, 4:8"', '"4:8"'),
        "quiet": NETWORK.replace("V_th: 1.0}}, shape: 2}\nproj", "V_th: 1e30}}, shape: 2}\nproj"),
    }
    for name, text in networks.items():
        Path(f"{name}.yaml").write_text(text)
    before = sorted(Path().rglob("*"))
    answers = {words: run(*words.split()) for words in MISTAKES}
    assert {answer[:2] for answer in answers.values()} == {(2, "")}
    assert sorted(Path().rglob("*")) == before
    messages({words: err for words, (_, _, err) in answers.items()})


def test_an_output_of_nir_that_never_fires_decides_by_potential(tmp_path):
    nir = pytest.importorskip("nir", reason="nir is not installed")
    weight = np.zeros((2, 2, 6, 8))
    weight[0, :, :, :4] = weight[1, :, :, 4:] = 0.3
    parts = (
        nir.Input({"input": np.array([2, 6, 8])}),
        nir.Flatten({"input": np.array([2, 6, 8])}, 0, -1),
        nir.Linear(weight.reshape(2, -1)),
        nir.LI(tau=np.full(2, 0.02), r=np.ones(2), v_leak=np.zeros(2)),
        nir.Output({"output": np.array([2])}),
    )
    edges = [(str(k), str(k + 1)) for k in range(len(parts) - 1)]
    net = snn.from_nir(nir.NIRGraph({str(k): part for k, part in enumerate(parts)}, edges), dt=1.0, from_="norse")
    net.save(tmp_path / "li.yaml")
    shown = [events("left", seed=1), events("right", seed=2)]
    on = snn.predict(snn.load(tmp_path / "li.yaml"), shown)
    assert (on.readout.decide, on.decided.tolist()) == ("potential", [0, 1])
    assert np.all(on.scores[[0, 1], [0, 1]] > on.scores[[0, 1], [1, 0]])
    with pytest.raises(snn.ModelError, match="never fire: expected potential"):
        snn.predict(net, shown, decide="first")
    with pytest.raises(snn.ModelError, match="V_th of '3' is never reached, but sets the scale of its registers"):
        snn.predict(net, shown, backend="loihi")
    near = re.sub(r"V_th: [^,}\n]*", "V_th: 8.0", (tmp_path / "li.yaml").read_text())
    (tmp_path / "near.yaml").write_text(near)
    for backend in ("event", "loihi", "spinnaker"):
        there = snn.predict(snn.load(tmp_path / "near.yaml"), shown, backend=backend, decide="potential")
        np.testing.assert_allclose(there.scores, on.scores, atol=0.02 * on.scores.max())
        assert there.spikes.sum() == 0


def test_the_convolutional_network_of_nir_reads_digits(tmp_path):
    """98.8 % of all 1000 recordings on event, see docs/reference/learning.md."""
    pytest.importorskip("nir", reason="nir is not installed")
    file, data = SHARED / "reference/nir/cnn_sinabs.nir", SHARED / "data/nmnist/nmnist_train1000_bin.zip"
    if not (file.exists() and data.exists()):
        pytest.skip("the network of the NIR paper, or N-MNIST, is not there")
    snn.from_nir(file, dt=1.0, from_="sinabs").save(tmp_path / "cnn.yaml")
    every = recordings(data)
    chosen = every.take(np.arange(0, 1000, 50))
    labels = [every.classes[k] for k in chosen.labels]
    found = snn.predict(snn.load(tmp_path / "cnn.yaml"), chosen, labels=labels)
    assert (found.readout.input, found.readout.output, found.readout.decide) == ("input", "12", "counts")
    assert found.own.accuracy >= 0.95


def test_the_host_of_merged_events_and_of_potentials_by_hand(run):
    """Two events of a pixel in a step are one spike, and both are looked at; V_m is added up in each step."""
    net = snn.load("named.yaml")
    net.projections["hidden_out"] = replace(net.projections["hidden_out"], weight=0.0001)
    one = events("left")
    twice = Events(np.repeat(one.t, 2), np.repeat(one.x, 2), np.repeat(one.y, 2), np.repeat(one.p, 2), one.sensor_size)
    net.readout(input="pixels", output="out", merge=True, decide="potential", duration=20.0)
    bill = snn.predict(net, [twice], backend="spinnaker").bill
    shown = np.count_nonzero(twice.t - twice.t[0] < 20_000)
    assert {item.of: item.count for item in bill.items if item.what == "host"} == {
        "pixels of pixels, cpu": 6 * shown,
        "potential of out, cpu": 20 * 2 + 3 * 2,
    }
