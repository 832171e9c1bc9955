"""Sliders: both ends, and what lies between, are values that are accepted."""

from contextlib import suppress

import pytest

import neuro
from neuro.live.facts import sliders
from neuro.model.neurons import MODELS
from neuro.model.synapses import SYNAPSES


def moved(sim, part):
    """What is refused of the ends and the middles of sliders; each is set back."""
    refused = []
    for each in sliders(sim, part):
        before = each["value"]
        middle = each["low"] + each["step"] * round((each["high"] - each["low"]) / each["step"] / 3)
        for value in (each["low"], each["high"], middle):
            try:
                sim.set(part, {each["word"]: bool(value) if each["kind"] == "boolean" else value})
            except neuro.ModelError as error:
                refused.append(f"{part}.{each['word']} = {value}: {error.message}")
        if before is not None:
            sim.set(part, {each["word"]: bool(before) if each["kind"] == "boolean" else before})
    return refused


def test_of_every_model():
    net = neuro.Network("all", resolution=0.1)
    for name, model in MODELS.items():
        if name == "event_camera" or name.startswith(("loihi", "spinnaker")):  # another shape, other backends
            continue
        with suppress(neuro.ModelError, TypeError):  # what has no default
            net.population(name, 2, model())
    sim = neuro.compile(net, "reference")
    assert len(net.populations) > 20
    assert [text for name in net.populations for text in moved(sim, name)] == []


def test_of_every_synapse_model():
    seen = 0
    for name, model in SYNAPSES.items():
        net = neuro.Network("two", resolution=1.0)
        cells = net.population("cells", 3, neuro.iaf_psc_exp())
        try:
            net.connect(cells, cells, neuro.all_to_all(), model(), weight=1.0, name="synapses")
            sim = neuro.compile(net, "reference")
        except (neuro.ModelError, TypeError):  # it has no default, or needs more of the network
            continue
        assert moved(sim, "synapses") == [], name
        seen += 1
    assert seen > 5


@pytest.mark.parametrize("value", [1e308, -1e308, 1e-320, -1e-320, 0.0])
def test_of_values_at_the_limits_of_floats(value):
    net = neuro.Network("two", resolution=1.0)
    cells = net.population("cells", 3, neuro.iaf_psc_exp())
    net.connect(cells, cells, neuro.all_to_all(), weight=1.0, name="synapses")
    sim = neuro.compile(net, "reference")
    sim.set("synapses", weight=value)
    sim.set("cells", I_e=value)
    for each in (*sliders(sim, "synapses"), *sliders(sim, "cells")):
        assert -1e301 < each["low"] < each["high"] < 1e301 or abs(each["value"] or 1e308) > 1e300
