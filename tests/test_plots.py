"""Pictures of simulations and results: what they show, what they leave out and say so; nothing stays behind."""

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import neuro
from neuro import plots
from neuro.files.parts import Trace, Train, Weights
from neuro.files.recorded import Recorded, SpikeTrain as Spikes, intervals, trains, variation
from neuro.files.results import Results
from neuro.plots import _spikes, _traces
from refused import refusals_of


def results(size=10, spikes=100, traced=1, recorded=True, duration=1000.0):
    rng = np.random.default_rng(1)
    steps, ids = np.sort(rng.integers(1, 10 * duration, spikes)), rng.integers(0, size, spikes)
    counts = np.bincount(ids, minlength=size)
    arrays = (steps, ids, np.ones(spikes, "i4"), counts, counts)
    train = Train("iaf_psc_exp", (size,), {"spikes": spikes}, recorded, 0.1, *arrays)
    trace = Trace("cells", "V_m", "mV", np.arange(1.0, duration + 1), rng.normal(-60.0, 5.0, (int(duration), traced)))
    about = {"network": "test", "duration_ms": duration, "resolution_ms": 0.1}
    pre, post = np.divmod(np.arange(size * size), size)
    weights = Weights("cells", "cells", "static", size * size, {}, pre, post, np.arange(size * size, dtype=float))
    return Results(about, {}, {"cells": train}, {"own": weights}, {"v": trace} if traced else {})


@pytest.fixture(scope="module")
def sim():
    net = neuro.Network("two")
    net.population("in", 4, neuro.spike_generator(spike_times=[[10.0, 20.0, 40.0], [30.0], [], [10.0, 20.0, 30.0]]))
    net.population("noise", 5, neuro.poisson_generator(rate=10.0))
    net.population("out", (2, 3), neuro.iaf_psc_exp(I_e=400.0))
    net.connect("in", "out", neuro.all_to_all(), weight=100.0)
    net.probe("v", "out", "V_m", every=1.0)
    net.probe("fired", "out")
    sim = neuro.compile(net, backend="reference")
    sim.run(50.0)
    return sim


@pytest.mark.parametrize(("size", "spikes"), [(1, 0), (7, 1), (3000, 5000)])
def test_any_size(size, spikes, tmp_path):
    run = results(size, spikes, traced=size)
    for draw in (plots.raster, plots.rate, plots.trace, plots.isi, plots.cv):
        draw(run).savefig(tmp_path / "a.png", dpi=20)


def test_titles_units_and_rates():
    axis = plots.raster(results()).axes[0]
    assert axis.get_title("left") == "cells: 10 neurons, 10 Hz"
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("time (ms)", "neuron")
    axis = plots.rate(results(size=1)).axes[0]
    assert (axis.get_title("left"), axis.get_ylabel()) == ("cells: 1 neuron, 100 Hz", "rate (Hz)")
    assert plots.trace(results(traced=2)).axes[0].get_ylabel() == "V_m (mV)"
    assert plots.trace(results(traced=20)).axes[1].get_ylabel() == "V_m (mV)"
    figure = plots.rate(results(size=10, spikes=500))
    hz, edges, _ = figure.axes[0].patches[0].get_data()
    assert (hz * np.diff(edges)).sum() * 10 / 1000.0 == pytest.approx(500)
    assert figure.get_suptitle() == "test: mean rates in bins of 5 ms"
    plots.rate(results(duration=1.0, spikes=3))


def test_edges_bins_and_windows(sim):
    hz, edges, _ = plots.rate(sim, "in", bin=20.0).axes[0].patches[0].get_data()
    assert edges.tolist() == [0.0, 20.0, 40.0, 50.0]
    assert (hz * 4 * np.diff(edges) / 1000.0).round(9).tolist() == [4.0, 3.0, 0.0]
    tenths = plots.rate(sim, "in", bin=0.1, window=(29.9, 30.1)).axes[0].patches[0].get_data()[0]
    assert (tenths * 4 * 0.1 / 1000.0).round(9).tolist() == [2.0, 0.0]
    told = plots.rate(sim, "in", bin="5 ms", window=("0.01 s", "30 ms")).axes[0].patches[0].get_data()
    assert told[1].tolist() == [10.0, 15.0, 20.0, 25.0, 30.0]
    assert sim.plot(window=("10 ms", 30.0)).axes[0].get_xlim() == (10.0, 30.0)
    (train,) = trains(Recorded(sim), "in", (10.0, 30.0))
    assert (train.times_ms.tolist(), train.ids.tolist()) == ([20.0, 20.0, 30.0, 30.0], [0, 3, 1, 3])
    axis = plots.raster(sim, "in", window=(10.0, 30.0)).axes[0]
    assert (axis.get_xlim(), axis.get_title("left")) == ((10.0, 30.0), "in: 4 neurons, 50 Hz")
    shown = plots.trace(sim, "v", window=(10.0, 12.0)).axes[0]
    assert [line.get_xdata().tolist() for line in shown.lines] == [[10.0, 11.0, 12.0]] * 6


def test_few_of_many_are_drawn_and_said(monkeypatch):
    monkeypatch.setattr(_spikes, "MOST_DOTS", 50)
    axis = plots.raster(results(spikes=100)).axes[0]
    assert axis.get_title("left") == "cells: 10 neurons, 10 Hz, 50 of 100 spikes drawn"
    assert axis.lines[0].get_xdata().size == 50
    monkeypatch.setattr(_traces, "MOST_ROWS", 5)
    axis = plots.trace(results(traced=20)).axes[0]
    assert axis.get_title("left") == "v: V_m of cells, 5 of 20 neurons drawn"
    assert axis.images[0].get_array().shape == (5, 1000)
    monkeypatch.setattr(_traces, "MOST_CELLS", 4)
    axis = plots.weights(results(), "own", "matrix").axes[0]
    assert axis.get_title("left") == "own: 100 weights, means of blocks of 3 x 3"
    image, whole = axis.images[0].get_array(), np.arange(100.0).reshape(10, 10)
    assert (image.shape, image[0, 0], image[3, 3]) == ((4, 4), whole[:3, :3].mean(), whole[9, 9])
    run = results()
    run.projections["grid"] = Weights("cells", "cells", "static", 30, {}, weight=np.arange(30.0).reshape(5, 1, 2, 3))
    sheet = plots.weights(run, "grid", "matrix").axes[0].images[0].get_array()
    assert (sheet.shape, sheet[3:, 4:7].tolist()) == ((5, 11), np.arange(24.0, 30.0).reshape(2, 3).tolist())
    monkeypatch.setattr(_traces, "MOST_KERNELS", 2)
    assert plots.weights(run, "grid", "matrix").axes[0].get_title("left") == "grid: kernels of 2 x 3, 2 of 5 drawn"


def test_whole_pictures(sim):
    fresh = neuro.compile(sim.network(), backend="reference")
    for draw in (plots.raster, plots.rate, plots.isi, plots.cv, plots.overview):
        assert isinstance(draw(fresh), Figure)
    figure = sim.plot()
    assert (figure.get_suptitle(), len(figure.axes)) == ("two on reference: 50 ms, 10 neurons", 3)
    assert len(sim.plot("in", window=(0.0, 20.0)).axes) == 2
    assert plots.raster(sim)._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    from matplotlib import _pylab_helpers

    before, shown = dict(matplotlib.rcParams), dict(_pylab_helpers.Gcf.figs)
    plots.overview(sim)
    plots.weights(sim, "in_out", "matrix")
    assert (dict(matplotlib.rcParams), _pylab_helpers.Gcf.figs) == (before, shown)


def test_a_simulation_is_drawn_as_its_results(sim):
    from neuro.run.collect import collect

    left = collect(sim, sim.network())
    for of in ("in", ["out", "in"], None):
        for mine, theirs in zip(trains(Recorded(sim), of), trains(Recorded(left), of), strict=True):
            assert mine.population == theirs.population
            for word in ("neurons", "times_ms", "ids", "window"):
                assert np.array_equal(getattr(mine, word), getattr(theirs, word)), word
    mine, theirs = Recorded(sim).trace("v"), Recorded(left).trace("v")
    assert (mine.of, mine.state, mine.unit) == (theirs.of, theirs.state, theirs.unit)
    assert np.array_equal(mine.values, theirs.values)


@pytest.mark.parametrize("resolution", [0.1, 0.125, 0.3, 1.0])
def test_bins_are_on_the_grid(resolution):
    run = results()
    run.about["resolution_ms"] = resolution
    _, width = _spikes._edges(Recorded(run), trains(Recorded(run))[0], None)
    assert width >= 5.0
    assert width / resolution == pytest.approx(round(width / resolution), abs=1e-9)


def test_populations_by_name_by_part_and_by_view(sim):
    part = sim.network().populations["in"]
    assert plots.raster(sim, part).axes[0].get_title("left") == "in: 4 neurons, 35 Hz"
    (train,) = trains(Recorded(sim), part[[3, 1]])
    assert (train.neurons.tolist(), train.ids.tolist(), train.rate_hz) == ([1, 3], [3, 3, 1, 3], 40.0)
    assert plots.raster(sim, [part[[3, 1]]]).axes[0].get_title("left") == "in: 2 neurons, 40 Hz"


def test_intervals_and_their_variation():
    elephant = pytest.importorskip("elephant.statistics", reason="the extra compare is not installed")
    rng = np.random.default_rng(2)
    times, ids = np.sort(rng.uniform(0.0, 1000.0, 400)), rng.integers(0, 12, 400)
    train = Spikes("cells", np.arange(14), times, ids, (0.0, 1000.0))
    trains_ = [times[ids == neuron] for neuron in range(12)]
    lengths, whose = intervals(train.times_ms, train.ids)
    assert all(np.array_equal(lengths[whose == neuron], elephant.isi(one)) for neuron, one in enumerate(trains_))
    expected = [elephant.cv(elephant.isi(one)) for one in trains_]
    assert variation(train.times_ms, train.ids) == pytest.approx(expected, rel=1e-12)


def test_intervals_and_what_they_say(sim):
    times, ids = np.array([1.0, 2.0, 3.0, 5.0, 9.0]), np.array([0, 0, 1, 1, 1])
    train = Spikes("cells", np.arange(2), times, ids, (0.0, 10.0))
    assert variation(train.times_ms, train.ids) == pytest.approx([1.0 / 3.0])
    assert plots.isi(sim, "in").axes[0].get_title("left") == "in: 4 intervals, mean 12.5 ms"
    heights, edges, _ = plots.isi(sim, "in").axes[0].patches[0].get_data()
    assert heights.sum() == 4
    assert edges[0] < 0.0
    assert plots.cv(sim, "in").axes[0].get_title("left") == "in: mean 0.17 of 2 of 4 neurons"
    assert plots.cv(results(spikes=1)).axes[0].get_title("left") == "cells: 0 of 10 neurons with two intervals"
    assert plots.isi(results(spikes=1)).axes[0].get_title("left") == "cells: no intervals"


def test_weights_as_a_histogram_and_a_matrix(sim):
    figure = plots.weights(results(), "own")
    assert figure.axes[0].patches[0].get_data()[0].sum() == 100
    assert figure.axes[0].get_title("left") == "own: 100 weights, 49.5 ± 28.9"
    image = plots.weights(results(), "own", "matrix").axes[0].images[0].get_array()
    assert np.array_equal(image, np.arange(100.0).reshape(10, 10))
    shown = plots.weights(sim, "in_out", "matrix").axes[0]
    assert shown.images[0].get_array().shape == (4, 6)
    assert (shown.get_xlabel(), shown.get_ylabel()) == ("target neuron", "source neuron")


def test_into_axes_that_are_given(sim):
    figure = Figure()
    axes = figure.subplots(5, 1)
    assert plots.raster(sim, ax=axes[0]) is figure
    assert [text.get_text() for text in axes[0].get_yticklabels()] == ["in", "out"]
    assert plots.rate(sim, ax=axes[1]) is figure
    assert [text.get_text() for text in axes[1].get_legend().get_texts()] == ["in", "out"]
    assert plots.trace(sim, "v", ax=axes[2]) is figure
    assert plots.isi(sim, "in", ax=axes[3]) is figure
    assert [text.get_text() for text in axes[3].get_legend().get_texts()] == ["in: 4 intervals, mean 12.5 ms"]
    assert plots.weights(sim, "in_out", ax=axes[4]) is figure


def test_mistakes(sim, messages):
    messages(refusals_of(messages.cases, globals() | locals()))


FORMULA = "$\\x_{^%$"
"""A name that matplotlib cannot read as the formula that it looks like."""


def test_names_are_no_formulas(tmp_path):
    """Drawn letter by letter, in figures of ours and in axes of others, whose own formulas stay."""
    plain = results()
    names = {**plain.about, "network": FORMULA}
    train, weights, probe = plain.populations["cells"], plain.projections["own"], plain.traces["v"]
    run = Results(names, {}, {FORMULA: train, "cells": train}, {FORMULA: weights}, {FORMULA: probe})
    for draw in (plots.raster, plots.rate, plots.trace, plots.isi, plots.cv, plots.overview):
        draw(run).savefig(tmp_path / "a.png", dpi=20)
    plots.weights(run, FORMULA).savefig(tmp_path / "a.png", dpi=20)
    for draw in (plots.raster, plots.rate, plots.isi):
        axis = Figure().subplots()
        axis.set_title(r"$\alpha$")
        draw(run, ax=axis).savefig(tmp_path / "a.png", dpi=20)
        assert axis.get_title() == r"$\alpha$"
