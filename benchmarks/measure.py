"""How a figure is taken: after a warm-up, in the units of the peers' scripts."""

from __future__ import annotations

import resource
import time
from typing import Any

import numpy as np

import neuro

WARM_UP_MS = 100.0
STEP_MS = 50.0


def seconds(work: Any, *args: Any) -> float:
    """How long a call takes."""
    began = time.perf_counter()
    work(*args)
    return time.perf_counter() - began


def running(net: neuro.Network, ms: float, threads: int = 1) -> dict[str, Any]:
    """Time a network that runs by itself, after a warm-up of 100 ms."""
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
    """Time windows of a network on one thread and on several, in turn; gains are one / several."""
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
    """Spikes of all neurons, without those of generators."""
    counts = sim.counts().populations
    return sum(counts[p.name].spikes for p in sim.program.populations if p.model.states)


class ClosedLoop:
    """The closed loop as a robot would drive it: each step sets rates and dopamine, runs, reads spikes and weights."""

    def __init__(self, net: neuro.Network) -> None:
        self.sim = neuro.compile(net, seed=12345)
        self.rng = np.random.default_rng(3)
        self.rate, self.reward = self.sim.port("noise", "rate"), self.sim.port("reward")
        self.fired, self.learnt = self.sim.port("out", "counts"), self.sim.port("learnt", "weight")
        self.counts, self.weights = np.zeros(4, dtype=np.int64), np.zeros(256)

    def step(self) -> tuple[Any, Any]:
        """One step of 50 ms."""
        self.rate.set(self.rng.uniform(0.0, 80.0, 64))
        self.reward.set(self.rng.uniform(-0.02, 0.02, 4))
        self.sim.run(STEP_MS)
        self.sim.forget(before=self.sim.time)
        return self.fired.get(self.counts), self.learnt.get(self.weights)

    def steps(self, count: int) -> None:
        """Many of them."""
        for _ in range(count):
            self.step()


class PlainLoop(ClosedLoop):
    """The same without ports."""

    def step(self) -> tuple[Any, Any]:
        """One step of 50 ms."""
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
