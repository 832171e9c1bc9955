"""Conversion of codes and cameras of a network to generators."""

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
    """Return the generator in place of a code or a camera. The generator of a camera has no listed spikes.

    Raises:
        ModelError: the code has another number of neurons, or a time is too late or off the grid of steps.
    """
    if isinstance(model, event_camera):
        return spike_generator()
    with naming_the_part(part):
        encoded = model.spikes(key(seed, "encode", part.name))
        neurons = encoded.shape if model.gives_rates else encoded.shape[:-1]
        if neurons not in (shape, (size(shape),)):
            message = f"encode gives spikes for neurons of shape {list(neurons)}: expected {list(shape)}"
            raise ModelError(message, hint=f"give the population the shape {list(neurons)}")
        if model.gives_rates:
            return poisson_generator(rate=encoded, start=model.start, stop=model.stop)
        return spike_generator(spike_times=_times(model, encoded.reshape(size(shape), -1), clock))


def _times(model: encode, after: Floats, clock: Clock) -> list[Floats]:
    """Return the times of the emitted spikes, at the ends of their steps, as a list for each neuron."""
    start, stop = clock.step(model.start, "encode.start"), clock.step(model.stop, "encode.stop")
    neurons, spikes = np.nonzero(~np.isnan(after))
    steps = start + clock.floors(after[neurons, spikes], "encode: spike") + 1
    is_emitted = steps <= stop
    neurons, steps = neurons[is_emitted], steps[is_emitted]
    order = np.lexsort((steps, neurons))
    ends = np.cumsum(np.bincount(neurons, minlength=len(after)))[:-1]
    return np.split(clock.array_ms(steps[order]), ends)
