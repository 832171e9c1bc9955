"""Reichardt detectors read the speed and direction of edges before an event camera: `python motion.py [figure.png]`.

An edge of each of 64 motions crosses a camera of 8 x 8 pixels with noise; 64 neurons look at each camera, and the one
with the highest potential names the motion. The network is `neuro_models.motion`.
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import neuro
from neuro.events import DVS, frames_of
from neuro_models import motion

SIDE = 8
Y, X = np.indices((SIDE, SIDE))
SHOWN = (3, 1)  # the speed and direction of the figure's edge


def seen(speed, degrees, seed):
    """Events of a camera that an edge crosses; what it has passed is brighter."""
    angle = np.deg2rad(degrees)
    along = X * np.cos(angle) + Y * np.sin(angle)
    along -= along.min()

    def scene(t_us):
        return 0.2 + 0.6 * (1e-3 * speed * t_us - along).clip(0.0, 1.0)

    end = int(1e3 * (along.max() + 2.0) / speed)
    return DVS((SIDE, SIDE), seed=seed).record(frames_of(scene, 0, end, step_us=1000))


def draw(events, times, potential, peaks):
    """One edge: its events, the potentials of its 64 detectors, and their peaks."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    first = np.full((SIDE, SIDE), np.nan)
    first[events.y[::-1], events.x[::-1]] = events.t[::-1] / 1000.0
    figure.colorbar(left.imshow(first, cmap="plasma"), ax=left, label="first event of a pixel (ms)")
    left.set(title="what the camera sees", xlabel="x (px)", ylabel="y (px)")

    speed, direction = SHOWN
    against = (direction + 4) % 8
    middle.plot(times, potential.reshape(-1, 64), color="0.8", linewidth=0.5)
    own = f"{motion.SPEEDS[speed]:.2f} px/ms, {motion.DIRECTIONS[direction]:.0f}°"
    middle.plot(times, potential[:, speed, direction], color="C3", label=own)
    middle.plot(times, potential[:, speed, against], color="C0", label="the same, against the edge")
    middle.set(title="64 detectors", xlabel="time (ms)", ylabel="V_m (mV)", xlim=(0.0, 140.0))
    middle.legend(fontsize=8)

    image = right.imshow(peaks, origin="lower", aspect="auto")
    figure.colorbar(image, ax=right, label="peak of V_m (mV)")
    right.tick_params(labelsize=8)
    right.set_xticks(range(8), [f"{degrees:.0f}°" for degrees in motion.DIRECTIONS])
    right.set_yticks(range(8), [f"{v:.2f}" for v in motion.SPEEDS])
    right.set(title="which one", xlabel="direction", ylabel="speed (px/ms)")
    return figure


motions = [(v, degrees) for v in motion.SPEEDS for degrees in motion.DIRECTIONS]
edges = [seen(*each, seed) for seed, each in enumerate(motions)]
spikes = [motion.to_patches(e.t, e.x + SIDE * n, e.y, columns=64, side=SIDE) for n, e in enumerate(edges)]

sim = neuro.compile(motion.network(patches=64, side=SIDE))
peaks = motion.peaks(sim, *(np.concatenate(part) for part in zip(*spikes, strict=True)))
decided = peaks.reshape(64, 64).argmax(axis=1)
right = decided == np.arange(64)
print(f"direction right {np.mean(decided % 8 == np.arange(64) % 8):.0%}, direction and speed {np.mean(right):.0%}")

name = sys.argv[1] if len(sys.argv) > 1 else "motion.png"
edge = 8 * SHOWN[0] + SHOWN[1]
times, potential = sim.trace("potential")
draw(edges[edge], times, potential.reshape(-1, 64, 8, 8)[:, edge], peaks[edge]).savefig(name, dpi=110)
print(f"one of them is drawn in {name}")
