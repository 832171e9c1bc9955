"""Networks and chips to place: small ones, with the limits that a test is about."""

from dataclasses import replace

import neuro
from neuro.chips import chip
from neuro.chips.description import Figure
from neuro.compiler import compile_network

LOIHI, SPINNAKER = chip("loihi"), chip("spinnaker")


def limited(base=LOIHI, mesh=None, **limits):
    """A chip with other limits; None takes one away."""
    kept = {**base.limits, **{name: Figure(value or 0, "test") for name, value in limits.items()}}
    for name, value in limits.items():
        if value is None:
            del kept[name]
    return replace(base, limits=kept, mesh=mesh or base.mesh)


def network(*populations, connect=()):
    """Populations (name, size or shape, model or None) and connections (from, to, rule, words)."""
    net = neuro.Network("test", resolution=1.0)
    for name, size, *model in populations:
        net.population(name, size, model[0] if model else neuro.iaf_psc_delta())
    for source, target, rule, *words in connect:
        told = {"weight": 1.0, "delay": 1.0, **(words[0] if words else {})}
        net.connect(source, target, rule, told.pop("synapse", neuro.static()), name=f"{source}_{target}", **told)
    return compile_network(net, 0)


def sources(size):
    return ("in", size, neuro.spike_generator())
