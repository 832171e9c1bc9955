"""Recorded spikes in files: HDF5, NPY and CSV give the same, and what is wrong in them is told."""

from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from beside import beside
from neuro.files.results import write
from neuro.run.collect import collect
from refused import refused

TIMES, IDS = np.array([0.5, 0.5, 2.0, 7.25]), np.array([1, 0, 1, 2])


def loaded(words: str) -> neuro.Network:
    text = f"neuro: 1\nresolution: 0.25\npopulations:\n  input: {{model: {{spike_train: {words}}}, shape: 3}}\n"
    Path("net.yaml").write_text(text)
    return neuro.load("net.yaml")


def emitted(net: neuro.Network) -> tuple[list[float], list[int]]:
    sim = neuro.compile(net, "reference")
    sim.run(10.0)
    times, ids = sim.spikes("input")
    return times.tolist(), ids.tolist()


def written() -> None:
    with h5py.File("spikes.h5", "w") as file:
        file["run/exc/times"], file["run/exc/ids"] = TIMES, IDS
        file["table"] = np.stack([TIMES, IDS], axis=1)
        file["uneven/times"], file["uneven/ids"] = TIMES, IDS[:2]
        file["back"] = np.array([[2.0, 0.0], [1.0, 0.0]])
        file["nan"] = np.array([[2.0, 0.0], [np.nan, 0.0]])
        file["half/times"] = TIMES
    np.save("table.npy", np.stack([TIMES, IDS], axis=1))
    np.save("fields.npy", np.array(list(zip(TIMES, IDS, strict=True)), dtype=[("times", float), ("ids", int)]))
    np.save("flat.npy", TIMES)
    np.save("other.npy", np.zeros(2, dtype=[("t", float), ("ids", int)]))
    Path("spikes.csv").write_text("ids,times,weight\n1,0.5,9\n0,0.5,9\n1,2,9\n2,7.25,9\n")
    Path("marked.csv").write_bytes(b"\xef\xbb\xbf" + Path("spikes.csv").read_bytes())
    Path("bad.csv").write_text("times,ids\n0.5,1\n0.75,one\n")
    Path("no.csv").write_text("time,ids\n0.5,1\n")
    Path("empty.csv").write_text("")
    Path("damaged.npy").write_bytes(b"\x93NUMPY\x01")
    Path("damaged.h5").write_bytes(b"no HDF5")


(FILES,) = beside(__file__, "FILES")


@pytest.mark.parametrize("words", FILES)
def test_all_files_give_the_same(folder, words):
    written()
    assert emitted(loaded(words)) == ([0.5, 0.5, 2.0, 7.25], [0, 1, 1, 2])


@pytest.mark.parametrize(
    "words", [{"file": "spikes.h5", "key": "run/exc"}, {"file": Path("fields.npy")}, {"file": "marked.csv"}]
)
def test_a_program_names_files_too(folder, words):
    written()
    net = neuro.Network("program", resolution=0.25)
    net.population("input", 3, neuro.spike_train(**(words | {"file": Path.cwd() / words["file"]})))
    assert emitted(net) == ([0.5, 0.5, 2.0, 7.25], [0, 1, 1, 2])
    assert neuro.spike_train(**words) == neuro.spike_train(spikes=np.stack([TIMES, IDS], axis=1)[[0, 1, 2, 3]])
    net.save("saved.yaml")
    assert neuro.load("saved.yaml") == net


def test_mistakes_of_programs_are_told(folder, messages):
    written()
    messages.calls(globals())


def test_spikes_of_a_run_are_emitted_again(folder):
    net = neuro.Network("first", resolution=0.25)
    net.population("input", 3, neuro.poisson_generator(rate=900.0))
    net.probe("spikes", "input")
    sim = neuro.compile(net, "reference", seed=1)
    sim.run(10.0)
    write(collect(sim, net), "run.h5")
    times, ids = sim.spikes("input")
    assert emitted(loaded("{file: run.h5, key: populations/input}")) == (times.tolist(), ids.tolist())


def test_a_network_keeps_them(folder):
    written()
    net = loaded("{file: spikes.csv}")
    net.save("kept.yaml")
    assert neuro.load("kept.yaml") == net


def test_mistakes_are_told(folder, messages):
    written()
    messages.of(lambda words: refused(loaded, words))
