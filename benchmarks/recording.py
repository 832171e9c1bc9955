"""Recording to disk: memory, loss of data when the process is killed, and processor time of probes.

    python benchmarks/recording.py memory [MINUTES]    spikes of 10,000 neurons at 5 Hz and V_m of 100, to a file
    python benchmarks/recording.py kill [SECONDS]      the same, killed after so many seconds, then read
    python benchmarks/recording.py probe               a Brunel network with and without a probe of 100 neurons

Memory is the largest resident size of the process (VmHWM) minus its size after 10 s of biological time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from networks import brunel

import neuro

NEURONS, RATE, PROBED = 10_000, 5.0, 100


def firing() -> neuro.Network:
    """Return 10,000 independent neurons that fire irregularly at about 5 Hz. V_m of 100 neurons is probed each ms."""
    net = neuro.Network("firing", resolution=1.0)
    net.population("drive", NEURONS, neuro.poisson_generator(rate=RATE))
    cells = net.population("cells", NEURONS, neuro.iaf_psc_delta())
    net.connect("drive", cells, neuro.one_to_one(), weight=20.0, delay=1.0)
    net.probe("V_m", cells[:PROBED], "V_m", every=1.0)
    return net


def probed(every: float | None) -> neuro.Network:
    """Return Brunel's network with a probe of V_m of some neurons, or without a probe."""
    net = brunel()
    if every is not None:
        net.probe("V_m", net.populations["exc"][:PROBED], "V_m", every=every)
    return net


def _resident_mb(word: str = "VmHWM") -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(word))


def memory(minutes: float) -> None:
    """Print the growth of memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        sim = neuro.compile(firing())
        began = time.perf_counter()
        with sim.record_to(path):
            sim.run(10_000.0)
            first = _resident_mb()
            print(f"after 10 s: {first:.0f} MB", flush=True)
            for minute in range(1, int(minutes) + 1):
                sim.run(60_000.0 if minute > 1 else 50_000.0)
                print(f"after {minute} min: {_resident_mb() - first:+.1f} MB", flush=True)
        took = time.perf_counter() - began
        print(f"{took:.0f} s, file of {path.stat().st_size / 1e6:.0f} MB", flush=True)
        before, began = _resident_mb("VmRSS"), time.perf_counter()
        times, _ = neuro.results.read(path).spikes("cells", since=30_000.0, until=40_000.0)
        took = time.perf_counter() - began
        print(f"10 s of spikes read back: {times.size:,} in {took:.2f} s, {_resident_mb('VmRSS') - before:+.0f} MB")


def run_until_killed(path: str) -> None:
    """Run without end. Print the wall time and the biological time of each finished stretch."""
    sim = neuro.compile(firing())
    with sim.record_to(path):
        while True:
            sim.run(20.0)
            print(time.time(), sim.time, flush=True)


def kill(seconds: float) -> None:
    """Print the biological time that is lost when the process is killed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        log = Path(folder) / "log"
        with log.open("w") as told:
            child = subprocess.Popen([sys.executable, __file__, "_run", str(path)], stdout=told)
        while not log.read_text():
            time.sleep(0.1)
        time.sleep(seconds)
        os.kill(child.pid, signal.SIGKILL)
        killed = time.time()
        child.wait()
        lines = log.read_text().splitlines()
        done = [(float(line.split()[0]), float(line.split()[1])) for line in lines[:-1]]
        results = neuro.results.read(f"{path}.part")
        written = max((wall for wall, ms in done if ms <= results.time), default=0.0)
        print(f"killed at {done[-1][1]:.0f} ms; the file has {results.time:.0f} ms: lost {killed - written:.2f} s")
        print(f"{results.spikes('cells')[0].size:,} spikes, last at {results.spikes('cells')[0][-1]:.1f} ms")


def probe() -> None:
    """Print the time of a run with and without a probe, as medians of alternating stretches."""
    names = {"none": None, "every 0.1 ms": 0.1, "every 1 ms": 1.0}
    sims = {name: neuro.compile(probed(every)) for name, every in names.items()}
    taken: dict[str, list[float]] = {name: [] for name in names}
    for sim in sims.values():
        sim.run(50.0)
    for _ in range(9):
        for name, sim in sims.items():
            began = time.process_time()
            sim.run(50.0)
            taken[name].append(time.process_time() - began)
            sim.forget(sim.time)
    for name, seconds in taken.items():
        print(
            f"{name}: {median(seconds) * 1e3:.1f} ms of processor time for 50 ms, "
            f"{(median(seconds) / median(taken['none']) - 1) * 100:+.1f} %; "
            f"fastest {min(seconds) * 1e3:.1f} ms, {(min(seconds) / min(taken['none']) - 1) * 100:+.1f} %"
        )


if __name__ == "__main__":
    words = sys.argv[1:] or ["memory"]
    if words[0] == "_run":
        run_until_killed(words[1])
    elif words[0] == "memory":
        memory(float(words[1]) if len(words) > 1 else 10.0)
    elif words[0] == "kill":
        kill(float(words[1]) if len(words) > 1 else 20.0)
    else:
        probe()
