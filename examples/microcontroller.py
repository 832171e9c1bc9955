"""A network as C for a microcontroller: the same spikes as on the emulated chip, and the memory that it takes.

A bar moves over 16 x 16 pixels; maps see pieces of it, and their spikes reach the neurons of the output. Where a C
compiler is installed, the program runs on this computer, and a test compares each spike and state of it with the
emulator's. Writes microcontroller.png and the programs of the folder microcontroller.
"""

import shutil
import subprocess

import matplotlib.pyplot as plt
import numpy as np

import neuro
from neuro import plots

SIDE, STEPS = 16, 100
SIZES = (2, 4, 8, 16)  # maps


def network(maps: int) -> neuro.Network:
    """A bar of one pixel's width that moves to the right and comes again, and two layers that see it."""
    seen = [np.arange(1.0 + x, STEPS, SIDE) for _ in range(SIDE) for x in range(SIDE)]  # ms
    net = neuro.Network("bar", resolution=1.0)
    net.population("pixels", (1, SIDE, SIDE), neuro.spike_generator(spike_times=seen))
    cell = neuro.iaf_psc_delta(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=8.0, t_ref=2.0)
    net.population("maps", (maps, "auto", "auto"), cell)
    net.population("out", 3, neuro.iaf_psc_exp(E_L=0.0, V_reset=0.0, V_th=10.0))
    drawn = neuro.uniform(low=0.1, high=3.0)
    net.connect("pixels", "maps", neuro.grid(kernel=(5, 5), stride=2), weight=drawn, delay=1.0)
    net.connect("maps", "out", neuro.all_to_all(), weight=90.0, delay=neuro.uniform(low=1.0, high=12.0))
    return net


codes = [neuro.save_c(network(maps), f"microcontroller/{maps}", seed=1) for maps in SIZES]
for maps, code in zip(SIZES, codes, strict=True):
    print(f"{maps} maps: {code.flash + code.code:,} bytes of flash, {code.ram:,} of RAM")
if shutil.which("cc") and shutil.which("make"):
    tested = subprocess.run(["make", "-C", codes[-1].folder, "test"], capture_output=True, text=True, check=True)
    print(next(line for line in tested.stdout.splitlines() if "equal" in line))

sim = neuro.compile(network(SIZES[-1]), backend="loihi", seed=1)
sim.run(STEPS)
figure, (spikes, memory) = plt.subplots(1, 2, figsize=(10, 3.5), layout="constrained", width_ratios=(2, 1))
plots.raster(sim, of=["out", "maps", "pixels"], ax=spikes)
memory.plot(SIZES, [code.flash + code.code for code in codes], "o-", label="flash")
memory.plot(SIZES, [code.ram for code in codes], "o-", label="RAM, at most")
memory.set(xlabel="maps", ylabel="bytes", ylim=(0.0, None))
memory.legend()
figure.savefig("microcontroller.png", dpi=80)
