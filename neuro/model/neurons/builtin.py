"""Built-in models of populations. Each import line registers a model and makes its name available in `neuro`.

The registry reads these lines, and imports the module of a model when the model is first used. Lists for users follow
the order of these lines: generators, neurons, and last the neurons in the registers of a chip.
"""

from neuro.model.neurons.current_generators import (
    ac_generator as ac_generator,
    dc_generator as dc_generator,
    noise_generator as noise_generator,
    step_current_generator as step_current_generator,
)
from neuro.model.neurons.event_cameras import event_camera as event_camera
from neuro.model.neurons.generators import (
    encode as encode,
    gamma_sup_generator as gamma_sup_generator,
    graded_spike_train as graded_spike_train,
    inhomogeneous_poisson_generator as inhomogeneous_poisson_generator,
    poisson_generator as poisson_generator,
    sinusoidal_poisson_generator as sinusoidal_poisson_generator,
    spike_generator as spike_generator,
    spike_train as spike_train,
)

# isort: split
from neuro.model.neurons.adaptive_exponential import aeif_cond_exp as aeif_cond_exp, aeif_psc_exp as aeif_psc_exp
from neuro.model.neurons.conductances import iaf_cond_alpha as iaf_cond_alpha, iaf_cond_exp as iaf_cond_exp
from neuro.model.neurons.currents import (
    cuba_lif as cuba_lif,
    iaf_psc_alpha as iaf_psc_alpha,
    iaf_psc_exp as iaf_psc_exp,
)
from neuro.model.neurons.exponential_thresholds import (
    iaf_psc_exp_adaptive_threshold as iaf_psc_exp_adaptive_threshold,
    mat2_psc_exp as mat2_psc_exp,
)
from neuro.model.neurons.graded import (
    delta_encoder as delta_encoder,
    graded_product as graded_product,
    graded_vector as graded_vector,
    sigma_decoder as sigma_decoder,
    sigma_delta as sigma_delta,
)
from neuro.model.neurons.hodgkin_huxley import hh_psc_alpha as hh_psc_alpha
from neuro.model.neurons.point_processes import pp_psc_delta as pp_psc_delta, soft_wta as soft_wta, srm0 as srm0
from neuro.model.neurons.potentials import (
    iaf_linear_leak as iaf_linear_leak,
    iaf_psc_delta as iaf_psc_delta,
    izhikevich as izhikevich,
    parrot_neuron as parrot_neuron,
)

# isort: split
from neuro.model.neurons.chip_neurons import (
    loihi2_lif as loihi2_lif,
    loihi2_rf as loihi2_rf,
    loihi2_rf_iz as loihi2_rf_iz,
    loihi2_ternary_lif as loihi2_ternary_lif,
    loihi_lif as loihi_lif,
    spinnaker_lif as spinnaker_lif,
)
