"""`neuro live`: inputs from files and streams, and what it refuses."""

import socket
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest

import neuro
from neuro.events import Events, save, send

NET = Path(__file__).with_name("camera.yaml").read_text("utf-8")
LIVE = ("live", "net.yaml", "--tick", "2 ms", "--for", "0.3 s")
pytestmark = pytest.mark.usefixtures("frozen_heap")


@pytest.fixture
def live(answer, monkeypatch, tmp_path):
    """Write the network, then run `neuro live`; exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    events = Events(1000 * np.arange(50), np.arange(50) % 16, np.zeros(50, int), np.ones(50, int), (16, 12))
    save(events, "a.npz")

    def run(*words, stream="", shape="[2, 12, 16]"):
        (tmp_path / "net.yaml").write_text(NET.format(stream=stream, shape=shape))
        return answer(*LIVE, *words)

    run.events = events
    return run


def test_a_file_is_an_input(live):
    code, out, err = live("--input", "camera=a.npz", "--out", "day.h5", "--record", "camera")
    assert (code, err) == (0, "")
    assert out.startswith("LiveRun(149 ticks of 2 ms, ")
    assert "\nday.h5: 300 ms; neuro rerun day.h5 repeats the run\n" in out
    assert len(neuro.results.read("day.h5").spikes("camera")[0]) == 50


@pytest.mark.parametrize("said", ["in the file", "on the command line"])
def test_a_stream_is_an_input(live, said):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{free.getsockname()[1]}"

    def sending():
        for k in range(100):
            send(url, Events(live.events.t[:1] + k, [1], [1], [1], (16, 12)), format="faery8")
            pause.wait(0.05)
            if pause.is_set():
                break

    pause, thread = Event(), Thread(target=sending)
    thread.start()
    if said == "in the file":
        words, asked = {"stream": f"stream: '{url}', format: faery8, sensor: [16, 12]", "shape": "auto"}, ()
    else:
        words, asked = {}, ("--input", f"camera={url}", "--from", "faery8")
    code, _, _ = live("--out", "day.h5", *asked, **words)
    pause.set()
    thread.join()
    assert code == 0
    assert neuro.results.read("day.h5").counts().populations["camera"].spikes > 2
    assert neuro.results.read("day.h5").network().populations["camera"].model.stream is None


def test_what_is_refused(messages, live):
    inputs = ("a.npz", "cam=a.npz", "camera=b.npz", "camera=a.npz --input camera=a.npz", "camera=a.npz --from spif")
    found = {words: live(*f"--input {words}".split()) for words in (*inputs, "camera=udp://127.0.0.1:0")}
    found |= {"late": live("--late", "never"), "tick": live("--tick", "1.5 ms")}
    stream = {"stream": "stream: 'udp://127.0.0.1:0', format: spif, sensor: [16, 12]", "shape": "auto"}
    found["stream"] = live("--input", "camera=a.npz", **stream)
    assert {code for code, _, _ in found.values()} == {2}
    messages({case: " ".join(err.split()) for case, (_, _, err) in found.items()})
