"""A Dask cluster of real processes on this machine: a scheduler, two workers, and what happens when one is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import neuro
from neuro_sweeps.folder import began
from neuro_sweeps.table import table_of
from refused import refused

pytest.importorskip("distributed", reason="the extra dask is not installed")

FOLDER = Path(__file__).parent


class Cluster:
    """A scheduler and its workers.

    Args:
        folder: of the scheduler's file.
        path: where workers look for modules.
    """

    def __init__(self, folder, path):
        self.file = folder / "scheduler.json"
        self.env = {**os.environ, "PYTHONPATH": path}
        self.scheduler = self.start("dask_scheduler", "--scheduler-file", self.file, "--port", "0", "--no-dashboard")
        self.workers = []
        end = time.monotonic() + 60
        while not self.file.exists() and time.monotonic() < end:
            time.sleep(0.1)

    def start(self, what, *words):
        command = [sys.executable, "-m", f"distributed.cli.{what}", *map(str, words), "--host", "127.0.0.1"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return subprocess.Popen(command, env=self.env, cwd=self.file.parent, start_new_session=True, **quiet)

    def add(self):
        words = ("--scheduler-file", self.file, "--nthreads", "1", "--no-dashboard", "--no-nanny")
        self.workers.append(self.start("dask_worker", *words))

    def close(self):
        for each in (self.scheduler, *self.workers):
            if each.poll() is None:
                os.killpg(each.pid, signal.SIGKILL)
            each.wait()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path, os.pathsep.join([*sys.path, str(FOLDER)]))
    yield made
    made.close()


def sweep(function, space, out, **words):
    return neuro.sweep(function, space, out=out, progress=False, **words)


def test_a_cluster_does_what_cores_do(runs, searches, cluster, tmp_path, monkeypatch):
    """Runs of a search are pruned on workers, too, which see the journal."""
    with monkeypatch.context() as patch:
        patch.setattr("neuro_sweeps.executors.CONNECT_S", 1.5)
        told = refused(sweep, runs.add, {"a": [1]}, tmp_path / "none", on=cluster.file)
    assert told == f"on = '{cluster.file}': the cluster has no worker"
    cluster.add()
    cluster.add()
    space = {"a": list(range(12))}
    on_cluster = sweep(runs.add, space, tmp_path / "cluster", seeds=2, on=cluster.file)
    assert on_cluster.csv() == sweep(runs.add, space, tmp_path / "here", seeds=2, on="here").csv()
    pytest.importorskip("optuna", reason="the extra tune is not installed")
    table = neuro.tune(
        searches.stepping, {"x": {"from": 0.0, "to": 1.0}}, objectives={"value": "maximise"}, trials=15,
        out=tmp_path / "search", on=cluster.file, sampler="random", prune={"startup_trials": 2}, progress=False,
    )  # fmt: skip
    counts = table.counts()
    assert counts["done"] + counts["pruned"] == 15
    assert counts["pruned"] > 0
    assert table.best()[0].point["x"] == max(table.column("x"))


@pytest.mark.slow
def test_limits_hold_on_a_cluster(runs, cluster, tmp_path):
    cluster.add()
    table = sweep(
        runs.uneven, {"a": [0, 1, 2, 4]}, tmp_path / "out", on=cluster.file, time_limit="3 s", memory_limit="500 MB"
    )
    assert table.column("error") == [
        "",
        "time: exceeds the limit of 3 s",
        "memory: exceeds the limit of 500 MB",
        "ZeroDivisionError: a = 4",
    ]


def killer(process, killed):
    """What kills a process once five jobs are done, and notes it."""

    def kill(table):
        if not killed and table.counts()["done"] >= 5:
            killed.append(True)
            os.killpg(process.pid, signal.SIGKILL)

    return kill


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(runs, cluster, tmp_path, notes):
    cluster.add()
    cluster.add()
    killed = []
    kill = killer(cluster.workers[0], killed)
    words = {"set": {"notes": notes.path, "pause": 0.05}, "on": cluster.file, "each": kill}
    table = sweep(runs.noting, {"a": list(range(60))}, tmp_path / "out", **words)
    assert killed
    assert table.column("value") == [2 * a for a in range(60)]
    assert len(notes()) == 60
    assert sum(notes().values()) <= 62
    cluster.close()
    processes = {int(word) for note in Path(notes.path).iterdir() for word in note.read_text().split()}
    until = time.monotonic() + 10
    while any(map(began, processes)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(began, processes)), "a process of a run has outlived its worker"


@pytest.mark.slow
def test_a_killed_scheduler_loses_nothing(runs, cluster, tmp_path, notes):
    out = tmp_path / "out"
    cluster.add()
    kill = killer(cluster.scheduler, [])
    words = {"set": {"notes": notes.path, "pause": 0.02}}
    told = refused(sweep, runs.noting, {"a": list(range(400))}, out, **words, on=cluster.file, each=kill)
    hint = "finished runs are kept: run the same command again to continue"
    assert told == f"the cluster at {cluster.file} has stopped\n  hint: {hint}"
    there = table_of(out).counts()["done"]
    assert there >= 5
    cluster.close()
    table = sweep(runs.noting, {"a": list(range(400))}, out, **words, workers=2)
    assert table.column("value") == [2 * a for a in range(400)]
    assert sum(notes().values()) <= 402


def test_no_scheduler(runs, tmp_path, monkeypatch):
    monkeypatch.setattr("neuro_sweeps.executors.CONNECT_S", 0.5)
    with pytest.raises(neuro.ModelError, match=r"on = 'tcp://127.0.0.1:9': no scheduler answers: "):
        sweep(runs.add, {"a": [1]}, tmp_path / "out", on="tcp://127.0.0.1:9")


def _other(folder, text):
    """A folder with another package of our name, and what Dask needs."""
    (folder / "neuro").mkdir(parents=True)
    (folder / "neuro" / "__init__.py").write_text(text)
    return str(folder)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("__version__ = '0.0.1'\n", rf"the worker tcp://.* has neuro 0\.0\.1: expected {neuro.__version__}, as here"),
        ("raise ImportError('none here')\n", r"the worker tcp://.* has no neuro: none here"),
    ],
)
def test_a_worker_without_this_package_is_told_before_the_first_run(runs, tmp_path, text, told):
    ours = str(Path(neuro.__file__).parents[1])
    rest = [path for path in sys.path if path and not path.startswith(ours + os.sep) and path != ours]
    cluster = Cluster(tmp_path, os.pathsep.join([_other(tmp_path / "other", text), *rest]))
    try:
        cluster.add()
        with pytest.raises(neuro.ModelError, match=told):
            sweep(runs.add, {"a": [1]}, tmp_path / "out", on=cluster.file)
    finally:
        cluster.close()
    assert table_of(tmp_path / "out").counts()["left"] == 1
