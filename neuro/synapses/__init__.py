"""Synapse models, one a file. A new one is a module and a line in `SYNAPSES`."""

from neuro.synapses.base import Synapse
from neuro.synapses.r_stdp import r_stdp
from neuro.synapses.static import static
from neuro.synapses.stdp import stdp
from neuro.synapses.stdp_dopa import stdp_dopa

SYNAPSES: dict[str, type[Synapse]] = {model.__name__: model for model in (static, stdp, stdp_dopa, r_stdp)}

__all__ = ["SYNAPSES", "Synapse", "r_stdp", "static", "stdp", "stdp_dopa"]
