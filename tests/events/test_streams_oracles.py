"""Streams beside other programs: faery, aestream and dv-processing send to us and receive from us, event for event."""

import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from neuro.events import Events, listen, save, send
from neuro.events.streams._sender import channel, paced

pytestmark = pytest.mark.filterwarnings(  # faery leaves its sockets to the collector
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
SIZE = (346, 260)
HOST = "127.0.0.1"
FAERY = {"faery13": "t64_x16_y16_on8", "faery8": "t32_x16_y15_on1"}


@pytest.fixture
def events():
    """As many as fill datagrams of aestream, which writes beyond the end of a last one that is not full."""
    draw, n = np.random.default_rng(1), 128 * 20
    t = np.sort(draw.integers(1000, 200_000, n))
    return Events(t, draw.integers(0, SIZE[0], n), draw.integers(0, SIZE[1], n), draw.integers(0, 2, n), SIZE)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((HOST, 0))
        return int(sock.getsockname()[1])


def wait_for_listener(port: int) -> None:
    """Until a program listens there, as Linux lists it; binding the port to see would be in its way."""
    deadline = time.monotonic() + 20.0
    while f":{port:04X} " not in Path("/proc/net/udp").read_text() and time.monotonic() < deadline:
        time.sleep(0.02)


def port_of(url: str) -> int:
    return int(url.rpartition(":")[2])


@pytest.mark.parametrize("format", FAERY)
def test_faery_sends(events, format):
    faery = pytest.importorskip("faery")
    records = np.zeros(len(events), faery.events_stream.EVENTS_DTYPE)
    for name, column in zip(records.dtype.names, (events.t, events.x, events.y, events.p), strict=True):
        records[name] = column
    with listen(f"udp://{HOST}:0", format=format, sensor=SIZE, until_silent=0.5) as stream:
        source = faery.events_stream_from_array(records, dimensions=SIZE)
        source.to_udp((HOST, port_of(stream.url)), format=FAERY[format])
        assert (sum(stream), stream.counts.lost) == (events, {})


@pytest.mark.parametrize("format", FAERY)
def test_faery_receives(events, format):
    """It leaves out a datagram whose first time is earlier than that of the one before; ours has none."""
    faery = pytest.importorskip("faery")
    port, found = free_port(), []

    def receive():
        parts = iter(faery.events_stream_from_udp(SIZE, (HOST, port), format=FAERY[format]))
        while sum(map(len, found)) < len(events):
            found.append(next(parts).copy())
        parts.close()

    thread = threading.Thread(target=receive, daemon=True)
    thread.start()
    wait_for_listener(port)
    send(f"udp://{HOST}:{port}", events, format=format)
    thread.join(10.0)
    got = np.concatenate(found)
    assert all(np.array_equal(got[a], getattr(events, b)) for a, b in zip(got.dtype.names, "txyp", strict=True))


@pytest.mark.parametrize("timed", [False, True])
def test_aestream_sends(events, tmp_path, timed):
    pytest.importorskip("aestream")
    pytest.importorskip("lz4", reason="aestream reads packets of LZ4")
    save(events, tmp_path / "a.aedat4")
    words = ["--include-timestamp", "1"] if timed else []
    with listen(f"udp://{HOST}:0", format="spif", sensor=SIZE, until_silent=0.5) as stream:
        command = [str(Path(sys.executable).with_name("aestream")), "input", "file", str(tmp_path / "a.aedat4")]
        command += ["output", "udp", HOST, str(port_of(stream.url)), *words]
        subprocess.run(command, check=True, capture_output=True)
        got = sum(stream)
        assert stream.counts.lost == {}
    assert all(np.array_equal(getattr(got, name), getattr(events, name)) for name in ("txyp" if timed else "xyp"))


AESTREAM = """
import os, sys
import numpy as np
from aestream import UDPInput
with UDPInput((346, 260), device="cpu", port=int(sys.argv[1])) as stream:
    sys.stdin.readline()
    np.save(sys.argv[2], np.array(stream.read()))
    os._exit(0)
"""


def test_aestream_receives(events, tmp_path):
    """It counts the events of each pixel."""
    pytest.importorskip("aestream")
    port = free_port()
    command = [sys.executable, "-c", AESTREAM, str(port), str(tmp_path / "frame.npy")]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as receiver:
        wait_for_listener(port)
        send(f"udp://{HOST}:{port}", events, format="spif")
        time.sleep(0.2)
        receiver.communicate(b"\n", timeout=20)
    frame, expected = np.load(tmp_path / "frame.npy"), np.zeros(SIZE)
    np.add.at(expected, (events.x, events.y), 1)
    assert np.array_equal(frame, expected)


DV_SENDS = """
import sys, time
import dv_processing as dv
import numpy as np
events = np.load(sys.argv[1])
writer = dv.io.NetworkWriter("127.0.0.1", int(sys.argv[2]), dv.io.Stream.EventStream(0, "events", "camera", (346, 260)))
print("ready", flush=True)
while not writer.getClientCount():
    time.sleep(0.01)
for some in np.array_split(events, 5):
    store = dv.EventStore()
    for t, x, y, p in some.tolist():
        store.push_back(t, x, y, bool(p))
    writer.writeEvents(store)
sys.stdin.readline()
"""


def test_dv_processing_sends(events, tmp_path):
    pytest.importorskip("dv_processing")
    port = free_port()
    np.save(tmp_path / "events.npy", events.records())
    command = [sys.executable, "-c", DV_SENDS, str(tmp_path / "events.npy"), str(port)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as sender:
        sender.stdout.readline()
        with listen(f"tcp://{HOST}:{port}", until_silent=1.0) as stream:
            assert (stream.sensor_size, sum(stream), stream.counts.lost) == (SIZE, events, {})
        sender.communicate(b"\n")


DV_RECEIVES = """
import sys
import dv_processing as dv
import numpy as np
reader = dv.io.NetworkReader("127.0.0.1", int(sys.argv[1]))
assert reader.getEventResolution() == (346, 260)
found = []
while sum(map(len, found)) < int(sys.argv[2]):
    batch = reader.getNextEventBatch()
    if batch is not None:
        found.append(batch.numpy())
np.save(sys.argv[3], np.concatenate(found))
"""


def test_dv_processing_receives(events, tmp_path):
    pytest.importorskip("dv_processing")
    server = channel(f"tcp://{HOST}:0", None, None)
    command = [sys.executable, "-c", DV_RECEIVES, str(port_of(server.url)), str(len(events)), str(tmp_path / "got.npy")]
    with subprocess.Popen(command) as receiver:
        server.wait()
        paced([events], server, 1.0)
        assert receiver.wait(20) == 0
    server.close()
    got = np.load(tmp_path / "got.npy")
    assert all(np.array_equal(got[a], getattr(events, b)) for a, b in zip(got.dtype.names, "txyp", strict=True))
