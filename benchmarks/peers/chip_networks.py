"""The two networks that emulators of Loihi are timed with, as arrays of integers; numpy alone is needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

WARM_UP = 20
"""Steps before the clock starts."""
RATE = 0.05
"""Spikes of a source in a step of `feedforward`."""


@dataclass(frozen=True)
class Layer:
    """Neurons of one kind.

    Attributes:
        size: number of neurons.
        du: decay of the current, in 4096ths.
        dv: decay of the voltage, in 4096ths.
        vth: threshold, in units of 64.
    """

    size: int
    du: int
    dv: int
    vth: int


FEEDFORWARD = Layer(1000, du=600, dv=300, vth=30000)
RECURRENT = Layer(10_240, du=1500, dv=160, vth=500)
SOURCES = 1000
FAN_IN = 100


def feedforward(size: int = FEEDFORWARD.size) -> np.ndarray:
    """Even weights of 1,000 sources, by target and source."""
    return 2 * np.random.default_rng(1).integers(-40, 60, (size, size))


def fired(steps: int, size: int = SOURCES) -> tuple[np.ndarray, np.ndarray]:
    """Steps and sources of the input of `feedforward`, in order."""
    rows, columns = np.nonzero(np.random.default_rng(2).random((steps, size)) < RATE)
    return rows, columns


def recurrent(
    size: int = RECURRENT.size, fan_in: int = FAN_IN
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sources, targets and weights of the synapses, four of five excitatory, and the bias of each neuron."""
    rng = np.random.default_rng(3)
    bias = rng.integers(900, 2700, size)
    sources = rng.integers(0, size, size * fan_in)
    excite, inhibit = 2 * rng.integers(1, 10, size * fan_in), -2 * rng.integers(4, 40, size * fan_in)
    weights = np.where(rng.random(size * fan_in) < 0.8, excite, inhibit)
    return sources, np.repeat(np.arange(size), fan_in), weights, bias


def line(tool: str, net: str, steps: int, seconds: float, setup_s: float, spikes: int | None = None) -> dict[str, Any]:
    """The figures of a run, which a script prints as its last line.

    Args:
        tool: name of the emulator.
        net: "ff" or "rec".
        steps: number of timed steps.
        seconds: their time.
        setup_s: time before the first step.
        spikes: of the timed steps; None where the tool does not count them.
    """
    rate = None if spikes is None else round(spikes / steps, 1)
    figures = {"tool": tool, "net": net, "steps": steps, "steps_per_s": round(steps / seconds, 2)}
    return figures | {"spikes_per_step": rate, "setup_s": round(setup_s, 2)}
