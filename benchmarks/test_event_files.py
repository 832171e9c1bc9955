"""How fast event files are read from the page cache, beside other libraries.

``NEURO_EVENT_PEERS`` names a Python with expelliarmus and faery; without it only this library is timed.
"""

import json
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from neuro.events import Events, load, save, stream

COUNT = 5_000_000
SIZE = (1280, 720)
PEERS = os.environ.get("NEURO_EVENT_PEERS")
FORMATS = {
    "dat": ("a.dat", "expelliarmus", "at least 1.1 times"),
    "evt2": ("a.raw", "expelliarmus", "at least 1.1 times"),
    "evt3": ("a.raw", "faery", "at least 2 times"),
}


@pytest.fixture(scope="module")
def events():
    """Like an edge that moves: groups of one to six neighbours of a row at one time, some 5 M events a second."""
    rng = np.random.default_rng(1)
    members = rng.integers(1, 7, COUNT)
    group = np.repeat(np.arange(COUNT), members)[:COUNT]
    step = np.ones(COUNT, np.int64)
    step[1:] = np.where(np.diff(group) == 0, rng.integers(1, 5, COUNT - 1), 0)
    first = np.concatenate(([True], np.diff(group) > 0))
    run = np.cumsum(step) - np.maximum.accumulate(np.where(first, np.cumsum(step), 0))
    t, y, p = np.cumsum(rng.integers(0, 2, COUNT)), rng.integers(0, SIZE[1], COUNT), rng.integers(0, 2, COUNT)
    return Events(t[group], rng.integers(0, 1200, COUNT)[group] + run, y[group], p[group], SIZE)


def peer(library, coding, path):
    """Events a second that another library reads."""
    script = Path(__file__).with_name("peers_event_files.py")
    command = [PEERS, str(script), library, coding, str(path), str(SIZE[0]), str(SIZE[1])]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    seconds, count = json.loads(done.stdout.splitlines()[-1])
    assert count == COUNT
    return count / seconds


def best(read, rounds=7):
    """The least processor time of a call, s."""
    taken = []
    for _ in range(rounds):
        began = time.process_time()
        read()
        taken.append(time.process_time() - began)
    return min(taken)


@pytest.mark.parametrize("coding", FORMATS)
def test_read(benchmark, figure, tmp_path, events, coding):
    name, library, aim = FORMATS[coding]
    path = tmp_path / name
    save(events, path, format=coding)
    assert load(path) == events
    benchmark.pedantic(load, args=(path,), rounds=5)
    rate = COUNT / best(lambda: load(path))
    figure(f"{coding}: load", rate / 1e6, "M events/s")
    figure(f"{coding}: stream", COUNT / best(lambda: sum(map(len, stream(path)))) / 1e6, "M events/s")
    saved = best(lambda: save(events, path, format=coding, replace=True), 3)
    figure(f"{coding}: save", COUNT / saved / 1e6, "M events/s")
    if PEERS:
        other = peer(library, coding, path)
        figure(f"{coding}: {library}", other / 1e6, "M events/s")
        figure(f"{coding}: load beside {library}", rate / other, "times as fast", aim)
