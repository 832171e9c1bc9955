"""The network of HFirst, and what runs it on recordings."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

import neuro
import neuro_models
from neuro.events import Events
from neuro.events.filters import BackgroundActivity
from neuro_recognise.hfirst.settings import HFirst

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
LAYERS = 3
"""Steps from an event to the last spike that it causes: each layer hears the one before a step later."""


class Spikes(NamedTuple):
    """Spikes of one layer in order of time: times in ms since a recording's first event, and neurons."""

    times: Floats
    ids: Ints


class Heard(NamedTuple):
    """What layer S2 did with the C1 spikes of a recording.

    Attributes:
        spikes: its spikes; neurons are classes.
        potentials: (C1 spikes, classes) V_m after each C1 spike, mV.
    """

    spikes: Spikes
    potentials: Floats


def network(settings: HFirst, classes: int, templates: Floats | None = None) -> neuro.Network:
    """The network `hfirst` with some settings.

    Args:
        settings: of the network.
        classes: how many there are.
        templates: (classes, C1 neurons) weights of S2 in mV; None before they are learnt.

    Raises:
        ModelError: a setting is out of its bounds.
    """
    net = neuro.load(neuro_models.path("hfirst"), settings.parameters(classes, templates))
    if settings.c1_resets:
        net.group("first_in_cell", neuro.lateral_reset(of="c1"))
    return net


def s2_alone(settings: HFirst, templates: Floats) -> neuro.Network:
    """Layer S2 of `hfirst` on spikes of C1 that are given.

    Args:
        settings: of the network.
        templates: (classes, C1 neurons) weights in mV.
    """
    whole = network(settings, len(templates))
    net = neuro.Network("hfirst_s2", resolution=whole.resolution)
    net.population("c1", settings.shape, neuro.spike_generator())
    net.population("s2", len(templates), whole.populations["s2"].model)
    # what a chip refuses stands in the file of the network
    net.populations["s2"] = replace(net.populations["s2"], origin=whole.populations["s2"].origin)
    net.connect("c1", "s2", neuro.all_to_all(), weight=templates.T, delay=net.resolution, name="c1_s2")
    net.group("first_class", whole.groups["first_class"].choice)
    return net


def c1_spikes(sim: neuro.Simulation, settings: HFirst, events: Events) -> Spikes:
    """The C1 spikes of one recording, which starts anew.

    Args:
        sim: of `network`.
        settings: those of the network.
        events: the recording; those without a neighbour's event are left out, times are rounded to the nearest step.

    Raises:
        ModelError: an event lies outside of the camera.
    """
    events = _without_noise(events, settings)
    sim.reset()
    if not len(events):
        return Spikes(np.zeros(0), np.zeros(0, dtype=np.int64))
    h, width = settings.resolution, settings.size[0]
    steps = 1 + np.rint((events.t - events.t[0]) / (1000.0 * h)).astype(np.int64)
    places = events.y.astype(np.int64) * width + events.x
    for name, polarity in (("on_events", 1), ("off_events", 0)):
        some = events.p == polarity
        sim.inject(name, steps[some] * h, places[some])
    sim.run(float(steps[-1] + LAYERS) * h)
    return Spikes(*sim.spikes("c1"))


def s2_heard(sim: neuro.Simulation, settings: HFirst, spikes: Spikes) -> Heard:
    """What S2 does with the C1 spikes of one recording.

    Args:
        sim: of `s2_alone`.
        settings: those of the network.
        spikes: from `c1_spikes`.
    """
    sim.reset()
    sim.inject("c1", spikes.times, spikes.ids)
    arrivals = 1 + np.rint(spikes.times / settings.resolution).astype(np.int64)
    moments, moment_of = np.unique(arrivals, return_inverse=True)
    potentials = np.empty((moments.size, sim.get("s2", "V_m").size))
    for k, steps in enumerate(np.diff(moments, prepend=0)):
        sim.run(float(steps) * settings.resolution)
        potentials[k] = sim.get("s2", "V_m")
    return Heard(Spikes(*sim.spikes("s2")), potentials[moment_of])


def _without_noise(events: Events, settings: HFirst) -> Events:
    width, height = settings.size
    if len(events) and (events.x.max() >= width or events.y.max() >= height):
        raise neuro.ModelError(
            f"an event at ({events.x.max()}, {events.y.max()}): expected a sensor of at most {width} x {height} px",
            hint="set size",
        )
    return BackgroundActivity(sensor_size=events.sensor_size, dt_us=settings.noise_us)(events)
