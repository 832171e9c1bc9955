"""Reichardt detectors: 64 neurons with linear leak that measure the speed and direction of an edge from its events.

A patch of pixels reaches every detector through delays. An edge with the detector's speed v and direction u crosses
pixel p at p u / v, so all spikes arrive together if the delay is (max - p u) / v. A patch has two dimensions, because a
row of pixels cannot distinguish a fast oblique edge from a slow straight one: along the row both need the time
cos(angle) / v per pixel.

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
"""Speeds of the detectors, px/ms, in equal ratios from 0.1 to 0.8."""
DIRECTIONS: Floats = np.arange(0.0, 360.0, 45.0)
"""Directions of the detectors, degrees from the x axis (right) towards the y axis (down, as picture rows)."""


def delays(side: int = 8, speeds: Floats = SPEEDS, directions: Floats = DIRECTIONS) -> Floats:
    """Return the delay from each pixel of a patch to each detector.

    Args:
        side: side of the patch, px.
        speeds: speeds of the detectors, px/ms.
        directions: directions of the detectors, degrees.

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
    delay = (along.max(axis=0) - along)[:, None, :] / np.asarray(speeds)[:, None]
    flat: Floats = delay.reshape(side * side, -1)
    return flat


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
    """Return independent patches, with a detector for each speed and direction.

    Events enter `events`, shape (patches, y, x). `pixels` fire at the first event of an edge and ignore the others.
    `detectors`, shape (patches, speed, direction), only integrate. The detector with the highest peak of the potential
    gives the motion.

    Args:
        patches: number of patches.
        side: side of a patch, px.
        speeds: speeds of the detectors, px/ms.
        directions: directions of the detectors, degrees.
        leak: leak of the detectors, mV/ms. The weights onto a detector sum to 1 mV times the number of a patch's
            pixels.
        t_ref: refractory period of a pixel, ms.
        longest: longest allowed delay, ms. Pixels with a longer delay are not connected, and the other weights are
            larger: a slow detector sees a part of its patch.
        resolution: length of a step, ms.

    Raises:
        ModelError: an argument is out of range; the message names it.
    """
    if not longest >= resolution:
        raise ModelError(f"motion: longest = {longest:g} ms: expected at least the resolution, {resolution:g} ms")
    pixel_model = neuro.iaf_linear_leak(E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=t_ref)
    detector_model = neuro.iaf_linear_leak(E_L=0.0, V_reset=0.0, V_th=np.inf, leak=leak)
    net = neuro.Network("motion", resolution=resolution)
    net.population("events", (patches, side, side), neuro.spike_generator())
    net.population("pixels", (patches, side, side), pixel_model)
    net.population("detectors", (patches, len(speeds), len(directions)), detector_model)
    net.connect("events", "pixels", neuro.one_to_one(), weight=1.0, delay=resolution)
    delay_ms = resolution * (1.0 + np.rint(delays(side, speeds, directions) / resolution))
    pixel, detector = np.nonzero(delay_ms <= longest)
    patch = np.arange(patches)[:, None]
    pairs = neuro.pairs((patch * len(delay_ms) + pixel).ravel(), (patch * delay_ms.shape[1] + detector).ravel())
    share = side**2 / np.bincount(detector)
    weight, delay = np.tile(share[detector], patches), np.tile(delay_ms[pixel, detector], patches)
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
    """Convert events of a camera to spikes of patches that lie side by side from the upper left corner on.

    Args:
        t_us: times, >= 0, us.
        x: columns of pixels.
        y: rows of pixels; events outside all patches are dropped.
        rows: number of rows of patches.
        columns: number of columns of patches, which are numbered row by row.
        side: side of a patch, px.
        resolution: step of the network, ms.

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
    """Present events to the network from time 0 on, and return the highest potential of each detector.

    Args:
        sim: simulation of `network`; it is reset.
        times: times of the events, ms, > 0 and on the grid of steps.
        ids: neurons of `events`.

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
    """Draw edges with the detectors' speeds and directions, one per patch: an event per pixel, jitter 1 ms, 10 % lost.

    Args:
        seed: seed of the draws.
        n: number of edges.
        side: side of a patch, px.

    Returns:
        indices of each edge's speed and direction, and the times in ms and neurons of `events`, on a grid of 1 ms.
    """
    rng = np.random.default_rng(seed)
    speed, direction = rng.integers(8, size=(2, n))
    y, x = np.indices((side, side)).reshape(2, -1)
    angle = np.deg2rad(DIRECTIONS[direction])[:, None]
    crossed = (x * np.cos(angle) + y * np.sin(angle)) / SPEEDS[speed][:, None]
    crossed += 5.0 - crossed.min(axis=1, keepdims=True) + rng.uniform(0.0, 1.0, (n, 1))
    crossed += rng.normal(0.0, 1.0, crossed.shape)
    is_seen = rng.random(crossed.shape) >= 0.1
    return speed, direction, np.rint(crossed).clip(1.0)[is_seen], np.flatnonzero(is_seen)


def shares(peaks: Floats, speed: Ints, direction: Ints) -> tuple[float, float]:
    """Return the shares of edges with the right direction, and with direction and speed right, from their `peaks`."""
    best_speed = peaks.reshape(len(speed), -1).argmax(axis=1)
    is_right = best_speed % 8 == direction
    return float(is_right.mean()), float((is_right & (best_speed // 8 == speed)).mean())
