"""`neuro events listen` and `send`."""

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


HERE = ("udp://127.0.0.1:0", "--from", "spif", "--sensor", "34x34")


@pytest.mark.parametrize("end", [("--for", "50"), ("--first-within", "50 ms")])
def test_counts_alone_until_an_end(run, end):
    status, out, err = run("listen", *HERE, *end)
    assert status == 0
    assert re.fullmatch(r"udp://127.0.0.1:\d+: 0 events in 0 datagrams, 0\.\d s\n", out)
    assert err.startswith("listening at udp://127.0.0.1:")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("listen", HERE[0], "--from", "spiff", "--sensor", "34x34"), "unknown format of a stream 'spiff'"),
        (("listen", *HERE[:3]), "sensor is missing"),
        (("listen", HERE[0], "walk.es", *HERE[1:]), "--force"),
        (("listen", *HERE, "--no-browser"), "--no-browser: expected --page as well"),
        (("listen", *HERE, "--to", "es"), "--to: expected OUT as well"),
        (("listen", *HERE, "--force"), "--force: expected OUT as well"),
        (("send", "walk.es", "udp://127.0.0.1", "--to", "spif"), "expected udp://HOST:PORT"),
        (("send", "walk.es", "udp://127.0.0.1:9", "--to", "spif", "--speed", "0"), "speed = 0"),
        (("send", "none.es", "udp://127.0.0.1:9", "--to", "spif"), "no such file"),
    ],
)
def test_mistakes(run, walk, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(*words)
    assert status != 0
    assert message in err
