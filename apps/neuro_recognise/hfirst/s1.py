"""What the network `hfirst` is shown of a recording, and what its layer S1 makes of that, event by event.

S1 has nearly all neurons of the network. Event by event it takes a tenth of what a backend takes that runs every step.
"""

from __future__ import annotations

import numpy as np

import neuro
from neuro.apps import allocating
from neuro.events import Events
from neuro.events.filters import BackgroundActivity
from neuro_recognise.hfirst.settings import HFirstSettings
from neuro_recognise.hfirst.spikes import Floats, Ints, LayerSpikes


def shown(settings: HFirstSettings, events: Events) -> dict[str, LayerSpikes]:
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
    return {name: LayerSpikes(steps[some] * settings.resolution, places[some]) for name, some in which.items()}


def s1_spikes(settings: HFirstSettings, inputs: dict[str, LayerSpikes]) -> dict[str, LayerSpikes]:
    """The spikes of layer S1.

    They are those of the network but where orientations are equal at threshold: here the first fires, there a drawn
    one.

    Args:
        settings: of the network.
        inputs: from `shown`.

    Returns:
        By the name of the population.
    """
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
        found[layer] = LayerSpikes(steps * h, ids)
    return found


def _without_noise(events: Events, settings: HFirstSettings) -> Events:
    width, height = settings.size
    if len(events) and (events.x.max() >= width or events.y.max() >= height):
        raise neuro.ModelError(
            f"an event at ({events.x.max()}, {events.y.max()}): expected a sensor of at most {width} x {height} px",
            hint="set size",
        )
    return BackgroundActivity(sensor_size=events.sensor_size, dt_us=settings.noise_us)(events)


@allocating
def first_spikes(
    steps: Ints,
    rows: Ints,
    columns: Ints,
    bank: Floats,
    leak: float,
    threshold: float,
    held: int,
    height: int,
    width: int,
) -> Ints:
    """Spikes of layer S1: of the orientations at a place the first to reach threshold, which resets the others.

    A place is brought up to date where an event reaches it. Of equal orientations the first fires.

    steps: int64[n], ascending, in which events arrive; rows, columns: int64[n]; bank: float64[side, side,
    orientations], mV; leak: mV a step; held: steps of rest after a spike. Returns int64[2, spikes]: steps and neurons,
    (orientation, row, column) in C order.
    """
    side, orientations = bank.shape[0], bank.shape[2]
    half = side // 2
    v = np.zeros((height, width, orientations))
    since = np.zeros((height, width), np.int64)
    free = np.zeros((height, width), np.int64)
    reached = np.empty((height * width, 2), np.int64)
    found = np.empty((2, 256), np.int64)
    n, k = 0, 0
    while k < steps.size:
        now, touched = steps[k], 0
        while k < steps.size and steps[k] == now:
            y, x = rows[k], columns[k]
            for r in range(max(0, y - half), min(height, y + half + 1)):
                for c in range(max(0, x - half), min(width, x + half + 1)):
                    if now < free[r, c]:
                        continue
                    here, taps = v[r, c], bank[half + y - r, half + x - c]
                    if since[r, c] != now:
                        lost = leak * (now - since[r, c])
                        for o in range(orientations):
                            here[o] -= min(max(here[o], -lost), lost)
                        since[r, c] = now
                        reached[touched, 0], reached[touched, 1] = r, c
                        touched += 1
                    for o in range(orientations):
                        here[o] += taps[o]
            k += 1
        for place in range(touched):
            r, c = reached[place]
            best = v[r, c].argmax()
            if v[r, c, best] < threshold:
                continue
            if n == found.shape[1]:
                more = np.empty((2, 2 * n), np.int64)
                more[:, :n] = found
                found = more
            found[0, n], found[1, n] = now, (best * height + r) * width + c
            n += 1
            v[r, c] = 0.0
            free[r, c] = now + held + 1
    return found[:, :n].copy()
