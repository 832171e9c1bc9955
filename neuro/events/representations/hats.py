"""Histograms of averaged time surfaces (HATS)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.events._arguments import choice, positive, whole
from neuro.events._events import Events
from neuro.events.representations._common import Representation, given, real

Normalise = Literal["cell", "polarity", "none"]


def hats(
    events: Events,
    *,
    cell: int = 10,
    radius: int = 3,
    window_us: int = 100_000,
    tau_us: float = 1e9,
    itself: bool = False,
    normalise: Normalise = "cell",
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Average the surroundings of events over cells of the sensor.

    The local memory time surface of event i is T_i[dy, dx], the sum of exp(-(t_i - t_j) / tau) over the events j that
    came before it, at most `window_us` ago, with its polarity, in its cell, and at (x_i + dx, y_i + dy). A cell's
    histogram is the sum of T_i over its events, by polarity, divided by the number of its events.
    Events of one time count as having come in their order.

    tonic's ``ToAveragedTimesurface(decay="exp")`` is this with ``itself=True, normalise="polarity"``, its first axis
    being our first two.

    Args:
        events: the recording, or the part of one that is to be classified.
        cell: side of a cell, px; cells at the right and at the bottom may be smaller.
        radius: of the surroundings, px; rho of the paper.
        window_us: how long an event is remembered, us; the paper's Delta t.
        tau_us: time constant, us.
        itself: whether an event is part of its own surroundings, which adds 1 in the middle.
        normalise: by the events of the ``"cell"`` as in the paper, of the cell and ``"polarity"``, or ``"none"``.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        (rows, columns, 2, 2 radius + 1, 2 radius + 1), rows = ceil(height / cell) and columns likewise; the last axes
        are polarity, dy and dx. 0 for a cell without events.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: Sironi et al., HATS, CVPR 2018, section 4 and algorithm 1; the defaults are theirs for N-CARS.
    """
    from neuro.events.representations._hats_kernel import histograms

    cell, radius = whole("cell", cell), whole("radius", radius, least=0)
    window_us, tau_us = whole("window_us", window_us), positive("tau_us", tau_us, "us")
    choice("normalise", normalise, ("cell", "polarity", "none"))
    width, height = events.sensor_size
    rows, columns, size = -(-height // cell), -(-width // cell), 2 * radius + 1
    padded = cell + 2 * radius
    sums = np.zeros((rows, columns, 2, size, size))
    counts = np.zeros((rows, columns, 2), np.int64)
    memory = np.zeros((rows, columns, 2, padded, padded))
    inside = np.zeros(memory.shape, np.int32)
    queues = np.full((3, rows, columns, 2), -1, np.int64)  # oldest and newest remembered event, reference time
    following = np.empty(len(events), np.int64)
    constants = (cell, radius, window_us, tau_us, 1.0 if itself else 0.0)
    histograms(events.t, events.x, events.y, events.p, constants, memory, inside, queues, following, sums, counts)
    by = {"cell": counts.sum(2, keepdims=True), "polarity": counts, "none": np.ones_like(counts)}[normalise]
    out = sums / np.maximum(by, 1)[..., None, None]
    return given(out.astype(real(dtype)), as_torch)
