"""How long a folder of small files takes to become one HDF5 file, and which process works how long."""

import resource
import time

import numpy as np
import pytest

from neuro.events import Dataset, Events, save

FILES = 10_000
EVENTS = 4_000
SIZE = (34, 34)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files like N-MNIST's: ten classes, 4,000 events in 300 ms."""
    rng = np.random.default_rng(0)
    root = tmp_path_factory.mktemp("set")
    for k in range(FILES):
        path = root / str(k % 10) / f"{k:05d}.bin"
        path.parent.mkdir(exist_ok=True)
        x, y = (np.clip(rng.normal(17, 6, EVENTS), 0, 33).astype(int) for _ in "xy")
        save(Events(np.sort(rng.integers(0, 300_000, EVENTS)), x, y, rng.integers(0, 2, EVENTS), SIZE), path)
    return root


def children():
    """Processor time of the processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@pytest.mark.parametrize("jobs", [1, 2])
def test_to_hdf5(figure, folder, tmp_path, jobs):
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
