"""The network of HFirst, whole and layer by layer, and what runs these on recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import neuro
import neuro_models
from neuro import ModelError
from neuro_recognise.hfirst.settings import HFirstSettings
from neuro_recognise.hfirst.spikes import Floats, LayerResponse, LayerSpikes


def network(settings: HFirstSettings, classes: int, templates: Floats | None = None) -> neuro.Network:
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


def c1_alone(settings: HFirstSettings) -> neuro.Network:
    """Layer C1 of `hfirst` on spikes of S1 that are given.

    Args:
        settings: of the network.
    """
    width, height = settings.size
    s1 = (settings.orientations, height, width)
    return _behind(network(settings, 1), {"s1_on": s1, "s1_off": s1}, "c1")


def s2_alone(settings: HFirstSettings, templates: Floats) -> neuro.Network:
    """Layer S2 of `hfirst` on spikes of C1 that are given.

    Args:
        settings: of the network.
        templates: (classes, C1 neurons) weights in mV.
    """
    return _behind(network(settings, len(templates), templates), {"c1": settings.shape}, "s2")


def show(sim: neuro.Simulation, settings: HFirstSettings, inputs: Mapping[str, LayerSpikes]) -> None:
    """Let a network hear the spikes of its inputs until the last spike that they cause; it starts anew.

    Args:
        sim: of any of these networks.
        settings: those of the network.
        inputs: by the name of the population.
    """
    sim.reset()
    last = 0.0
    for name, spikes in inputs.items():
        sim.inject(name, spikes.times, spikes.ids)
        last = max(last, spikes.times.max(initial=0.0))
    layers = len(sim.network().populations)  # each hears the one before a step later
    sim.run(last + layers * settings.resolution)


def c1_spikes(sim: neuro.Simulation, settings: HFirstSettings, s1: Mapping[str, LayerSpikes]) -> LayerSpikes:
    """The C1 spikes of one recording.

    Args:
        sim: of `c1_alone`.
        settings: those of the network.
        s1: from `s1_spikes`.
    """
    show(sim, settings, s1)
    return LayerSpikes(*sim.spikes("c1"))


def s2_heard(sim: neuro.Simulation, settings: HFirstSettings, spikes: LayerSpikes) -> LayerResponse:
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
    return LayerResponse(LayerSpikes(*sim.spikes("s2")), potentials[moment_of])


def _behind(net: neuro.Network, given: Mapping[str, tuple[int, ...]], layer: str) -> neuro.Network:
    """One layer of a network; populations that it hears, with their shapes, become generators."""
    sources = {
        name: replace(net.populations[name], model=neuro.spike_generator(), shape=shape)
        for name, shape in given.items()
    }
    alone = neuro.Network(f"{net.name}_{layer}", resolution=net.resolution)
    alone.populations.update({**sources, layer: net.populations[layer]})
    alone.projections.update({name: one for name, one in net.projections.items() if one.target == layer})
    alone.groups.update({name: one for name, one in net.groups.items() if one.choice.of == layer})
    return alone


READINGS = ("hard", "soft", "potentials")


def scores(heard: LayerResponse, reading: str = "hard") -> Floats:
    """A number for each class, the larger the likelier.

    Args:
        heard: from `s2_heard`.
        reading: "hard": spikes of the class; "soft": its share of all spikes; "potentials": V_m summed over the C1
            spikes, mV.

    Raises:
        ModelError: there is no such reading.
    """
    if reading not in READINGS:
        raise ModelError(f"reading = {reading!r}: expected one of {', '.join(READINGS)}")
    if reading == "potentials":
        return np.asarray(heard.potentials.sum(axis=0))
    counts = np.bincount(heard.spikes.ids, minlength=heard.potentials.shape[1]).astype(np.float64)
    return counts / max(1.0, counts.sum()) if reading == "soft" else counts


def decisive(heard: LayerResponse, reading: str = "hard") -> Floats:
    """The same, but of classes with equal spikes those with larger summed potentials have more, by less than a spike.

    The authors' code takes the first of such classes. Where S2 heard nothing all are NaN.

    Args:
        heard: from `s2_heard`.
        reading: see `scores`.
    """
    found = scores(heard, reading)
    if not len(heard.potentials):
        return np.full_like(found, np.nan)
    if reading == "potentials":
        return found
    ranks = scores(heard, "potentials").argsort().argsort() / len(found)
    return np.asarray(found + ranks / (1 if reading == "hard" else max(1, heard.spikes.ids.size)))


def decide(heard: LayerResponse, reading: str = "hard") -> int:
    """The class of a recording by `decisive`, -1 if S2 heard nothing.

    Args:
        heard: from `s2_heard`.
        reading: see `scores`.
    """
    found = decisive(heard, reading)
    return -1 if np.isnan(found).all() else int(found.argmax())
