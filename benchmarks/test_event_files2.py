"""How fast event files are read from the page cache, beside other libraries.

Recordings of `../shared` are repeated until they have millions of events; those of AEDAT 4 are read as they are, since
they end with a table of their packets, which dv-processing needs. With NEURO_PEERS set to the Python of an environment
that has dv-processing, event_stream, faery or tonic, these read the same files in the same run.
"""

import json
import os
import subprocess
import time
from pathlib import Path

import pytest

from neuro.events import load
from neuro.events.files import BLOCK
from neuro.events.formats.aedat import Aedat2
from neuro.events.formats.event_stream import START
from neuro.events.opening import find
from neuro.events.source import WHOLE, Source

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "formats"
ROUNDS = 20
CASES = {
    "N-MNIST .bin": ("ncaltech101_faces_easy_0001.bin", 50, "2 times tonic"),
    "Event Stream": ("es_dvs_320x240.es", 10, "2 times event_stream"),
    "AEDAT 2.0 DVS128": ("mnistdvs_0_scale04_0001.aedat", 200, ""),
    "AEDAT 2.0 DAVIS240": ("davis240_translBoxes.aedat", 20, ""),
    "AEDAT 4 davis346": ("davis346_aestream.aedat4", 1, "0.8 times dv-processing"),
    "AEDAT 4 dvxplorer": ("dvxplorer_lite_320x240.aedat4", 1, "0.8 times dv-processing"),
}
DV = """import dv_processing as dv
def read(path):
    recording, count = dv.io.MonoCameraRecording(path), 0
    while (events := recording.getNextEventBatch()) is not None:
        count += events.size()
    return count
"""
PEERS = {
    "AEDAT 4 davis346": {"dv-processing": DV},
    "AEDAT 4 dvxplorer": {"dv-processing": DV},
    "N-MNIST .bin": {
        "tonic": "import tonic.io, numpy as np\n"
        "kind = np.dtype([('x', int), ('y', int), ('t', int), ('p', int)])\n"
        "def read(path): return len(tonic.io.read_mnist_file(path, dtype=kind))",
    },
    "Event Stream": {
        "event_stream": "import event_stream\n"
        "def read(path): return sum(len(packet) for packet in event_stream.Decoder(path))",
        "faery": "import faery\n"
        "def read(path): return sum(len(packet) for packet in faery.events_stream_from_file(path))",
    },
}
CLOCK = """
import json, sys, time
best, count = float("inf"), 0
for _ in range(int(sys.argv[2])):
    began = time.process_time()
    count = read(sys.argv[1])
    best = min(best, time.process_time() - began)
print(json.dumps([count, best]))
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of a format, repeated."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    folder = tmp_path_factory.mktemp("events")

    def made(case):
        name, times, _ = CASES[case]
        data = (SHARED / name).read_bytes()
        begin = {".bin": 0, ".aedat4": 0, ".es": START}.get(Path(name).suffix)
        begin = Aedat2(Source(data))._start if begin is None else begin
        path = folder / name
        path.write_bytes(data[:begin] + data[begin:] * times)
        return path

    return made


def read(path, block):
    """Number of events, all of which are decoded."""
    source = Source(path)
    return sum(piece.t.size for piece in find(source).open(source).pieces(block))


def best(path, block):
    """Number of events and the least seconds of one core."""
    seconds, count = float("inf"), read(path, block)
    for _ in range(ROUNDS):
        began = time.process_time()
        read(path, block)
        seconds = min(seconds, time.process_time() - began)
    return count, seconds


@pytest.mark.parametrize("case", CASES)
def test_reading(figure, recording, case):
    path = recording(case)
    count, whole = best(path, WHOLE)
    _, blocks = best(path, BLOCK)
    figure(f"{case}, whole", count / whole / 1e6, "M events/s", "")
    figure(f"{case}, in blocks", count / blocks / 1e6, "M events/s", "")
    python = os.environ.get("NEURO_PEERS")
    for peer, code in PEERS.get(case, {}).items() if python else ():
        done = subprocess.run(
            [python, "-c", code + CLOCK, str(path), str(ROUNDS)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            figure(f"{case}, {peer} did not run", float("nan"), "")
            continue
        theirs, seconds = json.loads(done.stdout.splitlines()[-1])
        assert theirs == count
        figure(f"{case}, {peer}", theirs / seconds / 1e6, "M events/s", "")
        figure(f"{case}, neuro beside {peer}", seconds / whole, "times", CASES[case][2])


def test_load(figure, recording):
    path = recording("Event Stream").with_suffix(".once.es")
    path.write_bytes((SHARED / CASES["Event Stream"][0]).read_bytes())
    load(path)
    began = time.process_time()
    count = sum(len(load(path)) for _ in range(20))
    figure("Event Stream, load with all checks", count / (time.process_time() - began) / 1e6, "M events/s", "")
