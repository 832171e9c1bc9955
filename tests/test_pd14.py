"""The microcircuit by the recipe of its benchmark, `benchmarks/pd14.py`: statistics, interrupted runs, the folder."""

import sys

import numpy as np
import pytest
from scipy.stats import ks_2samp

from benchmark_scripts import script

pd14, statistics, spikes = script("pd14"), script("pd14_statistics"), script("spike_statistics")
SETTINGS = {"scale": 0.01, "ms": 120.0, "threads": [1], "speed_ms": 1000.0, "seeds": 2, "reference": 0, "watts": 50.0}


@pytest.fixture
def train():
    """40 neurons with rates from 0 to 30 Hz, in (500, 1500] ms."""
    rng = np.random.default_rng(1)
    fires = rng.random((40, 10_000)) < np.linspace(0.0, 30.0, 40)[:, None] * 1e-4
    neurons, at = np.nonzero(fires)
    order = np.argsort(at, kind="stable")
    return spikes.Train(40, np.round(500.0 + (at[order] + 1) * 0.1, 1), neurons[order])


def test_distributions_are_those_of_the_recipe(train):
    each = [np.sort(train.times[train.neurons == i]) for i in range(train.size)]
    assert statistics.rates(train, 500.0, 1500.0) == pytest.approx([times.size for times in each])
    intervals = [np.diff(times) for times in each if times.size > 2]
    assert statistics.irregularities(train, statistics.LEAST_SPIKES) == pytest.approx(
        [np.std(found) / np.mean(found) for found in intervals]
    )
    counts = [np.histogram(times, np.arange(500.05, 1501.0, 2.0))[0] for times in each if times.size]
    pairs = np.corrcoef(counts)[np.triu_indices(len(counts), 1)]
    assert statistics.correlations(train, 500.0, 1500.0) == pytest.approx(pairs)


def test_pairs_are_those_of_250_neurons():
    neurons = np.repeat(np.arange(600), 3)
    train = spikes.Train(600, 500.0 + 0.1 * np.random.default_rng(2).integers(1, 9000, neurons.size), neurons)
    assert statistics.correlations(train, 500.0, 1400.0).size == 250 * 249 / 2


def test_distances_within_and_between_simulators():
    rng = np.random.default_rng(3)
    ones, others = ([{"rates": {"L4E": rng.normal(mean, 1.0, 50)}} for _ in range(3)] for mean in (0.0, 1.0))
    found = statistics.between(ones, others, "rates", "L4E")
    apart = [ks_2samp(a["rates"]["L4E"], b["rates"]["L4E"]).statistic for a in ones for b in others]
    assert (found.value, found.error) == pytest.approx((np.mean(apart), np.std(apart)))
    assert statistics.within(ones, "rates", "L4E").value < found.value
    assert np.isnan(statistics.within(ones[:1], "rates", "L4E").value)
    assert np.isnan(statistics.distance(np.array([]), np.array([1.0])))


def test_an_interrupted_run_goes_on_to_the_same_spikes(tmp_path, monkeypatch):
    monkeypatch.setattr(pd14, "STRETCH_MS", 40.0)
    pd14.run_ours(tmp_path / "whole.h5", 1, SETTINGS)
    saved = pd14.save

    def interrupted(path, recording):
        if path.name == "cut.1":
            raise KeyboardInterrupt
        saved(path, recording)

    monkeypatch.setattr(pd14, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pd14.run_ours(tmp_path / "cut.h5", 1, SETTINGS)
    assert (tmp_path / "cut.state").exists()
    monkeypatch.setattr(pd14, "save", saved)
    pd14.run_ours(tmp_path / "cut.h5", 1, SETTINGS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.h5", "whole.h5"]
    whole, cut = (pd14.loaded(tmp_path / name) for name in ("whole.h5", "cut.h5"))
    assert (whole.begin, whole.end) == (cut.begin, cut.end) == (500.0, 620.0)
    for name, train in whole.trains.items():
        np.testing.assert_array_equal(train.times, cut.trains[name].times)
        np.testing.assert_array_equal(train.neurons, cut.trains[name].neurons)


def test_a_folder_is_ready_to_be_handed_in(tmp_path, monkeypatch, capsys):
    words = ["pd14.py", str(tmp_path), "--scale", "0.01", "--ms", "120", "--seeds", "2", "--reference", "0"]
    words += ["--speed-ms", "1000", "--watts", "50"]

    def one(command, check):
        assert check
        path = dict(pd14.steps(tmp_path, SETTINGS))[command[-1]]
        pd14.step(command[-1], path, SETTINGS)

    monkeypatch.setattr(pd14.subprocess, "run", one)
    monkeypatch.setattr(sys, "argv", words)
    pd14.main()
    page, row = (tmp_path / "README.md").read_text(), (tmp_path / "row.yaml").read_text()
    assert "(the recipe: 900 s, 10 seeds)" in page
    assert "| L4E | 4.414 | - |" in page
    assert "energy from 50 W at the power outlet" in row
    assert {path.name for path in (tmp_path / "statistics" / "neuro_seed2").iterdir()} == {
        "rates.json",
        "spike_ccs.json",
        "spike_cvs.json",
    }
    assert (tmp_path / "distributions.png").exists()
    monkeypatch.setattr(pd14.subprocess, "run", lambda *_, **__: pytest.fail("done again"))
    pd14.main()
    monkeypatch.setattr(sys, "argv", [*words, "--scale", "0.02"])
    with pytest.raises(SystemExit):
        pd14.main()
    assert "has scale = 0.01: expected the same, or another folder" in capsys.readouterr().err
