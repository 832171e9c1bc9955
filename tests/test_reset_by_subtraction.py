"""A spike lowers V_m by V_th - V_reset where the neuron says so; what exceeds the threshold is kept."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import neuro
from beside import evaluated
from refused import refused

WORDS = {"tau_m": 20.0, "C_m": 20.0, "E_L": 0.0, "V_reset": 0.0, "V_th": 2.0, "t_ref": 0.0}
MODELS = evaluated(__file__, "MODELS", globals())


def driven(model: neuro.Neuron, scale: float) -> neuro.Network:
    net, rng = neuro.Network("driven", resolution=1.0), np.random.default_rng(0)
    net.population("source", 30, neuro.poisson_generator(rate=60.0))
    net.population("cells", 20, model)
    net.connect("source", "cells", neuro.all_to_all(), weight=scale * rng.normal(0.3, 1.0, (30, 20)), delay=1.0)
    net.connect("cells", "cells", neuro.all_to_all(), weight=scale * rng.normal(0.0, 0.5, (20, 20)), delay=1.0)
    net.probe("v", "cells", "V_m")
    return net


@pytest.mark.parametrize("backend", ["event", "torch"])
@pytest.mark.parametrize(("model", "scale"), MODELS, ids=lambda value: getattr(value, "name", ""))
def test_backends_agree(model, scale, backend):
    if backend == "torch":
        pytest.importorskip("torch", reason="torch is not installed")
    runs = [neuro.compile(driven(model, scale), backend=name, seed=3) for name in ("reference", backend)]
    for sim in runs:
        sim.run(100.0)
    one, other = (np.stack(sim.spikes("cells")) for sim in runs)
    assert one.shape[1] > 100
    assert np.array_equal(one, other)
    assert np.allclose(*(sim.trace("v")[1] for sim in runs), rtol=0, atol=1e-9)


def constant(model: neuro.Neuron, weight: float, backend: str = "reference") -> tuple[list[float], np.ndarray]:
    """Spikes and potential of one neuron that receives one input in step 1."""
    net = neuro.Network("one", resolution=1.0)
    net.population("source", 1, neuro.spike_generator(spike_times=[[1.0]]))
    net.population("cell", 1, model)
    net.connect("source", "cell", neuro.one_to_one(), weight=weight, delay=1.0)
    net.probe("v", "cell", "V_m")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", neuro.ApproximationWarning)
        sim = neuro.compile(net, backend=backend)
    sim.run(6.0)
    return sim.spikes("cell")[0].tolist(), sim.trace("v")[1].ravel()


INTEGRATOR = {**WORDS, "tau_m": np.inf, "V_th": 1.0}


@pytest.mark.parametrize("backend", ["reference", "event", "loihi", "spinnaker"])
def test_what_exceeds_the_threshold_is_kept(backend):
    model = neuro.iaf_psc_delta(**INTEGRATOR, reset_by_subtraction=True)
    times, v = constant(model, 3.5, backend)
    assert times == [2.0, 3.0, 4.0]
    assert v[-1] == pytest.approx(0.5, abs=0.02)


def test_it_fires_several_times_in_a_step():
    model = neuro.iaf_psc_delta(**INTEGRATOR, reset_by_subtraction=True, max_spikes=2)
    times, v = constant(model, 3.5)
    assert times == [2.0, 2.0, 3.0]
    assert v[1:3].tolist() == [1.5, 0.5]


def test_the_threshold_rises_while_more_is_left():
    model = neuro.iaf_psc_delta(**INTEGRATOR, reset_by_subtraction=True, threshold_rises=True)
    assert constant(model, 3.5)[0] == [2.0, 3.0]  # 2.5 is left, then 1.5, which is below twice the threshold


def test_several_spikes_without_it_are_refused():
    with pytest.raises(neuro.ModelError, match="max_spikes above 1: expected reset_by_subtraction: true"):
        constant(neuro.iaf_psc_delta(**WORDS, max_spikes=3), 1.0)


def test_nest_refuses_it():
    pytest.importorskip("nest", reason="nest-simulator is not installed")
    assert "NEST's model resets to V_reset" in refused(neuro.compile, driven(MODELS[0][0], 1.0), backend="nest")
