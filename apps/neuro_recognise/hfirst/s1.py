"""What the network `hfirst` is shown of a recording, and what its layer S1 makes of that, event by event.

S1 has nearly all neurons of the network. Event by event it takes a tenth of what a backend takes that runs every step.
"""

from __future__ import annotations

import numpy as np

import neuro
from neuro.events import Events
from neuro.events.filters import BackgroundActivity
from neuro_recognise.hfirst.settings import HFirstSettings
from neuro_recognise.hfirst.spikes import Spikes


def shown(settings: HFirstSettings, events: Events) -> dict[str, Spikes]:
    """The spikes of the network's inputs.

    Args:
        settings: of the network.
        events: the recording; those without a neighbour's event are left out, times are rounded to the nearest step
            and count from the first event that is left.

    Returns:
        By the name of the population.

    Raises:
        ModelError: an event lies outside of the camera.
    """
    events = _without_noise(events, settings)
    steps = 1 + np.rint((events.t - (events.t[0] if len(events) else 0)) / (1000.0 * settings.resolution))
    places = events.y.astype(np.int64) * settings.size[0] + events.x
    which = {"on_events": events.p == 1, "off_events": events.p == 0}
    return {name: Spikes(steps[some] * settings.resolution, places[some]) for name, some in which.items()}


def s1_spikes(settings: HFirstSettings, inputs: dict[str, Spikes]) -> dict[str, Spikes]:
    """The spikes of layer S1.

    They are those of the network but where orientations are equal at threshold: here the first fires, there a drawn
    one.

    Args:
        settings: of the network.
        inputs: from `shown`.

    Returns:
        By the name of the population.
    """
    from neuro_recognise.hfirst._s1_kernels import first_spikes

    h, (width, height) = settings.resolution, settings.size
    bank = np.ascontiguousarray(settings.gabors.transpose(1, 2, 0))
    found = {}
    for layer, source in (("s1_on", "on_events"), ("s1_off", "off_events")):
        heard = inputs[source]
        arrive = 1 + np.rint(heard.times / h).astype(np.int64)
        rows, columns = np.divmod(heard.ids, width)
        held = round(settings.t_ref / h)
        told = (settings.s1_leak * h, settings.s1_threshold, held, height, width)
        steps, ids = first_spikes(arrive, rows, columns, bank, *told)
        found[layer] = Spikes(steps * h, ids)
    return found


def _without_noise(events: Events, settings: HFirstSettings) -> Events:
    width, height = settings.size
    if len(events) and (events.x.max() >= width or events.y.max() >= height):
        raise neuro.ModelError(
            f"an event at ({events.x.max()}, {events.y.max()}): expected a sensor of at most {width} x {height} px",
            hint="set size",
        )
    return BackgroundActivity(sensor_size=events.sensor_size, dt_us=settings.noise_us)(events)
