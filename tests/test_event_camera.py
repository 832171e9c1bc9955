"""An event camera is a population: its recording drives a network in its own time."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import neuro
from neuro import ModelError
from neuro.compiler import cameras
from neuro.core.clock import Clock
from neuro.events import EventFileError, Events, load, save, stream

STEP = 0.1
FORMATS = [
    ("davis346_small.aedat4", {"crop": {"x": [100, 220], "y": [80, 200]}, "scale": 3}),
    ("ncars_cars_obj_004414_td.dat", {"crop": {"x": [0, 60], "y": [0, 60]}}),
    ("evt3_imx636_wrap.raw", {"crop": {"x": [400, 700], "y": [100, 400]}, "scale": 4}),
    ("es_poker_club_trcl0.es", {"polarity": "merge"}),
    ("nmnist_sample.bin", {"polarity": "off", "offset": 100.0}),
    ("mnistdvs_0_scale04_0001.aedat", {"polarity": "on", "scale": 2}),
]


def network(model, shape="auto", resolution=STEP):
    net = neuro.Network("seen", resolution=resolution)
    net.population("camera", shape, model)
    net.population("cells", 20, neuro.iaf_psc_exp())
    net.connect("camera", "cells", neuro.fixed_outdegree(n=3), weight=120.0, delay=1.0)
    net.probe("sent", "camera")
    net.probe("v", "cells", "V_m", every=5.0)
    return net


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


def same_run(a, b):
    for what in ("camera", "cells"):
        for x, y in zip(a.spikes(what), b.spikes(what), strict=True):
            np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(a.trace("v")[1], b.trace("v")[1])


@pytest.fixture
def walk():
    rng = np.random.default_rng(3)
    n = 4000
    t = np.sort(rng.integers(7_000_000, 7_060_000, n))
    return Events(t, rng.integers(0, 12, n), rng.integers(0, 9, n), rng.integers(0, 2, n), (12, 9))


@pytest.fixture
def short(monkeypatch):
    """Stretches so short that runs are cut in many places."""
    monkeypatch.setattr(cameras, "MOST", 97)


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


@settings(max_examples=100, deadline=None)
@given(cases(), st.integers(0, 40))
def test_the_step_of_an_event_is_exact(case, after):
    events, resolution, words = case
    exact = Fraction(1, 3) if resolution == 1 / 3 else Fraction(str(resolution))
    rows, shape = by_hand(events, **words, resolution=exact)
    part = neuro.Network("n", resolution=resolution).population("c", "auto", neuro.event_camera(events=events, **words))
    camera = cameras.Camera(part, part.model, Clock(resolution))
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


def test_what_has_no_file_here_cannot_be_saved(walk, tmp_path):
    with pytest.raises(ModelError) as error:
        network(neuro.event_camera(events=walk)).save(tmp_path / "net.yaml")
    assert str(error.value) == (
        "camera.model.events = events of a program: expected a file\n"
        "  hint: neuro.events.save(events, 'walk.h5') makes one"
    )
    save(walk, tmp_path / "walk.dat")
    (tmp_path / "sub").mkdir()
    with pytest.raises(ModelError) as error:
        network(neuro.event_camera(file=tmp_path / "walk.dat")).save(tmp_path / "sub" / "net.yaml")
    assert str(error.value) == (
        f"camera.model.file = '{tmp_path / 'walk.dat'}': expected a file in the folder of the description, or below\n"
        f"  hint: copy it to {tmp_path / 'sub'}, or save the network beside it"
    )


def test_what_was_learnt_keeps_its_camera(walk, tmp_path):
    save(walk, tmp_path / "walk.npz")
    sim = neuro.compile(network(neuro.event_camera(file=tmp_path / "walk.npz")))
    sim.run(20.0)
    sim.network().save(tmp_path / "net.yaml")
    assert "camera: {model: {event_camera: {file: walk.npz}}, shape: [2, 9, 12]}" in (tmp_path / "net.yaml").read_text()
    again = neuro.load(tmp_path / "net.yaml")
    assert again.populations["camera"].model.file == tmp_path / "walk.npz"
    assert neuro.compile(again).program.populations[0].shape == (2, 9, 12)


# events of a program


def as_array(walk):
    return walk.records()


def as_iterator(walk):
    return iter([walk[:10], walk[10:10], walk[10:]])


def as_function(walk):
    return lambda: iter([walk])


@pytest.mark.parametrize("form", [as_array, as_iterator, as_function])
def test_events_in_any_form(walk, form):
    sims = [neuro.compile(network(neuro.event_camera(events=e), (2, 9, 12))) for e in (walk, form(walk))]
    for sim in sims:
        sim.run(70.0)
    same_run(*sims)


def test_an_iterator_is_asked_when_its_events_are_due(walk):
    asked = []

    def parts():
        for k in range(0, len(walk), 500):
            asked.append(int(walk.t[k] - walk.t[0]))
            yield walk[k : k + 500]

    sim = neuro.compile(network(neuro.event_camera(events=parts()), (2, 9, 12)))
    assert asked == []
    sim.run(10.0)
    assert asked[-2] <= 10_000
    assert len(asked) < 4
    with pytest.raises(ModelError) as error:
        sim.reset()
    assert str(error.value) == (
        "reset: 'camera' has played events of an iterator, which cannot be played again: expected events that can\n"
        "  hint: give it Events, a list of them, or a function that makes an iterator"
    )
    sim.run(60.0)
    assert sim.spikes("camera")[0].size == len(walk)


def test_feeding_while_it_runs(walk):
    origin = int(walk.t[0])
    fed = neuro.compile(network(neuro.event_camera(origin=origin), (2, 9, 12)))
    for begin in range(0, 70_000, 10_000):
        fed.feed("camera", walk.between(origin + begin, origin + begin + 10_000))
        fed.run(10.0)
    played = neuro.compile(network(neuro.event_camera(events=walk)))
    played.run(70.0)
    same_run(fed, played)
    with pytest.raises(ModelError) as error:
        fed.feed("camera", walk[-1:])
    late = (int(walk.t[-1]) - origin) // 100 * 0.1 + 0.1
    assert str(error.value) == (
        f"feed: an event of 'camera' in the step that ends at {late:g} ms: expected later than 70 ms, the present"
    )
    with pytest.raises(ModelError) as error:
        fed.feed("camera", Events([origin - 1], [0], [0], [1], (12, 9)))
    assert str(error.value) == (
        f"feed: 'camera': an event at {origin - 1} us: expected from {origin} us on, the beginning"
    )
    with pytest.raises(ModelError, match="feed: 'cells' is an iaf_psc_exp: expected an event_camera"):
        fed.feed("cells", walk)


# mistakes


def refused(model, shape="auto"):
    with pytest.raises(ModelError) as error:
        neuro.compile(network(model() if callable(model) else model, shape))
    return str(error.value).partition(": ")[2] if str(error.value).startswith("test_") else str(error.value)


NUMBERS = "\n  hint: write the numbers: [2, height, width], or [height, width] unless the polarities are split"
AUTO = "\n  hint: 'shape: auto' takes it from the recording"
AS_SENSOR = f"as the sensor is 12x9 px{AUTO}"
CROP = "crop.x = [3, 40]: expected within [0, 12], the sensor is 12x9 px"
WORDS = "expected one of split, merge, on, off\n  hint: known: merge, off, on, split"
EVENTS = "expected Events, or an array with the fields t, x, y and p, or an iterator of such\n  hint: write file="
ALONE = "population 'camera': shape [9]"
NONE = Events([], [], [], [], (12, 9))


@pytest.mark.parametrize(
    ("words", "shape", "message"),
    [
        ({"polarity": "both"}, "auto", f"event_camera.polarity = 'both': {WORDS}"),
        ({"crop": {"x": [3, 40]}}, "auto", f"population 'camera': {CROP}"),
        ({"crop": {"y": [5, 5]}}, "auto", "crop.y = [5, 5]: expected [first, the one after the last]"),
        ({"scale": 0.5}, "auto", "event_camera.scale = 0.5: expected a whole number >= 1"),
        ({"offset": 5e-4}, "auto", "event_camera.offset = 0.0005 ms: expected whole us, as the times of events are"),
        ({}, (2, 12, 9), f"population 'camera': shape [2, 12, 9]: expected [2, 9, 12], {AS_SENSOR}"),
        ({"polarity": "on"}, (2, "auto"), f"population 'camera': shape [2, auto]: expected [9, 12], {AS_SENSOR}"),
        ({"file": "walk.dat"}, "auto", "event_camera: found both 'file' and 'events': expected one of them"),
        ({"events": None}, "auto", f"population 'camera': shape auto: no sensor is told before it is played{NUMBERS}"),
        (
            {"events": None, "polarity": "on"},
            9,
            "population 'camera': shape [9]: expected [height, width] with polarity: on",
        ),
        ({"events": "walk.dat"}, "auto", f"event_camera: events: found 'walk.dat': {EVENTS}"),
        ({"events": NONE}, "auto", "population 'camera': its recording has no events: expected at least one"),
    ],
)
def test_mistakes(walk, words, shape, message):
    assert refused(lambda: neuro.event_camera(**{"events": walk, **words}), shape) == message


def test_a_file_that_is_none(tmp_path):
    path = tmp_path / "walk.dat"
    assert refused(neuro.event_camera(file=path)) == f"{path}: no such file"
    save(Events([], [], [], [], (12, 9)), path)
    assert refused(neuro.event_camera(file=path)) == f"{path}: has no events"


def test_in_yaml_a_file_lies_beside_the_description(tmp_path, walk):
    save(walk, tmp_path / "walk.dat")
    file = tmp_path / "net.yaml"
    text = "neuro: 1\npopulations:\n  camera: {model: {event_camera: {file: NAME}}, shape: auto}\n"
    inside = "expected a path inside the folder of the description, without '..'"
    for name, told in (
        ("wlak.dat", "no file 'wlak.dat' beside the description\n  hint: did you mean 'walk.dat'?"),
        ("../walk.dat", f"file '../walk.dat': {inside}"),
    ):
        file.write_text(text.replace("NAME", name))
        with pytest.raises(ModelError) as error:
            neuro.load(file)
        assert str(error.value) == f"{file}:3:41: population 'camera': {told}"
    file.write_text(text.replace("file: NAME", "events: x"))
    with pytest.raises(ModelError) as error:
        neuro.load(file)
    assert str(error.value) == (
        f"{file}:3:43: population 'camera': event_camera.events: events of a program: expected a file\n"
        "  hint: write file: NAME"
    )
    file.write_text(text.replace("NAME", "walk.dat, polarity: off, crop: {x: [2, 8]}, scale: 3"))
    assert neuro.compile(neuro.load(file)).program.populations[0].shape == (3, 2)


def test_damage_stops_the_run_before_it(tmp_path, walk, monkeypatch):
    """What was simulated stays, and who goes on is told again."""
    path = tmp_path / "walk.es"
    save(walk, path)
    path.write_bytes(path.read_bytes()[:-1])
    sim = neuro.compile(network(neuro.event_camera(file=path)))
    for _ in range(2):
        with pytest.raises(EventFileError) as error:
            sim.run(100.0)
        assert str(error.value).startswith(f"{path}: byte ")
        assert sim.time == pytest.approx((walk.t[-2] - walk.t[0]) // 100 * STEP)
    times, _ = sim.spikes("camera")
    assert times.size > 3900
    assert times.size == np.count_nonzero((walk.t - walk.t[0]) // 100 * STEP + STEP < sim.time + STEP / 2)


def test_events_out_of_the_shape_of_an_iterator(walk):
    sim = neuro.compile(network(neuro.event_camera(events=iter([walk])), (2, 5, 12)))
    with pytest.raises(ModelError) as error:
        sim.run(10.0)
    k = int((walk.y >= 5).argmax())
    assert str(error.value).endswith(
        f"population 'camera': event at x = {walk.x[k]}, y = {walk.y[k]}, {walk.t[k]} us: "
        "expected within its shape [2, 5, 12]"
    )


def test_networks_with_trials_have_none(walk):
    net = network(neuro.event_camera(events=walk))
    net.group("first", neuro.winner_take_all(of="cells"))
    net.trials(input="camera", duration=5.0)
    with pytest.raises(ModelError, match="an event_camera in a network with trials, which show what they are given"):
        neuro.compile(net)


def test_memory_does_not_grow_with_the_recording(tmp_path):
    """Its spikes are neither listed nor, unless a probe asks, kept."""
    rng = np.random.default_rng(0)
    n = 200_000

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
        sim = neuro.compile(net)
        most = 0
        for _ in range(4):
            sim.run(seconds * 250.0)
            most = max(most, sum(sim.memory().values()))
        assert sim.counts().populations["camera"].spikes == seconds * n
        sizes.append(most)
    assert sizes[1] < 1.05 * sizes[0]


def test_a_stream_of_filters_is_played(tmp_path, walk):
    """Any iterator of events will do, so filters need no words of their own."""
    save(walk, tmp_path / "walk.dat")
    keep = neuro.events.filters.Refractory((12, 9), period_us=5000)
    sim = neuro.compile(network(neuro.event_camera(events=keep.stream(stream(tmp_path / "walk.dat"))), (2, 9, 12)))
    sim.run(70.0)
    assert sim.spikes("camera")[0].size == len(neuro.events.filters.Refractory((12, 9), period_us=5000).apply(walk))


def test_people_are_told_the_model_that_they_know(walk):
    net = network(neuro.event_camera(events=walk))
    code = {"rate": {"max_rate": 50.0, "min_rate": 0.0, "r_max": 1.0, "r_min": 0.0}}
    net.population("coded", 2, neuro.encode(values=[0.5, 1.0], code=code))
    net.population("bias", 1, neuro.dc_generator())
    net.connect("bias", "cells", neuro.all_to_all())
    sim = neuro.compile(net)
    sim.run(5.0)
    assert "camera  event_camera" in str(sim)
    assert [(part.name, part.said) for part in sim.program.populations] == [
        ("camera", "event_camera"),
        ("cells", "iaf_psc_exp"),
        ("coded", "encode"),
        ("bias", "dc_generator"),
    ]
    with pytest.raises(ModelError) as error:
        sim.inject("camera", [6.0], [0])
    assert str(error.value) == (
        "inject: 'camera' is an event_camera: expected a spike_generator\n"
        "  hint: sim.feed('camera', events) gives it events"
    )
    with pytest.raises(ModelError, match="spikes of 'coded', an encode, are not recorded"):
        sim.spikes("coded")
    wrong = network(neuro.event_camera(events=walk))
    wrong.connect("cells", "camera", neuro.all_to_all())
    with pytest.raises(ModelError, match="its target 'camera' is an event_camera, which takes no input") as error:
        neuro.compile(wrong)


def test_a_camera_is_compared_and_recorded(walk, tmp_path):
    save(walk, tmp_path / "walk.aedat4")
    net = network(neuro.event_camera(file=tmp_path / "walk.aedat4"))
    del net.probes["sent"]
    found = neuro.compare.compare(net, ["reference", "event"], 10.0)
    assert found.runs[0].populations["camera"].spikes > 0


# arrays, which tell no sensor


def test_arrays_need_a_sensor_or_a_shape(walk):
    records = walk.records()
    way_out = NUMBERS.replace("write", "neuro.events.Events(t, x, y, p, (width, height)) tells it; or write")
    message = f"population 'camera': shape auto: its events are an array, which tells no sensor{way_out}"
    assert refused(neuro.event_camera(events=records)) == message
    assert refused(neuro.event_camera(events=[records[:5], records[5:]])) == message
    sized = neuro.compile(network(neuro.event_camera(events=[records[:5], walk[5:]])))
    assert sized.program.populations[0].shape == (2, 9, 12)
    few = walk[(walk.x < 8) & (walk.y < 6)]
    crop = {"x": [2, 12], "y": [0, 8]}
    for words, shape in (
        ({"scale": 2}, (2, 5, 6)),
        ({"crop": crop}, (2, 8, 10)),
        ({"crop": crop, "scale": 4}, (2, 2, 3)),
    ):
        sims = [neuro.compile(network(neuro.event_camera(events=e, **words), shape)) for e in (few, few.records())]
        for sim in sims:
            sim.run(70.0)
        same_run(*sims)
    beyond = neuro.compile(network(neuro.event_camera(events=records), (2, 9, 11)))
    with pytest.raises(ModelError, match="expected within its shape"):
        beyond.run(70.0)


def as_list_of_events(walk):
    return list(walk)


def as_iterator_of_events(walk):
    return iter(walk)


@pytest.mark.parametrize("form", [as_array, as_iterator, as_list_of_events, as_iterator_of_events, as_function])
def test_events_in_any_form_are_fed(walk, form):
    few = walk[:300]
    origin = int(few.t[0])
    sims = [neuro.compile(network(neuro.event_camera(origin=origin), (2, 9, 12))) for _ in range(2)]
    for sim, events in zip(sims, (few, form(few)), strict=True):
        sim.feed("camera", events)
        sim.run(10.0)
    same_run(*sims)
    assert sims[0].spikes("camera")[0].size == 300


NO_EVENTS = "expected Events, or an array with the fields t, x, y and p, or an iterator of such"


@pytest.mark.parametrize(
    ("events", "message"),
    [
        (3, f"events: found 3: {NO_EVENTS}"),
        ("walk.dat", "events: found 'walk.dat': expected Events\n  hint: neuro.events.load reads a file"),
        ([1, 2], f"events: found 1: {NO_EVENTS}"),
        ([(1, 2, 3, 1)], f"events: found (1, 2, 3, 1): {NO_EVENTS}"),
        (np.zeros(3), f"events: found an array of float64: {NO_EVENTS}"),
        (np.zeros(3, [("t", int), ("x", int)]), f"events: found an array of [('t', '<i8'), ('x', '<i8')]: {NO_EVENTS}"),
        (neuro.events.Event(7, 12, 0, 1), "event at x = 12, y = 0, 7 us: expected within its shape [2, 9, 12]"),
    ],
    ids=["number", "name", "numbers", "tuples", "floats", "fields", "outside"],
)
def test_what_cannot_be_fed(events, message):
    sim = neuro.compile(network(neuro.event_camera(), (2, 9, 12)))
    with pytest.raises(ModelError) as error:
        sim.feed("camera", events)
    assert str(error.value) == f"feed: 'camera': {message}"


# views


def test_views_of_a_camera_whose_recording_tells_its_shape(walk, tmp_path):
    save(walk, tmp_path / "walk.aedat4")
    for model in (neuro.event_camera(file=tmp_path / "walk.aedat4"), neuro.event_camera(events=walk)):
        net = network(model)
        camera = net.populations["camera"]
        assert (len(camera), camera.sizes) == (216, (2, 9, 12))
        assert camera[0, 2:4].shape == (2, 12)
        assert camera[1, :, -1].ids.tolist() == [108 + 12 * row + 11 for row in range(9)]
        assert len(camera[np.ones((2, 9, 12), bool)]) == 216
        assert camera[[0, 215]].ids.tolist() == [0, 215]
        with pytest.raises(ModelError, match="camera\\[:10\\]: axis 0: found 10: expected -2 to 2"):
            camera[:10]
        net.connect(camera[0, 2:4], "cells", neuro.all_to_all(), name="some")
        net.probe("part", camera[1, :, 3])
        sim = neuro.compile(net)
        assert sim.program.projections[1].size == 24 * 20
        sim.run(20.0)
        times, ids = sim.trace("part")
        assert times.size
        assert set(((ids - 108) % 12).tolist()) == {3}


def test_views_of_a_camera_whose_shape_is_not_known(walk):
    net = network(neuro.event_camera(file="nowhere.aedat4"))
    camera = net.populations["camera"]
    assert repr(camera[0, 2:4]) == "camera[0, 2:4, :]"
    with pytest.raises(ModelError) as error:
        len(camera[0, 2:4])
    assert str(error.value) == (
        "camera[0, 2:4, :]: the shape [auto] of 'camera' follows when it is compiled: expected numbers\n"
        "  hint: write the numbers, or index the population itself with a number or a slice for each axis"
    )


# results without the recording


def test_results_are_read_without_the_recording(walk, tmp_path, monkeypatch):
    ran, moved = tmp_path / "ran", tmp_path / "moved"
    for folder in (ran, moved):
        folder.mkdir()
    save(walk, ran / "walk.aedat4")
    monkeypatch.chdir(ran)
    net = network(neuro.event_camera(file="walk.aedat4"))
    neuro.compile(net).run(20.0, out=tmp_path / "ran" / "run.h5")
    monkeypatch.chdir(tmp_path)
    results = neuro.results.read(ran / "run.h5")
    assert results.network().populations["camera"].model.file == ran / "walk.aedat4"
    (ran / "run.h5").rename(moved / "run.h5")
    (ran / "walk.aedat4").rename(moved / "walk.aedat4")
    results = neuro.results.read(moved / "run.h5")
    assert neuro.compile(results.network()).program.populations[0].shape == (2, 9, 12)
    (moved / "walk.aedat4").rename(tmp_path / "other.aedat4")
    results = neuro.results.read(moved / "run.h5")
    with pytest.raises(ModelError) as error:
        results.network()
    assert str(error.value) == (
        f"the network plays the recording 'walk.aedat4': not found in {ran}, {moved}, {tmp_path}\n"
        "  hint: results.network(recordings=FOLDER) says where it lies; spikes, traces and weights are read without it"
    )
    (tmp_path / "kept").mkdir()
    (tmp_path / "other.aedat4").rename(tmp_path / "kept" / "walk.aedat4")
    assert results.network(tmp_path / "kept").populations["camera"].model.file == tmp_path / "kept" / "walk.aedat4"
    assert "event_camera" in str(results.network(played=False))
    assert results.spikes("camera")[0].size
    from neuro.report.counted import energy

    bill = energy(results, results.network(played=False), "cpu")
    sim = neuro.compile(network(neuro.event_camera(events=walk)))
    sim.run(20.0)
    assert bill.total_j == pytest.approx(sim.energy("cpu").total_j, rel=1e-12)


def test_results_of_events_of_a_program(walk, tmp_path):
    neuro.compile(network(neuro.event_camera(events=walk))).run(20.0, out=tmp_path / "run.h5")
    results = neuro.results.read(tmp_path / "run.h5")
    assert results.network(played=False).populations["camera"].model == neuro.event_camera()
    with pytest.raises(ModelError) as error:
        results.network()
    assert str(error.value) == (
        "the network plays events of a program, which results do not hold\n"
        "  hint: describe it anew with these events; spikes, traces and weights are read without them"
    )
