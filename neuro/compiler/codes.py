"""Codes and cameras of a network as the generators that stand for them."""

from __future__ import annotations

import numpy as np

from neuro.compiler.shapes import Shape, size
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.keyed_random import key
from neuro.model.neurons import Generator, encode, event_camera, poisson_generator, spike_generator
from neuro.model.parts import Population, naming_the_part
from neuro.program.program import Floats


def generator_of(part: Population, model: encode | event_camera, shape: Shape, clock: Clock, seed: int) -> Generator:
    """The generator that stands for a code or a camera; that of a camera lists nothing.

    Raises:
        ModelError: a code gives the spikes of another number of neurons, or a time is too late or off the grid.
    """
    if isinstance(model, event_camera):
        return spike_generator()
    with naming_the_part(part):
        found = model.spikes(key(seed, "encode", part.name))
        neurons = found.shape if model.gives_rates else found.shape[:-1]
        if neurons not in (shape, (size(shape),)):
            message = f"encode makes the spikes of neurons of shape {list(neurons)}: expected {list(shape)}"
            raise ModelError(message, hint=f"give the population the shape {list(neurons)}")
        if model.gives_rates:
            return poisson_generator(rate=found, start=model.start, stop=model.stop)
        return spike_generator(spike_times=_times(model, found.reshape(size(shape), -1), clock))


def _times(model: encode, after: Floats, clock: Clock) -> list[Floats]:
    """The end of the step of each spike that is emitted, a list for each neuron."""
    start, stop = clock.step(model.start, "encode.start"), clock.step(model.stop, "encode.stop")
    neurons, spikes = np.nonzero(~np.isnan(after))
    steps = start + clock.floors(after[neurons, spikes], "encode: spike") + 1
    emitted = steps <= stop
    neurons, steps = neurons[emitted], steps[emitted]
    order = np.lexsort((steps, neurons))
    ends = np.cumsum(np.bincount(neurons, minlength=len(after)))[:-1]
    return np.split(clock.array_ms(steps[order]), ends)
