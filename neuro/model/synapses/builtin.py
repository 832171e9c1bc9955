"""Built-in models of synapses. Each import line registers a model and makes its name available in `neuro`."""

from neuro.model.synapses.base import static as static
from neuro.model.synapses.loihi_registers import (
    loihi2_convolution as loihi2_convolution,
    loihi2_learning as loihi2_learning,
    loihi2_static as loihi2_static,
    loihi_learning as loihi_learning,
    loihi_static as loihi_static,
)
from neuro.model.synapses.modulated import hedonistic as hedonistic, mstdpet as mstdpet, stdp_dopa as stdp_dopa
from neuro.model.synapses.moves import (
    reinforce as reinforce,
    td_lambda as td_lambda,
    td_ltp as td_ltp,
    td_moves as td_moves,
)
from neuro.model.synapses.pairs import (
    stddp as stddp,
    stdp as stdp,
    stdp_literal as stdp_literal,
    stdp_nn_pre_centered as stdp_nn_pre_centered,
    stdp_nn_restr as stdp_nn_restr,
    stdp_nn_symm as stdp_nn_symm,
    stdp_pl_hom as stdp_pl_hom,
    stdp_triplet as stdp_triplet,
    tsodyks2 as tsodyks2,
    vogels_sprekeler as vogels_sprekeler,
)
from neuro.model.synapses.spinnaker_programs import spinnaker_learning as spinnaker_learning
from neuro.model.synapses.trials import (
    first_spike_stdp as first_spike_stdp,
    mozafari as mozafari,
    normalised_stdp as normalised_stdp,
    r_stddp as r_stddp,
    r_stdp as r_stdp,
    tempotron as tempotron,
)
