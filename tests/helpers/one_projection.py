"""The smallest network that a chip may refuse: a generator onto one population."""

import neuro
from neuro.chips import chip, quantise
from neuro.compiler import compile_network

EXP = {"E_L": 0.0, "V_reset": 0.0, "V_th": 10.0}
DELTA = {**EXP, "t_ref": 0.0}


def one(model, h=1.0, weight=1.0, delay=None, synapse=None, n=1, initial=None, generator=None):
    """A generator onto one population."""
    net = neuro.Network("one", resolution=h)
    net.population("in", n, generator or neuro.spike_generator(spike_times=[[]] * n))
    net.population("out", n, model, initial=initial or {})
    net.connect(
        "in", "out", neuro.one_to_one(), synapse or neuro.static(), weight=weight, delay=delay or h, name="in_out"
    )
    return compile_network(net, 0)


def refusals(program, name, **options):
    """All that is refused: what, why, way out."""
    return [(p.what, p.why, p.way_out) for p in quantise(program, chip(name), **options).problems if p.refused]


def exp(**values):
    return neuro.iaf_psc_exp(**{**EXP, **values})


def delta(**values):
    return neuro.iaf_psc_delta(**{**DELTA, **values})
