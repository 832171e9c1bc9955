"""Recorded spikes in files: HDF5, NPY and CSV give the same, and what is wrong in them is told."""

# ruff: noqa: E501
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from neuro.core.errors import ModelError
from neuro.files.results import write
from neuro.run.collect import collect

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


@pytest.mark.parametrize(
    "words",
    [
        "{file: spikes.h5, key: run/exc}",
        "{file: spikes.h5, key: table}",
        "{spikes: {file: table.npy}}",
        "{file: fields.npy}",
        "{file: spikes.csv}",
        "{file: marked.csv}",
    ],
)
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


MISTAKES = {
    "{file: spikes.txt}": "net.yaml:4:39: population 'input': file 'spikes.txt': expected a name ending in .h5, .hdf5, .npy, .csv",
    "{file: spikes.csv, key: a}": "net.yaml:4:56: population 'input': a key for 'spikes.csv': expected none, a CSV file holds one table",
    "{file: spikes.h5, key: uneven}": "net.yaml:4:55: population 'input': 'uneven' in 'spikes.h5' holds 4 times and 2 ids: expected as many of each, in lists",
    "{file: spikes.h5, key: half}": "net.yaml:4:55: population 'input': no data set 'half/ids' in 'spikes.h5'",
    "{file: flat.npy}": "net.yaml:4:39: population 'input': file 'flat.npy' holds an array of shape [4]: expected two columns, times and ids",
    "{file: other.npy}": "net.yaml:4:39: population 'input': file 'other.npy' has no column 'times': found 't', 'ids': expected 'times' and 'ids'",
    "{file: no.csv}": "net.yaml:4:39: population 'input': file 'no.csv' has no column 'times': found 'time', 'ids': expected 'times' and 'ids'",
    "{file: empty.csv}": "net.yaml:4:39: population 'input': file 'empty.csv' has no column 'times': found nothing: expected 'times' and 'ids'",
    "{file: bad.csv}": "net.yaml:4:39: population 'input': file 'bad.csv', line 3: found '0.75,one': expected a time and a neuron",
    "{file: damaged.npy}": "net.yaml:4:39: population 'input': file 'damaged.npy': expected an NPY file with an array of numbers",
    "{file: damaged.h5, key: a}": "net.yaml:4:39: population 'input': file 'damaged.h5': expected an HDF5 file that can be read",
    "{file: spikes.h5, key: back}": "net.yaml:4:39: population 'input': spike_train.spikes[1] = 1 ms of neuron 0 after 2 ms: expected a row for each spike: a time > 0 ms, not before the last one, and a neuron",
    "{file: spikes.h5, key: nan}": "net.yaml:4:39: population 'input': spike_train.spikes[1] = .nan ms of neuron 0: expected a row for each spike: a time > 0 ms, not before the last one, and a neuron",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_mistakes_are_told(folder, words):
    written()
    with pytest.raises(ModelError) as told:
        loaded(words)
    assert str(told.value).partition("\n")[0] == MISTAKES[words]
