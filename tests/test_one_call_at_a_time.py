"""One call of a simulation at a time, from whatever thread or callback; several simulations in as many threads."""

import copy
import os
import pickle
import re
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier, Event, Thread
from typing import Any

import numpy as np
import pytest

import neuro
from beside import evaluated
from neuro_event.host import threads as shared
from refused import refused

FROM_THREAD = r"^{}: found another thread within '{}' of the same simulation: expected one call at a time\n  hint: "
FROM_WITHIN = r"{}: found a call from within '{}' of the same simulation: expected one call at a time\n  hint: "


def network(size: int = 500) -> neuro.Network:
    """Some neurons that fire."""
    net = neuro.Network("shared", resolution=0.1)
    net.population("noise", size, neuro.poisson_generator(rate=9000.0))
    net.population("cells", size, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.one_to_one(), weight=95.0, delay=1.0)
    net.connect("cells", "cells", neuro.fixed_indegree(n=20), weight=-20.0, delay=1.0)
    return net


def camera(events: Callable[[], Iterator[Any]]) -> neuro.Network:
    """A camera that plays what a function of the user gives while the network runs."""
    net = neuro.Network("camera", resolution=1.0)
    net.population("eye", (2, 4, 4), neuro.event_camera(events=events))
    net.probe("seen", "eye")
    return net


def event(us: int, x: int) -> neuro.events.Events:
    """One event of such a camera."""
    return neuro.events.Events([us], [x], [0], [1], (4, 4))


class Waits:
    """A simulation whose run stops half-way, in a callback, until it is let go."""

    def __init__(self) -> None:
        self.inside, self.let_go = Event(), Event()
        self.sim = neuro.compile(camera(self._events), "event")
        self.thread = Thread(target=self.sim.run, args=(20.0,))

    def _events(self) -> Iterator[Any]:
        yield event(1000, 0)
        self.inside.set()
        assert self.let_go.wait(20.0)
        yield event(9000, 1)

    def __enter__(self) -> neuro.Simulation:
        self.thread.start()
        assert self.inside.wait(20.0)
        return self.sim

    def __exit__(self, *_: object) -> None:
        self.let_go.set()
        self.thread.join()


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["event", "reference", "loihi", "torch"])
def test_the_time_is_the_sum_of_the_calls_that_took_effect(backend: str):
    if backend == "torch":
        pytest.importorskip("torch")
    sim = neuro.compile(network(100), backend, seed=1)
    start, ran, refused = Barrier(8), [], []

    def drive() -> None:
        start.wait()
        for _ in range(5):
            try:
                sim.run(2.0)
                ran.append(2.0)
            except neuro.ModelError as error:
                refused.append(error.message)

    with ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(drive) for _ in range(8)]:
            done.result()
    assert ran
    assert len(ran) + len(refused) == 40
    assert all("of the same simulation: expected one call at a time" in message for message in refused)
    assert sim.time == pytest.approx(sum(ran))
    alone = neuro.compile(network(100), backend, seed=1)
    alone.run(sim.time)
    assert all(np.array_equal(a, b) for a, b in zip(sim.spikes("cells"), alone.spikes("cells"), strict=True))


CALLS: dict[str, Callable[[neuro.Simulation], Any]] = evaluated(__file__, "CALLS", globals())


def test_every_call_of_another_thread_is_refused_while_one_is_under_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    waits = Waits()
    port = waits.sim.port("eye", "counts")
    with waits as sim:
        for name, call in CALLS.items():
            assert re.search(FROM_THREAD.format(name, "run"), refused(call, sim))
        for use in (port.get, lambda: port.set(1.0)):
            assert re.search(FROM_THREAD.format("port: counts of 'eye'", "run"), refused(use))
        assert 0.0 <= sim.time < 20.0
        assert not list(tmp_path.iterdir())
    assert sim.time == 20.0
    assert port.get().sum() == 2
    for call in CALLS.values():
        if call is not CALLS["restore"]:
            call(sim)


def test_the_end_of_a_recording_waits_for_the_run_of_another_thread(tmp_path: Path):
    waits, path = Waits(), tmp_path / "results.h5"
    with waits.sim.record_to(path):
        waits.thread.start()
        assert waits.inside.wait(20.0)
        Thread(target=lambda: (time.sleep(0.05), waits.let_go.set())).start()
    waits.thread.join()
    assert neuro.results.read(path).spikes("eye")[0].size == 2


@pytest.mark.parametrize("name", ["run", "spikes", "reset"])
def test_a_callback_may_not_call_the_simulation_that_called_it(name: str):
    def events() -> Iterator[Any]:
        CALLS[name](sim)
        yield event(1000, 0)

    sim = neuro.compile(camera(events))
    assert re.search(FROM_WITHIN.format(name, "run"), refused(sim.run, 5.0))
    assert sim.time == 0.0


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_ctrl_c_leaves_the_simulation_free(backend: str):
    sim = neuro.compile(network(100), backend, seed=1)
    sim.run(1.0)
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012
        Thread(target=lambda: (time.sleep(0.05), signal.raise_signal(signal.SIGINT))).start()
        while True:
            sim.run(0.1)
            sim.counts()
    sim.counts()
    sim.run(1.0)


def test_several_simulations_run_in_as_many_threads():
    def one(k: int) -> Any:
        sim = neuro.compile(network(500 + 60 * k), seed=k, threads=1 + k % 2)
        for _ in range(4):
            sim.run(5.0)
        return sim.spikes("cells")

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(one, range(6)))
    for k, spikes in enumerate(found):
        assert all(np.array_equal(a, b) for a, b in zip(spikes, one(k), strict=True))


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda sim: pickle.loads(pickle.dumps(sim))])
def test_a_copy_is_refused(again: Callable[[neuro.Simulation], Any]):
    with pytest.raises(
        neuro.ModelError, match=r"^a simulation cannot be copied or pickled, .*\n  hint: use sim\.save\(path\)"
    ):
        again(neuro.compile(network(10)))


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork.*:DeprecationWarning")
def test_a_forked_process_goes_on(monkeypatch: pytest.MonkeyPatch):
    for name, value in {"GAIN": 1e-9, "AGAIN": np.inf, "HELD": 0.0}.items():  # on all threads, whatever they gain
        monkeypatch.setattr(shared, name, value)
    sim = neuro.compile(network(2000), seed=1, threads=2)
    sim.run(20.0)
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        sim.run(20.0)
        os._exit(sim.spikes("cells")[0].size % 199)
    sim.run(20.0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == sim.spikes("cells")[0].size % 199
