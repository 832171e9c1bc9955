"""Growth of time and memory with the sizes of a network and of its data, over three decades.

    python benchmarks/growth.py [--only LINE ...] [--json FILE]

Each size is measured in a process of its own, after the same work at the smallest size, which compiles the kernels.
Time is processor time. Memory is the peak above the peak at the smallest size. A slope is the slope of the last decade
on logarithmic axes, so a slope of 1 is linear growth. A line whose largest size takes less than 0.05 s, or 10 MB, has
no slope.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from kept import markdown

import neuro
from neuro.apps import mistakes

LEAST_S, LEAST_MB = 0.05, 10.0
"""Time and memory below which a slope would mainly show noise."""

Work = Callable[[], Any]
"""The part of a measurement that is timed."""


def _cells(n: int) -> neuro.Network:
    net = neuro.Network("growth", resolution=1.0)
    net.population("cells", n, neuro.iaf_psc_exp(I_e=380.0))
    return net


def neurons(n: int, folder: Path) -> Work:
    """Run n neurons that fire at about 20 Hz, for 100 ms."""
    return lambda: neuro.compile(_cells(n), seed=1).run(100.0)


def synapses(n: int, folder: Path) -> Work:
    """Build n static synapses between n / 100 neurons, and run 100 ms."""
    net = _cells(n // 100)
    net.connect("cells", "cells", neuro.fixed_indegree(100), weight=0.1, delay=1.0)
    return lambda: neuro.compile(net, seed=1).run(100.0)


def plastic(n: int, folder: Path) -> Work:
    """Build n synapses with STDP between n / 100 neurons, and run 100 ms."""
    net = _cells(n // 100)
    net.connect("cells", "cells", neuro.fixed_indegree(100), neuro.stdp(Wmax=1.0), weight=0.1, delay=1.0)
    return lambda: neuro.compile(net, seed=1).run(100.0)


def checked(n: int, folder: Path) -> Work:
    """Check a file of n populations without projections."""
    file = folder / f"growth{n}.yaml"
    lines = "".join(f"  p{k}: {{shape: 1, model: iaf_psc_exp}}\n" for k in range(n))
    file.write_text(f"neuro: 1\npopulations:\n{lines}")
    return lambda: mistakes(file, {}, 0, False)


def populations(n: int, folder: Path) -> Work:
    """Run n populations of ten neurons, for 100 ms."""
    net = neuro.Network("growth", resolution=1.0)
    cell = neuro.iaf_psc_exp(I_e=380.0)
    for k in range(n):
        net.population(f"p{k}", 10, cell)
    return lambda: neuro.compile(net, seed=1).run(100.0)


def projections(n: int, folder: Path) -> Work:
    """Run n projections of ten neurons onto ten, for 100 ms."""
    net = neuro.Network("growth", resolution=1.0)
    cell = neuro.iaf_psc_exp(I_e=380.0)
    for name in ("a", "b"):
        net.population(name, 10, cell)
    for k in range(n):
        net.connect("a", "b", neuro.one_to_one(), weight=0.1, delay=1.0, name=f"c{k}")
    return lambda: neuro.compile(net, seed=1).run(100.0)


def probes(n: int, folder: Path) -> Work:
    """Record V_m of n neurons with a probe each, in each of 100 steps."""
    net = neuro.Network("growth", resolution=1.0)
    cells = net.population("cells", n, neuro.iaf_psc_exp(I_e=380.0))
    for k in range(n):
        net.probe(f"v{k}", cells[k : k + 1], "V_m")
    return lambda: neuro.compile(net, seed=1).run(100.0)


def spikes(n: int, folder: Path) -> Work:
    """Record n spikes of 1,000 neurons that fire in each step."""
    net = neuro.Network("growth", resolution=1.0)
    net.population("cells", 1000, neuro.parrot_neuron())
    net.population("drive", 1000, neuro.poisson_generator(rate=1000.0))
    net.connect("drive", "cells", neuro.one_to_one(), weight=1.0, delay=1.0)
    sim = neuro.compile(net, seed=1)
    return lambda: (sim.run(n / 1000.0), sim.spikes("cells"))


def control_steps(n: int, folder: Path) -> Work:
    """Run 100 neurons n times for 1 ms."""
    sim = neuro.compile(_cells(100), seed=1)
    return lambda: [sim.run(1.0) for _ in range(n)]


def total(x: float) -> dict[str, float]:
    """Return a metric of a run."""
    return {"y": 2.0 * x}


def points(n: int, folder: Path) -> Work:
    """Run a sweep of n points of one small function, in this process."""
    return lambda: neuro.sweep(total, {"x": list(range(n))}, out=folder / f"runs{n}", on="here")


def recordings(n: int, folder: Path) -> Work:
    """Read n event-camera recordings of 1,000 events from a folder."""
    from neuro import events

    rng = np.random.default_rng(1)
    for k in range(n):
        where = folder / f"set{n}" / str(k % 10)
        where.mkdir(parents=True, exist_ok=True)
        t = np.sort(rng.integers(0, 100_000, 1000))
        x, y = rng.integers(0, 34, (2, 1000), dtype=np.uint16)
        events.save(
            events.Events(t, x, y, rng.integers(0, 2, 1000, dtype=np.uint8), sensor_size=(34, 34)),
            where / f"{k:05}.aedat",
            replace=True,
        )
    return lambda: [recording.load() for recording in events.recordings(folder / f"set{n}")]


LINES: dict[str, tuple[Callable[[int, Path], Work], tuple[int, ...]]] = {
    "neurons": (neurons, (1_000, 10_000, 100_000, 1_000_000)),
    "synapses": (synapses, (10_000, 100_000, 1_000_000, 10_000_000)),
    "plastic synapses": (plastic, (10_000, 100_000, 1_000_000, 10_000_000)),
    "populations, check": (checked, (220, 2_200, 22_000, 220_000)),
    "populations, run": (populations, (10, 100, 1_000, 10_000)),
    "projections, run": (projections, (10, 100, 1_000, 10_000)),
    "probes": (probes, (10, 100, 1_000, 10_000)),
    "recorded spikes": (spikes, (10_000, 100_000, 1_000_000, 10_000_000)),
    "control steps": (control_steps, (100, 1_000, 10_000, 100_000)),
    "points of a sweep": (points, (3, 30, 300, 3_000)),
    "recordings": (recordings, (10, 100, 1_000, 10_000)),
}


def peak_mb() -> float:
    """Return the largest memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def measure(line: str, size: int) -> tuple[float, float]:
    """Measure one size in this process. Return processor time in s, and memory in MB above the smallest size."""
    prepare, sizes = LINES[line]
    with tempfile.TemporaryDirectory() as folder:
        prepare(sizes[0], Path(folder))()
        before = peak_mb()
        work = prepare(size, Path(folder))
        began = time.process_time()
        work()
        return time.process_time() - began, peak_mb() - before


def slope(values: list[float], sizes: tuple[int, ...], least: float) -> float | None:
    """Return the slope of the last decade, or None if its values are too small."""
    if values[-1] < least or values[-2] <= 0.0:
        return None
    return math.log(values[-1] / values[-2]) / math.log(sizes[-1] / sizes[-2])


def main() -> None:
    """Measure the lines, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=LINES, default=list(LINES))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", nargs=2, metavar=("LINE", "SIZE"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options.one[0], int(options.one[1]))))
        return
    figures = {}
    for line in options.only:
        sizes = LINES[line][1]
        runs = []
        for size in sizes:
            command = [sys.executable, __file__, "--one", line, str(size)]
            answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            runs.append(json.loads(answer.splitlines()[-1]))
        seconds, megabytes = ([run[k] for run in runs] for k in (0, 1))
        slopes = slope(seconds, sizes, LEAST_S), slope(megabytes, sizes, LEAST_MB)
        figures[line] = {"sizes": sizes, "cpu_s": seconds, "mb": megabytes, "slopes": slopes}
        print(line, figures[line], file=sys.stderr, flush=True)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1))
    rows = []
    for line, figure in figures.items():
        shown = ["-" if value is None else f"{value:.2f}" for value in figure["slopes"]]
        times = ", ".join(f"{value:.2g}" for value in figure["cpu_s"])
        rows.append((line, f"{figure['sizes'][0]:,} to {figure['sizes'][-1]:,}", times, *shown))
    print(markdown(("line", "sizes", "s of the processor", "slope of time", "slope of memory"), rows), end="")


if __name__ == "__main__":
    main()
