"""Reichardt detectors: 64 neurons with linear leak that read the speed and direction of an edge from its events.

A patch of pixels reaches every detector by delays: an edge of the detector's speed v and direction u crosses pixel p
at p u / v, and all arrives at once if the delay is (max - p u) / v. A patch has two dimensions since a row of pixels
cannot tell a fast oblique edge from a slow straight one: along it both take the time cos(angle) / v a pixel.

Source: Orchard, Benosman, Etienne-Cummings & Thakor, A spiking neural network architecture for visual motion
estimation, BioCAS 2013 (two layers, 8 speeds and 8 directions); Mosca, MSc thesis, 2020, section 5.1.2. Size of the
patch, speeds, leak and t_ref are measured choices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import neuro
from neuro import ModelError

__all__ = ["DIRECTIONS", "SPEEDS", "delays", "drawn_edges", "network", "peaks", "shares", "to_patches"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SPEEDS: Floats = np.geomspace(0.1, 0.8, 8)
"""px/ms, from 0.1 to 0.8 in equal ratios."""
DIRECTIONS: Floats = np.arange(0.0, 360.0, 45.0)
"""Degrees from the x axis, to the right, towards the y axis, which points down as rows of a picture are counted."""


def delays(side: int = 8, speeds: Floats = SPEEDS, directions: Floats = DIRECTIONS) -> Floats:
    """How long what each pixel of a patch sends is on its way to each detector.

    Args:
        side: of the patch, px.
        speeds: of the detectors, px/ms.
        directions: of the detectors, degrees.

    Returns:
        ms, >= 0, shape (pixels, detectors), both in C order of (y, x) and of (speed, direction).

    Raises:
        ModelError: a speed is not above 0.
    """
    if not np.all(np.asarray(speeds) > 0.0):
        raise ModelError(f"motion: speeds = {np.asarray(speeds).tolist()} px/ms: expected numbers > 0")
    angles = np.deg2rad(directions)
    y, x = np.indices((side, side)).reshape(2, -1, 1)
    along = x * np.cos(angles) + y * np.sin(angles)
    late = (along.max(axis=0) - along)[:, None, :] / np.asarray(speeds)[:, None]
    every: Floats = late.reshape(side * side, -1)
    return every


def network(
    patches: int = 1,
    side: int = 8,
    speeds: Floats = SPEEDS,
    directions: Floats = DIRECTIONS,
    leak: float = 8.0,
    t_ref: float = 20.0,
    longest: float = np.inf,
    resolution: float = 1.0,
) -> neuro.Network:
    """Patches that know nothing of each other, with a detector for each speed and direction.

    Events come to `events`, shape (patches, y, x). `pixels` fire at the first event of an edge and leave out the
    others. `detectors`, shape (patches, speed, direction), only integrate: the one whose potential has the highest
    peak tells the motion.

    Args:
        patches: how many.
        side: of a patch, px.
        speeds: of the detectors, px/ms.
        directions: of the detectors, degrees.
        leak: of the detectors, mV/ms; all pixels of a patch together weigh 1 mV times their number.
        t_ref: how long a pixel is silent after a spike, ms.
        longest: the longest delay that there is, ms. Pixels that would wait longer do not reach a detector, and the
            others weigh more: a slow detector sees a part of its patch.
        resolution: ms.

    Raises:
        ModelError: a number cannot be used; it says which.
    """
    if not longest >= resolution:
        raise ModelError(f"motion: longest = {longest:g} ms: expected at least the resolution, {resolution:g} ms")
    once = neuro.iaf_linear_leak(E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=t_ref)
    integrate = neuro.iaf_linear_leak(E_L=0.0, V_reset=0.0, V_th=np.inf, leak=leak)
    net = neuro.Network("motion", resolution=resolution)
    net.population("events", (patches, side, side), neuro.spike_generator())
    net.population("pixels", (patches, side, side), once)
    net.population("detectors", (patches, len(speeds), len(directions)), integrate)
    net.connect("events", "pixels", neuro.one_to_one(), weight=1.0, delay=resolution)
    late = resolution * (1.0 + np.rint(delays(side, speeds, directions) / resolution))
    pixel, detector = np.nonzero(late <= longest)
    patch = np.arange(patches)[:, None]
    pairs = neuro.pairs((patch * len(late) + pixel).ravel(), (patch * late.shape[1] + detector).ravel())
    share = side**2 / np.bincount(detector)
    weight, delay = np.tile(share[detector], patches), np.tile(late[pixel, detector], patches)
    net.connect("pixels", "detectors", pairs, weight=weight, delay=delay, name="pixels_detectors")
    net.probe("potential", "detectors", "V_m", every=resolution)
    return net


def to_patches(
    t_us: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    rows: int = 1,
    columns: int = 1,
    side: int = 8,
    resolution: float = 1.0,
) -> tuple[Floats, Ints]:
    """Events of a camera as spikes of patches that lie side by side from its upper left corner on.

    Args:
        t_us: times, >= 0, us.
        x: columns of pixels.
        y: rows of pixels; events outside all patches are left out.
        rows: of patches.
        columns: of patches, which are numbered row by row.
        side: of a patch, px.
        resolution: of the network, ms.

    Returns:
        times in ms, at the ends of their steps, and neurons of `events`.
    """
    x, y = np.asarray(x, dtype=np.int64), np.asarray(y, dtype=np.int64)
    inside = (x >= 0) & (x < columns * side) & (y >= 0) & (y < rows * side)
    x, y = x[inside], y[inside]
    times = resolution * (np.floor(np.asarray(t_us)[inside] / (1000.0 * resolution)) + 1.0)
    patch = y // side * columns + x // side
    return times, (patch * side + y % side) * side + x % side


def peaks(sim: neuro.Simulation, times: ArrayLike, ids: ArrayLike) -> Floats:
    """Show events to the network, from time 0 on, and tell the highest potential of each detector.

    Args:
        sim: of `network`; it is reset.
        times: of the events, ms, > 0 and on the grid of steps.
        ids: where: neurons of `events`.

    Returns:
        mV, shape (patches, speeds, directions).
    """
    sim.reset()
    sim.inject("events", times, ids)
    resolution = sim.program.resolution
    longest = resolution * next(p.delay.max() for p in sim.program.projections if p.name == "pixels_detectors")
    sim.run(np.max(np.asarray(times, dtype=np.float64), initial=0.0) + longest + resolution)
    _, potential = sim.trace("potential")
    highest: Floats = potential.max(axis=0)
    return highest.reshape(next(p.shape for p in sim.program.populations if p.name == "detectors"))


def drawn_edges(seed: int, n: int, side: int = 8) -> tuple[Ints, Ints, Floats, Ints]:
    """Edges of the detectors' speeds and directions, one a patch: an event a pixel, jitter 1 ms, 10 % lost.

    Args:
        seed: of the draws.
        n: how many.
        side: of a patch, px.

    Returns:
        which speed and which direction each has, and the times in ms and neurons of `events`, on a grid of 1 ms.
    """
    rng = np.random.default_rng(seed)
    speed, direction = rng.integers(8, size=(2, n))
    y, x = np.indices((side, side)).reshape(2, -1)
    angle = np.deg2rad(DIRECTIONS[direction])[:, None]
    crossed = (x * np.cos(angle) + y * np.sin(angle)) / SPEEDS[speed][:, None]
    crossed += 5.0 - crossed.min(axis=1, keepdims=True) + rng.uniform(0.0, 1.0, (n, 1))
    crossed += rng.normal(0.0, 1.0, crossed.shape)
    seen = rng.random(crossed.shape) >= 0.1
    return speed, direction, np.rint(crossed).clip(1.0)[seen], np.flatnonzero(seen)


def shares(peaks: Floats, speed: Ints, direction: Ints) -> tuple[float, float]:
    """How often the direction is right, and how often direction and speed are, from `peaks` of an edge a patch."""
    best = peaks.reshape(len(speed), -1).argmax(axis=1)
    right = best % 8 == direction
    return float(right.mean()), float((right & (best // 8 == speed)).mean())
