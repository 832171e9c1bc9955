"""Speed of reading event files from the page cache, beside other libraries, and of joining a folder of files.

Recordings of `../shared` are repeated until they have millions of events. Recordings in AEDAT 4 are read unchanged,
because they end with a table of their packets, which dv-processing needs. `NEURO_PEERS` is the path of a Python with
dv-processing, event_stream, expelliarmus, faery or tonic, which then read the same files in the same run.
"""

import json
import os
import resource
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from neuro.events import Dataset, Events, load, save, stream
from neuro.events.files import BLOCK
from neuro.events.formats.aedat import Aedat2
from neuro.events.formats.event_stream import START
from neuro.events.opening import find
from neuro.events.source import WHOLE, Source

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "formats"
COUNT = 5_000_000
SIZE = (1280, 720)
WRITTEN = {
    "dat": ("a.dat", "expelliarmus", "at least 1.1 times"),
    "evt2": ("a.raw", "expelliarmus", "at least 1.1 times"),
    "evt3": ("a.raw", "faery", "at least 2 times"),
}
RECORDED = {
    "N-MNIST .bin": ("ncaltech101_faces_easy_0001.bin", 50, "2 times tonic", ("tonic",)),
    "Event Stream": ("es_dvs_320x240.es", 10, "2 times event_stream", ("event_stream", "faery")),
    "AEDAT 2.0 DVS128": ("mnistdvs_0_scale04_0001.aedat", 200, "", ()),
    "AEDAT 2.0 DAVIS240": ("davis240_translBoxes.aedat", 20, "", ()),
    "AEDAT 4 davis346": ("davis346_aestream.aedat4", 1, "0.8 times dv-processing", ("dv-processing",)),
    "AEDAT 4 dvxplorer": ("dvxplorer_lite_320x240.aedat4", 1, "0.8 times dv-processing", ("dv-processing",)),
}
PEERS = {
    "dv-processing": """import dv_processing as dv
def read(path):
    recording, count = dv.io.MonoCameraRecording(path), 0
    while (events := recording.getNextEventBatch()) is not None:
        count += events.size()
    return count
""",
    "event_stream": """import event_stream
def read(path): return sum(len(packet) for packet in event_stream.Decoder(path))
""",
    "expelliarmus": """from expelliarmus import Wizard
def read(path): return len(Wizard(encoding=sys.argv[3]).read(path))
""",
    "faery": """import faery
def read(path): return len(faery.events_stream_from_file(path, dimensions_fallback=(1280, 720)).to_array())
""",
    "tonic": """import tonic.io, numpy as np
kind = np.dtype([('x', int), ('y', int), ('t', int), ('p', int)])
def read(path): return len(tonic.io.read_mnist_file(path, dtype=kind))
""",
}
CLOCK = """
best, count = float("inf"), 0
for _ in range(int(sys.argv[2])):
    began = time.process_time()
    count = read(sys.argv[1])
    best = min(best, time.process_time() - began)
print(json.dumps([count, best]))
"""


def beside_peers(figure, case, peers, count, seconds, path, coding=""):
    """Let other libraries read the same file, if there is a Python with them. The figure of the first is our aim."""
    for peer, aim in peers.items() if (python := os.environ.get("NEURO_PEERS")) else ():
        command = [python, "-c", f"import json, sys, time\n{PEERS[peer]}{CLOCK}", str(path), "20", coding]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            figure(f"{case}, {peer} did not run", float("nan"), "")
            continue
        theirs, needed = json.loads(done.stdout.splitlines()[-1])
        assert theirs == count
        figure(f"{case}, {peer}", theirs / needed / 1e6, "M events/s")
        figure(f"{case}, neuro beside {peer}", needed / seconds, "times", aim)


def best(read, rounds=20):
    """Return the least processor time of a call, s."""
    taken = []
    for _ in range(rounds):
        began = time.process_time()
        read()
        taken.append(time.process_time() - began)
    return min(taken)


@pytest.fixture(scope="module")
def events():
    """Return events like those of a moving edge, some 5 million per second.

    Groups of one to six neighbours in a row have the same time.
    """
    rng = np.random.default_rng(1)
    members = rng.integers(1, 7, COUNT)
    group = np.repeat(np.arange(COUNT), members)[:COUNT]
    step = np.ones(COUNT, np.int64)
    step[1:] = np.where(np.diff(group) == 0, rng.integers(1, 5, COUNT - 1), 0)
    first = np.concatenate(([True], np.diff(group) > 0))
    run = np.cumsum(step) - np.maximum.accumulate(np.where(first, np.cumsum(step), 0))
    t, y, p = np.cumsum(rng.integers(0, 2, COUNT)), rng.integers(0, SIZE[1], COUNT), rng.integers(0, 2, COUNT)
    return Events(t[group], rng.integers(0, 1200, COUNT)[group] + run, y[group], p[group], SIZE)


@pytest.mark.parametrize("coding", WRITTEN)
def test_written(benchmark, figure, tmp_path, events, coding):
    name, library, aim = WRITTEN[coding]
    path = tmp_path / name
    save(events, path, format=coding)
    assert load(path) == events
    benchmark.pedantic(load, args=(path,), rounds=5)
    loading = best(lambda: load(path), 7)
    figure(f"{coding}: load", COUNT / loading / 1e6, "M events/s")
    figure(f"{coding}: stream", COUNT / best(lambda: sum(map(len, stream(path))), 7) / 1e6, "M events/s")
    saved = best(lambda: save(events, path, format=coding, replace=True), 3)
    figure(f"{coding}: save", COUNT / saved / 1e6, "M events/s")
    beside_peers(figure, coding, {library: aim}, COUNT, loading, path, coding)


@pytest.mark.parametrize("case", RECORDED)
def test_recorded(figure, tmp_path, case):
    name, times, aim, peers = RECORDED[case]
    if not SHARED.is_dir():
        pytest.skip("../shared is not here")
    data, path = (SHARED / name).read_bytes(), tmp_path / name
    begin = {".bin": 0, ".aedat4": 0, ".es": START}.get(path.suffix)
    begin = Aedat2(Source(data)).start if begin is None else begin
    path.write_bytes(data[:begin] + data[begin:] * times)
    source = Source(path)

    def read(block):
        return sum(piece.t.size for piece in find(source).open(source).pieces(block))

    count, whole = read(WHOLE), best(lambda: read(WHOLE))
    figure(f"{case}, whole", count / whole / 1e6, "M events/s")
    figure(f"{case}, in blocks", count / best(lambda: read(BLOCK)) / 1e6, "M events/s")
    beside_peers(figure, case, dict.fromkeys(peers, aim), count, whole, path)
    if case == "Event Stream":
        path.write_bytes(data)
        count = len(load(path))
        figure("Event Stream, load with all checks", count / best(lambda: load(path)) / 1e6, "M events/s")


FILES = 10_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of files like those of N-MNIST: ten classes, and 4,000 events in 300 ms in each file."""
    rng, n, size = np.random.default_rng(0), 4_000, (34, 34)
    root = tmp_path_factory.mktemp("set")
    for k in range(FILES):
        path = root / str(k % 10) / f"{k:05d}.bin"
        path.parent.mkdir(exist_ok=True)
        x, y = (np.clip(rng.normal(17, 6, n), 0, 33).astype(int) for _ in "xy")
        save(Events(np.sort(rng.integers(0, 300_000, n)), x, y, rng.integers(0, 2, n), size), path)
    return root


def children():
    """Return the processor time of the child processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.parametrize("jobs", [1, 2])
def test_to_hdf5(figure, folder, tmp_path, jobs):
    """Time the conversion of a folder of small files to one HDF5 file, with the processor time of each process."""
    data, since = Dataset(folder), {}

    def tell(what, done, total):
        since.setdefault(what, (time.perf_counter(), time.process_time()))

    workers = children()
    data.to_hdf5(tmp_path / "o.h5", jobs=jobs, report=tell)
    (began, cpu), (joining, cpu_joining) = since["reading"], since["writing"]
    case = f"{FILES:,} files, {jobs} jobs"
    figure(f"{case}: all", time.perf_counter() - began, "s")
    figure(f"{case}: processor, this process while files are read", cpu_joining - cpu, "s")
    figure(f"{case}: processor, this process while they are joined", time.process_time() - cpu_joining, "s")
    figure(f"{case}: processor, the others", children() - workers, "s")
    figure(f"{case}: joining", time.perf_counter() - joining, "s")
