"""Views of a camera, and results that are read without its recording."""

import numpy as np
import pytest

import neuro
from event_tests import refusal
from neuro.events import save
from seen import network

# views


def test_views_of_a_camera_whose_recording_tells_its_shape(walk, tmp_path):
    save(walk, tmp_path / "walk.aedat4")
    for model in (neuro.event_camera(file=tmp_path / "walk.aedat4"), neuro.event_camera(events=walk)):
        net = network(model)
        camera = net.populations["camera"]
        assert (len(camera), camera.sizes, camera[0, 2:4].shape) == (216, (2, 9, 12), (2, 12))
        assert camera[1, :, -1].ids.tolist() == [108 + 12 * row + 11 for row in range(9)]
        assert (len(camera[np.ones((2, 9, 12), bool)]), camera[[0, 215]].ids.tolist()) == (216, [0, 215])
        assert "camera[:10]: axis 0: found 10: expected -2 to 2" in refusal(camera.__getitem__, slice(10))
        net.connect(camera[0, 2:4], "cells", neuro.all_to_all(), name="some")
        net.probe("part", camera[1, :, 3])
        sim = neuro.compile(net)
        assert sim.program.projections[1].size == 24 * 20
        sim.run(20.0)
        times, ids = sim.trace("part")
        assert times.size
        assert set(((ids - 108) % 12).tolist()) == {3}


def test_views_of_a_camera_whose_shape_is_not_known(messages, walk):
    camera = network(neuro.event_camera(file="nowhere.aedat4")).populations["camera"]
    assert repr(camera[0, 2:4]) == "camera[0, 2:4, :]"
    messages({"len": refusal(len, camera[0, 2:4])})


# results without the recording


def test_results_are_read_without_the_recording(walk, tmp_path, monkeypatch):
    ran, moved = tmp_path / "ran", tmp_path / "moved"
    for folder in (ran, moved):
        folder.mkdir()
    save(walk, ran / "walk.aedat4")
    monkeypatch.chdir(ran)
    neuro.compile(network(neuro.event_camera(file="walk.aedat4"))).run(20.0, out=tmp_path / "ran" / "run.h5")
    monkeypatch.chdir(tmp_path)
    results = neuro.results.read(ran / "run.h5")
    assert results.network().populations["camera"].model.file == ran / "walk.aedat4"
    (ran / "run.h5").rename(moved / "run.h5")
    (ran / "walk.aedat4").rename(moved / "walk.aedat4")
    results = neuro.results.read(moved / "run.h5")
    assert neuro.compile(results.network()).program.populations[0].shape == (2, 9, 12)
    (moved / "walk.aedat4").rename(tmp_path / "other.aedat4")
    results = neuro.results.read(moved / "run.h5")
    assert f"not found in {ran}, {moved}, {tmp_path}\n  hint: " in refusal(results.network)
    (tmp_path / "kept").mkdir()
    (tmp_path / "other.aedat4").rename(tmp_path / "kept" / "walk.aedat4")
    assert results.network(tmp_path / "kept").populations["camera"].model.file == tmp_path / "kept" / "walk.aedat4"
    assert "event_camera" in str(results.network(played=False))
    assert results.spikes("camera")[0].size
    from neuro.files.finished_runs import energy

    bill = energy(results, results.network(played=False), "cpu")
    sim = neuro.compile(network(neuro.event_camera(events=walk)))
    sim.run(20.0)
    assert bill.total_j == pytest.approx(sim.energy("cpu").total_j, rel=1e-12)


def test_results_of_events_of_a_program(messages, walk, tmp_path):
    neuro.compile(network(neuro.event_camera(events=walk))).run(20.0, out=tmp_path / "run.h5")
    results = neuro.results.read(tmp_path / "run.h5")
    assert results.network(played=False).populations["camera"].model == neuro.event_camera()
    messages({"network": refusal(results.network)})
