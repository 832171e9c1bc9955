"""Within a slice threads know nothing of each other: whoever runs first, the result is the same."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro.compiler import pairs, resolve
from neuro.model.network import Network
from neuro.program.program import Ints
from neuro.testing import observe
from neuro.testing.case import differences, run_on
from neuro_event.building import joined_rows, layout, thread_partition
from neuro_event.host import threads as host_threads
from neuro_event.host.threads import LINE
from neuro_event.loop import steps, tables as t
from strategies import networks


class InTurn:
    """In place of `Threads`: the parts of each slice one after the other, the last thread's first."""

    several = True

    def __init__(self, n: int) -> None:
        self._n = n

    def run(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        step = first
        while step < last:
            end = min(step + longest, last)
            if steps.has_room(view, step, 2 * longest, reach) < 2 * longest:  # thread 0 asks when others are done
                reached = steps.run(view, step, end, longest, reach, h)
                if reached < end:
                    return int(reached)
            else:
                self._slice(view, step, end, longest, reach, h)
            step = end
        for thread in range(self._n):
            steps.finish(view, thread, step - 1, h)
        return step

    def _slice(self, view: Ints, step: int, end: int, longest: int, reach: int, h: float) -> None:
        told = np.full((self._n + 1, LINE), step, dtype=np.int64)
        told[self._n, 0] = end
        for thread in range(self._n - 1, 0, -1):
            assert steps.share(view, told, thread, end, longest, reach, h) == 0
        assert steps.share(view, told, 0, end, longest, reach, h) == 1
        assert (told[: self._n, 0] == end).all()


class AtRandom(InTurn):
    """In place of `Threads`: some steps of one thread after some of another, as far as they let each other go."""

    def __init__(self, n: int) -> None:
        super().__init__(n)
        self._random = np.random.default_rng(n)

    def run(self, view: Ints, first: int, last: int, longest: int, reach: int, h: float, stop: Ints) -> int:
        told = np.full((self._n + 1, LINE), first, dtype=np.int64)
        step, end = told[: self._n, 0], told[self._n :, 0]
        while True:
            thread, allowed = int(self._random.integers(self._n)), int(end[0])
            upto = min(last, int(step[thread] + self._random.integers(1, longest + 2)))
            if thread > 0:
                end[0] = min(upto, allowed)
            halted = steps.share(view, told, thread, upto, longest, reach, h)
            assert step.max() - step.min() <= longest
            if thread > 0:
                end[0] = allowed
            elif halted:
                assert (step == step[0]).all()
                if step[0] == last or step[0] < upto:
                    break
                end[0] = step[0]
        for thread in range(self._n):
            steps.finish(view, thread, int(step[0]) - 1, h)
        return int(step[0])


def ran(net: Network, threads: int, pieces: list[float], seed: int = 1) -> dict[str, Any]:
    """What is seen after some runs."""
    sim = neuro.compile(net, "event", seed=seed, threads=threads)
    for ms in pieces:
        run_on(sim, ms)
    return observe(sim)


@pytest.mark.parametrize(("order", "shortest"), [(InTurn, 0.1), (AtRandom, 0.1), (AtRandom, 0.7)])
@pytest.mark.parametrize("few", [0, 1 << 16, -1], ids=["into a ring", "in runs", "in joined rows"])
@pytest.mark.parametrize("many", [100, 1 << 20], ids=["by delay", "by target"])
def test_delays_of_their_own(
    few: int, many: int, shortest: float, order: type[InTurn], monkeypatch: pytest.MonkeyPatch
):
    """Synapses of one source lie by delay in very large networks, and those of all threads' targets between another."""
    for module in (pairs, resolve):
        monkeypatch.setattr(module, "MANY", many)
    if few >= 0:
        monkeypatch.setattr(layout, "_FEW_RUNS", few)
        monkeypatch.setattr(joined_rows, "_longest_series", lambda *given: [])
    net = neuro.Network("own", resolution=0.1)
    cell = neuro.iaf_psc_exp(tau_syn_ex=0.5, tau_syn_in=0.5, I_e=450.0)
    net.population("cells", 1500, cell, initial={"V_m": neuro.uniform(low=-70.0, high=-55.0)})
    net.population("others", 1200, cell)
    late = neuro.uniform(low=shortest, high=2.0)
    weight = neuro.normal(mean=200.0, std=90.0)
    net.connect("cells", "others", neuro.fixed_total_number(n=9000), weight=weight, delay=late)
    net.connect("others", "cells", neuro.fixed_indegree(n=5), weight=80.0, delay=late)
    engine: Any = neuro.compile(net, "event", seed=1)._engine
    engine.run(0)
    assert (engine._arrays.net["projections"][:, t.JOINED_ROW] >= 0).all() == (few > 0)
    alone = ran(net, 1, [20.0])
    assert alone["spikes of others: steps"].size > 100
    with monkeypatch.context() as patched:
        patched.setattr(host_threads, "Threads", order)
        for threads in (2, 3):
            assert differences(alone, ran(net, threads, [20.0]), exact=True) == []
            assert differences(alone, ran(net, threads, [0.1] * 5 + [19.5]), exact=True) == []


@settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.function_scoped_fixture],
)
@given(
    net=networks(largest=1300),
    seed=st.integers(0, 5),
    threads=st.integers(2, 3),
    whole=st.booleans(),
    order=st.sampled_from([InTurn, AtRandom]),
)
def test_random_networks(
    net: Network, seed: int, threads: int, whole: bool, order: type[InTurn], monkeypatch: pytest.MonkeyPatch
):
    alone = ran(net, 1, [60 * net.resolution], seed)
    with monkeypatch.context() as patched:
        patched.setattr(host_threads, "Threads", order)
        if whole:
            patched.setattr(thread_partition, "SCATTERED", 0)
            patched.setattr(thread_partition, "EVEN", np.inf)
        assert differences(alone, ran(net, threads, [60 * net.resolution], seed), exact=True) == []
