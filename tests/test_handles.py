"""Parts and views in the calls of a simulation, and synapses chosen by their ends."""

import numpy as np
import pytest

import neuro
from neuro.model.network import Network
from refused import without_place

BACKENDS = ("reference", "event", "loihi")
FLOATS = BACKENDS[:2]


def network() -> Network:
    """Cells that fire, synapses of all layouts, and probes of some."""
    net = Network("n", resolution=1.0)
    source = net.population("source", 6, neuro.spike_generator())
    cells = net.population("cells", 6, neuro.iaf_psc_delta(C_m=1.0, tau_m=float("inf"), E_L=0.0, V_reset=0.0, V_th=9.0))
    net.connect(source, cells, neuro.all_to_all(), weight=2.0, delay=np.arange(1.0, 37.0).reshape(6, 6), name="all")
    net.connect(source[:4], cells[2:], neuro.one_to_one(), weight=[4.0, 5.0, 6.0, 7.0], delay=2.0, name="some")
    net.probe("v", cells[[5, 0]], "V_m", every=2.0)
    net.probe("s", cells[1:3])
    return net


def learning() -> Network:
    """Pairs that learn, too weak to move a spike; their post spikes wait for the next pre spike."""
    net = Network("n")
    cells = net.population("cells", 5, neuro.iaf_psc_exp(I_e=500.0), initial={"V_m": neuro.uniform(low=-70, high=-56)})
    net.connect(
        cells, cells, neuro.all_to_all(autapses=False), neuro.stdp(lambda_=0.2, Wmax=1e-3), weight=5e-4, name="w"
    )
    return net


@pytest.fixture(params=BACKENDS)
def run(request):
    """A network, and a simulation of it that has run."""
    net = network()
    sim = neuro.compile(net, request.param)
    sim.inject(net.populations["source"], [1.0, 4.0, 5.0])
    sim.run(30.0)
    return net, sim


def test_a_part_names_what_its_name_does(run):
    net, sim = run
    cells, wires = net.populations["cells"], net.projections["all"]
    for word in ("V_m", "V_th"):
        assert np.array_equal(sim.get(cells, word), sim.get("cells", word))
    assert np.array_equal(sim.spikes(cells), sim.spikes("cells"))
    assert all(np.array_equal(a, b) for a, b in zip(sim.trace(net.probes["v"]), sim.trace("v"), strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(sim.weights(wires), sim.weights("all"), strict=True))
    assert sim.states(cells) == sim.states("cells") == ["V_m"]
    sim.set(cells, V_m=1.0)
    sim.set_weights(wires, 1.0)
    assert sim.get("cells", "V_m").tolist() == [1.0] * 6
    assert sim.get("all", "weight").tolist() == [1.0] * 36


def test_a_signal_is_named_by_its_part():
    net = Network()
    cells = net.population("cells", 2, neuro.iaf_psc_exp())
    reward = net.signal("reward", to=cells)
    wires = net.connect(cells, cells, neuro.all_to_all(), neuro.stdp_dopa(signal="reward"), weight=1.0)
    sim = neuro.compile(net)
    sim.signal(reward, [0.1, 0.2])
    assert sim.get(wires, "n").tolist() == [0.1, 0.2, 0.1, 0.2]
    assert sim.get(wires, "n", post=cells[1]).tolist() == [0.2, 0.2]


def test_values_of_a_view_are_in_its_order(run):
    net, sim = run
    cells = net.populations["cells"]
    every = sim.get(cells, "V_m")
    assert len(set(every.tolist())) > 1
    for index in (slice(None, None, -1), [4, 0, 2], 3, slice(1, 5, 2)):
        assert sim.get(cells[index], "V_m").tolist() == every[cells[index].ids].tolist()
    sim.set(cells[[4, 0]], V_m=[1.0, 2.0], V_th=[8.0, 7.0])
    every[[4, 0]] = [1.0, 2.0]
    assert sim.get(cells, "V_m").tolist() == every.tolist()
    assert sim.get(cells, "V_th").tolist() == [7.0, 9.0, 9.0, 9.0, 8.0, 9.0]
    sim.set(cells[2:4], V_m=0.0)
    assert sim.get(cells[2:4], "V_m").tolist() == [0.0, 0.0]


def test_spikes_of_a_view_and_of_a_time(run):
    net, sim = run
    cells = net.populations["cells"]
    times, ids = sim.spikes(cells)
    assert len(set(ids.tolist())) > 3
    for since, until in ((None, None), (6.0, None), (None, 9.0), (6.0, 20.0)):
        kept = np.isin(ids, [1, 2, 3]) & (times > (since or 0.0)) & (times <= (until or 99.0))
        found = sim.spikes(cells[3:0:-1], since=since, until=until)
        assert np.array_equal(found, (times[kept], ids[kept]))
    parts = [sim.spikes(cells, since=since, until=since + 10.0)[0] for since in (0.0, 10.0, 20.0)]
    assert np.array_equal(np.concatenate(parts), times)
    assert np.array_equal(sim.trace("s"), sim.spikes(cells[1:3]))


@pytest.mark.parametrize("backend", ["event", "reference", "loihi", "spinnaker"])
def test_spikes_since_the_time_of_a_spike_are_later(backend):
    net = neuro.Network("listed", resolution=0.1)
    net.population("in", 1, neuro.spike_generator(spike_times=[[0.3, 0.6, 0.7, 0.9]]))
    net.probe("s", "in")
    sim = neuro.compile(net, backend)
    sim.run(1.0)
    for since, later in ((0.3, [0.6, 0.7, 0.9]), (0.6, [0.7, 0.9]), (0.7, [0.9])):
        assert sim.spikes("in", since=since)[0].tolist() == later


def test_a_probe_of_a_view_records_its_neurons():
    found = {}
    for index in ([5, 0], slice(None)):
        net = network()
        net.probe("u", net.populations["cells"][index], "V_m")
        sim = neuro.compile(net)
        sim.inject("source", [1.0, 4.0, 5.0])
        sim.run(20.0)
        found[str(index)] = sim.trace("u")[1]
        sim.reset()
        assert sim.trace("u")[1].size == 0
    some, every = found.values()
    assert some.shape == (20, 2)
    assert np.array_equal(some, every[:, [5, 0]])
    assert every.any()


def test_a_probe_of_a_view_is_saved(tmp_path):
    sims = [neuro.compile(network()) for _ in range(2)]
    sims[0].inject("source", [1.0, 4.0, 5.0])
    sims[0].run(11.0)
    sims[0].save(tmp_path / "state.h5")
    sims[1].restore(tmp_path / "state.h5")
    for sim in sims:
        sim.run(9.0)
    assert np.array_equal(sims[0].trace("v")[1], sims[1].trace("v")[1])


@pytest.mark.parametrize("backend", BACKENDS)
def test_spikes_are_injected_into_a_view(backend):
    net = network()
    source = net.populations["source"]
    sim = neuro.compile(net, backend)
    sim.inject(source[2:4], [1.0, 3.0])
    sim.inject(source[::2], [2.0, 5.0], [4, 0])
    sim.run(6.0)
    times, ids = sim.spikes(source)
    assert list(zip(times.tolist(), ids.tolist(), strict=True)) == [(1, 2), (1, 3), (2, 4), (3, 2), (3, 3), (5, 0)]
    assert without_place(sim.inject, source[2:4], [9.0], [1]) == "ids[0] = 1: expected a neuron of source[2:4]"


@pytest.mark.parametrize("backend", FLOATS)
def test_a_neuron_draws_the_same_in_whatever_view(backend):
    found = []
    for views in ([slice(None)], [slice(3, None), [2, 0, 1]]):
        net = network()
        cells = net.populations["cells"]
        sim = neuro.compile(net, backend, seed=4)
        for index in views:
            sim.set(cells[index], V_m=neuro.normal(mean=0.0, std=1.0))
        found.append(sim.get(cells, "V_m"))
    assert len(set(found[0].tolist())) == 6
    assert np.array_equal(*found)


# synapses


def test_synapses_are_chosen_by_their_ends(run):
    net, sim = run
    source, cells = (net.populations[name] for name in ("source", "cells"))
    for wires in net.projections.values():
        pre, post, weight, delay = sim.weights(wires, delays=True)
        for before, after in ((source[1:4], None), (None, cells[[2, 5]]), (source[1], cells[3:]), (source, cells[0])):
            kept = np.ones(pre.size, bool)
            kept &= True if before is None else np.isin(pre, np.arange(6) if before is source else before.ids)
            kept &= True if after is None else np.isin(post, after.ids)
            found = sim.weights(wires, pre=before, post=after, delays=True)
            assert all(np.array_equal(a, b[kept]) for a, b in zip(found, (pre, post, weight, delay), strict=True))
            assert np.array_equal(sim.get(wires, "weight", pre=before, post=after), weight[kept])
            assert np.array_equal(sim.get(wires, "delay", pre=before, post=after), delay[kept])
    assert sim.get("all", "delay").tolist() == list(range(1, 37))
    assert sim.get("some", "delay").tolist() == [2.0] * 4


def test_single_weights_are_set(run):
    net, sim = run
    source, cells = (net.populations[name] for name in ("source", "cells"))
    table = np.full((6, 6), 2.0)
    sim.set("all", weight=1.0, pre=source[2], post=cells[4])
    table[2, 4] = 1.0
    sim.set("all", weight=[0.0, 1.0], pre=source[0], post=cells[[5, 1]])
    table[0, [1, 5]] = [0.0, 1.0]
    assert np.array_equal(sim.get("all", "weight").reshape(6, 6), table)
    sim.set("all", weight=2.0 - table.reshape(-1))
    assert np.array_equal(sim.get("all", "weight").reshape(6, 6), 2.0 - table)
    sim.set("some", weight=1.0, post=cells[4])
    assert sim.get("some", "weight").tolist() == [4.0, 5.0, 1.0, 7.0]


@pytest.mark.parametrize("backend", FLOATS)
def test_setting_some_weights_leaves_what_others_have_learnt(backend):
    """Post spikes that a synapse has yet to show are not lost when another one is set."""
    found = {}
    for how in ("none", "one", "all"):
        net = learning()
        cells = net.populations["cells"]
        sim = neuro.compile(net, backend, seed=1)
        sim.run(33.3)
        shown = sim.get("w", "weight")
        if how == "one":
            sim.set("w", weight=shown[0], pre=cells[0], post=cells[1])
        elif how == "all":
            sim.set_weights("w", shown)
        sim.run(60.0)
        found[how] = sim.get("w", "weight")
    assert np.allclose(found["one"][1:], found["none"][1:], rtol=1e-12, atol=0.0)
    assert not np.allclose(found["all"][1:], found["none"][1:], rtol=1e-3, atol=0.0)


def test_registers_of_a_view_and_of_single_synapses():
    net = network()
    sim = neuro.compile(net, "loihi")
    cells, wires = net.populations["cells"], net.projections["some"]
    assert np.array_equal(sim.get(cells[::-1], "V_th", raw=True), sim.get(cells, "V_th", raw=True)[::-1])
    assert np.array_equal(sim.get(wires, "weight", raw=True, post=cells[3]), sim.get(wires, "weight", raw=True)[1:2])


def test_the_kernels_of_a_grid_stay_whole(messages):
    net = Network()
    sheet = net.population("sheet", (4, 4), neuro.iaf_psc_exp())
    net.population("maps", (2, "auto", "auto"), neuro.iaf_psc_exp())
    wires = net.connect(sheet, "maps", neuro.grid(kernel=(3, 3)), weight=1.0, delay=0.7)
    sim = neuro.compile(net)
    kernels, delay = sim.weights(wires, delays=True)
    assert kernels.shape == (2, 1, 3, 3)
    assert delay == 0.7
    sim.set(wires, weight=2.0 * kernels)
    assert np.array_equal(sim.weights(wires), 2.0 * kernels)
    for call in (sim.weights, lambda of, **ends: sim.set(of, weight=1.0, **ends)):
        messages({"told": without_place(call, wires, pre=sheet[0])})


def test_weights_are_normalised_by_the_part():
    net = network()
    sim = neuro.compile(net)
    neuro.normalise(sim, net.projections["all"], 6.0)
    assert sim.get("all", "weight").tolist() == [1.0] * 36


# refused


def test_what_names_nothing_here_is_refused(messages):
    net = network()
    messages.calls(globals() | {"n": net, "s": neuro.compile(net, "reference")})
