"""A stream by the network is a population as a recording is."""

import socket
import threading
import time

import numpy as np
import pytest

import neuro
from event_tests import refusal
from neuro.events import send
from neuro.events.errors import EventFileWarning
from seen import network, same_run

HOST = "127.0.0.1"
HERE = f"udp://{HOST}:3333"


def free_port() -> int:
    """A port at which nobody listened just now; a stream of a description cannot tell which one it has got."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        return int(sock.getsockname()[1])


def of(walk, port, **more):
    words = {"stream": f"udp://{HOST}:{port}", "format": "faery13", "sensor": walk.sensor_size, "until_silent": 500.0}
    return neuro.event_camera(**words | more)


def sent_when_heard(port, events) -> threading.Thread:
    """A thread that sends as soon as somebody listens."""

    def run():
        deadline = time.monotonic() + 10.0
        while time.monotonic() < deadline:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
                try:
                    sock.bind((HOST, port))
                except OSError:
                    break
            time.sleep(0.01)
        send(f"udp://{HOST}:{port}", events, format="faery13")

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_a_stream_does_what_its_recording_does(walk):
    port = free_port()
    sims = [neuro.compile(network(model)) for model in (of(walk, port), neuro.event_camera(events=walk))]
    thread = sent_when_heard(port, walk)
    for sim in sims:
        sim.run(70.0)
    thread.join()
    same_run(*sims)
    assert refusal(sims[0].reset).startswith("reset: 'camera' has played events of an iterator or a stream")


def test_in_a_file(walk, tmp_path):
    """With crop and shape as of a recording; checking and compiling listen to nothing."""
    port = free_port()
    text = f"""
neuro: 1
resolution: 0.1
populations:
  camera:
    model:
      event_camera:
        {{stream: "udp://{HOST}:{port}", format: faery13, sensor: [12, 9], crop: {{x: [2, 10]}}, until_silent: 500 ms}}
    shape: auto
probes: {{sent: {{of: camera}}}}
"""
    (tmp_path / "net.yaml").write_text(text)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as busy:
        busy.bind((HOST, port))
        sim = neuro.compile(neuro.load(tmp_path / "net.yaml"))
        assert sim.program.populations[0].shape == (2, 9, 8)
        assert "another program listens there" in refusal(sim.run, 1.0)
    thread = sent_when_heard(port, walk)
    sim.run(70.0)
    thread.join()
    assert sim.counts().populations["camera"].spikes == len(walk.inside((2, 10), (0, 9)))


def test_losses_are_warned_of(walk):
    port = free_port()
    sim = neuro.compile(network(of(walk, port)))
    far = neuro.events.Events(walk.t, walk.x + 6, walk.y, walk.p, (18, 9))
    thread = sent_when_heard(port, far)
    with pytest.warns(EventFileWarning, match=f"outside {np.count_nonzero(far.x >= 12):,}"):
        sim.run(1000.0)
    thread.join()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"stream": "udp://x"}, "event_camera: url = 'udp://x': expected udp://HOST:PORT or tcp://HOST:PORT, such as"),
        ({"format": "spiff"}, "event_camera: unknown format of a stream 'spiff'\n  hint: did you mean 'spif'?"),
        ({"format": None}, "event_camera: format is missing: expected one of spif, spif-timed, faery13, faery8, raw"),
        ({"sensor": None}, "event_camera: sensor is missing: expected [width, height] in px"),
        ({"sensor": [3]}, "event_camera: sensor_size = (3,): expected width and height of 1 to 65536 px"),
        ({"file": "a.dat"}, "event_camera: found both 'file' and 'stream': expected one of them"),
        ({"stream": None}, "event_camera: found 'sensor' without 'stream': a recording tells its own"),
        ({"until_silent": 0}, "event_camera.until_silent = 0: expected a number > 0 ms"),
    ],
)
def test_mistakes(words, message):
    given = {"stream": HERE, "format": "spif", "sensor": [12, 9], **words}
    told = refusal(lambda: neuro.event_camera(**given))
    assert told.partition(": ")[2].startswith(message) or told.startswith(message)
