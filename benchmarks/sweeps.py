"""CPU time of a sweep besides its runs: `python benchmarks/sweeps.py --out FOLDER`.

The same runs, which do nothing, are done on the cores of this machine, on a Dask cluster (a scheduler and two workers
on the loopback), and as four parts at once in one folder. The script prints the CPU time of all processes per run, with
and without their start. The start is measured with a few runs. It also prints whether all tables are equal.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import neuro
from neuro_sweeps.table import table_of

HERE = Path(__file__).resolve()
FEW = 8
"""Number of runs after which all processes have started."""

TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def nothing(a: int) -> dict[str, int]:
    """Make a run that takes no time."""
    return {"twice": 2 * a, "square": a * a}


def cpu_s(roots: Iterable[int]) -> float:
    """Return the CPU time of processes and of their child processes, also of those that have ended, s.

    Source: proc(5), /proc/pid/stat, fields 4 and 14 to 17
    """
    each: dict[int, tuple[int, int]] = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = file.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        each[int(file.parent.name)] = int(words[1]), sum(map(int, words[11:15]))
    wanted, more = set(roots), set(roots)
    while more:
        more = {process for process, (parent, _) in each.items() if parent in more}
        wanted |= more
    return TICK_S * sum(each[process][1] for process in wanted if process in each)


def swept(out: Path, runs: int, *words: str) -> subprocess.Popen[bytes]:
    """Start a process that runs a sweep or a part of it."""
    return subprocess.Popen([sys.executable, str(HERE), "--out", str(out), "--runs", str(runs), "--child", *words])


def taken(processes: list[subprocess.Popen[bytes]]) -> float:
    """Wait until processes have ended, and return their CPU time in s."""
    before = os.times()
    for process in processes:
        if process.wait():
            raise SystemExit(f"ended with {process.returncode}")
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


class Cluster:
    """A scheduler and two workers of one thread each.

    Args:
        folder: folder for the file of the scheduler.
    """

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self.file.unlink(missing_ok=True)
        words = ("--scheduler-file", str(self.file))
        self._all = [self._start("dask_scheduler", *words, "--port", "0")]
        while not self.file.exists():
            time.sleep(0.1)
        self._all += [self._start("dask_worker", *words, "--nthreads", "1", "--no-nanny") for _ in range(2)]
        time.sleep(10.0)
        swept(folder / "warm", FEW, "--on", str(self.file)).wait()  # afterwards the workers have imported all modules

    def _start(self, what: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{what}", *words, "--host", "127.0.0.1", "--no-dashboard"]
        env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])}
        return subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def cpu_s(self) -> float:
        """Return the CPU time of all processes so far, s."""
        return cpu_s(each.pid for each in self._all)

    def close(self) -> None:
        """End the cluster."""
        for each in self._all:
            each.kill()
            each.wait()


def per_run(name: str, out: Path, runs: int, cluster: Cluster | None) -> tuple[float, float]:
    """Return the CPU time per run in s, with the start of all processes, and after the first `FEW` runs."""
    found = []
    for number in (FEW, FEW + runs):
        folder = out / f"{name}-{number}"
        shutil.rmtree(folder, ignore_errors=True)
        before = cluster.cpu_s() if cluster else 0.0
        if cluster:
            started = [swept(folder, number, "--on", str(cluster.file))]
        elif name == "parts":
            started = [swept(folder, number, "--share", f"{k}/4", "--workers", "1") for k in range(1, 5)]
        else:
            started = [swept(folder, number, "--workers", "2")]
        found.append(taken(started) + (cluster.cpu_s() - before if cluster else 0.0))
    return found[1] / (FEW + runs), (found[1] - found[0]) / runs


def main() -> None:
    """Measure all sweeps and print the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--runs", type=int, default=1000)
    options.add_argument("--times", type=int, default=3, help="of which the fastest counts")
    options.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    options.add_argument("--on", default="cores", help=argparse.SUPPRESS)
    options.add_argument("--share", help=argparse.SUPPRESS)
    options.add_argument("--workers", type=int, help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.child:
        import sweeps  # imported by name, so that all folders belong to the same sweep

        words = {"on": asked.on, "share": asked.share, "workers": asked.workers, "progress": False}
        neuro.sweep(sweeps.nothing, {"a": list(range(asked.runs))}, out=asked.out, **words)
        return
    asked.out.mkdir(parents=True, exist_ok=True)
    cluster = Cluster(asked.out)
    try:
        found: dict[str, list[tuple[float, float]]] = {}
        for _ in range(asked.times):
            for name in ("cores", "parts", "dask"):
                took = per_run(name, asked.out, asked.runs, cluster if name == "dask" else None)
                found.setdefault(name, []).append(took)
    finally:
        cluster.close()
    for name, each in found.items():
        whole, beyond = (1000.0 * min(column) for column in zip(*each, strict=True))
        print(f"{name}: {whole:.2f} ms a run with the start of all processes, {beyond:.2f} ms without")
    tables = [table_of(asked.out / f"{name}-{asked.runs + FEW}") for name in found]
    same = all(table.csv() == tables[0].csv() for table in tables)
    print(f"tables of {len(tables[0]):,} runs: {'equal' if same else 'NOT equal'}, {tables[0].counts()}")


if __name__ == "__main__":
    main()
