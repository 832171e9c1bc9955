"""Results that are read from a file answer the calls by which a simulation is read."""

import numpy as np
import pytest

import neuro
from refused import refused


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A simulation and what it has left, by name."""
    path = tmp_path_factory.mktemp("results") / "out.h5"
    net = neuro.Network("both")
    drive = net.population("drive", 8, neuro.poisson_generator(rate=800.0))
    cells = net.population("cells", (2, 3), neuro.iaf_psc_exp())
    late = neuro.uniform(low=0.5, high=3.0)
    net.connect(drive, cells, neuro.fixed_indegree(n=4), neuro.stdp(Wmax=900.0), weight=400.0, delay=late, name="w")
    net.connect(cells, cells, neuro.all_to_all(), weight=-5.0, delay=1.5, name="back")
    net.probe("all_spikes", drive)
    net.probe("some_spikes", cells[0])
    net.probe("v", cells, "V_m", every=1.0)
    sim = neuro.compile(net, seed=3)
    with sim.record_to(path):
        sim.run(50.0)
    live = neuro.compile(net, seed=3)
    live.run(50.0)
    return net, live, neuro.results.read(path)


def equal(live, left):
    for mine, theirs in zip(live, left, strict=True):
        assert mine.size
        assert np.array_equal(mine, theirs)


def test_spikes_between_any_two_of_them(both):
    _, live, left = both
    times = np.unique(live.spikes("drive")[0])[::7]
    for since, until in zip(times, times[2:], strict=False):
        kept = live.spikes("drive", since=since, until=until)
        assert kept[0].min() > since
        assert kept[0].max() == until
        equal(kept, left.spikes("drive", since=since, until=until))


def test_an_end_before_the_begin_is_refused_also_as_text(both):
    _, live, left = both
    for run in (live, left):
        expected = "since = 50 ms and until = 3 ms: expected an end after the begin"
        assert refused(run.spikes, "drive", since="0.05 s", until="3 ms") == expected


@pytest.mark.parametrize("words", [{}, {"delays": True}, {"pre": [0, 3]}, {"post": 2, "delays": True}, {"post": [5]}])
@pytest.mark.parametrize("name", ["w", "back"])
def test_weights(both, name, words):
    net, live, left = both
    mine, theirs = live.weights(name, **words), left.weights(net.projections[name], **words)
    assert len(mine) == 3 + words.get("delays", False)
    equal(mine, theirs)


def test_weights_of_views_and_pairs(both):
    net, live, left = both
    cells = net.populations["cells"]
    for words in ({"post": cells[1]}, {"pre": net.populations["drive"][:4]}, {"of": [(2, 5), (0, 1)]}):
        name = "back" if "of" in words else "w"
        equal(live.weights(name, **words), left.weights(name, **words))
    for what in ("weight", "delay"):
        assert np.array_equal(live.get("w", what, post=cells[0]), left.get("w", what, post=cells[0]))


def test_wrong_ends(both, messages):
    for run in both[1:]:
        messages.calls({"run": run})


@pytest.mark.parametrize("name", ["all_spikes", "some_spikes", "v"])
def test_traces(both, name):
    net, live, left = both
    equal(live.trace(name), left.trace(name))
    equal(live.trace(name), left.trace(net.probes[name]))


def test_a_file_has_no_states(both, messages):
    messages.calls({"left": both[2]})


def test_a_bill(both):
    _, live, left = both
    assert left.energy("loihi").total_j == live.energy("loihi").total_j
    assert left.energy("loihi", step_s=1e-3).total_j == live.energy("loihi", step_s=1e-3).total_j


def test_a_picture(both):
    live, left = both[1:]
    assert [axis.get_title("left") for axis in left.plot("cells").axes] == [
        axis.get_title("left") for axis in live.plot("cells").axes
    ]


def test_what_is_held(both):
    assert both[2].held == both[1].held == 0.0
