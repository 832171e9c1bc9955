"""The network of `coba.py` in Brian2 as C++, by the same RK4: `PYTHON benchmarks/coba_brian2.py [--ms 1000]`.

PYTHON has brian2 installed (`make bench-peers` makes one). The time is Brian2's own, of the run alone.
"""

from __future__ import annotations

import argparse
import tempfile

import brian2 as b2
import numpy as np

NEURONS, INPUTS = 10_000, 80


def main() -> None:
    """Print a line."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--ms", type=float, default=1000.0)
    asked = options.parse_args()
    b2.set_device("cpp_standalone", build_on_run=False, directory=tempfile.mkdtemp())
    b2.seed(1)
    b2.defaultclock.dt = 0.1 * b2.ms
    excitatory = NEURONS * 4 // 5
    cells = b2.NeuronGroup(
        NEURONS,
        """dv/dt = (10*nS*(-60*mV - v) + g_ex*(0*mV - v) + g_in*(-80*mV - v)) / (200*pF) : volt (unless refractory)
        dg_ex/dt = -g_ex / (5*ms) : siemens
        dg_in/dt = -g_in / (10*ms) : siemens""",
        threshold="v >= -50*mV", reset="v = -60*mV", refractory=5 * b2.ms, method="rk4",
    )  # fmt: skip
    cells.v = "-60*mV + rand()*10*mV"
    kick = b2.PoissonGroup(20, rates="300*Hz*int(t < 50*ms)")
    start = b2.Synapses(kick, cells[:excitatory], on_pre="g_ex_post += 6*nS", delay=0.1 * b2.ms)
    start.connect(p=0.1)
    rng = np.random.default_rng(1)
    parts = [cells, kick, start]
    for sources, size, offset, share, effect in (
        (cells[:excitatory], excitatory, 0, 0.8, "g_ex_post += 6*nS"),
        (cells[excitatory:], NEURONS - excitatory, 0, 0.2, "g_in_post += 67*nS"),
    ):
        count = round(INPUTS * share)
        made = b2.Synapses(sources, cells, on_pre=effect, delay=0.1 * b2.ms)
        made.connect(i=rng.integers(offset, size, NEURONS * count), j=np.repeat(np.arange(NEURONS), count))
        parts.append(made)
    spikes = b2.SpikeMonitor(cells)
    network = b2.Network(*parts, spikes)
    network.run(asked.ms * b2.ms)
    b2.device.build(run=True, compile=True, with_output=False)
    print(f"Brian2 C++ RK4 {b2.device._last_run_time:8.3f} s  {spikes.num_spikes} spikes")


if __name__ == "__main__":
    main()
