"""Timing of a network after a warm-up, in the units of the scripts of other simulators.

    python benchmarks/run.py brunel|cuba|stdp [--threads 1] [--T 1000] [--pairs N]
    python benchmarks/run.py loop [--steps N] [--resolution 0.1] [--plain]
    python benchmarks/run.py ff|rec [--steps N]                               on the emulated Loihi

Each prints one JSON line.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from typing import Any

began = time.perf_counter()
import neuro  # noqa: E402

import_s = time.perf_counter() - began

import numpy as np  # noqa: E402
from networks import CHIP_NETWORKS, NETWORKS, loop, sources  # noqa: E402

WARM_UP_MS = 100.0
STEP_MS = 50.0


def seconds(work: Any, *args: Any) -> float:
    """Return the wall time of a call, s."""
    began = time.perf_counter()
    work(*args)
    return time.perf_counter() - began


def running(net: neuro.Network, ms: float, threads: int = 1) -> dict[str, Any]:
    """Time a network without a closed loop, after a warm-up of 100 ms."""
    began = time.perf_counter()
    sim = neuro.compile(net, seed=12345, threads=threads)
    sim.run(net.resolution)
    build = time.perf_counter() - began
    sim.run(WARM_UP_MS - net.resolution)
    before, cpu = emitted(sim), time.process_time()
    taken = seconds(sim.run, ms)
    cpu = time.process_time() - cpu
    spikes = emitted(sim) - before
    neurons = sum(p.size for p in sim.program.populations if p.model.states)
    synapses = sum(p.size for p in sim.program.projections)
    return {
        "build_s": build,
        "sim_s_per_bio_s": taken / ms * 1e3,
        "cpu_s_per_bio_s": cpu / ms * 1e3,
        "spikes": spikes,
        "rate_hz": spikes / neurons / ms * 1e3,
        "synapses": synapses,
        "bytes_per_synapse": sim.memory()["synapses"] / synapses,
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def in_pairs(net: neuro.Network, ms: float, rounds: int, threads: int = 2) -> dict[str, Any]:
    """Time windows of a network in turn on one thread and on several. A gain is time on one / time on several."""
    sims = {n: neuro.compile(net, seed=12345, threads=n) for n in (1, threads)}
    wall: dict[int, list[float]] = {n: [] for n in sims}
    cpu: dict[int, list[float]] = {n: [] for n in sims}
    for sim in sims.values():
        sim.run(WARM_UP_MS)
    for k in range(rounds):
        for n, sim in list(sims.items())[:: 1 - 2 * (k % 2)]:
            began = time.process_time()
            wall[n].append(seconds(sim.run, ms) / ms * 1e3)
            cpu[n].append((time.process_time() - began) / ms * 1e3)
            sim.forget(sim.time)
    gains = np.array(wall[1]) / wall[threads]
    drawn = np.random.default_rng(0).choice(gains, (10_000, rounds))
    low, high = np.quantile(np.median(drawn, axis=1), (0.025, 0.975))
    return {
        "one_s_per_bio_s": float(np.median(wall[1])),
        "several_s_per_bio_s": float(np.median(wall[threads])),
        "gain": float(np.median(gains)),
        "gain_from": float(low),
        "gain_to": float(high),
        "gain_of_sums": sum(wall[1]) / sum(wall[threads]),
        "gain_of_least": min(wall[1]) / min(wall[threads]),
        "cpu_gain": float(np.median(np.array(cpu[1]) / cpu[threads])),
    }


def emitted(sim: neuro.Simulation) -> int:
    """Return the number of spikes of all neurons, without generators."""
    counts = sim.counts().populations
    return sum(counts[p.name].spikes for p in sim.program.populations if p.model.states)


class ClosedLoop:
    """A closed loop as with a robot: each step sets rates and dopamine, runs, and reads spikes and weights."""

    def __init__(self, net: neuro.Network) -> None:
        self.sim = neuro.compile(net, seed=12345)
        self.rng = np.random.default_rng(3)
        self.rate, self.reward = self.sim.port("noise", "rate"), self.sim.port("reward")
        self.fired, self.learnt = self.sim.port("out", "counts"), self.sim.port("learnt", "weight")
        self.counts, self.weights = np.zeros(4, dtype=np.int64), np.zeros(256)

    def step(self) -> tuple[Any, Any]:
        """Make a step of 50 ms."""
        self.rate.set(self.rng.uniform(0.0, 80.0, 64))
        self.reward.set(self.rng.uniform(-0.02, 0.02, 4))
        self.sim.run(STEP_MS)
        self.sim.forget(before=self.sim.time)
        return self.fired.get(self.counts), self.learnt.get(self.weights)

    def steps(self, count: int) -> None:
        """Make `count` steps."""
        for _ in range(count):
            self.step()


class PlainLoop(ClosedLoop):
    """The closed loop without ports."""

    def step(self) -> tuple[Any, Any]:
        """Make a step of 50 ms."""
        sim, now = self.sim, self.sim.time
        sim.set("noise", rate=self.rng.uniform(0.0, 80.0, 64))
        sim.signal("reward", self.rng.uniform(-0.02, 0.02, 4))
        sim.run(STEP_MS)
        _, ids = sim.spikes("out", since=now)
        counts = np.bincount(ids, minlength=4)
        sim.forget(before=sim.time)
        return counts, sim.weights("learnt")[2]


def looping(net: neuro.Network, steps: int, loop_of: type[ClosedLoop] = ClosedLoop) -> dict[str, Any]:
    """Time a closed loop after 20 steps."""
    began = time.perf_counter()
    loop = loop_of(net)
    build = time.perf_counter() - began
    loop.steps(20)
    cpu = time.process_time()
    taken = seconds(loop.steps, steps)
    cpu = time.process_time() - cpu
    return {
        "build_s": build,
        "steps_per_s": steps / taken,
        "ms_per_step": taken / steps * 1e3,
        "sim_s_per_bio_s": taken / steps / STEP_MS * 1e3,
        "cpu_s_per_bio_s": cpu / steps / STEP_MS * 1e3,
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def on_chip(name: str, steps: int = 0) -> dict[str, Any]:
    """Return steps per second with counts, after a warm-up of 50 steps, by processor time and by wall time."""
    steps = steps or (20_000 if name == "ff" else 3_000)
    net = CHIP_NETWORKS[name]()
    began = time.perf_counter()
    sim = neuro.compile(net, backend="loihi")
    setup = time.perf_counter() - began
    if name == "ff":
        sim.inject("sources", *sources(1000, steps + 50))
    sim.run(50.0)
    clock, began = time.perf_counter(), time.process_time()
    sim.run(float(steps))
    seconds, clock = time.process_time() - began, time.perf_counter() - clock
    counts = sim.counts()
    return {
        "tool": "neuro loihi",
        "net": name,
        "steps": steps,
        "steps_per_s": round(steps / seconds, 1),
        "clock_steps_per_s": round(steps / clock, 1),
        "spikes_per_step": round(counts.spikes / counts.steps, 1),
        "setup_s": round(setup, 3),
    }


def main() -> None:
    """Time the chosen network and print the line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("case", choices=[*NETWORKS, "loop", *CHIP_NETWORKS])
    options.add_argument("--threads", type=int, default=1)
    options.add_argument("--T", type=float, default=1000.0, help="ms of biological time")
    options.add_argument("--pairs", type=int, default=0, help="so many windows of T on one thread and on two, in turn")
    options.add_argument("--steps", type=int, default=0, help="of the closed loop, 20,000 if not given, or of the chip")
    options.add_argument("--resolution", type=float, default=0.1, help="of the closed loop, ms")
    options.add_argument("--plain", action="store_true", help="the closed loop without ports")
    asked = options.parse_args()
    if asked.case in CHIP_NETWORKS:
        print(json.dumps(on_chip(asked.case, asked.steps)))
        return
    if asked.case == "loop":
        figures = looping(loop(asked.resolution), asked.steps or 20_000, PlainLoop if asked.plain else ClosedLoop)
    elif asked.pairs:
        figures = in_pairs(NETWORKS[asked.case](), asked.T, asked.pairs)
    else:
        figures = running(NETWORKS[asked.case](), asked.T, asked.threads)
    line = {"peer": "neuro", "version": neuro.__version__, "case": asked.case, "threads": asked.threads, **figures}
    line["import_s"] = import_s
    print(json.dumps({name: round(v, 4) if isinstance(v, float) else v for name, v in line.items()}))


if __name__ == "__main__":
    main()
