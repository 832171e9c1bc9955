"""Figures of spike trains as benchmarks tell them: `benchmarks/spike_statistics.py`, beside NumPy and Elephant."""

import sys
import warnings

import numpy as np
import pytest

from benchmark_scripts import script

statistics = script("spike_statistics")
BEGIN, END, STEP = 500.0, 2500.0, 0.1


def poisson(size, rate, seed, shared=0.0):
    """Spikes at random steps, a share of which all neurons have."""
    rng = np.random.default_rng(seed)
    steps = round((END - BEGIN) / STEP)
    fires = rng.random((size, steps)) < (1 - shared) * rate * STEP / 1e3
    fires |= rng.random(steps) < shared * rate * STEP / 1e3
    neurons, at = np.nonzero(fires)
    order = np.argsort(at, kind="stable")
    return statistics.Train(size, BEGIN + (at[order] + 1) * STEP, neurons[order])


def of_each(train):
    return [np.sort(train.times[train.neurons == i]) for i in range(train.size)]


def counted(train, bin_ms=2.0):
    """Counts in bins (begin, begin + bin], ..., by neuron."""
    edges = np.arange(BEGIN, END + bin_ms, bin_ms) + STEP / 2
    return np.array([np.histogram(times, edges)[0] for times in of_each(train)])


@pytest.mark.parametrize("shared", [0.0, 0.3])
def test_correlation_equals_the_mean_over_all_pairs(shared):
    train = poisson(40, 8.0, seed=1, shared=shared)
    found = np.corrcoef(counted(train))
    pairs = found[~np.eye(40, dtype=bool)]
    assert statistics.correlation(train, BEGIN, END).value == pytest.approx(pairs.mean(), rel=1e-9)
    assert (pairs.mean() > 0.2) == (shared > 0.0)


def test_correlation_leaves_out_who_is_silent():
    train = poisson(20, 8.0, seed=2)
    more = statistics.Train(500, train.times, train.neurons + 300)
    assert statistics.correlation(more, BEGIN, END) == statistics.correlation(train, BEGIN, END)
    alone = train.neurons == 0
    single = statistics.Train(20, train.times[alone], train.neurons[alone])
    assert np.isnan(statistics.correlation(single, BEGIN, END).value)


def test_a_spike_at_the_end_of_a_bin_is_in_it():
    """Two neurons that fire at both ends of the same bins are correlated, bins being (begin, end]."""
    first = np.array([500.1, 700.1, 1000.1, 2400.1])
    train = statistics.Train(2, np.concatenate([first, first + 1.9]), np.repeat([0, 1], 4))
    assert statistics.correlation(train, BEGIN, END).value == pytest.approx(1.0)
    late = statistics.Train(2, np.concatenate([first, first + 2.0]), np.repeat([0, 1], 4))
    assert statistics.correlation(late, BEGIN, END).value < 0.0


def test_irregularity_equals_numpy():
    train = poisson(30, 10.0, seed=3)
    intervals = [np.diff(times) for times in of_each(train) if times.size >= 10]
    each = np.array([gaps.std() / gaps.mean() for gaps in intervals])
    found = statistics.irregularity(train)
    assert 20 < each.size <= 30
    assert found.value == pytest.approx(each.mean(), rel=1e-12)
    assert found.error == pytest.approx(each.std(ddof=1) / np.sqrt(each.size), rel=1e-12)
    shuffled = np.random.default_rng(0).permutation(train.times.size)
    mixed = statistics.Train(30, train.times[shuffled], train.neurons[shuffled])
    assert statistics.irregularity(mixed).value == pytest.approx(found.value, rel=1e-12)


def test_a_regular_train_has_no_irregularity():
    train = statistics.Train(1, np.arange(600.0, 2400.0, 100.0), np.zeros(18, dtype=np.int64))
    assert statistics.irregularity(train).value == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(statistics.irregularity(statistics.Train(1, train.times[:9], train.neurons[:9])).value)


def test_both_equal_elephant():
    elephant = pytest.importorskip("elephant")
    neo, pq = pytest.importorskip("neo"), pytest.importorskip("quantities")
    from elephant.conversion import BinnedSpikeTrain
    from elephant.spike_train_correlation import correlation_coefficient
    from elephant.statistics import cv

    assert elephant
    train = poisson(15, 10.0, seed=4, shared=0.2)
    # its bins are [begin, end): half a step less is the same spikes in the same bins
    trains = [neo.SpikeTrain((t - STEP / 2) * pq.ms, t_start=BEGIN * pq.ms, t_stop=END * pq.ms) for t in of_each(train)]
    with warnings.catch_warnings(action="ignore"):
        found = correlation_coefficient(BinnedSpikeTrain(trains, bin_size=2.0 * pq.ms), binary=False)
    pairs = found[~np.eye(15, dtype=bool)].mean()
    assert statistics.correlation(train, BEGIN, END).value == pytest.approx(pairs, rel=1e-9)
    each = [cv(np.diff(t)) for t in of_each(train) if t.size >= statistics.LEAST_SPIKES]
    assert statistics.irregularity(train).value == pytest.approx(np.mean(each), rel=1e-9)


def test_the_errors_tell_how_far_figures_of_other_seeds_lie():
    found = [statistics.measured(recording(seed))["a"] for seed in range(40)]
    for measure in statistics.MEASURES:
        values = np.array([each[measure].value for each in found])
        told = np.mean([each[measure].error for each in found])
        assert 0.6 < told / values.std(ddof=1) < 1.6, measure
    assert np.mean([each["rate"].value for each in found]) == pytest.approx(8.0, rel=0.02)


def recording(seed):
    return statistics.Recording(BEGIN, END, {"a": poisson(60, 8.0, seed), "b": poisson(10, 5.0, seed + 1000)})


def test_what_is_saved_is_read(tmp_path):
    one = recording(5)
    one.save(tmp_path / "spikes.npz")
    other = statistics.Recording.load(tmp_path / "spikes.npz")
    assert (other.begin, other.end, list(other.trains)) == (BEGIN, END, ["a", "b"])
    assert statistics.measured(other) == statistics.measured(one)


def test_seeds_together():
    three = [statistics.Figure(v, 0.3) for v in (1.0, 2.0, 3.0)]
    assert statistics.together(three[:1]) == three[0]
    assert statistics.together(three).value == pytest.approx(2.0)
    assert statistics.together(three).error == pytest.approx(1.0 / np.sqrt(3))
    same = statistics.together([statistics.Figure(2.0, 0.3)] * 3)
    assert same.error == pytest.approx(0.3 / np.sqrt(3))  # no less than within them


@pytest.mark.parametrize(
    ("one", "other", "fine"),
    [
        ((1.0, 0.0001), (1.049, 0.0001), True),  # within 5 %
        ((1.0, 0.0001), (1.051, 0.0001), False),
        ((1.0, 0.03), (1.12, 0.03), True),  # within 3 standard errors
        ((1.0, 0.03), (1.14, 0.03), False),
    ],
)
def test_agreement(one, other, fine):
    assert statistics.agree(statistics.Figure(*one), statistics.Figure(*other)) is fine


def test_the_table_names_what_differs(capsys):
    microcircuit = script("microcircuit")
    first = recording(6)
    assert microcircuit.compare(microcircuit.beside(first, [recording(7), recording(8)]))
    told = capsys.readouterr().out
    assert told.count("all within 5 % or 3 standard errors") == 3
    faster = statistics.Recording(BEGIN, END, {"a": poisson(60, 16.0, 9), "b": first.trains["b"]})
    assert not microcircuit.compare(microcircuit.beside(first, [faster]))
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("rate: "))
    assert line.endswith("DIFFERS in a")


def test_a_run_writes_what_the_comparison_reads(tmp_path, capsys, monkeypatch):
    microcircuit = script("microcircuit")
    path = tmp_path / "ours.npz"
    words = ["microcircuit.py", "run", "--scale", "0.01", "--ms", "60", "--warm", "20", "--out", str(path)]
    monkeypatch.setattr(sys, "argv", words)
    assert microcircuit.main() == 0
    assert '"events_per_bio_s"' in capsys.readouterr().out
    found = statistics.Recording.load(path)
    assert (found.begin, found.end) == (20.0, pytest.approx(80.0))
    assert found.trains["L4E"].size == 219
    assert min(train.times.min(initial=21.0) for train in found.trains.values()) > 20.0
