"""`neuro events listen` and `send`, each in a process of its own."""

import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from neuro.events import Events, load, save

NEURO = [sys.executable, "-c", "from neuro.cli import main; main()", "events"]


@pytest.fixture
def walk(tmp_path):
    draw = np.random.default_rng(2)
    n = 500
    t = np.sort(draw.integers(0, 50_000, n))
    events = Events(t, draw.integers(0, 34, n), draw.integers(0, 34, n), draw.integers(0, 2, n), (34, 34))
    save(events, tmp_path / "walk.es")
    return events


def run(*words, cwd):
    return subprocess.run([*NEURO, *words], cwd=cwd, capture_output=True, text=True, timeout=60)


def test_a_recording_is_sent_heard_and_written(walk, tmp_path):
    """Ctrl-C ends it, and the file is kept."""
    command = [*NEURO, "listen", "udp://127.0.0.1:0", "heard.es", "--format", "faery8", "--sensor", "34x34"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as heard:
        url = heard.stderr.readline().split()[-1]
        sent = run("send", "walk.es", url, "--format", "faery8", "--speed", "2", cwd=tmp_path)
        assert re.fullmatch(rf"{url}: 500 events in \d+ datagrams, 0\.\d s(, at most [\d.]+ ms late)?\n", sent.stdout)
        heard.send_signal(signal.SIGINT)
        told, _ = heard.communicate(timeout=30)
    assert heard.returncode == 0
    assert re.fullmatch(rf"{url}: 500 events in \d+ datagrams, \d+\.\d s\n", told)
    assert load(tmp_path / "heard.es") == walk


def test_counts_alone_until_an_end(tmp_path):
    words = ("listen", "udp://127.0.0.1:0", "--format", "spif", "--sensor", "34x34")
    assert "0 events in 0 datagrams" in run(*words, "--for", "50", cwd=tmp_path).stdout
    assert "0 events in 0 datagrams" in run(*words, "--until-silent", "50 ms", cwd=tmp_path).stdout


def test_mistakes(walk, tmp_path):
    told = run("listen", "udp://127.0.0.1:0", "--format", "spiff", "--sensor", "34x34", cwd=tmp_path)
    assert told.returncode != 0
    assert "unknown format of a stream 'spiff'" in told.stderr
    assert "Traceback" not in told.stderr
    told = run("send", "walk.es", "udp://127.0.0.1", "--format", "spif", cwd=tmp_path)
    assert "expected udp://HOST:PORT" in told.stderr
    told = run("listen", "udp://127.0.0.1:0", "walk.es", "--format", "spif", "--sensor", "34x34", cwd=tmp_path)
    assert "--force" in told.stderr
