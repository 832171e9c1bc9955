"""A network that sees a recording, and what two runs of it have in common."""

import numpy as np

import neuro

STEP = 0.1


def network(model, shape="auto", resolution=STEP):
    net = neuro.Network("seen", resolution=resolution)
    net.population("camera", shape, model)
    net.population("cells", 20, neuro.iaf_psc_exp())
    net.connect("camera", "cells", neuro.fixed_outdegree(n=3), weight=120.0, delay=1.0)
    net.probe("sent", "camera")
    net.probe("v", "cells", "V_m", every=5.0)
    return net


def same_run(a, b):
    for what in ("camera", "cells"):
        for x, y in zip(a.spikes(what), b.spikes(what), strict=True):
            np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(a.trace("v")[1], b.trace("v")[1])
