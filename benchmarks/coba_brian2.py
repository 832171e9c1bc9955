"""The networks of `coba.py` in Brian2 as C++, by the same RK4: `PYTHON benchmarks/coba_brian2.py [adex] [--ms 1000]`.

PYTHON is an interpreter with brian2, which `make bench-peers` can make. The figure is the processor time of the run
alone, in s. The program that Brian2 writes is run `--repeat` times, and the least time is printed.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import brian2 as b2
import numpy as np

NEURONS, INPUTS = 10_000, 80

SYNAPSES = """
dg_ex/dt = -g_ex / (5*ms) : siemens
dg_in/dt = -g_in / (10*ms) : siemens
"""
LIF = """
dv/dt = (10*nS*(-60*mV - v) + g_ex*(0*mV - v) + g_in*(-80*mV - v)) / (200*pF) : volt (unless refractory)
"""
ADEX = """
u = clip(v, -1000*mV, 0*mV) : volt
dv/dt = (10*nS*(-60*mV - u) + 25*pA*exp((u + 50*mV) / (2.5*mV)) - w
         + g_ex*(0*mV - u) + g_in*(-80*mV - u)) / (200*pF) : volt (unless refractory)
dw/dt = (1*nS*(u + 60*mV) - w) / (600*ms) : amp
b : amp (constant)
"""
CELLS = {
    "lif": {"model": LIF + SYNAPSES, "threshold": "v >= -50*mV", "reset": "v = -60*mV"},
    "adex": {"model": ADEX + SYNAPSES, "threshold": "v >= 0*mV", "reset": "v = -60*mV; w += b"},
}
TIMER = """
{ std::ofstream told("%s"); told << (std::clock() - began) / double(CLOCKS_PER_SEC); }
"""


def main() -> None:
    """Run the network and print a line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("cells", nargs="?", choices=list(CELLS), default="lif")
    options.add_argument("--ms", type=float, default=1000.0)
    options.add_argument("--repeat", type=int, default=1)
    asked = options.parse_args()
    folder = Path(tempfile.mkdtemp())
    b2.set_device("cpp_standalone", build_on_run=False)
    b2.prefs.codegen.cpp.headers += ["<ctime>", "<fstream>"]
    b2.seed(1)
    b2.defaultclock.dt = 0.1 * b2.ms
    excitatory = NEURONS * 4 // 5
    cells = b2.NeuronGroup(NEURONS, **CELLS[asked.cells], refractory=5 * b2.ms, method="rk4")
    cells.v = "-60*mV + rand()*10*mV"
    if asked.cells == "adex":
        cells.b[:excitatory] = 5 * b2.pA
    kick = b2.PoissonGroup(20, rates="300*Hz" if asked.cells == "adex" else "300*Hz*int(t < 50*ms)")
    start = b2.Synapses(kick, cells[:excitatory], on_pre="g_ex_post += 6*nS", delay=0.1 * b2.ms)
    start.connect(p=0.1)
    rng = np.random.default_rng(1)
    parts = [cells, kick, start]
    for sources, size, share, effect in (
        (cells[:excitatory], excitatory, 0.8, "g_ex_post += 6*nS"),
        (cells[excitatory:], NEURONS - excitatory, 0.2, "g_in_post += 67*nS"),
    ):
        count = round(INPUTS * share)
        made = b2.Synapses(sources, cells, on_pre=effect, delay=0.1 * b2.ms)
        made.connect(i=rng.integers(0, size, NEURONS * count), j=np.repeat(np.arange(NEURONS), count))
        parts.append(made)
    spikes = b2.SpikeMonitor(cells)
    network = b2.Network(*parts, spikes)
    b2.device.insert_code("before_network_run", "const std::clock_t began = std::clock();")
    b2.device.insert_code("after_network_run", TIMER % (folder / "seconds"))
    network.run(asked.ms * b2.ms)
    b2.device.build(directory=str(folder), run=True, compile=True, with_output=False)
    taken = [float((folder / "seconds").read_text())]
    for _ in range(asked.repeat - 1):
        b2.device.run(with_output=False)
        taken.append(float((folder / "seconds").read_text()))
    print(f"Brian2 C++ RK4 {min(taken):8.3f} s  {spikes.num_spikes} spikes")


if __name__ == "__main__":
    main()
