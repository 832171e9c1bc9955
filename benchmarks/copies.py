"""Copies of a small network that learns by reward, with one call per step, beside the same simulations in turn.

    python benchmarks/copies.py [COPIES] [--neurons 200] [--steps 200]

A step is a step of a closed loop: spikes go in, 20 ms run, counts come out, and an error teaches. The copies run in
three ways: all copies with one stepper; each simulation with its own stepper; each with `inject`, `run`, ports of
counts and `signal`. All ways give the same bits, and take turns in one process on one core. The figures are medians of
5 rounds, and ratios within a round.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

import neuro

ROUNDS, MS, ACTIVE, PERIOD = 5, 20.0, 24, 5
Ints: TypeAlias = npt.NDArray[np.int64]
Step: TypeAlias = Callable[[Ints, Ints, npt.NDArray[np.float64]], None]


def network(neurons: int) -> neuro.Network:
    """Return a network in which all synapses learn.

    Neurons for places excite a critic of 50 neurons, and a circuit that chooses between two actions.
    """
    net = neuro.Network("loop", resolution=1.0)
    places = net.population("places", neurons - 53, neuro.spike_generator())
    ask = net.population("ask", 1, neuro.spike_generator())
    point = neuro.pp_psc_delta(tau_m=5.0, with_reset=False, c_1=180.0, c_2=240.0, c_3=0.0)
    critic = net.population("critic", 50, point)
    actor = net.population("actor", 2, neuro.soft_wta(tau_m=5.0))
    net.signal("error", to=critic)
    net.signal("error_of_actor", to=actor)
    value = neuro.td_lambda(signal="error", tau=5.0, eta=1e-3)
    net.connect(places, critic, neuro.all_to_all(), value, weight=0.0, delay=1.0, name="value")
    policy = neuro.reinforce(signal="error_of_actor", tau=5.0, eta=1e-3, receptor="ex")
    net.connect(places, actor, neuro.all_to_all(), policy, weight=0.0, delay=1.0, name="policy")
    net.connect(ask, actor, neuro.all_to_all(), neuro.static(receptor="ask"), weight=1.0, delay=1.0)
    return net


def ways(net: neuro.Network, n: int) -> dict[str, tuple[list[neuro.Simulation], Step]]:
    """Return the ways to run n copies by name: the simulations of each way, and a function that runs a step."""
    ask, none = np.full(n, int(MS) - 1), np.zeros(n, dtype=np.int64)
    copies = neuro.compile(net, copies=n, seed=1)
    stepper = copies.stepper(MS, emit=["places", "ask"], count=["critic", "actor"])

    def together(ticks: Ints, ids: Ints, errors: npt.NDArray[np.float64]) -> None:
        offsets = np.arange(n + 1) * ticks.shape[1]
        stepper.step((offsets, ticks.ravel(), ids.ravel()), (np.arange(n + 1), ask, none))
        copies.signal("error", errors)
        copies.signal("error_of_actor", errors)

    stepped = [neuro.compile(net, seed=1 + k) for k in range(n)]
    steppers = [sim.stepper(MS, emit=["places", "ask"], count=["critic", "actor"]) for sim in stepped]

    def each_by_a_stepper(ticks: Ints, ids: Ints, errors: npt.NDArray[np.float64]) -> None:
        for k, (sim, own) in enumerate(zip(stepped, steppers, strict=True)):
            own.step((ticks[k], ids[k]), (ask[:1], none[:1]))
            sim.signal("error", errors[k, 0])
            sim.signal("error_of_actor", errors[k, 0])

    plain = [neuro.compile(net, seed=1 + k) for k in range(n)]
    counts = [[sim.port(name, "counts") for name in ("critic", "actor")] for sim in plain]

    def each_by_calls(ticks: Ints, ids: Ints, errors: npt.NDArray[np.float64]) -> None:
        for k, (sim, ports) in enumerate(zip(plain, counts, strict=True)):
            sim.inject("places", sim.time + ticks[k], ids[k])
            sim.inject("ask", [sim.time + MS - 1.0], [0])
            sim.run(MS)
            for port in ports:
                port.get()
            sim.forget(sim.time)
            sim.signal("error", errors[k, 0])
            sim.signal("error_of_actor", errors[k, 0])

    return {
        "copies, one stepper": (list(copies), together),
        "one after the other, a stepper each": (stepped, each_by_a_stepper),
        "one after the other, inject, run, ports": (plain, each_by_calls),
    }


def main() -> None:
    """Time all ways in turn. Print the steps per second of all copies, and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("copies", nargs="?", type=int, default=64)
    parser.add_argument("--neurons", type=int, default=200)
    parser.add_argument("--steps", type=int, default=100)
    given = parser.parse_args()
    n, rng = given.copies, np.random.default_rng(1)
    found = ways(network(given.neurons), n)
    shape = (given.steps, n, ACTIVE)
    ids = np.sort(np.argsort(rng.random((given.steps, n, given.neurons - 53)), axis=2)[:, :, :ACTIVE], axis=2)
    waves = len(range(1, int(MS) - 1, PERIOD))
    ids = np.tile(ids, waves)
    ticks = np.broadcast_to(np.repeat(np.arange(waves) * PERIOD + 1, ACTIVE), (*shape[:2], waves * ACTIVE)).copy()
    errors = rng.normal(0.0, 0.1, (given.steps, n, 1))
    taken: dict[str, list[float]] = {name: [] for name in found}
    for _ in range(ROUNDS):
        for name, (_, way) in found.items():
            begun = time.perf_counter()
            for step in range(given.steps):
                way(ticks[step], ids[step], errors[step])
            taken[name].append(time.perf_counter() - begun)
    first, *others = (sims for sims, _ in found.values())
    for sims in others:
        for copy, sim in zip(first, sims, strict=True):
            np.testing.assert_array_equal(copy.weights("value")[2], sim.weights("value")[2])
    best = np.array(next(iter(taken.values())))
    for name, each in taken.items():
        ratio = np.array(each) / best
        speed = given.steps * n / np.median(each)
        print(f"{name}: {speed:,.0f} steps/s; {np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})")


if __name__ == "__main__":
    main()
