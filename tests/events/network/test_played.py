"""An event camera is a population: its recording drives a network in its own time."""

import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from event_tests import refusal
from neuro import ModelError
from neuro.compiler import cameras
from neuro.core.clock import Clock
from neuro.events import Events, load, save
from seen import STEP, network, same_run

FORMATS = [
    ("davis346_small.aedat4", {"crop": {"x": [100, 220], "y": [80, 200]}, "scale": 3}),
    ("ncars_cars_obj_004414_td.dat", {"crop": {"x": [0, 60], "y": [0, 60]}}),
    ("evt3_imx636_wrap.raw", {"crop": {"x": [400, 700], "y": [100, 400]}, "scale": 4}),
    ("es_poker_club_trcl0.es", {"polarity": "merge"}),
    ("nmnist_sample.bin", {"polarity": "off", "offset": 100.0}),
    ("mnistdvs_0_scale04_0001.aedat", {"polarity": "on", "scale": 2}),
]


def by_hand(events, resolution=STEP, **words):
    """Step and neuron of each event, one after the other, in exact numbers."""
    width, height = events.sensor_size
    crop, scale = words.get("crop") or {}, words.get("scale", 1)
    (left, right), (top, bottom) = crop.get("x") or (0, width), crop.get("y") or (0, height)
    columns, rows = -(-(right - left) // scale), -(-(bottom - top) // scale)
    h = Fraction(str(resolution)) * 1000
    begin = words.get("origin", int(events.t[0]) if len(events) else 0) + round(words.get("offset", 0.0) * 1000)
    first, last = (words.get(word, bound) / resolution for word, bound in (("start", 0.0), ("stop", np.inf)))
    polarity, found = words.get("polarity", "split"), []
    for t, x, y, p in events:
        if t < begin or not (left <= x < right and top <= y < bottom) or polarity == ("off" if p else "on"):
            continue
        step = round(first) + (t - begin) // h + 1
        if step <= (last if np.isinf(last) else round(last)):
            place = (y - top) // scale * columns + (x - left) // scale
            found.append((step, place + p * rows * columns * (polarity == "split")))
    return found, (2,) * (polarity == "split") + (rows, columns)


def generator(rows, shape):
    """A spike_generator that emits what was found by hand."""
    times = [[] for _ in range(int(np.prod(shape)))]
    for step, neuron in sorted(rows):
        times[neuron].append(step * STEP)
    return neuro.spike_generator(spike_times=times)


@pytest.mark.parametrize(("name", "words"), FORMATS, ids=[name for name, _ in FORMATS])
def test_a_recording_drives_as_its_listed_spikes_do(shared, name, words, short):
    path = shared / "data" / "formats" / name
    rows, shape = by_hand(load(path), **words, stop=60.0)
    sim = neuro.compile(network(neuro.event_camera(file=path, stop=60.0, **words)))
    other = neuro.compile(network(generator(rows, shape), shape))
    assert sim.program.populations[0].shape == shape
    for one in (sim, other):
        one.run(80.0)
    assert len(rows) > 300
    assert sim.counts().populations["cells"].spikes > 0
    same_run(sim, other)


@st.composite
def cases(draw):
    times = draw(st.lists(st.integers(0, 3000), min_size=1, max_size=30))
    n = len(times)
    x, y, p = (draw(st.lists(st.integers(0, top), min_size=n, max_size=n)) for top in (6, 4, 1))
    events = Events(np.sort(times) + draw(st.sampled_from([0, 10**15])), x, y, p, (7, 5))
    words = {
        "polarity": draw(st.sampled_from(["split", "merge", "on", "off"])),
        "scale": draw(st.integers(1, 4)),
        "crop": draw(st.sampled_from([None, {"x": [1, 6]}, {"x": [0, 7], "y": [2, 3]}])),
        "offset": draw(st.sampled_from([0.0, 0.001, 0.5])),
    }
    if draw(st.booleans()):
        words["origin"] = int(events.t[0]) + draw(st.integers(-500, 500))
    resolution = draw(st.sampled_from([0.1, 1.0, 0.0125, 0.007, 1 / 3, 0.25]))
    words["start"] = draw(st.integers(0, 3)) * resolution
    words["stop"] = draw(st.sampled_from([np.inf, 5 * resolution]))
    return events, resolution, words


@settings(max_examples=100)
@given(cases(), st.integers(0, 40))
def test_the_step_of_an_event_is_exact(case, after):
    events, resolution, words = case
    exact = Fraction(1, 3) if resolution == 1 / 3 else Fraction(str(resolution))
    rows, shape = by_hand(events, **words, resolution=exact)
    part = neuro.Network("n", resolution=resolution).population("c", "auto", neuro.event_camera(events=events, **words))
    camera = cameras.CameraInput(part, part.model, Clock(resolution))
    assert camera.shape == shape
    stretches = list(camera.after(after))
    found = [row for s in stretches for row in zip(s.steps.tolist(), s.ids.tolist(), strict=True)]
    assert found == [row for row in rows if row[0] > after]
    given_up_to = [s.until for s in stretches]
    assert given_up_to == sorted(given_up_to)
    assert all(s.steps.max(initial=-(2**62)) <= s.until for s in stretches)
    assert all(s.steps.min(initial=2**62) > before for s, before in zip(stretches[1:], given_up_to, strict=False))


def test_running_in_parts_and_again_gives_the_same_bits(walk, short):
    whole = neuro.compile(network(neuro.event_camera(events=walk)))
    whole.run(70.0)
    parts = neuro.compile(network(neuro.event_camera(events=[walk[:1], walk[1:1500], walk[1500:]])))
    for ms in (0.0, 0.1, 19.9, 3.0, 27.0, 20.0):
        parts.run(ms)
    same_run(whole, parts)
    parts.reset()
    parts.run(70.0)
    same_run(whole, parts)


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("backend", ["event", "reference", "loihi", "spinnaker"])
def test_a_saved_state_goes_on_in_the_recording(walk, short, backend, tmp_path):
    save(walk, tmp_path / "walk.dat")
    net = network(neuro.event_camera(file=tmp_path / "walk.dat"), resolution=1.0 if backend == "spinnaker" else STEP)
    sims = [neuro.compile(net, backend) for _ in range(2)]
    sims[0].run(23.0)
    sims[0].save(tmp_path / "state.h5")
    sims[0].run(40.0)
    sims[1].run(5.0)
    sims[1].restore(tmp_path / "state.h5")
    sims[1].run(40.0)
    same_run(*sims)


def test_a_state_of_another_recording_is_refused(walk, tmp_path):
    neuro.compile(network(neuro.event_camera(events=walk))).save(tmp_path / "state.h5")
    with pytest.raises(ModelError, match="a state of another network 'seen'"):
        neuro.compile(network(neuro.event_camera(events=walk[:99]))).restore(tmp_path / "state.h5")


def test_what_has_no_file_here_cannot_be_saved(messages, walk, tmp_path):
    save(walk, tmp_path / "walk.dat")
    (tmp_path / "sub").mkdir()
    told = {"events": refusal(network(neuro.event_camera(events=walk)).save, tmp_path / "net.yaml")}
    net = network(neuro.event_camera(file=tmp_path / "walk.dat"))
    told["elsewhere"] = refusal(net.save, tmp_path / "sub" / "net.yaml")
    messages({case: text.replace(f"{tmp_path}/", "") for case, text in told.items()})


def test_what_was_learnt_keeps_its_camera(walk, tmp_path):
    save(walk, tmp_path / "walk.npz")
    sim = neuro.compile(network(neuro.event_camera(file=tmp_path / "walk.npz")))
    sim.run(20.0)
    sim.network().save(tmp_path / "net.yaml")
    assert "camera: {model: {event_camera: {file: walk.npz}}, shape: [2, 9, 12]}" in (tmp_path / "net.yaml").read_text()
    again = neuro.load(tmp_path / "net.yaml")
    assert again.populations["camera"].model.file == tmp_path / "walk.npz"
    assert neuro.compile(again).program.populations[0].shape == (2, 9, 12)


def test_in_yaml_a_file_lies_beside_the_description(messages, tmp_path, walk):
    save(walk, tmp_path / "walk.dat")
    file = tmp_path / "net.yaml"
    text, told = "neuro: 1\npopulations:\n  camera: {model: {event_camera: {file: NAME}}, shape: auto}\n", {}
    for line in ("file: wlak.dat", "file: ../walk.dat", "events: x"):
        file.write_text(text.replace("file: NAME", line))
        told[line] = refusal(neuro.load, file).replace(f"{tmp_path}/", "")
    messages(told)
    file.write_text(text.replace("NAME", "walk.dat, polarity: off, crop: {x: [2, 8]}, scale: 3"))
    assert neuro.compile(neuro.load(file)).program.populations[0].shape == (3, 2)


def test_memory_does_not_grow_with_the_recording(tmp_path):
    """Its spikes are neither listed nor, unless a probe asks, kept."""
    rng, n = np.random.default_rng(0), 200_000

    def parts(seconds):
        for k in range(seconds):
            t = np.sort(rng.integers(0, 10**6, n)) + k * 10**6
            yield Events(t, rng.integers(0, 64, n), rng.integers(0, 64, n), rng.integers(0, 2, n), (64, 64))

    sizes = []
    for seconds in (2, 8):
        path = tmp_path / f"{seconds}.dat"
        save(parts(seconds), path)
        net = neuro.Network(resolution=1.0)
        net.population("camera", "auto", neuro.event_camera(file=path))
        sim, most = neuro.compile(net), 0
        for _ in range(4):
            sim.run(seconds * 250.0)
            most = max(most, sum(sim.memory().values()))
        assert sim.counts().populations["camera"].spikes == seconds * n
        sizes.append(most)
    assert sizes[1] < 1.05 * sizes[0]


def test_people_are_told_the_model_that_they_know(messages, walk):
    net = network(neuro.event_camera(events=walk))
    code = {"rate": {"max_rate": 50.0, "min_rate": 0.0, "r_max": 1.0, "r_min": 0.0}}
    net.population("coded", 2, neuro.encode(values=[0.5, 1.0], code=code))
    net.population("bias", 1, neuro.dc_generator())
    net.connect("bias", "cells", neuro.all_to_all())
    sim = neuro.compile(net)
    sim.run(5.0)
    assert "camera  event_camera" in str(sim)
    said = {"camera": "event_camera", "cells": "iaf_psc_exp", "coded": "encode", "bias": "dc_generator"}
    assert {part.name: part.model_name for part in sim.program.populations} == said
    wrong = network(neuro.event_camera(events=walk))
    wrong.connect("cells", "camera", neuro.all_to_all())
    calls = {"inject": lambda: sim.inject("camera", [6.0], [0]), "spikes": lambda: sim.spikes("coded")}
    calls["connect"] = lambda: neuro.compile(wrong)
    messages({case: re.sub(r"^\w+\.py:\d+: ", "", refusal(call)) for case, call in calls.items()})


def test_a_camera_is_compared_and_recorded(walk, tmp_path):
    save(walk, tmp_path / "walk.aedat4")
    net = network(neuro.event_camera(file=tmp_path / "walk.aedat4"))
    del net.probes["sent"]
    assert neuro.compare.compare(net, ["reference", "event"], 10.0).runs[0].populations["camera"].spikes > 0
