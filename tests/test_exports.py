"""What was recorded as objects of Neo and as data frames, of a simulation and of the results that it leaves."""

import sys

import numpy as np
import pytest

import neuro
from neuro.run.collect import collect
from refused import refused


@pytest.fixture(params=["live", "left"])
def run(request):
    net = neuro.Network("two", resolution=0.5)
    net.population("in", 4, neuro.spike_generator(spike_times=[[10.0, 20.0, 40.0], [30.0], [], [10.0, 20.0, 30.0]]))
    out = net.population("out", (2, 3), neuro.iaf_psc_exp(I_e=400.0))
    net.population("sheet", (1, 3, 3), neuro.iaf_psc_delta())
    net.population("maps", (2, 2, 2), neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.all_to_all(), weight=np.arange(24.0))
    net.connect("sheet", "maps", neuro.grid(kernel=(2, 2)), weight=np.arange(8.0).reshape(2, 1, 2, 2))
    net.probe("v", out, "V_m", every=2.0)
    net.probe("current", out[[5, 3]], "I_syn_ex")
    sim = neuro.compile(net, backend="reference", seed=7)
    sim.run(50.0)
    return sim if request.param == "live" else collect(sim, net)


def test_neo(run):
    neo = pytest.importorskip("neo", reason="the extra neo is not installed")
    block = run.to_neo()
    assert isinstance(block, neo.Block)
    assert block.name == "two"
    assert block.annotations == {"simulator": "neuro", "backend": "reference", "seed": 7, "resolution_ms": 0.5}
    (segment,) = block.segments
    trains = [each for each in segment.spiketrains if each.annotations["source_population"] == "in"]
    assert [train.rescale("s").magnitude.tolist() for train in trains] == [
        [0.01, 0.02, 0.04],
        [0.03],
        [],
        [0.01, 0.02, 0.03],
    ]
    assert [train.annotations["source_id"] for train in trains] == [0, 1, 2, 3]
    assert {(float(train.t_start), float(train.t_stop), str(train.units)) for train in trains} == {
        (0.0, 50.0, "1.0 ms")
    }
    v, current = segment.analogsignals
    assert current.array_annotations["channel_index"].tolist() == [5, 3]
    assert (v.name, v.annotations["probe"], v.annotations["source_population"]) == ("V_m", "v", "out")
    assert v.shape == (25, 6)
    assert v.array_annotations["channel_index"].tolist() == list(range(6))
    assert (str(v.units), str(current.units)) == ("1.0 mV", "1.0 pA")
    assert v.times.rescale("ms").magnitude == pytest.approx(np.arange(2.0, 51.0, 2.0))
    assert float(current.sampling_rate.rescale("Hz")) == pytest.approx(2000.0)
    groups = {group.name: group for group in block.groups}
    assert list(groups) == ["in", "out", "sheet", "maps"]
    assert len(groups["out"].spiketrains) == 6
    assert len(groups["out"].analogsignals) == 2


def test_neo_is_what_elephant_reads(run):
    pytest.importorskip("neo", reason="the extra neo is not installed")
    statistics = pytest.importorskip("elephant.statistics", reason="the extra compare is not installed")
    train = next(each for each in run.to_neo().segments[0].spiketrains)
    assert float(statistics.mean_firing_rate(train).rescale("Hz")) == pytest.approx(60.0)


def test_pandas(run):
    pandas = pytest.importorskip("pandas", reason="the extra pandas is not installed")
    told = run.to_pandas()
    spikes = told.spikes[told.spikes.population == "in"]
    assert spikes.time_ms.tolist() == [10.0, 10.0, 20.0, 20.0, 30.0, 30.0, 40.0]
    assert spikes.neuron.tolist() == [0, 3, 0, 3, 1, 3, 0]
    assert told.spikes.time_ms.is_monotonic_increasing
    assert told.populations.loc["in"].to_dict() == {"neurons": 4, "spikes": 7, "rate_hz": 35.0}
    v = told.traces["v"]
    assert (v.index.name, v.columns.name, v.shape) == ("time_ms", "neuron", (25, 6))
    assert v.attrs == {"of": "out", "state": "V_m", "unit": "mV"}
    assert told.weights["in_out"].pivot(index="pre", columns="post", values="weight").to_numpy().tolist() == (
        np.arange(24.0).reshape(4, 6).tolist()
    )
    assert told.traces["current"].columns.tolist() == [5, 3]
    kernel = told.weights["sheet_maps"].set_index(["map", "channel", "row", "column"]).weight
    assert kernel.loc[1, 0, 0, 1] == 5.0
    assert isinstance(spikes.population.dtype, pandas.CategoricalDtype)


@pytest.mark.parametrize("package", ["neo", "pandas"])
def test_a_package_that_is_missing(run, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    assert f"the package {package} is not installed\n  hint: " in refused(getattr(run, f"to_{package}"))
