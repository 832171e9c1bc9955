"""Ctrl-C while compiled code runs."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import neuro
from beside import beside
from refused import refused

SOON_S = 5.0
"""Seconds in which a run must end here, where others use the machine, too; alone it takes a third of a second."""


def runaway() -> neuro.Network:
    """Parrots that reach each other: every step takes eighty times as long, the fifth half a second, the sixth 40 s."""
    net = neuro.Network("runaway", resolution=1.0)
    net.population("source", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("parrots", 80, neuro.parrot_neuron())
    net.connect("source", "parrots", neuro.all_to_all(), delay=1.0)
    net.connect("parrots", "parrots", neuro.all_to_all(), neuro.stdp(Wmax=3000.0), weight=1.0, delay=1.0)
    return net


def long() -> neuro.Network:
    net = neuro.Network("long", resolution=0.1)
    net.population("noise", 1000, neuro.poisson_generator(rate=5000.0))
    net.population("cells", 1000, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.fixed_indegree(n=100), weight=20.0, delay=1.0)
    return net


def interrupted(sim: neuro.Simulation, ms: float, after: float) -> float:
    """Run until Ctrl-C; return how many seconds it took to end."""
    moment = []

    def ask() -> None:
        moment.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, ask)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        sim.run(ms)
    return time.perf_counter() - moment[0]


def test_a_step_that_does_not_end_is_interrupted():
    sim = neuro.compile(runaway(), "event", threads=1)
    sim.run(5.0)
    assert interrupted(sim, 1.0, 0.3) < SOON_S
    assert "the network was interrupted within a step: expected whole steps" in refused(sim.run, 1.0)
    sim.reset()
    sim.run(1.0)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_run_of_many_steps_is_interrupted(threads):
    sim = neuro.compile(long(), "event", threads=threads)
    sim.run(0.1)
    assert interrupted(sim, 1e7, 0.5) < SOON_S


def test_a_run_goes_on_where_it_was_interrupted():
    sims = [neuro.compile(long(), "event", threads=1, seed=3) for _ in range(2)]
    sims[0].run(0.1)
    interrupted(sims[0], 1e7, 0.5)
    done = sims[0].time
    assert done > 0.1
    sims[0].run(10.0)
    sims[1].run(done + 10.0)
    assert sims[0].counts() == sims[1].counts()
    assert (sims[0].get("cells", "V_m") == sims[1].get("cells", "V_m")).all()


def test_weights_that_are_set_after_an_interrupt_leave_the_spikes_under_way():
    net = long()
    net.connect("cells", "cells", neuro.fixed_indegree(n=20), weight=30.0, delay=10.0, name="wires")
    sims = [neuro.compile(net, "event", threads=1, seed=3) for _ in range(2)]
    for sim in sims:
        sim.run(1.0)
        sim.set("wires", weight=10.0)
    interrupted(sims[0], 1e7, 0.5)
    sims[1].run(sims[0].time - 1.0)
    for sim in sims:
        sim.set("wires", weight=-200.0)
        sim.run(30.0)
    assert sims[0].counts() == sims[1].counts()
    assert (sims[0].get("cells", "V_m") == sims[1].get("cells", "V_m")).all()


def test_a_handler_of_the_program_may_let_a_run_go_on():
    """A handler that raises nothing: the run ends between two steps, and goes on."""
    calls = []
    before = signal.signal(signal.SIGINT, lambda *_: calls.append(1))
    try:
        sims = [neuro.compile(long(), "event", threads=1, seed=3) for _ in range(2)]
        sims[0].run(0.1)
        timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        sims[0].run(500.0)
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
    sims[1].run(500.1)
    assert calls == [1]
    assert sims[0].counts() == sims[1].counts()


COMMANDS, SCRIPT = beside(__file__, "COMMANDS", "SCRIPT")


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_a_program_is_interrupted(name):
    ready = "" if "ready" in COMMANDS[name] else "print('ready', flush=True)\n"
    code = f"{SCRIPT}{ready}{COMMANDS[name]}"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "ready\n", process.stderr.read()
        time.sleep(1.0)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        process.wait(SOON_S)
        assert "KeyboardInterrupt" in process.stderr.read()
    finally:
        process.kill()
        process.communicate()
