"""A stream by the network is a population as a recording is."""

import queue
import socket
import threading

import numpy as np
import pytest

import neuro
from event_tests import refusal
from neuro.events import listen, send
from neuro.events.source import EventFileWarning
from neuro.events.streams import _listener
from seen import network, same_run

HOST = "127.0.0.1"
HERE = f"udp://{HOST}:0"


@pytest.fixture
def sent(monkeypatch):
    """A function that makes a thread; it sends events to the stream that is opened next, at its free port."""
    urls: queue.Queue[str] = queue.Queue()

    def opened(*given, **more):
        stream = listen(*given, **more)
        urls.put(stream.url)
        return stream

    monkeypatch.setattr(_listener, "listen", opened)

    def to_come(events):
        thread = threading.Thread(target=lambda: send(urls.get(timeout=20.0), events, format="faery13"))
        thread.start()
        return thread

    return to_come


def of(walk):
    return neuro.event_camera(stream=HERE, format="faery13", sensor=walk.sensor_size, until_silent=500.0)


def test_a_stream_does_what_its_recording_does(walk, sent):
    sims = [neuro.compile(network(model)) for model in (of(walk), neuro.event_camera(events=walk))]
    thread = sent(walk)
    for sim in sims:
        sim.run(70.0)
    thread.join()
    same_run(*sims)
    assert refusal(sims[0].reset).startswith("reset: 'camera' has played events that can be read only once")


def text_of(port):
    return f"""
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


def test_compiling_listens_to_nothing(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as busy:
        busy.bind((HOST, 0))
        (tmp_path / "net.yaml").write_text(text_of(busy.getsockname()[1]))
        sim = neuro.compile(neuro.load(tmp_path / "net.yaml"))
        assert "another program listens at this port" in refusal(sim.run, 1.0)


def test_in_a_file(walk, tmp_path, sent):
    """With crop and shape as of a recording."""
    (tmp_path / "net.yaml").write_text(text_of(0))
    sim = neuro.compile(neuro.load(tmp_path / "net.yaml"))
    assert sim.program.populations[0].shape == (2, 9, 8)
    thread = sent(walk)
    sim.run(70.0)
    thread.join()
    assert sim.counts().populations["camera"].spikes == len(walk.inside((2, 10), (0, 9)))


def test_losses_are_warned_of(walk, sent):
    sim = neuro.compile(network(of(walk)))
    far = neuro.events.Events(walk.t, walk.x + 6, walk.y, walk.p, (18, 9))
    thread = sent(far)
    with pytest.warns(EventFileWarning, match=f"outside {np.count_nonzero(far.x >= 12):,}"):
        sim.run(1000.0)
    thread.join()


SPIF = {"stream": HERE, "format": "spif", "sensor": [12, 9]}


def test_mistakes(messages):
    messages.calls(globals())


def test_mistakes_of_a_file_have_places_and_none_only_follows(tmp_path, capsys, monkeypatch):
    """A stream without an address leaves 'sensor' and 'shape: auto' without a meaning, which is not told."""
    from neuro.cli import main

    (tmp_path / "net.yaml").write_text("""
neuro: 1
populations:
  a: {model: {event_camera: {stream: "udp://127.0.0.1:3333", format: spiff, sensor: [9, 7]}}, shape: auto}
  b: {model: {event_camera: {stream: "udp:127.0.0.1:3333", format: spif, sensor: [9, 7]}}, shape: auto}
  c: {model: {event_camera: {stream: "udp://127.0.0.1:3333", format: spif}}, shape: auto}
""")
    monkeypatch.setattr("sys.argv", ["neuro", "check", str(tmp_path / "net.yaml")])
    with pytest.raises(SystemExit):
        main()
    told = capsys.readouterr().err.replace(f"{tmp_path}/", "")
    assert told.count("error:") == 3
    assert "net.yaml:4:70: population 'a': event_camera: unknown format of a stream 'spiff'" in told
    assert "net.yaml:5:38: population 'b': event_camera: url = 'udp:127.0.0.1:3333': expected udp://HOST" in told
    assert "net.yaml:6:29: population 'c': event_camera: sensor is missing: expected [width, height] in px" in told
