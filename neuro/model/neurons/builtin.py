"""The built-in models of populations: one line registers a model and makes it a name of `neuro`."""

from neuro.model.neurons.aeif_cond_exp import aeif_cond_exp as aeif_cond_exp
from neuro.model.neurons.aeif_psc_exp import aeif_psc_exp as aeif_psc_exp
from neuro.model.neurons.chip_neurons import (
    loihi2_lif as loihi2_lif,
    loihi2_rf as loihi2_rf,
    loihi2_rf_iz as loihi2_rf_iz,
    loihi2_ternary_lif as loihi2_ternary_lif,
    loihi_lif as loihi_lif,
    spinnaker_lif as spinnaker_lif,
)
from neuro.model.neurons.cuba_lif import cuba_lif as cuba_lif
from neuro.model.neurons.current_generators import (
    ac_generator as ac_generator,
    dc_generator as dc_generator,
    noise_generator as noise_generator,
    step_current_generator as step_current_generator,
)
from neuro.model.neurons.delta_encoder import delta_encoder as delta_encoder
from neuro.model.neurons.event_camera import event_camera as event_camera
from neuro.model.neurons.gamma_sup_generator import gamma_sup_generator as gamma_sup_generator
from neuro.model.neurons.generators import (
    encode as encode,
    graded_spike_train as graded_spike_train,
    inhomogeneous_poisson_generator as inhomogeneous_poisson_generator,
    poisson_generator as poisson_generator,
    spike_generator as spike_generator,
    spike_train as spike_train,
)
from neuro.model.neurons.graded_product import graded_product as graded_product
from neuro.model.neurons.graded_vector import graded_vector as graded_vector
from neuro.model.neurons.hh_psc_alpha import hh_psc_alpha as hh_psc_alpha
from neuro.model.neurons.iaf_cond_alpha import iaf_cond_alpha as iaf_cond_alpha
from neuro.model.neurons.iaf_cond_exp import iaf_cond_exp as iaf_cond_exp
from neuro.model.neurons.iaf_linear_leak import iaf_linear_leak as iaf_linear_leak
from neuro.model.neurons.iaf_psc_alpha import iaf_psc_alpha as iaf_psc_alpha
from neuro.model.neurons.iaf_psc_delta import iaf_psc_delta as iaf_psc_delta
from neuro.model.neurons.iaf_psc_exp import iaf_psc_exp as iaf_psc_exp
from neuro.model.neurons.iaf_psc_exp_adaptive_threshold import (
    iaf_psc_exp_adaptive_threshold as iaf_psc_exp_adaptive_threshold,
)
from neuro.model.neurons.izhikevich import izhikevich as izhikevich
from neuro.model.neurons.mat2_psc_exp import mat2_psc_exp as mat2_psc_exp
from neuro.model.neurons.parrot_neuron import parrot_neuron as parrot_neuron
from neuro.model.neurons.pp_psc_delta import pp_psc_delta as pp_psc_delta
from neuro.model.neurons.sigma_decoder import sigma_decoder as sigma_decoder
from neuro.model.neurons.sigma_delta import sigma_delta as sigma_delta
from neuro.model.neurons.sinusoidal_poisson_generator import (
    sinusoidal_poisson_generator as sinusoidal_poisson_generator,
)
from neuro.model.neurons.soft_wta import soft_wta as soft_wta
from neuro.model.neurons.srm0 import srm0 as srm0
