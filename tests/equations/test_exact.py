"""Linear models as equations: those of the package, written so, give the same."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro.model.equations.exact import change
from neuro.model.neurons.propagators import from_alpha, from_constant, from_exponential
from neuro.testing import check_part

MODELS = yaml.safe_load(Path(__file__).with_name("models.yaml").read_text())["models"]
IAF_PSC_EXP = MODELS["own_iaf_psc_exp"]
TWINS = {
    "iaf_psc_exp": (300.0, 1e-12),
    "iaf_psc_alpha": (300.0, 1e-12),
    "iaf_psc_delta": (4.0, 1e-12),
    "izhikevich": (8.0, 1e-9),
}
"""A weight with which each fires, and how near the two potentials are: what rounds otherwise grows in a spike."""


def network(model, weight):
    net = neuro.Network("twins")
    net.population("noise", 20, neuro.poisson_generator(rate=150.0))
    net.population("dc", 1, neuro.dc_generator(amplitude=5.0, start=20.0, stop=60.0))
    net.population("cells", 70, model)
    weights = neuro.uniform(low=-0.3 * weight, high=weight)
    net.connect("noise", "cells", neuro.pairwise_bernoulli(p=0.5), weight=weights, delay=1.0)
    net.connect("cells", "cells", neuro.pairwise_bernoulli(p=0.1), weight=-0.3 * weight, delay=1.5)
    net.connect("dc", "cells", neuro.all_to_all(), delay=1.0)
    net.probe("v", "cells", "V_m")
    return net


@pytest.mark.parametrize(("name", "backend"), [*((name, "reference") for name in TWINS), ("iaf_psc_alpha", "event")])
def test_a_built_in_written_as_equations_gives_its_spikes_and_potential(name, backend):
    weight, near = TWINS[name]
    found = []
    for model in (getattr(neuro, name)(), neuro.equations(f"own_{name}", **MODELS[f"own_{name}"])()):
        sim = neuro.compile(network(model, weight), backend, seed=1)
        sim.run(150.0)
        found.append((sim.spikes("cells"), sim.trace("v")[1]))
    (spikes, v), (own_spikes, own_v) = found
    assert spikes[0].size > 50
    assert np.array_equal(spikes[0], own_spikes[0])
    assert np.array_equal(spikes[1], own_spikes[1])
    assert np.abs(v - own_v).max() < near


def test_it_runs_as_any_part_does():
    check_part(
        neuro.equations("own_iaf_psc_exp", **IAF_PSC_EXP)(t_ref=0.5, tau_m=neuro.uniform(low=5.0, high=20.0)), ms=15.0
    )


@pytest.mark.parametrize("h", [0.1, 1.0, 50.0])
@pytest.mark.parametrize("tau", [2.0, 10.0, 10.0 + 1e-9])
def test_the_exponential_is_exact(h, tau):
    """A membrane under an alpha current and a constant one, beside the closed forms; equal time constants, too."""
    matrix = np.zeros((4, 4))
    matrix[0], matrix[1, 1:3], matrix[2, 2] = (-0.1, 1.0 / 250.0, 0.0, 1.0 / 250.0), (-1.0 / tau, 1.0), -1.0 / tau
    c = np.zeros(48)
    c[:16] = matrix.ravel()
    change(c, 0, 3, 1, h)
    arguments = (10.0, tau, 250.0, h)
    expected = [
        math.expm1(-0.1 * h),
        from_exponential(*arguments),
        from_alpha(*arguments),
        from_constant(10.0, 250.0, h),
    ]
    assert c[:4] == pytest.approx(expected, rel=1e-14)


def test_one_definition_is_one_class():
    assert neuro.equations("lif", **IAF_PSC_EXP) is neuro.equations("lif", **IAF_PSC_EXP)
    assert neuro.equations("lif", **IAF_PSC_EXP)(tau_m=5.0) == neuro.equations("lif", **IAF_PSC_EXP)(tau_m=5.0)
