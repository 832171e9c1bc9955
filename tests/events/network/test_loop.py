"""A loop in real time: what comes live is what can be run again, and lateness is counted and answered."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from threading import Thread

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from event_tests import refusal
from neuro import ModelError
from neuro.core.inputs import digest_of
from neuro.events import Events, listen, save, send
from neuro.realtime import Histogram, LiveRun, Loop, Player, empty_loop  # noqa: F401  (named in messages.yaml)
from neuro.realtime.sources import Inlet
from refused import refusals_of

SIZE = 16, 12
pytestmark = pytest.mark.usefixtures("frozen_heap")


def rerun(file):
    return pytest.importorskip("neuro_sweeps.rerun").rerun(file)


def network(resolution=0.5, **words):
    net = neuro.Network("live", resolution=resolution)
    net.population("camera", (2, 12, 16), neuro.event_camera(**words))
    net.population("cells", 6, neuro.iaf_psc_exp())
    net.connect("camera", "cells", neuro.fixed_outdegree(n=2), weight=150.0, delay=1.0)
    net.probe("v", "cells", "V_m", every=5.0)
    net.probe("seen", "camera")
    return net


def noise(n, ms, seed=0):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, round(1000 * ms), n))
    return Events(t, rng.integers(0, 16, n), rng.integers(0, 12, n), rng.integers(0, 2, n), SIZE)


class Burst:
    """All its events at the second `take`, received long before."""

    sensor_size = SIZE

    def __init__(self, events):
        self._events, self._takes = events, 0
        self.received_ns = 0
        self.counts = {"lost": 3}

    def take(self):
        self._takes += 1
        return self._events if self._takes == 2 else self._events[:0]


@settings(max_examples=3, deadline=None)
@given(
    seed=st.integers(0, 99), n=st.integers(0, 3000), tick=st.sampled_from([0.5, 1.0, 2.5]),
    late=st.sampled_from(["catch_up", "skip"]), backend=st.sampled_from(["event", "reference"])
)  # fmt: skip
def test_what_was_live_can_be_run_again(tmp_path_factory, seed, n, tick, late, backend):
    out, sim = tmp_path_factory.mktemp("live") / "day.h5", neuro.compile(network(), backend, seed=seed)
    run = Loop(sim, tick=tick, inputs={"camera": Player(noise(n, 30.0, seed))}, late=late).run(50.0, out=out)
    counts = run.inputs["camera"]
    assert counts["fed"] + counts["dropped"] <= counts["taken"] <= n
    assert late == "skip" or counts["fed"] == n
    results = neuro.results.read(out)
    assert results.counts().populations["camera"].spikes == counts["fed"] == len(results.spikes("camera")[0])
    assert len(run.latency) == counts["fed"]
    assert (results.live["ticks"], results.live["camera.fed"]) == (run.ticks, counts["fed"])
    assert (results.live["tick_to_action.p99_ms"], rerun(out).difference) == (run.response.ms(0.99), "")


def test_places_and_moments_of_ticks():
    sim = neuro.compile(network(origin=7000.0, offset=1.0))
    events = Events(np.array([0, 400, 900, 1600, 9000]) + 5_000_000, [1] * 5, [2] * 5, [1] * 5, SIZE)
    inlet = Loop(sim, tick=10.0, inputs={"camera": Burst(events)})._inlets[0]
    sim.run(5.0)
    inlet.feed(events, np.full(5, 3_200_000), 0, 10, 20)
    inlet.feed(events[::4], np.full(2, 3_200_000), 0, 10, 20)
    sim.run(10.0)
    assert ((sim.spikes("camera")[0] - 5.0).tolist(), inlet.fed) == ([3.5, 3.5, 4.0, 4.5, 5.0, 10.0, 10.0], 7)
    inlet = Loop(neuro.compile(network()), tick=10.0, inputs={"camera": Player(noise(100, 5.0))})._inlets[0]
    inlet.begin()
    time.sleep(0.006)
    begin = inlet._source._begin
    found = [inlet.take(begin + 1_000_000, begin + end)[1] - begin for end in (2_000_000, 2_000_000, 10_000_000)]
    t = noise(100, 5.0).t * 1000
    t -= t[0]
    assert [len(each) for each in found] == [np.sum((t >= 1_000_000) & (t < 2_000_000)), 0, np.sum(t >= 2_000_000)]
    assert inlet.dropped == np.sum(t < 1_000_000)


def test_events_that_come_by_the_network(tmp_path):
    events, out, sim = noise(3000, 100.0), tmp_path / "day.h5", neuro.compile(network())
    with listen("udp://127.0.0.1:0", format="faery8", sensor=SIZE) as stream:
        sender = Thread(target=send, args=(stream.url, events), kwargs={"format": "faery8"})

        def act(ms):
            if ms == 10.0:
                sender.start()
            elif loop._inlets[0].fed == 3000:
                loop.stop()

        loop = Loop(sim, tick=2.0, inputs={"camera": stream}, act=act)
        run = loop.run(20_000.0, out=out)
        sender.join()
    assert run.ended == "stopped"
    assert run.inputs["camera"]["fed"] == run.inputs["camera"]["events"] == 3000
    assert len(neuro.results.read(out).spikes("camera")[0]) == 3000
    assert rerun(out).same


def slow(at):
    def act(ms):
        if ms == at:
            time.sleep(0.025)

    return act


def test_late_ticks():
    sim = neuro.compile(network())
    run = Loop(sim, tick=5.0, inputs={"camera": Player(noise(300, 60.0))}, act=slow(20.0)).run(100.0)
    assert (run.ticks, run.skipped, run.drops, run.ended) == (19, 0, 0, "")
    assert run.misses >= 4
    assert (sim.time, run.inputs["camera"]["fed"]) == (100.0, 300)
    assert run.largest_tick[1]["act"] > 20.0
    assert "slowest\n" in str(run)
    sim = neuro.compile(network())
    run = Loop(sim, tick=5.0, inputs={"camera": Player(noise(300, 60.0))}, act=slow(20.0), late="skip").run(100.0)
    assert run.skipped >= 4
    assert (run.ticks + run.skipped, sim.time) == (19, 100.0 - 5.0 * run.skipped)
    assert run.drops > 20
    assert run.inputs["camera"]["fed"] + run.drops <= 300
    sim = neuro.compile(network())
    assert Loop(sim, tick=5.0, act=slow(20.0), late="stop").run(1000.0).ended.startswith("the action of tick ")
    assert sim.time <= 20.0


def test_what_comes_by_the_network_while_a_tick_is_late_keeps_its_tick():
    """All of it waits in the stream, whose times are those of the oldest datagrams."""
    with listen("udp://127.0.0.1:0", format="faery8", sensor=SIZE) as stream:
        inlet, ends = Inlet(neuro.compile(network()), "camera", stream), []
        inlet.begin()
        for k in range(6):
            send(stream.url, Events([1000 * k], [1], [1], [1], SIZE), format="faery8")
            while stream._receiver.entries[1] <= k:
                time.sleep(1e-3)
            ends.append(time.monotonic_ns())
        for end in ends[:2]:
            events, received = inlet.take(0, end)
            assert (len(events), received[0] < end) == (1, True)
        events, received = inlet.take(ends[3], ends[4])  # two ticks were skipped
        assert (len(events), inlet.dropped, inlet.taken) == (1, 2, 5)
        assert ends[3] <= received[0] < ends[4]
        assert len(inlet.take(ends[3], ends[5])[0]) == 1


def test_a_source_that_fails_leaves_a_whole_file(tmp_path):
    class Broken(Burst):
        def take(self):
            if self._takes == 8:
                raise OSError("unplugged")
            return super().take()

    sim = neuro.compile(network())
    with pytest.raises(OSError, match="unplugged"):
        Loop(sim, tick=2.0, inputs={"camera": Broken(noise(20, 1.0))}).run(1000.0, out=tmp_path / "day.h5")
    results = neuro.results.read(tmp_path / "day.h5")
    assert results.finished
    assert results.counts().populations["camera"].spikes == 20
    assert rerun(tmp_path / "day.h5").same
    assert gc.isenabled()


def test_memory_does_not_grow():
    sim = neuro.compile(network())
    counts, room, held = sim.port("cells", "counts"), np.zeros(6, dtype=np.int64), []

    def act(ms):
        counts.get(room)
        held.append(sum(sim.memory().values()))

    Loop(sim, tick=1.0, inputs={"camera": Player(noise(20_000, 200.0))}, act=act).run(200.0)
    assert held[-1] <= held[20]
    assert len(sim.spikes("camera")[0]) == 0


SCRIPT = """
import sys

sys.path[:0] = {path!r}
import neuro.realtime.loop as loop
loop.COMMIT_S = 0.05

from neuro.cli.commands import app
app(["live", "net.yaml", "--tick", "1 ms", "--for", "1 h", "--input", "camera=a.npz", "--out", "day.h5"])
"""


def test_a_killed_run_can_be_made_again_as_far_as_it_was_recorded(tmp_path):
    network().save(tmp_path / "net.yaml")
    save(noise(2000, 200.0), tmp_path / "a.npz")
    process = subprocess.Popen([sys.executable, "-c", SCRIPT.format(path=sys.path)], cwd=tmp_path, stdout=-1, stderr=-1)
    part, deadline = tmp_path / "day.h5.part", time.monotonic() + 60.0
    while time.monotonic() < deadline and process.poll() is None:
        with suppress(ModelError):
            if neuro.results.read(part).duration_ms > 300.0:
                break
        time.sleep(0.05)
    process.kill()
    said = process.communicate(timeout=30)
    while _written_by_another(tmp_path):
        time.sleep(0.05)
    results = neuro.results.read(part)
    assert results.counts().populations["camera"].spikes == 2000, said
    assert not results.finished
    assert rerun(part).difference == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_a_kill_end_a_run_with_a_whole_file(tmp_path, number):
    before = signal.getsignal(number)
    loop = Loop(neuro.compile(network()), tick=1.0, act=lambda ms: ms == 20.0 and os.kill(os.getpid(), number))
    assert loop.run(1000.0, out=tmp_path / "day.h5").ended == "interrupted"
    assert signal.getsignal(number) is before
    results = neuro.results.read(tmp_path / "day.h5")
    assert results.finished
    assert results.duration_ms == 20.0


def test_the_record_is_that_of_the_begin_but_for_what_was_changed(tmp_path):
    network().save(tmp_path / "net.yaml")
    sim = neuro.compile(neuro.load(tmp_path / "net.yaml"))
    with sim.record_to(tmp_path / "day.h5") as recording:
        (tmp_path / "net.yaml").write_text("# edited while it runs\n")
        sim.run(5.0)
        sim.set("cells", V_th=-54.0)
        recording.commit()
        (tmp_path / "killed.h5").write_bytes((tmp_path / "day.h5.part").read_bytes())
    kept = json.loads(neuro.results.read(tmp_path / "day.h5").about["provenance"])
    assert kept["inputs"] != {each: digest_of(each) for each in kept["inputs"]}
    for name in ("day.h5", "killed.h5"):
        assert "the run was steered by sim.set" in refusal(rerun, tmp_path / name)


def _written_by_another(folder):
    """Whether a process still has a file of the folder open."""
    for number in filter(str.isdigit, os.listdir("/proc")):
        try:
            if any(str(folder) in os.readlink(f"/proc/{number}/fd/{fd}") for fd in os.listdir(f"/proc/{number}/fd")):
                return True
        except OSError:
            continue
    return False


def test_mistakes(messages):
    class Source:
        def __init__(self, gives, received=None, **counts):
            self.take, self.received_ns, self.counts = lambda: gives, received, counts

    def fed(source):
        Loop(neuro.compile(network()), tick=1.0, inputs={"camera": source}).run(10.0)

    sim, played = neuro.compile(network()), neuro.compile(network(events=noise(10, 10.0)))
    later, source = neuro.compile(network(start=5.0)), Player(noise(10, 1.0))
    other, loop = Player(Events([0], [0], [0], [0], (9, 9))), Loop(sim, tick=2.0)
    messages(refusals_of(messages.cases, globals() | locals()))


def test_what_is_counted():
    run = Loop(neuro.compile(network()), tick=1.0).run(3.0)
    assert str(run.latency) == "p50 –, p99 –, largest – ms"
    assert "nan" not in str(run)
    ns = np.sort(np.random.default_rng(1).lognormal(12.0, 2.0, 5000).astype(np.int64))
    one, together = Histogram(), Histogram()
    for each in ns.tolist():
        one.add(each)
    together.add_since(10**12 - ns[::-1], 10**12)
    assert np.array_equal(one.counts, together.counts)
    assert one.largest_ms == together.largest_ms == ns[-1] / 1e6
    for share in (0.01, 0.5, 0.99, 1.0):
        exact = np.quantile(ns, share, method="inverted_cdf") / 1e6
        assert exact <= one.ms(share) <= 1.032 * exact
    assert np.isnan(Histogram().ms(0.5))
    counts = {"taken": 9, "fed": 8, "dropped": 1, "events": 9, "datagrams": 3, "dropped_kernel": 4, "outside": 0}
    found = LiveRun(tick_ms=1.0, ticks=10, inputs={"camera": counts})
    assert (found.drops, found.losses) == (1, 4)
    assert repr(found) == "LiveRun(10 ticks of 1 ms, 0 missed, 1 drops, 4 lost by sources)"
    assert "4 dropped_kernel" in str(found)
    assert "outside" not in str(found)
