"""The built-in models of synapses: one line registers a model and makes it a name of `neuro`."""

from neuro.model.synapses.base import static as static
from neuro.model.synapses.first_spike_stdp import first_spike_stdp as first_spike_stdp
from neuro.model.synapses.hedonistic import hedonistic as hedonistic
from neuro.model.synapses.loihi_learning import (
    loihi2_convolution as loihi2_convolution,
    loihi2_learning as loihi2_learning,
    loihi2_static as loihi2_static,
    loihi_learning as loihi_learning,
    loihi_static as loihi_static,
)
from neuro.model.synapses.mozafari import mozafari as mozafari
from neuro.model.synapses.mstdpet import mstdpet as mstdpet
from neuro.model.synapses.normalised_stdp import normalised_stdp as normalised_stdp
from neuro.model.synapses.r_stddp import r_stddp as r_stddp
from neuro.model.synapses.r_stdp import r_stdp as r_stdp
from neuro.model.synapses.reinforce import reinforce as reinforce
from neuro.model.synapses.stddp import stddp as stddp
from neuro.model.synapses.stdp import stdp as stdp
from neuro.model.synapses.stdp_dopa import stdp_dopa as stdp_dopa
from neuro.model.synapses.stdp_literal import stdp_literal as stdp_literal
from neuro.model.synapses.stdp_nn_pre_centered import stdp_nn_pre_centered as stdp_nn_pre_centered
from neuro.model.synapses.stdp_nn_restr import stdp_nn_restr as stdp_nn_restr
from neuro.model.synapses.stdp_nn_symm import stdp_nn_symm as stdp_nn_symm
from neuro.model.synapses.stdp_pl_hom import stdp_pl_hom as stdp_pl_hom
from neuro.model.synapses.stdp_triplet import stdp_triplet as stdp_triplet
from neuro.model.synapses.td_lambda import td_lambda as td_lambda
from neuro.model.synapses.td_ltp import td_ltp as td_ltp
from neuro.model.synapses.td_moves import td_moves as td_moves
from neuro.model.synapses.tempotron import tempotron as tempotron
from neuro.model.synapses.tsodyks2 import tsodyks2 as tsodyks2
from neuro.model.synapses.vogels_sprekeler import vogels_sprekeler as vogels_sprekeler
