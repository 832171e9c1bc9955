"""The calls of `Simulation`: what they return, and what they say when misused."""

import os
import re
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from beside import beside
from neuro import Network, all_to_all, grid, iaf_psc_delta, iaf_psc_exp, one_to_one, poisson_generator, stdp
from neuro.core.errors import Where
from neuro.core.hdf5 import writing
from neuro.program.backend import Problem
from neuro.program.program import Program
from neuro.run.compiled import ApproximationWarning
from neuro.run.simulation import Simulation
from neuro_reference import ReferenceBackend
from refused import refused


def small() -> Network:
    net = Network("small", resolution=0.1)
    net.population("noise", 3, poisson_generator(rate=800.0))
    net.population("listed", 2, neuro.spike_generator(spike_times=[[1.0, 1.0, 2.5], [1.0]]))
    net.population("cells", 3, iaf_psc_exp(tau_m=[10.0, 20.0, 30.0]))
    net.connect("noise", "cells", all_to_all(), stdp(Wmax=900.0), weight=400.0, delay=1.5, name="plastic")
    net.connect("listed", "cells", neuro.pairs(pre=[1, 0], post=[2, 0]), weight=[10.0, 20.0], name="pairs")
    net.signal("reward", to="cells")
    net.probe("v", "cells", "V_m", every=0.5)
    net.probe("s", "noise")
    return net


def start(net: Network | None = None, **words: object) -> Simulation:
    return neuro.compile(net or small(), backend="reference", **words)  # type: ignore[arg-type]


def test_time_is_the_nearest_double():
    sim = start()
    for _ in range(3):
        sim.run(0.1)
    assert sim.time == 0.3
    assert repr(sim) == "Simulation('small', backend='reference', time=0.3 ms)"


def test_spikes_are_listed_as_often_as_they_occur():
    sim = start()
    sim.run(5.0)
    times, ids = sim.spikes("listed")
    assert times.tolist() == [1.0, 1.0, 1.0, 2.5]
    assert ids.tolist() == [0, 0, 1, 0]
    assert sim.spikes("listed", since=1.0)[0].tolist() == [2.5]
    assert [a.dtype for a in (times, ids)] == [np.float64, np.int64]
    sim.forget(before=1.0)
    assert sim.spikes("listed")[0].tolist() == [2.5]


def test_traces_begin_at_the_first_interval():
    sim = start()
    sim.run(1.2)
    sim.run(0.8)
    times, values = sim.trace("v")
    assert times.tolist() == [0.5, 1.0, 1.5, 2.0]
    assert values.shape == (4, 3)
    assert sim.trace("s")[0].size == sim.counts().populations["noise"].spikes
    sim.forget(before=1.0)
    assert sim.trace("v")[0].tolist() == [1.5, 2.0]


def test_weights_come_with_their_ends():
    pre, post, weight = start().weights("pairs")
    assert (pre.tolist(), post.tolist(), weight.tolist()) == ([0, 1], [0, 2], [20.0, 10.0])
    with pytest.raises(ValueError, match="read-only"):
        pre[0] = 1


def test_weights_of_a_grid_are_kernels():
    net = Network("grid", resolution=1.0)
    net.population("sheet", (2, 4, 5), poisson_generator())
    net.population("maps", (3, "auto", "auto"), iaf_psc_exp())
    kernels = np.arange(36.0).reshape(3, 2, 3, 2)
    net.connect("sheet", "maps", grid(kernel=[3, 2]), weight=kernels, name="s2")
    sim = start(net)
    assert np.array_equal(sim.weights("s2"), kernels)
    sim.set_weights("s2", 2.0 * kernels)
    assert np.array_equal(sim.network().projections["s2"].weight, 2.0 * kernels)


def test_get_and_set():
    sim = start()
    assert sim.get("cells", "tau_m").tolist() == [10.0, 20.0, 30.0]
    sim.set("cells", tau_m=15.0, V_m=[-60.0, -61.0, -62.0])
    assert sim.get("cells", "tau_m").tolist() == [15.0] * 3
    assert sim.get("cells", "V_m").tolist() == [-60.0, -61.0, -62.0]
    sim.set("cells", V_m=neuro.uniform(low=-70.0, high=-60.0))
    first = sim.get("cells", "V_m")
    assert ((first >= -70.0) & (first < -60.0)).all()
    assert len(set(first.tolist())) == 3
    sim.set("plastic", lambda_=0.5)
    assert sim.network().projections["plastic"].synapse.lambda_ == 0.5
    assert sim.get("plastic", "K_plus").shape == (9,)


def test_counts_by_hand():
    sim = start()
    sim.run(3.0)
    counts = sim.counts()
    noise = counts.populations["noise"].spikes
    assert counts.steps == 30
    assert counts.populations["listed"].spikes == 4
    assert counts.projections["pairs"].synaptic_ops == 4
    assert counts.projections["plastic"].synaptic_ops == 3 * noise
    assert counts.spikes == noise + 4 + counts.populations["cells"].spikes
    assert counts.neuron_updates == 3 * 30
    assert 0 < counts.neuron_updates_active <= counts.neuron_updates
    assert counts.learning_updates >= 3 * counts.populations["cells"].spikes


def test_the_learnt_network_has_listed_pairs():
    net = Network("random", resolution=0.1)
    net.population("noise", 5, poisson_generator(rate=900.0))
    net.population("cells", 4, iaf_psc_delta(I_e=neuro.uniform(low=0.0, high=10.0)), initial={"V_m": neuro.normal()})
    net.connect("noise", "cells", neuro.fixed_indegree(n=2), weight=neuro.normal(), delay=neuro.uniform(low=1, high=3))
    sim = start(net)
    sim.run(5.0)
    learnt = sim.network()
    again = start(learnt, seed=99)
    assert learnt.projections["noise_cells"].rule.name == "pairs"
    for name in ("weight",):
        assert np.array_equal(again.get("noise_cells", name), sim.get("noise_cells", name))
    assert np.array_equal(again.get("cells", "I_e"), sim.get("cells", "I_e"))
    assert np.array_equal(again.program.projections[0].delay, sim.program.projections[0].delay)


def test_distributions_become_arrays_that_save(tmp_path: Path):
    sim = start()
    sim.run(2.0)
    sim.network().save(tmp_path / "learnt.yaml")
    assert neuro.load(tmp_path / "learnt.yaml") == sim.network()


def test_a_reset_keeps_parameters_and_clears_traces():
    sim = start()
    sim.set("noise", rate=0.0)
    sim.run(2.0)
    sim.reset()
    assert sim.time == 0.0
    assert sim.trace("v")[0].size == 0
    assert sim.get("noise", "rate").tolist() == [0.0] * 3


def test_memory_is_told():
    assert start().memory()["synapses"] > 0


def test_misuse(messages):
    messages.calls(lambda: globals() | {"s": start()})


def without_probes() -> Simulation:
    net = small()
    del net.probes["s"]
    return start(net)


def test_compile_refuses(messages, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    messages.calls(globals())


class Narrow(ReferenceBackend):
    """A backend with limits."""

    name = "narrow"

    def __init__(self, refused: bool) -> None:
        self.refused = refused

    def problems(self, program: Program) -> Sequence[Problem]:
        where = Where("net.yaml", 12)
        return [
            Problem(self.refused, f"population '{p.name}'", f"needs {p.size} cores, limit 1", "split it", where)
            for p in program.populations[:2]
        ]


def test_what_is_approximated_is_a_warning():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        neuro.compile(small(), Narrow(refused=False))
    told = "backend 'narrow': net.yaml:12: population 'noise': needs 3 cores, limit 1\n  hint: split it"
    assert str(caught[0].message) == told
    assert [w.category for w in caught] == [ApproximationWarning] * 2


def test_a_state_of_something_else_is_refused(tmp_path: Path):
    file = tmp_path / "state.h5"
    sim = start()
    sim.run(1.0)
    sim.save(file)
    other = small()
    other.population("more", 1, iaf_psc_exp())
    changed = Network("other", resolution=0.1)
    changed.population("cells", 1, iaf_psc_exp())
    for net, words, message in (
        (small(), {"seed": 3}, "a state of seed 0: expected seed 3"),
        (changed, {}, "a state of network 'small': expected network 'other'"),
        (other, {}, "a state of another network 'small'"),
    ):
        assert re.search(message, refused(start(net, **words).restore, file))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        narrow = neuro.compile(small(), Narrow(refused=False))
    assert "a state of backend 'reference': expected backend 'narrow'" in refused(narrow.restore, file)
    file.write_bytes(b"nothing")
    assert "not a state written by sim.save" in refused(sim.restore, file)
    with h5py.File(file, "w") as empty:
        empty["x"] = 1
    assert "not a state written by sim.save\n  hint: the file has no digest" in refused(sim.restore, file)
    assert sim.time == 1.0


@pytest.mark.parametrize("backend", ["reference", "event"])
@pytest.mark.parametrize("damage", ["an array is missing", "a value is another", "an array is longer"])
def test_a_damaged_state_is_refused(tmp_path: Path, backend: str, damage: str):
    sim = neuro.compile(small(), backend=backend)
    sim.run(1.0)
    sim.save(tmp_path / "state.h5")
    sim.run(1.0)
    with h5py.File(tmp_path / "state.h5", "r+") as file:
        names: list[str] = []
        file["engine"].visititems(lambda name, item: names.append(name) if getattr(item, "size", 0) else None)
        last = f"engine/{names[-1]}"
        values = file[last][()]
        del file[last]
        if damage == "a value is another":
            file[last] = ~values if values.dtype == bool else values + 1
        elif damage == "an array is longer":
            file[last] = np.append(values, values)
    assert "damaged neuro state 2: the content does not match the digest" in refused(sim.restore, tmp_path / "state.h5")
    assert sim.time == 2.0


def test_a_state_of_an_earlier_version_is_refused(tmp_path: Path, messages):
    with writing(tmp_path / "state.h5", "neuro state 1") as file:
        file.attrs["backend"] = "event"
    messages({"told": refused(start().restore, tmp_path / "state.h5").replace(f"{tmp_path}/", "")})


def test_a_state_replaces_the_old_file_at_once(tmp_path: Path):
    file = tmp_path / "state.h5"
    sim = start()
    sim.save(file)
    sim.run(1.0)
    sim.save(file)
    assert [p.name for p in tmp_path.iterdir()] == ["state.h5"]
    again = start()
    again.restore(file)
    assert again.time == 1.0
    assert "there is no folder" in refused(sim.save, tmp_path / "missing" / "state.h5")


(HALF,) = beside(__file__, "HALF")


def test_a_state_of_another_process_continues(tmp_path: Path):
    """It holds no address of machine code: that lies elsewhere in each process."""
    net = Network("learns")
    net.population("in", 20, poisson_generator(rate=200.0))
    net.population("out", 20, iaf_psc_exp())
    net.connect("in", "out", all_to_all(), stdp(Wmax=100.0), weight=50.0, delay=1.0)
    net.connect("out", "out", all_to_all(), weight=5.0, delay=neuro.uniform(low=1.0, high=5.0))
    net.save(tmp_path / "net.yaml")
    subprocess.run([sys.executable, "-c", HALF, tmp_path / "net.yaml", tmp_path / "state.h5"], check=True)
    whole, half = neuro.compile(net), neuro.compile(neuro.load(tmp_path / "net.yaml"))
    whole.run(100.0)
    half.restore(tmp_path / "state.h5")
    half.run(50.0)
    for mine, other in zip(half.spikes("out", since=50.0), whole.spikes("out", since=50.0), strict=True):
        assert len(mine) > 10
        assert mine.tolist() == other.tolist()


def test_one_connection_of_each_kind_reads_alike():
    net = Network("kinds", resolution=1.0)
    net.population("a", 3, poisson_generator())
    net.population("b", 3, iaf_psc_exp())
    net.connect("a", "b", one_to_one(), weight=[1.0, 2.0, 3.0], name="one")
    net.connect("a", "b", all_to_all(), weight=np.arange(9.0).reshape(3, 3), name="all")
    net.connect("b", "b", all_to_all(autapses=False), weight=np.arange(9.0).reshape(3, 3), name="others")
    sim = start(net)
    assert [x.tolist() for x in sim.weights("one")] == [[0, 1, 2], [0, 1, 2], [1.0, 2.0, 3.0]]
    assert sim.weights("all")[2].tolist() == list(range(9))
    assert [x.tolist() for x in sim.weights("others")] == [[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1], [1, 2, 3, 5, 6, 7]]


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_populations_of_one_model_are_set_apart(backend: str):
    model, net = neuro.iaf_psc_exp(), neuro.Network("alike")
    for name in "ab":
        net.population(name, 2, model)
    sim = neuro.compile(net, backend)
    sim.set("a", I_e=300.0)
    sim.set("a", V_m=-60.0)
    sim.run(1.0)
    assert sim.get("b", "I_e").tolist() == [0.0, 0.0]
    assert sim.get("b", "V_m").tolist() == [-70.0, -70.0]
    assert neuro.compile(net, backend).get("a", "I_e").tolist() == [0.0, 0.0]
