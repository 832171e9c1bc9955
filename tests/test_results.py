"""A file of results gives back what was put into it."""

from dataclasses import fields

import h5py
import numpy as np
import pytest

from neuro.core.hdf5 import FRONT, seal
from neuro.files.parts import Trace, Train, Weights
from neuro.files.results import YAML, Results, read, write
from refused import refused


@pytest.fixture
def results():
    steps = np.arange(20_000)
    ids = steps % 6
    arrays = (steps, ids, np.ones(20_000, np.int32), np.bincount(ids), np.bincount(ids))
    train = Train("iaf_psc_exp", (2, 3), {"spikes": 20_000}, True, 0.1, *arrays)
    none, zero = np.zeros(0, np.int64), np.zeros(1, np.int64)
    silent = Train("dc_generator", (1,), {"spikes": 0}, False, 0.1, none, none, none.astype(np.int32), zero, zero)
    pairs = Weights(
        "z", "a", "stdp", 2, {"synaptic_ops": 4}, np.array([0, 1]), np.array([1, 0]), np.array([0.5, np.pi])
    )
    late = Weights("z", "a", "stddp", 1, {"synaptic_ops": 3}, *[np.array([0])] * 2, np.ones(1), np.array([31.25]))
    kernel = Weights("z", "a", "r_stdp", 4, {"synaptic_ops": 0}, weight=np.ones((1, 1, 2, 2)))
    trace = Trace("a", "V_m", "mV", np.array([0.1, 0.2]), np.array([[1.0], [2.0]]))
    about = {"network": "net", "backend": "event", "seed": 3, "duration_ms": 2000.0, "counts.steps": 20_000}
    files = {YAML: "neuro: 1\nname: ä\n".encode(), "network.h5": bytes(range(256))}
    return Results(about, files, {"z": train, "a": silent}, {"z_a": pairs, "late": late, "grid": kernel}, {"v": trace})


def same(a, b):
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return type(a) is type(b) and a == b


def test_round_trip(results, tmp_path):
    write(results, tmp_path / "a.h5")
    back = read(tmp_path / "a.h5")
    assert back.about == results.about
    assert back.files == results.files
    for section in ("populations", "projections", "traces"):
        mine, theirs = getattr(results, section), getattr(back, section)
        assert list(mine) == list(theirs)
        for name, part in mine.items():
            for field in fields(part):
                assert same(getattr(part, field.name), getattr(theirs[name], field.name)), (name, field.name)
    assert back.populations["z"].size == 6


@pytest.mark.parametrize("content", [b"", b"text", b"\x89HDF\r\n\x1a\n and no more"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    assert "a.h5: not a file of results, as 'neuro run' writes it" in refused(read, tmp_path / "a.h5")


def test_a_damaged_file_is_refused(results, tmp_path):
    write(results, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["populations/z/steps"]
    assert "a.h5: damaged neuro results 3: the content does not match the digest\n" in refused(read, tmp_path / "a.h5")
    seal(tmp_path / "a.h5")
    assert "a.h5: damaged: " in refused(read, tmp_path / "a.h5")


def test_without_a_digest_it_is_refused(results, tmp_path):
    write(results, tmp_path / "a.h5")
    (tmp_path / "a.h5").write_bytes((tmp_path / "a.h5").read_bytes()[FRONT:])
    told = "not a file of results, as 'neuro run' writes it\n  hint: the file has no digest: other tools or an"
    assert refused(read, tmp_path / "a.h5") == f"{tmp_path}/a.h5: {told} old version wrote it: make it again"


@pytest.mark.parametrize("absolute", [True, False])
def test_a_network_file_outside_the_network_is_refused(results, tmp_path, absolute):
    """HDF5 gives any bytes as a name, also those of a path; written there, a third-party file would replace ours."""
    name = str(tmp_path / "written") if absolute else ".."
    write(results, tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file[f"network_files/{name.replace('/', '%')}"] = np.zeros(3, np.uint8)
        if absolute:
            file[name] = np.zeros(3, np.uint8)  # what the name leads to when it is looked up
    data = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5").write_bytes(data.replace(name.replace("/", "%").encode(), name.encode()))
    seal(tmp_path / "a.h5")
    lack = "a name leads to no part of the file" if absolute else f"{name!r} is not the name of a file of the network"
    assert refused(lambda: read(tmp_path / "a.h5").network()) == f"{tmp_path / 'a.h5'}: damaged: {lack}"
    assert not (tmp_path / "written").exists()
