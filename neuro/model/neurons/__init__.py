"""Population models, one a file, and the registry of all."""

from neuro.core.registry import Registry
from neuro.model.neurons.aeif_cond_exp import aeif_cond_exp
from neuro.model.neurons.aeif_psc_exp import aeif_psc_exp
from neuro.model.neurons.base import Generator, Model, Neuron, State, complete
from neuro.model.neurons.current_generators import (
    CurrentGenerator,
    ac_generator,
    dc_generator,
    noise_generator,
    step_current_generator,
)
from neuro.model.neurons.encode import encode
from neuro.model.neurons.event_camera import event_camera
from neuro.model.neurons.gamma_sup_generator import gamma_sup_generator
from neuro.model.neurons.generators import (
    inhomogeneous_poisson_generator,
    poisson_generator,
    spike_generator,
    spike_train,
)
from neuro.model.neurons.hh_psc_alpha import hh_psc_alpha
from neuro.model.neurons.iaf_cond_alpha import iaf_cond_alpha
from neuro.model.neurons.iaf_cond_exp import iaf_cond_exp
from neuro.model.neurons.iaf_linear_leak import iaf_linear_leak
from neuro.model.neurons.iaf_psc_alpha import iaf_psc_alpha
from neuro.model.neurons.iaf_psc_delta import iaf_psc_delta
from neuro.model.neurons.iaf_psc_exp import iaf_psc_exp
from neuro.model.neurons.iaf_psc_exp_adaptive_threshold import iaf_psc_exp_adaptive_threshold
from neuro.model.neurons.izhikevich import izhikevich
from neuro.model.neurons.loihi_lif import loihi_lif
from neuro.model.neurons.mat2_psc_exp import mat2_psc_exp
from neuro.model.neurons.parrot_neuron import parrot_neuron
from neuro.model.neurons.pp_psc_delta import pp_psc_delta
from neuro.model.neurons.sinusoidal_poisson_generator import sinusoidal_poisson_generator
from neuro.model.neurons.soft_wta import soft_wta
from neuro.model.neurons.spinnaker_lif import spinnaker_lif
from neuro.model.neurons.srm0 import srm0

GENERATORS: tuple[type[Generator], ...] = (
    poisson_generator,
    inhomogeneous_poisson_generator,
    sinusoidal_poisson_generator,
    gamma_sup_generator,
    spike_generator,
    spike_train,
    dc_generator,
    step_current_generator,
    ac_generator,
    noise_generator,
    encode,
    event_camera,
)
INTEGRATED: tuple[type[Neuron], ...] = (iaf_cond_exp, iaf_cond_alpha, aeif_cond_exp, aeif_psc_exp, hh_psc_alpha)
NEURONS: tuple[type[Neuron], ...] = (
    parrot_neuron,
    iaf_psc_delta,
    iaf_psc_exp,
    iaf_psc_alpha,
    izhikevich,
    *INTEGRATED,
    mat2_psc_exp,
    iaf_psc_exp_adaptive_threshold,
    iaf_linear_leak,
    srm0,
    pp_psc_delta,
    soft_wta,
)
NATIVE: tuple[type[Neuron], ...] = (loihi_lif, spinnaker_lif)
"""Neurons in the registers of a chip; they have no float arithmetic."""

MODELS: Registry[type[Model]] = Registry(
    "model",
    (*GENERATORS, *NEURONS, *NATIVE),
    takes=lambda part: isinstance(part, type) and issubclass(part, Model),
    group="neuro.models",
    complete=complete,
)
"""All models of populations by name."""

__all__ = [
    "GENERATORS",
    "MODELS",
    "NATIVE",
    "NEURONS",
    "CurrentGenerator",
    "Generator",
    "Model",
    "Neuron",
    "State",
    "ac_generator",
    "aeif_cond_exp",
    "aeif_psc_exp",
    "dc_generator",
    "encode",
    "event_camera",
    "gamma_sup_generator",
    "hh_psc_alpha",
    "iaf_cond_alpha",
    "iaf_cond_exp",
    "iaf_linear_leak",
    "iaf_psc_alpha",
    "iaf_psc_delta",
    "iaf_psc_exp",
    "iaf_psc_exp_adaptive_threshold",
    "inhomogeneous_poisson_generator",
    "izhikevich",
    "loihi_lif",
    "mat2_psc_exp",
    "noise_generator",
    "parrot_neuron",
    "poisson_generator",
    "pp_psc_delta",
    "sinusoidal_poisson_generator",
    "soft_wta",
    "spike_generator",
    "spike_train",
    "spinnaker_lif",
    "srm0",
    "step_current_generator",
]
