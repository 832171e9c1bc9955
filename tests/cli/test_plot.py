from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from neuro import ModelError
from neuro.files import plots
from neuro.files.results import Results, Trace, Train


def results(size=10, spikes=100, traced=1, recorded=True, duration=1000.0):
    rng = np.random.default_rng(1)
    times = np.sort(rng.integers(1, 10 * duration, spikes)) / 10.0
    train = Train(
        "iaf_psc_exp",
        (size,),
        {"spikes": spikes},
        recorded,
        times,
        rng.integers(0, size, spikes),
        np.ones(spikes, "i4"),
    )
    trace = Trace("cells", "V_m", "mV", np.arange(1.0, duration + 1), rng.normal(-60.0, 5.0, (int(duration), traced)))
    about = {"network": "test", "duration_ms": duration, "resolution_ms": 0.1}
    return Results(about, {}, {"cells": train}, {}, {"v": trace} if traced else {})


def test_the_command(neuro, network):
    neuro("run", network, "--backend", "reference", "--for", "20")
    answer = neuro("plot", "out.h5", "--out", "pictures")
    assert answer.out.split() == [f"pictures/out-{name}.png" for name in ("raster", "rates", "traces")]
    for name in answer.out.split():
        picture = imread(name)
        assert picture.shape[1] == 1500
        assert picture[..., :3].std() > 0.01
    assert neuro("plot", "out.h5").out.split()[0] == "out-raster.png"
    assert not list(Path().rglob("*.part"))


def test_what_is_no_folder(neuro, network):
    neuro("run", network, "--backend", "reference", "--for", "2")
    for name in ("/dev/full", network):
        answer = neuro("plot", "out.h5", "--out", name)
        expected = f"error: {name}: is no folder: expected the name of a folder, or a new name\n"
        assert (answer.status, answer.out, answer.err) == (2, "", expected)


@pytest.mark.parametrize("size", [1, 7, 101, 10_000])
@pytest.mark.parametrize("spikes", [0, 1, 5000])
def test_any_size(size, spikes, tmp_path):
    for draw in (plots.raster, plots.rates, plots.traces):
        draw(results(size, spikes, traced=size)).savefig(tmp_path / "a.png")


def test_titles_and_units():
    axis = plots.raster(results()).axes[0]
    assert axis.get_title("left") == "cells: 10 neurons, 10 Hz"
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("time (ms)", "neuron")
    axis = plots.rates(results(size=1)).axes[0]
    assert axis.get_title("left") == "cells: 1 neuron, 100 Hz"
    assert axis.get_ylabel() == "rate (Hz)"
    assert plots.traces(results(traced=2)).axes[0].get_ylabel() == "V_m (mV)"
    assert plots.traces(results(traced=20)).axes[1].get_ylabel() == "V_m (mV)"


def test_rates_add_up():
    figure = plots.rates(results(size=10, spikes=500))
    hz, edges, _ = figure.axes[0].patches[0].get_data()
    assert (hz * np.diff(edges)).sum() * 10 / 1000.0 == pytest.approx(500)
    assert figure.get_suptitle() == "test: mean rates in bins of 5 ms"


def test_few_of_many_spikes_are_drawn_and_said(monkeypatch):
    monkeypatch.setattr(plots, "MOST_DOTS", 50)
    axis = plots.raster(results(spikes=100)).axes[0]
    assert axis.get_title("left") == "cells: 10 neurons, 10 Hz, 50 of 100 spikes drawn"
    assert axis.lines[0].get_xdata().size == 50


def test_a_run_shorter_than_a_bin():
    plots.rates(results(duration=1.0, spikes=3))


def test_nothing_to_draw():
    with pytest.raises(ModelError, match="the results hold no spikes\n  hint: 'neuro run --record NAME' keeps them"):
        plots.raster(results(recorded=False))
    with pytest.raises(
        ModelError, match="the results hold no traces\n  hint: a probe of a state, such as V_m, records"
    ):
        plots.traces(results(traced=0))
