"""The cortical microcircuit: its speed, and its firing beside another simulator.

    python benchmarks/microcircuit.py run [--scale 1] [--seed 1] [--threads 1] [--ms 10000] [--out OURS.npz]
    python benchmarks/microcircuit.py compare NEST.npz OURS.npz [OURS.npz ...] [--picture OUT.png]

`run` prints one JSON line. `compare` prints a table with the first file beside the mean of the others, which are seeds
of one network. `benchmarks/microcircuit_nest.py` writes the first file. A run at full scale needs 2.2 GB.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from spike_statistics import MEASURES, Figure, Recording, Train, agree, apart, measured, together

import neuro
import neuro_models

UNITS = {"rate": "Hz", "irregularity": "CV of intervals", "correlation": "of counts in 2 ms, x 1000"}
FACTORS = {"rate": 1.0, "irregularity": 1.0, "correlation": 1e3}


def circuit(scale: float, indegree: float | None = None) -> neuro.Network:
    """Return the network with `scale` of its neurons, and with `indegree` of the inputs of each (default: `scale`)."""
    params = {"scale": scale} | ({} if indegree is None else {"indegree": indegree})
    return neuro.load(neuro_models.path("microcircuit"), params=params)


def peak_gb() -> float:
    """Return the largest memory of this process so far, GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def events(sim: neuro.Simulation) -> int:
    """Return the number of synaptic events: the sum over all spikes of the number of outgoing synapses."""
    neurons = {p.name for p in sim.program.populations if p.kind == "neuron"}
    names = [p.name for p in sim.program.projections if sim.program.populations[p.source].name in neurons]
    counts = sim.counts().projections
    return sum(counts[name].synaptic_ops for name in names)


def timed(sim: neuro.Simulation, ms: float) -> dict[str, float]:
    """Run for `ms`. Return wall time and processor time per biological second in s, and events."""
    before, wall, cpu = events(sim), time.perf_counter(), time.process_time()
    sim.run(ms)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    count = events(sim) - before
    return {
        "s_per_bio_s": wall / ms * 1e3,
        "cpu_s_per_bio_s": cpu / ms * 1e3,
        "events_per_bio_s": count / ms * 1e3,
        "cpu_ns_per_event": cpu / max(count, 1) * 1e9,
    }


def recorded(sim: neuro.Simulation, begin: float) -> Recording:
    """Return the spikes of all neurons from `begin` ms on."""
    parts = [p for p in sim.program.populations if p.kind == "neuron"]
    trains = {p.name: Train(p.size, *sim.spikes(p.name, since=begin)) for p in parts}
    return Recording(begin, sim.time, trains)


def run(asked: argparse.Namespace) -> None:
    """Build and run the network, write the spikes and print the line."""
    net = circuit(asked.scale, asked.indegree)
    wall, cpu = time.perf_counter(), time.process_time()
    sim = neuro.compile(net, seed=asked.seed, threads=asked.threads)
    sim.run(net.resolution)
    built = {"build_s": time.perf_counter() - wall, "build_cpu_s": time.process_time() - cpu}
    sim.run(asked.warm - net.resolution)
    took = timed(sim, asked.ms)
    spikes = recorded(sim, asked.warm)
    if asked.out:
        spikes.save(asked.out)
    told = {"neuro": neuro.__version__} | {word: getattr(asked, word) for word in ("scale", "seed", "threads", "ms")}
    rates = {name: round(t.times.size / t.size / asked.ms * 1e3, 4) for name, t in spikes.trains.items()}
    print(json.dumps(told | built | took | {"peak_gb": peak_gb(), "rates": rates}))


def cell(figure: Figure, measure: str) -> str:
    """Return a figure and its error as text for a table."""
    if np.isnan(figure.value):
        return "too few spikes"
    value, error = figure.value * FACTORS[measure], figure.error * FACTORS[measure]
    digits = 3 if measure == "irregularity" else 2
    return f"{value:.{digits}f} ± {error:.{digits}f}"


Beside = dict[str, dict[str, tuple[Figure, Figure]]]


def beside(first: Recording, others: list[Recording]) -> Beside:
    """Return, by population and measure, the figure of the first recording and the figure of all others together."""
    one, many = measured(first), [measured(other) for other in others]
    return {
        name: {m: (told[m], together(each[name][m] for each in many)) for m in MEASURES} for name, told in one.items()
    }


def compare(found: Beside) -> bool:
    """Print the table. Return True if all figures agree."""
    print("| population | " + " | ".join(f"{m}, {UNITS[m]}: NEST | neuro" for m in MEASURES) + " |")
    print("| --- |" + " --- |" * 2 * len(MEASURES))
    for name, row in found.items():
        cells = [cell(figure, m) for m in MEASURES for figure in row[m]]
        print(f"| {name} | " + " | ".join(cells) + " |")
    good = True
    for m in MEASURES:
        told = {name: row[m] for name, row in found.items() if not np.isnan([f.value for f in row[m]]).all()}
        far = {name: (*apart(*pair), agree(*pair)) for name, pair in told.items()}
        bad = [name for name, (*_, fine) in far.items() if not fine]
        good &= not bad
        share, errors = (max((abs(d[k]) for d in far.values()), default=0.0) for k in (0, 1))
        verdict = f"DIFFERS in {', '.join(bad)}" if bad else "all within 5 % or 3 standard errors"
        print(f"{m}: at most {100 * share:.1f} %, at most {errors:.1f} standard errors apart: {verdict}")
        print("  " + ", ".join(f"{name} {100 * d[0]:+.1f} % ({d[1]:+.1f})" for name, d in far.items()))
    return good


def picture(found: Beside, spikes: Recording, path: str, shown_ms: float = 300.0) -> None:
    """Draw a stretch of spikes as in the paper, and the three measures of both simulators."""
    from matplotlib.figure import Figure as Canvas

    names = list(found)
    figure = Canvas(figsize=(11.0, 6.0), layout="constrained", dpi=130)
    grid = figure.add_gridspec(3, 2, width_ratios=[3, 2])
    axis = figure.add_subplot(grid[:, 0])
    every = max(1, sum(train.size for train in spikes.trains.values()) // 4000)
    rows, ticks, colours = 0.0, [], {"E": "#0072B2", "I": "#D55E00"}
    for name in reversed(names):
        train = spikes.trains[name]
        some = (train.times <= spikes.begin + shown_ms) & (train.neurons % every == 0)
        axis.plot(train.times[some], rows + train.neurons[some] / every, "o", ms=1.3, mew=0, color=colours[name[-1]])
        ticks.append(rows + train.size / every / 2)
        rows += train.size / every + 40
    axis.set(yticks=ticks, yticklabels=names[::-1], xlabel="time, ms", ylim=(-40, rows))
    axis.set_title(f"one of {every} neurons, neuro" if every > 1 else "neuro", fontsize=10)
    axis.margins(x=0.0)
    at = np.arange(len(names))
    for i, m in enumerate(MEASURES):
        axis = figure.add_subplot(grid[i, 1])
        for k, (who, mark) in enumerate((("NEST", "#999999"), ("neuro", "#0072B2"))):
            values = np.array([found[name][m][k].value for name in names]) * FACTORS[m]
            error = np.array([found[name][m][k].error for name in names]) * FACTORS[m]
            axis.bar(at + 0.4 * k - 0.2, values, 0.38, yerr=error, label=who, color=mark, error_kw={"lw": 1})
        axis.set(xticks=at, xticklabels=names)
        axis.set_title(f"{m}: {UNITS[m]}", fontsize=10)
        if i == 0:
            axis.legend(frameon=False, fontsize=9)
    for axis in figure.axes:
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path)


def main() -> int:
    """Run the chosen command. Return 1 if figures differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("run")
    one.add_argument("--scale", type=float, default=1.0)
    one.add_argument("--indegree", type=float)
    one.add_argument("--seed", type=int, default=1)
    one.add_argument("--threads", type=int, default=1)
    one.add_argument("--ms", type=float, default=10_000.0)
    one.add_argument("--warm", type=float, default=500.0, help="ms before")
    one.add_argument("--out", type=Path)
    two = commands.add_parser("compare")
    two.add_argument("first", type=Path)
    two.add_argument("others", type=Path, nargs="+")
    two.add_argument("--picture")
    asked: Any = parser.parse_args()
    if asked.command == "run":
        run(asked)
        return 0
    others = [Recording.load(path) for path in asked.others]
    found = beside(Recording.load(asked.first), others)
    if asked.picture:
        picture(found, others[0], asked.picture)
    return 0 if compare(found) else 1


if __name__ == "__main__":
    sys.exit(main())
