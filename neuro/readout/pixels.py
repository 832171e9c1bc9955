"""Recordings as spikes of the input of a network."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from neuro.coding.pixels import pixel_spikes
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.values import shown
from neuro.events import Events
from neuro.events.dataset import Sample
from neuro.events.parts import windowed
from neuro.model.network import Network
from neuro.model.parts import CENTRED, Readout

Ints = npt.NDArray[np.int64]


class Pixels:
    """What recordings make the input of a network emit.

    Args:
        net: the network.
        readout: how it is asked.

    Attributes:
        steps: for which the network runs, None where that is up to each recording.
    """

    def __init__(self, net: Network, readout: Readout) -> None:
        self._readout, self._h = readout, net.resolution
        self._shape = tuple(int(side) for side in net.populations[readout.input].shape)
        self.steps = None if readout.duration is None else Clock(self._h).step(readout.duration, "--for")
        if self.steps == 0:
            raise ModelError(f"--for = {readout.duration:g} ms: expected at least a step of {self._h:g} ms")

    def check(self, item: Sample | Events, name: str) -> None:
        """Refuse a recording that is damaged, or of another sensor."""
        events = load(item)
        size, stated = (item.sensor_size, True) if isinstance(item, Events) else item.sensor()
        if self._readout.window is None and stated:
            self._refuse(size, name)
        self.spikes(events, name)

    def spikes(self, events: Events, name: str) -> tuple[Ints, Ints]:
        """Steps from 0 on and neurons."""
        asked = self._readout
        if asked.window is not None:
            rows, columns = self._shape[-2:]
            at = None if asked.window == (CENTRED,) else asked.window
            length = (int(events.t[-1] - events.t[0]) + 1) / 1000.0 if len(events) else 0.0
            seen = length if self.steps is None else self.steps * self._h
            events = windowed(events, (columns * asked.scale, rows * asked.scale), at, asked.start, seen, name)
        elif len(events) and not self._fits((int(events.x.max()) + 1, int(events.y.max()) + 1)):
            self._refuse((int(events.x.max()) + 1, int(events.y.max()) + 1), name)
        step, neuron = pixel_spikes(
            events, self._shape, self._h, steps=self.steps, scale=asked.scale, start=asked.start
        )
        if not asked.merge:
            return step, neuron
        size = math.prod(self._shape)
        at_once = np.unique(step * size + neuron)
        return at_once // size, at_once % size

    def _fits(self, size: tuple[int, int]) -> bool:
        rows, columns = self._shape[-2:]
        return size[0] <= columns * self._readout.scale and size[1] <= rows * self._readout.scale

    def _refuse(self, size: tuple[int, int], name: str) -> None:
        """Refuse a sensor of another width and height than that of the pixels."""
        scale, (rows, columns) = self._readout.scale, self._shape[-2:]
        if tuple(-(-side // scale) for side in size) != (columns, rows):
            expected = f"{columns * scale}x{rows * scale} px, as --input {self._readout.input} has the shape"
            by = f" at scale {scale}" if scale > 1 else ""
            hint = "in its file 'readout: {..., window: centred}' shows a part of the sensor, 'scale: 2' joins pixels"
            message = f"{name}: found {size[0]}x{size[1]} px: expected {expected} {list(self._shape)}{by}"
            raise ModelError(message, hint=hint)


def load(item: Any) -> Events:
    """The events of a recording.

    Raises:
        EventFileError: it is damaged.
        ModelError: it is no recording.
    """
    if isinstance(item, Events):
        return item
    if not hasattr(item, "load"):
        hint = "neuro.events.recordings(path) finds them, [neuro.events.load(path)] is one"
        raise ModelError(f"recordings: found {shown(item)}: expected recordings, or the events of each", hint=hint)
    return cast(Sample, item).load()


def name_of(item: Any, k: int) -> str:
    """What the recording of index k is called."""
    return str(getattr(item, "path", f"recording {k}"))
