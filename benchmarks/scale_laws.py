"""Growth of time and memory with the size of a network, beside the bandwidth of memory.

    python benchmarks/scale_laws.py measure [--quick] [--out FILE.json]    up to 8 GB, 6 minutes; with --quick 2
    python benchmarks/scale_laws.py table FILE.json
    python benchmarks/scale_laws.py draw FILE.json PICTURE.png
    python benchmarks/scale_laws.py point microcircuit 0.3 [--indegree 1]  one of them, as a JSON line
    python benchmarks/scale_laws.py memory                                 bandwidth of this machine

The microcircuit grows in two ways: with all inputs of each neuron at any size (`indegree` 1), and with the share of
inputs in its file, which equals the size. Brunel's network always has 1000 inputs per neuron, because 10 % would be
10^9 synapses at 10^5 neurons. Time is the processor time of one thread in the fastest of several stretches. Each point
has a process of its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from microcircuit import circuit, peak_gb, timed
from networks import brunel
from numba import njit

import neuro

LINE = 64
WARM_MS, STRETCH_MS, STRETCHES = 200.0, 100.0, 5
POINTS = (
    *(("microcircuit", scale, 1.0) for scale in (0.1, 0.2, 0.4, 0.7, 1.0)),
    *(("microcircuit", scale, scale) for scale in (0.1, 0.2, 0.4, 0.7)),
    *(("brunel", neurons, 1.0) for neurons in (10_000, 20_000, 50_000, 100_000)),
)
QUICK = (
    *(("microcircuit", scale, 1.0) for scale in (0.1, 0.4, 1.0)),
    *(("microcircuit", scale, scale) for scale in (0.1, 0.4)),
    *(("brunel", neurons, 1.0) for neurons in (10_000, 100_000)),
)


def network(case: str, size: float, indegree: float) -> neuro.Network:
    """Return a network. `size` is a share of the microcircuit, or the number of neurons of Brunel's network."""
    return circuit(size, indegree) if case == "microcircuit" else brunel(int(size))


def point(case: str, size: float, indegree: float) -> dict[str, Any]:
    """Build and warm up a network, and time its fastest stretch. Then time its neurons without synapses among them."""
    net = network(case, size, indegree)
    began = time.process_time()
    sim = neuro.compile(net, seed=1)
    sim.run(net.resolution)
    built = time.process_time() - began
    sim.run(WARM_MS - net.resolution)
    stretches = [timed(sim, STRETCH_MS) for _ in range(STRETCHES)]
    best = min(stretches, key=lambda told: told["cpu_ns_per_event"])
    neurons = sum(p.size for p in sim.program.populations if p.kind == "neuron")
    synapses = sum(p.size for p in sim.program.projections if p.layout == "csr")
    memory, peak = sim.memory(), peak_gb()
    del sim
    alone = neurons_alone(net)
    return {
        "case": case,
        "size": size,
        "indegree": indegree,
        "neurons": neurons,
        "synapses": synapses,
        "build_cpu_s": built,
        "cpu_s_per_bio_s": best["cpu_s_per_bio_s"],
        "events_per_bio_s": best["events_per_bio_s"],
        "ns_per_event": best["cpu_ns_per_event"],
        "neurons_cpu_s_per_bio_s": alone,
        "ns_per_event_alone": (best["cpu_s_per_bio_s"] - alone) / best["events_per_bio_s"] * 1e9,
        "bytes_per_synapse": memory["synapses"] / synapses,
        "engine_gb": sum(memory.values()) / 2**30,
        "peak_gb": peak,
    }


def neurons_alone(net: neuro.Network) -> float:
    """Return the processor time of drive and neurons per biological second, s."""
    for name, part in list(net.projections.items()):
        if part.source in net.populations and net.populations[part.source].model.states:
            del net.projections[name]
    sim = neuro.compile(net, seed=1)
    sim.run(WARM_MS)
    return min(timed(sim, STRETCH_MS)["cpu_s_per_bio_s"] for _ in range(STRETCHES))


@njit
def _copy(source, target):
    for i in range(source.size):
        target[i] = source[i]


@njit
def _sum(source):
    a = b = c = d = 0.0
    for i in range(0, source.size, 4):
        a += source[i]
        b += source[i + 1]
        c += source[i + 2]
        d += source[i + 3]
    return a + b + c + d


@njit
def _gather(source, lines):
    total = 0.0
    for i in range(lines.size):
        total += source[lines[i] * 8]
    return total


def bandwidth(mb: int = 1024) -> dict[str, float]:
    """Return the memory bandwidth of one thread in GB/s: copies (read + write), reads, reads of random cache lines."""
    size = mb * 2**20 // 8
    source, target = np.ones(size), np.zeros(size // 2)
    lines = np.random.default_rng(1).integers(0, size // 8, 8_000_000).astype(np.uint32)
    work = {
        "copy": (lambda: _copy(source[: size // 2], target), 8.0 * size),
        "read": (lambda: _sum(source), 8.0 * size),
        "random_lines": (lambda: _gather(source, lines), float(LINE) * lines.size),
    }
    found = {}
    for name, (call, moved) in work.items():
        call()
        taken = []
        for _ in range(5):
            began = time.process_time()
            call()
            taken.append(time.process_time() - began)
        found[f"{name}_gb_per_s"] = moved / min(taken) / 1e9
    return found


def measure(points: tuple[tuple[str, float, float], ...]) -> dict[str, Any]:
    """Measure all points, each in a process of its own."""
    found = []
    me = [sys.executable, __file__]
    for case, size, indegree in points:
        line = subprocess.run(
            [*me, "point", case, str(size), "--indegree", str(indegree)], check=True, capture_output=True, text=True
        ).stdout
        print(line, end="", file=sys.stderr, flush=True)
        found.append(json.loads(line))
    memory = subprocess.run([*me, "memory"], check=True, capture_output=True, text=True).stdout
    return {"memory": json.loads(memory), "points": found}


def series(points: list[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Return the points of each way to grow, the smallest first. The full microcircuit belongs to both of its ways."""
    names = {
        "microcircuit, all inputs": lambda p: p["case"] == "microcircuit" and p["indegree"] == 1.0,
        "microcircuit, fewer inputs": lambda p: p["case"] == "microcircuit" and p["indegree"] == p["size"],
        "Brunel, 1000 inputs": lambda p: p["case"] == "brunel",
    }
    found = {name: sorted(filter(which, points), key=lambda p: p["neurons"]) for name, which in names.items()}
    return {name: each for name, each in found.items() if len(each) > 1}


def table(told: dict[str, Any]) -> str:
    """Return the points as a table, and the spread of the time of an event along each way to grow."""
    lines = [
        "| network | neurons | synapses | ns an event | without drive and neurons | million events/s | "
        "peak GB | bytes a synapse |",
        "| --- |" + " --- |" * 7,
    ]
    spread = []
    for name, points in series(told["points"]).items():
        lines += [
            f"| {name} | {p['neurons']:,} | {p['synapses'] / 1e6:.3g} M | {p['ns_per_event']:.3g} | "
            f"{p['ns_per_event_alone']:.3g} | {1e3 / p['ns_per_event']:.0f} | "
            f"{p['peak_gb']:.2f} | {p['peak_gb'] * 2**30 / p['synapses']:.1f} |"
            for p in points
        ]
        each = [p["ns_per_event"] for p in points]
        spread.append(f"{name}: longest by shortest time of an event {max(each) / min(each):.2f}")
    pace = ", ".join(f"{word.removesuffix('_gb_per_s')} {value:.1f}" for word, value in told["memory"].items())
    return "\n".join([*lines, "", *spread, f"memory, GB/s: {pace}"])


def draw(told: dict[str, Any], path: str) -> None:
    """Draw the time of an event, and memory."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained", dpi=130)
    time_axis, memory_axis = figure.subplots(1, 2)
    colours = ("#0072B2", "#56B4E9", "#D55E00")
    for (name, points), colour in zip(series(told["points"]).items(), colours, strict=False):
        neurons = [p["neurons"] for p in points]
        time_axis.plot(neurons, [p["ns_per_event"] for p in points], "o-", color=colour, label=name)
        time_axis.plot(neurons, [p["ns_per_event_alone"] for p in points], "o--", color=colour, mfc="w", lw=1)
        memory_axis.plot([p["synapses"] / 1e6 for p in points], [p["peak_gb"] for p in points], "o-", color=colour)
    time_axis.plot([], [], "o--", color="k", mfc="w", lw=1, label="without drive and neurons")
    time_axis.set(xlabel="neurons", ylabel="ns of the processor", title="a synaptic event, one thread", yscale="log")
    memory_axis.set(xlabel="million synapses", ylabel="GB", title="peak of building and running", ylim=(0, None))
    time_axis.set_xscale("log")
    for axis in figure.axes:
        axis.spines[["top", "right"]].set_visible(False)
    figure.legend(*time_axis.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path)


def main() -> None:
    """Run the chosen command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    every = commands.add_parser("measure")
    every.add_argument("--quick", action="store_true")
    every.add_argument("--out", type=Path)
    one = commands.add_parser("point")
    one.add_argument("case", choices=["microcircuit", "brunel"])
    one.add_argument("size", type=float)
    one.add_argument("--indegree", type=float, default=1.0)
    commands.add_parser("memory")
    commands.add_parser("table").add_argument("file", type=Path)
    picture = commands.add_parser("draw")
    picture.add_argument("file", type=Path)
    picture.add_argument("out")
    asked = parser.parse_args()
    match asked.command:
        case "measure":
            text = json.dumps(measure(QUICK if asked.quick else POINTS), indent=1)
            print(text) if asked.out is None else asked.out.write_text(text + "\n")
        case "point":
            print(json.dumps(point(asked.case, asked.size, asked.indegree)))
        case "memory":
            print(json.dumps(bandwidth()))
        case "table":
            print(table(json.loads(asked.file.read_text())))
        case "draw":
            draw(json.loads(asked.file.read_text()), asked.out)


if __name__ == "__main__":
    main()
