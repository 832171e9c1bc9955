"""`neuro events listen` and `send`."""

import math
import re
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from neuro.events import Events, load, save, send

NEURO = [sys.executable, "-c", "from neuro.cli import main; main()", "events"]


@pytest.fixture
def walk(tmp_path):
    draw, n = np.random.default_rng(2), 500
    t = np.sort(draw.integers(0, 50_000, n))
    events = Events(t, draw.integers(0, 34, n), draw.integers(0, 34, n), draw.integers(0, 2, n), (34, 34))
    save(events, tmp_path / "walk.es")
    return events


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_recording_is_sent_heard_and_written(run, walk, tmp_path, number):
    """Ctrl-C, a kill and a terminal that closes end it, and the file is kept."""
    command = [*NEURO, "listen", "udp://127.0.0.1:0", "heard.es", "--from", "faery8", "--sensor", "34x34"]
    words = {"cwd": tmp_path, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # What starts the tests may ignore a signal (nohup), and a command keeps that.
    with subprocess.Popen(command, **words, preexec_fn=lambda: signal.signal(number, signal.SIG_DFL)) as heard:
        url = heard.stderr.readline().split()[-1]
        _, sent, _ = run("send", tmp_path / "walk.es", url, "--to", "faery8", "--speed", "2")
        assert re.fullmatch(rf"{url}: 500 events in \d+ datagrams, \d\.\d s(, at most [\d.]+ ms late)?\n", sent)
        heard.send_signal(number)
        try:
            told, _ = heard.communicate(timeout=30)
        finally:
            heard.kill()
    assert heard.returncode == 0
    assert re.fullmatch(rf"{url}: 500 events in \d+ datagrams, \d+\.\d s\n", told)
    assert load(tmp_path / "heard.es") == walk


def listening(tmp_path, out, *more, **words):
    """A `neuro events listen` that writes, and its URL."""
    command = [*NEURO, "listen", "udp://127.0.0.1:0", out, "--from", "faery13", "--sensor", "34x34", *more]
    words = {"cwd": tmp_path, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **words}
    heard = subprocess.Popen(command, **words)
    return heard, heard.stderr.readline().split()[-1]


def later(events, us):
    return Events(events.t + us, events.x, events.y, events.p, events.sensor_size)


def grown(path, size):
    """Wait until a file has so many bytes."""
    end = time.monotonic() + 30
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < end, path
        time.sleep(0.02)


@pytest.mark.parametrize(("out", "far"), [("a.dat", 1 << 33), ("a.es", 1 << 50)])
def test_events_of_a_far_time_are_left_out_and_counted(walk, tmp_path, out, far):
    heard, url = listening(tmp_path, out)
    with heard:
        send(url, walk, format="faery13", speed=2)
        send(url, later(walk[:7], far), format="faery13", speed=math.inf)
        time.sleep(0.3)
        heard.send_signal(signal.SIGINT)
        told, err = heard.communicate(timeout=30)
    assert heard.returncode == 0
    assert told.endswith("; no room: 7\n")
    assert f"{out}: the format cannot store the time or position of an event" in err
    assert [path.name for path in tmp_path.iterdir() if path.name != "walk.es"] == [out]
    assert len(load(tmp_path / out, sensor_size=(34, 34))) == len(walk)


@pytest.mark.parametrize("out", ["a.dat", "a.h5"])
def test_a_killed_listener_leaves_what_came(walk, tmp_path, out):
    heard, url = listening(tmp_path, out)
    with heard:
        send(url, walk[:400], format="faery13", speed=2)
        part = tmp_path / f"{out}.part"
        grown(part, 400)
        time.sleep(0.3)
        heard.kill()
    assert load(part, sensor_size=(34, 34)).records().tolist() == walk[:400].records().tolist()


def test_a_full_disk_leaves_what_came(walk, tmp_path):
    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1003, 1003))

    heard, url = listening(tmp_path, "a.dat", preexec_fn=limited)
    with heard:
        send(url, walk[:60], format="faery13", speed=2)
        grown(tmp_path / "a.dat.part", 400)  # else a busy machine may receive all at once, and no piece fits
        send(url, walk[60:], format="faery13", speed=2)
        _, err = heard.communicate(timeout=30)
    assert heard.returncode == 2
    assert "a.dat: cannot be written: File too large" in err
    assert "the events so far are kept: 'neuro events info a.dat.part --from dat' reads a.dat.part" in err
    found = load(tmp_path / "a.dat.part")
    assert 60 <= len(found) <= 120
    assert found.records().tolist() == walk[: len(found)].records().tolist()


HERE = ("udp://127.0.0.1:0", "--from", "spif", "--sensor", "34x34")


@pytest.mark.parametrize("end", [("--for", "50"), ("--first-within", "50 ms")])
def test_counts_alone_until_an_end(run, end):
    status, out, err = run("listen", *HERE, *end)
    assert status == 0
    assert re.fullmatch(r"udp://127.0.0.1:\d+: 0 events in 0 datagrams, 0\.\d s\n", out)
    assert err.startswith("listening at udp://127.0.0.1:")


def test_mistakes(messages, run, walk):
    found = {case: run(*case.split()) for case in messages.cases}
    assert all(status for status, _, _ in found.values())
    messages({case: err for case, (_, _, err) in found.items()})
