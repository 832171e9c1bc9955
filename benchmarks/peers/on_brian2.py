"""Time Brian2 with the networks of `networks.py`: `on_brian2.py brunel|cuba|stdp|loop`, one JSON line.

What runs by itself is compiled as a C++ program, which times itself. The loop runs in Python with compiled functions,
since Python must set rates and read spikes between its steps. It needs numpy below 2.4 and a C++ compiler.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
import time
from typing import Any

import brian2
import numpy as np
from brian2 import Hz, Network, NeuronGroup, PoissonInput, SpikeMonitor, Synapses, ms

STEP_MS = 50.0
LOOP_STEPS = 100
LEARNING = """
w : 1
dap/dt = -ap/(20*ms) : 1 (event-driven)
dam/dt = -am/(20*ms) : 1 (event-driven)
"""
DOPAMINE = """
dc/dt = -c/(200*ms) : 1 (clock-driven)
dn/dt = -n/(50*ms) : 1 (clock-driven)
dw/dt = c*n/ms : 1 (clock-driven)
dap/dt = -ap/(20*ms) : 1 (event-driven)
dam/dt = -am/(20*ms) : 1 (event-driven)
"""


def balanced(excitatory: int, inhibitory: int, weight: float, plastic: bool) -> list[Any]:
    """Brunel's network at g = 5 and twice the rate of threshold."""
    leak = "dv/dt = -v/(20*ms) : 1 (unless refractory)"
    cells = NeuronGroup(10_000, leak, threshold="v >= 20", reset="v = 0", refractory=2 * ms, method="exact")
    exc, inh = cells[:8000], cells[8000:]
    rate = 2.0 * 20.0 / (weight * 20.0) * 1000.0 / excitatory * Hz
    noise = PoissonInput(cells, "v", excitatory, rate, weight=weight)
    synapses = [drawn(inh, cells, inhibitory, -5.0 * weight)]
    if plastic:
        step = 2.0 * weight * 0.01
        learning = Synapses(
            exc,
            exc,
            LEARNING,
            on_pre=f"v_post += w*int(not_refractory_post); ap += 1; w = clip(w - {1.1 * step}*am, 0, {2.0 * weight})",
            on_post=f"am += 1; w = clip(w + {step}*ap, 0, {2.0 * weight})",
            delay=1.5 * ms,
        )
        connect(learning, excitatory)
        learning.w = weight
        synapses += [learning, drawn(exc, inh, excitatory, weight)]
    else:
        synapses.append(drawn(exc, cells, excitatory, weight))
    return [cells, noise, *synapses]


def drawn(source: Any, target: Any, indegree: int, weight: float) -> Any:
    """Static synapses, of which each target draws so many sources."""
    synapses = Synapses(source, target, on_pre=f"v_post += {weight}*int(not_refractory_post)", delay=1.5 * ms)
    connect(synapses, indegree)
    return synapses


def connect(synapses: Any, indegree: int) -> None:
    """Draw sources with replacement, as NEST does."""
    targets = synapses.target.N
    rng = np.random.default_rng(indegree + targets)
    sources = rng.integers(0, synapses.source.N, targets * indegree).astype(np.int32)
    synapses.connect(i=sources, j=np.repeat(np.arange(targets, dtype=np.int32), indegree))


def cuba() -> list[Any]:
    """The CUBA benchmark: 4,000 neurons, 2 % connected."""
    equations = """
    dv/dt = (ge + gi - (v + 49))/(20*ms) : 1 (unless refractory)
    dge/dt = -ge/(5*ms) : 1
    dgi/dt = -gi/(10*ms) : 1
    """
    cells = NeuronGroup(4000, equations, threshold="v > -50", reset="v = -60", refractory=5 * ms, method="exact")
    cells.v = "-60 + rand()*10"
    excite, inhibit = Synapses(cells, cells, on_pre="ge += 1.62"), Synapses(cells, cells, on_pre="gi -= 9.0")
    excite.connect("i < 3200", p=0.02)
    inhibit.connect("i >= 3200", p=0.02)
    return [cells, excite, inhibit]


def running(parts: list[Any], began: float, duration_ms: float = 1000.0) -> dict[str, Any]:
    """Compile a network that runs by itself to a program, and run that."""
    spikes = SpikeMonitor(parts[0])
    network = Network([*parts, spikes])
    network.run(duration_ms * ms)
    brian2.device.build(run=False, compile=True)
    build_s = time.perf_counter() - began
    brian2.device.run()
    seconds = brian2.device._last_run_time
    return {
        "build_s": build_s,
        "sim_s_per_bio_s": seconds / duration_ms * 1e3,
        "spikes": int(spikes.num_spikes),
        "rate_hz": float(spikes.num_spikes / parts[0].N / duration_ms * 1e3),
        "synapses": int(sum(len(part) for part in parts if isinstance(part, Synapses))),
    }


def looping(began: float) -> dict[str, Any]:
    """Time the closed loop of 64 inputs and 4 neurons after three steps."""
    inputs = NeuronGroup(64, "r : Hz", threshold="rand() < r*dt")
    equations = """
    dv/dt = (-(v + 70) + s*0.04)/(10*ms) : 1 (unless refractory)
    ds/dt = -s/(2*ms) : 1
    """
    cells = NeuronGroup(4, equations, threshold="v >= -55", reset="v = -70", refractory=2 * ms, method="exact")
    cells.v = -70
    learning = Synapses(
        inputs,
        cells,
        DOPAMINE,
        on_pre="s_post += w; ap += 1; c -= 0.6*am; w = clip(w, 0, 300)",
        on_post="am += 1; c += 0.5*ap",
        delay={"pre": 1 * ms},
        method="euler",
    )
    learning.connect()
    learning.w = 120
    spikes = SpikeMonitor(cells)
    network = Network(inputs, cells, learning, spikes)
    rng, targets = np.random.default_rng(3), np.array(learning.j)

    def step() -> tuple[Any, Any]:
        inputs.r = rng.uniform(0.0, 80.0, 64) * Hz
        learning.n = rng.uniform(-0.02, 0.02, 4)[targets]
        network.run(STEP_MS * ms)
        return np.array(spikes.count), np.array(learning.w)

    network.run(1 * ms)
    build_s = time.perf_counter() - began
    for _ in range(3):
        step()
    began = time.perf_counter()
    for _ in range(LOOP_STEPS):
        step()
    seconds = time.perf_counter() - began
    figures = {"build_s": build_s, "steps_per_s": LOOP_STEPS / seconds, "ms_per_step": seconds / LOOP_STEPS * 1e3}
    return figures | {"sim_s_per_bio_s": seconds / LOOP_STEPS / STEP_MS * 1e3}


def main() -> None:
    """Print the line."""
    case = sys.argv[1]
    brian2.BrianLogger.suppress_hierarchy("brian2")
    if case == "loop":
        brian2.prefs.codegen.target = "cython"
    else:
        brian2.set_device("cpp_standalone", build_on_run=False, directory=tempfile.mkdtemp())
        brian2.prefs.devices.cpp_standalone.openmp_threads = 0
    brian2.seed(1)
    brian2.defaultclock.dt = 0.1 * ms
    began = time.perf_counter()
    if case == "loop":
        figures = looping(began)
    else:
        nets = {"brunel": (balanced, 800, 200, 0.1, False), "stdp": (balanced, 80, 20, 0.5, True), "cuba": (cuba,)}
        build, *arguments = nets[case]
        figures = running(build(*arguments), began)
    usage = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    figures["rss_mb"] = max(usage) / 1024
    line = {"peer": "brian2", "version": brian2.__version__, "case": case, "threads": 1, **figures}
    print(json.dumps({name: round(value, 4) if isinstance(value, float) else value for name, value in line.items()}))


if __name__ == "__main__":
    main()
