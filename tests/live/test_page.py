"""What browsers ask of a page, and what it shows."""

import io
import math
import sys
import threading
import time
import zipfile
from itertools import pairwise

import numpy as np
import pytest

import neuro
from neuro import ModelError
from neuro.chips import HostWork, chip
from neuro.coding import on_numbers
from neuro.live.beside import _bill
from neuro.live.commands import Pace
from neuro.live.facts import about
from neuro.live.frames import MOST_SPIKES, Frames, smaller, weights_of
from running_page import Running, network, until


def numbers(frame):
    """The arrays of a frame, as the page reads them."""
    head, body = frame
    at, spikes = 0, {}

    def take(kind, count):
        nonlocal at
        found = np.frombuffer(body, kind, count, at)
        at += found.nbytes
        return found

    for population, count in head["spikes"]:
        spikes[population] = take("<u4", count), take("<u4", count)
    traces = [(take("<f4", count), take("<f4", count * columns)) for _, count, columns in head["traces"]]
    watched = [take("<f4", 2 * head["watched"]["samples"])] if "watched" in head else []
    cameras = [take("u1", a * b * c + -(a * b * c) % 4) for _, a, b, c in head["cameras"]]
    assert at == len(body)
    return spikes, traces, watched, cameras


def test_frames_follow_each_other_without_a_gap(client):
    frames, fired = [client.frame() for _ in range(8)], 0
    for (before, _), frame in pairwise(frames):
        head = frame[0]
        assert head["began"] == before["time"] < head["time"]
        spikes, traces, _, _ = numbers(frame)
        assert len(traces) == 1
        if 1 in spikes:  # a frame of few steps has none, where the machine has much else to do
            steps, ids = spikes[1]
            assert 0 < steps.min() <= steps.max() <= (head["time"] - head["began"]) / 0.5
            assert ids.max() < 40
            fired += 1
    assert fired > 3
    assert sum("watched" in head for head, _ in frames) > 2
    assert np.mean([head["rates"][0] for head, _ in frames]) == pytest.approx(80.0, rel=0.3)


def test_a_watched_potential_has_samples_for_each_pixel():
    """A window of 1 s on 1,000 pixels: at least one sample per ms, where the run has time to wait."""
    with neuro.live.Page(neuro.compile(network()), speed=0.25) as page:
        page.tick()
        page._seen_until, page._ahead = math.inf, True
        page.frames.watch("exc", 0, "V_m")
        page._advance(8.0, page.pace)
        times = [ms for ms, _ in page.frames._sampled]
    assert (np.diff(times), len(times)) == (pytest.approx(0.5), 15)


def test_a_projection_names_the_population_whose_dopamine_teaches_it():
    net = network()
    net.connect("exc", "out", neuro.all_to_all(), neuro.stdp_dopa(dopamine="noise"), weight=1.0, name="taught")
    parts = {each["name"]: each["dopamine"] for each in about(neuro.compile(net))["projections"]}
    assert (parts["taught"], parts["exc_out"]) == ("noise", None)


def test_all_tabs_see_what_one_sets_also_those_to_come(running):
    with running.client() as one, running.client() as other:
        assert one.ask(do="set", part="exc", word="tau_m", value=12.5) == {"id": 1}
        assert other.until(lambda kept: "value/exc/tau_m" in kept)["value/exc/tau_m"]["value"] == 12.5
    with running.client() as third:
        assert third.until(lambda kept: "value/exc/tau_m" in kept)["value/exc/tau_m"]["same"]


def test_sliders_have_unit_and_bounds(client):
    def sliders(part):
        return {each["word"]: each for each in client.ask(do="sliders", part=part)["sliders"]}

    about = client.until(lambda kept: "about" in kept)["about"]
    cells, learning, reward = sliders("exc"), sliders("exc_out"), sliders("reward")
    assert "unknown part 'exc[0]'" in client.ask(do="sliders", part="exc[0]")["error"]
    assert (cells["V_th"]["unit"], cells["tau_m"]["bounds"]) == ("mV", "> 0")
    assert cells["V_reset"]["value"] < cells["V_th"]["low"] < cells["V_th"]["value"] < cells["V_th"]["high"]
    assert {"weight", "A_plus", "Wmax", "tau_plus"} <= learning.keys()
    assert learning["weight"]["high"] == learning["Wmax"]["value"] == 400.0
    assert (reward["value"]["unit"], about["populations"][3]["camera"]) == ("1/ms", [3, 4])


def test_mistakes_are_told_and_change_nothing(client):
    answer = client.ask(do="set", part="out", word="V_th", value=-80.0)
    assert "expected less than V_th" in answer["error"]
    answer = client.ask(do="set", part="out", word="V_thh", value=-80.0)
    assert "did you mean 'V_th'" in answer["error"]
    assert "value/out/V_th" not in client.kept


def test_a_run_is_paused_and_goes_step_by_step(running, client):
    client.ask(do="pause")
    assert client.until(lambda kept: kept.get("state", {}).get("paused"))
    time.sleep(0.05)
    paused = running.page.sim.time
    time.sleep(0.05)
    assert running.page.sim.time == paused
    client.ask(do="step")
    time.sleep(0.1)
    assert paused < running.page.sim.time <= paused + 20.0
    client.ask(do="resume")
    assert running.goes_on()


def test_reset_and_seed_begin_anew(running, client):
    client.frame()
    before = running.page.sim.time
    client.ask(do="reset", weights=True)
    assert client.until(lambda kept: kept.get("begun", {}).get("time") == 0.0)
    assert client.frame()[0]["time"] < before
    client.kept.clear()
    client.ask(do="seed", value=7)
    assert (client.until(lambda kept: "about" in kept)["about"]["seed"], running.page.sim.program.seed) == (7, 7)
    assert running.goes_on()


def test_sliders_show_what_other_commands_changed(client):
    def value(kept, name):
        return kept.get(f"value/{name}", {}).get("value")

    client.ask(do="set", part="noise_exc", word="weight", value=5.0)
    client.ask(do="reset", weights=True)
    client.until(lambda kept: value(kept, "noise_exc/weight") == 900.0)
    client.ask(do="silence", population="noise")
    client.until(lambda kept: value(kept, "noise_exc/weight") == 0.0)
    client.ask(do="restore", population="noise")
    client.until(lambda kept: value(kept, "noise_exc/weight") == 900.0)
    client.ask(do="activate", population="exc", rate=70.0)
    client.until(lambda kept: value(kept, "noise/rate") == 70.0)
    client.ask(do="activate", population="exc", rate=80.0)


def test_who_comes_while_it_is_paused_sees_the_time_and_the_weights(running):
    with running.client() as client:
        client.frame()
        client.ask(do="pause")
        client.ask(do="set", part="out_exc", word="weight", value=-7.0)
        client.until(lambda kept: kept.get("weights/out_exc", {}).get("mean") == -7.0)
        with running.client() as other:
            assert other.frame()[0]["time"] == running.page.sim.time
        client.ask(do="set", part="out_exc", word="weight", value=-20.0)
        client.ask(do="resume")


def test_weights_whose_sum_is_infinite_have_no_mean():
    sim = neuro.compile(network())
    sim.set("noise_exc", weight=1e308)
    assert weights_of(sim, 0)["mean"] is None


def test_populations_are_silenced_restored_and_driven(client):
    def mean(kept):
        return kept.get("weights/out_exc", {}).get("mean")

    client.until(lambda kept: mean(kept) == -20.0)
    client.ask(do="silence", population="out")
    client.until(lambda kept: mean(kept) == 0.0 and kept["state"]["silenced"] == ["out"])
    client.ask(do="restore", population="out")
    client.until(lambda kept: mean(kept) == -20.0 and kept["state"]["silenced"] == [])
    assert client.ask(do="activate", population="exc", rate=20.0) == {"id": 3}
    assert "expected a poisson_generator" in client.ask(do="activate", population="out", rate=20.0)["error"]
    client.ask(do="signal", part="reward", word="value", value=0.1)
    assert client.ask(do="set", part="reward", word="value", value=0.1) == {"id": 6}


def test_a_grid_is_silenced_and_restored(websockets):
    net = neuro.Network("sheets", resolution=1.0)
    net.population("sheet", (2, 4, 6), neuro.poisson_generator(rate=60.0))
    net.population("maps", (3, "auto", "auto"), neuro.iaf_psc_delta())
    net.connect("sheet", "maps", neuro.grid(kernel=(3, 3)), weight=0.5)
    sim = neuro.compile(net)
    with neuro.live.Page(sim) as page:
        assert page.commands.answer({"do": "silence", "population": "sheet", "id": 1})[0] == {"id": 1}
        assert not sim.weights("sheet_maps").any()
        assert page.commands.answer({"do": "restore", "population": "sheet", "id": 2})[0] == {"id": 2}
    assert (sim.weights("sheet_maps") == 0.5).all()


def test_state_and_network_are_fetched(running, client, tmp_path):
    answer, state = client.ask(do="save")
    assert answer["file"].endswith("ms.h5")
    answer, packed = client.ask(do="network")
    (tmp_path / "state.h5").write_bytes(state)
    sim = neuro.compile(running.page.sim._net, seed=running.page.sim.program.seed)
    sim.restore(tmp_path / "state.h5")
    assert sim.time > 0.0
    assert answer["file"] == "seen.yaml"
    (tmp_path / "seen.yaml").write_bytes(packed)
    assert [*neuro.load(tmp_path / "seen.yaml").populations] == ["noise", "exc", "out", "camera"]


def test_a_network_with_large_arrays_is_fetched_with_them(websockets, tmp_path):
    net = neuro.Network("large", resolution=1.0)
    net.population("cells", 100, neuro.iaf_psc_exp(tau_m=np.linspace(10.0, 20.0, 100)))
    with neuro.live.Page(neuro.compile(net)) as page:
        head, packed = page.commands.answer({"do": "network", "id": 1})
    assert head == {"id": 1, "file": "large.zip"}
    zipfile.ZipFile(io.BytesIO(packed)).extractall(tmp_path)
    assert "cells" in neuro.load(tmp_path / "network.yaml").populations


def test_the_curve_and_power_come_from_another_process(client):
    client.ask(do="curve", population="exc", neuron=3)
    kept = client.until(lambda kept: "curve" in kept and "joules" in kept)
    curve = kept["curve"]
    assert (curve["rates"][0], curve["rates"]) == (0.0, sorted(curve["rates"]))
    assert curve["rates"][-1] > 10.0
    chips = {each["chip"]: each for each in kept["joules"]["chips"]}
    assert chips["loihi"]["dynamic"] > 0.0
    assert chips["loihi"]["static"] > chips["loihi"]["dynamic"]
    assert chips["loihi"]["host"] == 0.0


def test_the_power_of_the_host_stands_beside_the_chip():
    net = neuro.Network("one", resolution=1.0)
    net.population("cell", 1, neuro.iaf_psc_exp())
    sim = neuro.compile(net)
    sim.run(100.0)
    host = [HostWork("part", on_numbers(70, 3), steps=20)]
    power, alone = (_bill(sim.program, sim.taken().raw_counts, each, chip("spinnaker2"), None) for each in (host, ()))
    assert power["host"] == pytest.approx(70 * 8.6e-9 / 0.02), "70 operations each 20 ms"
    assert power["dynamic"] == pytest.approx(alone["dynamic"])


def test_what_is_asked_for_all_the_time_does_not_hold_the_run_up(running):
    with running.client() as client:
        for _ in range(5):
            found = [client.ask(do="curve", population="exc", neuron=0) for _ in range(5)]
        assert any("try again" in answer.get("error", "") for answer in found)
    running.page.commands._used_s = 1.5
    with running.client() as client:
        assert "too many requests" in client.ask(do="save")["error"]
    running.page.commands._used_s = 0.0


def test_the_curve_is_that_of_the_neuron_as_it_is():
    from neuro.live.beside import curve_of

    net = neuro.Network("two", resolution=0.5)
    net.population("a", 2, neuro.iaf_psc_exp(tau_m=np.array([10.0, 20.0])))
    sim = neuro.compile(net)
    sim.set("a", V_th=-50.0)
    model = curve_of(sim, "a", 1).populations["cells"].model
    assert (model.tau_m, model.V_th) == (20.0, -50.0)
    with pytest.raises(ModelError, match="expected a neuron from 0 to 1"):
        curve_of(sim, "a", 2)


def test_events_of_a_camera_are_counted_by_pixel():
    net = neuro.Network("seen", resolution=1.0)
    net.population("camera", (2, 3, 4), neuro.event_camera())
    sim = neuro.compile(net)
    frames = Frames(sim)
    sim.feed("camera", neuro.events.Events([100, 200, 300], [1, 1, 3], [2, 2, 0], [1, 1, 0], (4, 3)))
    sim.run(5.0)
    head, body = frames.take()
    assert head["cameras"] == [[0, 2, 3, 4]]
    image = np.frombuffer(body, "u1")[:24].reshape(2, 3, 4)
    assert (image[1, 2, 1], image[0, 0, 3], image.sum(), np.frombuffer(frames.take()[1], "u1").sum()) == (2, 1, 3, 0)


def test_large_sensors_are_summed():
    events = np.zeros((2, 260, 346), dtype=np.int64)
    events[1, 259, 345] = events[1, 258, 344] = 3
    assert (smaller(events).shape, smaller(events)[1, 129, 172]) == ((2, 130, 173), 6)


def test_of_very_many_spikes_some_are_shown_and_all_are_counted():
    net = neuro.Network("many", resolution=1.0)
    net.population("cells", 3000, neuro.iaf_psc_exp(I_e=5000.0, t_ref=1.0))
    sim = neuro.compile(net)
    frames = Frames(sim)
    sim.run(100.0)
    head, _ = frames.take()
    spikes = sim.counts().spikes
    assert spikes > 2 * MOST_SPIKES
    assert head["spikes"][0][1] <= MOST_SPIKES
    assert head["rates"][0] == pytest.approx(spikes / (3000 * 0.1))


def test_what_a_caller_forgets_is_shown(websockets):
    net = neuro.Network("forgotten", resolution=1.0)
    net.population("cells", 3, neuro.iaf_psc_exp(I_e=1000.0))
    sim = neuro.compile(net)
    frames = Frames(sim)
    for _ in range(50):
        sim.run(1.0)
        if sim.held > frames.step:
            assert frames.is_forgotten
        frames.gather()
        sim.forget(sim.time)
    (head, _), spikes = frames.take(), sim.counts().spikes
    assert head["spikes"] == [[0, spikes]]


def test_what_is_reset_elsewhere_begins_anew(websockets):
    net = neuro.Network("reset", resolution=1.0)
    net.population("cells", 3, neuro.iaf_psc_exp(I_e=1000.0))
    sim = neuro.compile(net)
    with neuro.live.Page(sim) as page:
        running = Running.__new__(Running)
        running.look(page)
        stop = threading.Event()

        def run():
            while not stop.is_set():
                sim.run(5.0)
                page.tick()
                time.sleep(1e-3)
                if sim.time >= 100.0:
                    sim.reset()

        thread = threading.Thread(target=run)
        thread.start()
        with running.client() as client:
            frames = [client.frame() for _ in range(12)]
        stop.set()
        thread.join()
    for head, _ in frames:
        assert 0.0 <= head["began"] < head["time"] <= 100.0
        assert head["rates"][0] >= 0.0
    assert any(after[0]["time"] < before[0]["time"] for before, after in pairwise(frames))


def test_pace_keeps_real_time_and_catches_nothing_up(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr("neuro.live.commands.time.perf_counter", lambda: clock[0])
    pace = Pace(2.0)
    assert (pace.wait_s(0.0), pace.wait_s(20.0)) == (0.0, pytest.approx(0.01))
    clock[0] += 5.0
    assert pace.wait_s(40.0) < -4.0
    assert pace.wait_s(50.0) == pytest.approx(0.005)
    pace.step()
    assert (pace.wait_s(50.0), pace.wait_s(60.0)) == (0.0, math.inf)
    pace.set(math.inf)
    pace.pause(False)
    assert pace.wait_s(1e9) == 0.0


def test_a_tick_without_a_browser_takes_microseconds(websockets):
    net = neuro.Network("idle", resolution=1.0)
    net.population("cells", 3, neuro.iaf_psc_exp())
    with neuro.live.Page(neuro.compile(net)) as page:
        for _ in range(100):
            page.tick()
        began = time.thread_time()
        for _ in range(20_000):
            page.tick()
        assert (time.thread_time() - began) / 20_000 < 5e-6


def test_an_instability_pauses_the_run(websockets):
    net = neuro.Network("wild", resolution=0.1)
    net.population("cells", 1, neuro.hh_psc_alpha())
    sim = neuro.compile(net, "reference")
    sim.set("cells", V_m=1e4)
    with neuro.live.Page(sim, speed=math.inf) as page:
        thread = threading.Thread(target=page.run)
        thread.start()
        assert until(lambda: page.pace.paused)
        page.stop()
        thread.join()


def test_what_is_looked_at_runs_as_if_nobody_looked(websockets):
    alone, seen = neuro.compile(network(), seed=3), neuro.compile(network(), seed=3)
    alone.run(600.0)
    with neuro.live.Page(seen, speed=2.0) as page:
        thread = threading.Thread(target=page.run, args=(600.0,))
        thread.start()
        running = Running.__new__(Running)
        running.look(page)
        with running.client() as client:
            assert client.frame()
            thread.join()
        assert page.frames.step > 0
    assert seen.counts() == alone.counts()
    assert np.array_equal(seen.weights("exc_out")[2], alone.weights("exc_out")[2])
    assert np.array_equal(seen.get("exc", "V_m"), alone.get("exc", "V_m"))


def test_a_run_ends_with_the_process_that_serves_it(websockets):
    net = neuro.Network("n", resolution=1.0)
    net.population("cells", 1, neuro.iaf_psc_exp())
    with neuro.live.Page(neuro.compile(net), speed=1.0) as page:
        with pytest.raises(ModelError, match=r"run = 0\.5 ms: expected a multiple"):
            page.run(0.5)
        page._process.kill()
        with pytest.raises(ModelError, match="the process that serves the page has ended"):
            page.run()
        page.tick()


def test_what_cannot_be_served_is_refused(websockets, monkeypatch, messages):
    net = neuro.Network("n", resolution=1.0)
    net.population("cells", 1, neuro.iaf_psc_exp())
    sim = neuro.compile(net)
    messages.calls({"sim": sim})
    with neuro.live.Page(sim, speed=math.inf) as page:
        page.run("3 ms")
        assert sim.time == 3.0
    with neuro.live.Page(sim) as page:
        port = int(page.url.split(":")[2].split("/")[0])
        with pytest.raises(ModelError, match="the page cannot be served at"):
            neuro.live.Page(sim, port=port)
        with pytest.raises(ModelError, match="no speed"):
            page.run(1.0)
    monkeypatch.setitem(sys.modules, "websockets", None)
    with pytest.raises(ModelError, match=r"which is not installed[\s\S]*live"):
        neuro.live.Page(sim)
