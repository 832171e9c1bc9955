"""What was forgotten, or has gone to a file, is told and not left out in silence."""

import neuro
from neuro import Network
from refused import without_place


def simulated():
    net = Network("n", resolution=1.0)
    net.population("a", 1, neuro.spike_generator(spike_times=[[2.0, 5.0, 8.0, 11.0]]))
    net.population("b", 1, neuro.iaf_psc_delta())
    net.connect("a", "b", neuro.one_to_one())
    net.probe("v", "b", "V_m", every=1.0)
    return neuro.compile(net, "reference")


def test_spikes_that_were_forgotten_are_not_left_out_in_silence(tmp_path, messages):
    sim = simulated()
    sim.run(10.0)
    sim.forget(5.0)
    hint = "\n  hint: sim.spikes('a') returns all spikes in memory"
    begin = "spikes of 'a': since = 2 ms: spikes up to 5 ms were forgotten: expected since >= 5 ms" + hint
    assert without_place(sim.spikes, "a", since=2.0) == begin
    messages({"told": without_place(sim.spikes, "a", until=5.0).replace(f"{tmp_path}/", "")})
    for words in ({}, {"since": 5.0}, {"until": 9.0}):
        assert sim.spikes("a", **words)[0].tolist() == [8.0]
    assert sim.trace("v")[0].tolist() == [6.0, 7.0, 8.0, 9.0, 10.0]
    sim.forget(1.0)
    assert without_place(sim.spikes, "a", since=2.0) == begin
    sim.save(tmp_path / "state.h5")
    other = simulated()
    other.restore(tmp_path / "state.h5")
    assert without_place(other.spikes, "a", since=2.0) == begin
    sim.reset()
    assert sim.spikes("a", since=0.0)[0].tolist() == []


def test_what_is_to_come_is_not_forgotten():
    sim = simulated()
    sim.run(4.0)
    sim.forget(100.0)
    sim.run(6.0)
    assert sim.spikes("a", since=4.0)[0].tolist() == [5.0, 8.0]


def test_spikes_that_are_in_a_file(tmp_path, messages):
    sim, path = simulated(), tmp_path / "run.h5"
    sim.run(6.0, out=path)
    assert sim.spikes("a", since=0.0)[0].tolist() == [2.0, 5.0]
    sim.run(6.0)
    messages({"told": without_place(sim.spikes, "a", since=3.0).replace(f"{tmp_path}/", "")})
    assert sim.spikes("a", since=6.0)[0].tolist() == [8.0, 11.0]
    assert neuro.results.read(path).spikes("a")[0].tolist() == [2.0, 5.0]


def test_pictures_are_of_what_is_held():
    sim = simulated()
    sim.run(20.0)
    sim.forget(10.0)
    assert neuro.plots.raster(sim).axes[0].get_xlim() == (10.0, 20.0)
    expected = "window = [5, 20]: records up to 10 ms were forgotten: expected a begin >= 10 ms"
    assert without_place(neuro.plots.raster, sim, window=(5.0, 20.0)) == expected
    assert without_place(neuro.plots.trace, sim, "v", window=(5.0, 20.0)) == expected
