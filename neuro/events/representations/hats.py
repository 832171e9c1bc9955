"""Histograms of averaged time surfaces (HATS)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument
from neuro.events._events import Events
from neuro.events.parts import together
from neuro.events.representations._common import Representation, given, real

Normalise = Literal["cell", "polarity", "none"]


class Hats:
    """Averaged time surfaces that grow event by event, in bounded memory; for recordings that come in parts.

    Parts, cut anywhere, give to the bit what the whole gives.

    Args:
        sensor_size: width and height, px.
        cell, radius, window_us, tau_us, itself, normalise: see `hats`.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """

    def __init__(
        self,
        sensor_size: tuple[int, int],
        *,
        cell: int = 10,
        radius: int = 3,
        window_us: int = 100_000,
        tau_us: float = 1e9,
        itself: bool = False,
        normalise: Normalise = "cell",
    ) -> None:
        cell = argument("cell", cell, kind="integer", at_least=1)
        radius = argument("radius", radius, kind="integer", at_least=0)
        window_us = argument("window_us", window_us, kind="microseconds", at_least=1)
        tau_us = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._by = argument("normalise", normalise, words=("cell", "polarity", "none"))
        self._constants = (cell, radius, window_us, tau_us, 1.0 if itself else 0.0)
        width, height = sensor_size
        rows, columns, size = -(-height // cell), -(-width // cell), 2 * radius + 1
        padded = cell + 2 * radius
        self._sums = np.zeros((rows, columns, 2, size, size))
        self._counts = np.zeros((rows, columns, 2), np.int64)
        self._memory = np.zeros((rows, columns, 2, padded, padded))
        self._inside = np.zeros(self._memory.shape, np.int32)
        self._queues = np.full((3, rows, columns, 2), -1, np.int64)  # oldest and newest event, reference time
        self._held: Events | None = None  # those of the window, whose numbers the queues tell
        self._following = np.empty(0, np.int64)

    def add(self, events: Events) -> None:
        """Take in the next events."""
        from neuro.events.representations._kernels import histograms

        if not len(events):
            return
        old = self._forget() if self._held is not None else 0
        seen = together([self._held, events]) if self._held is not None else events
        following = np.concatenate([self._following, np.empty(len(events), np.int64)])
        state = (self._memory, self._inside, self._queues, following, self._sums, self._counts)
        histograms(seen.t, seen.x, seen.y, seen.p, old, self._constants, *state)
        self._held, self._following = seen, following

    def _forget(self) -> int:
        """Drop what has left the window; returns how many events are still held."""
        from neuro.events.representations._kernels import forget

        assert self._held is not None
        held = self._held
        state = (self._memory, self._inside, self._queues, self._following)
        first = forget(held.t, held.x, held.y, self._constants, *state)
        self._held, self._following = held[first:], self._following[first:]
        return len(self._following)

    def histograms(self, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """What `hats` gives of all events so far.

        Args:
            dtype: float32 or float64.
        """
        counts = self._counts
        by = {"cell": counts.sum(2, keepdims=True), "polarity": counts, "none": np.ones_like(counts)}[self._by]
        out: npt.NDArray[np.floating] = self._sums / np.maximum(by, 1)[..., None, None]
        return out.astype(real(dtype))


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
    grown = Hats(
        events.sensor_size,
        cell=cell,
        radius=radius,
        window_us=window_us,
        tau_us=tau_us,
        itself=itself,
        normalise=normalise,
    )
    grown.add(events)
    return given(grown.histograms(dtype), as_torch)
