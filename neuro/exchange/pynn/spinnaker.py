"""What sPyNNaker adds to PyNN, as far as it has a counterpart here. Source: sPyNNaker 7.3 and PyNN8Examples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyNN.connectors import FixedTotalNumberConnector
from pyNN.parameters import Sequence
from pyNN.standardmodels import StandardCellType, StandardSynapseType, STDPTimingDependence, build_translations

from neuro.exchange.pynn.session import SESSION
from neuro.exchange.pynn.standard import CELLS, SYNAPSES, Absent, Delayed

EXTRAS = ("extra_models", "external_devices")
"""Names under which sPyNNaker keeps what it adds."""


def _plain(*words: str) -> Any:
    return build_translations(*((word, word) for word in words))


class Neuromodulation(Delayed, StandardSynapseType):
    """Synapses whose spikes are dopamine: each raises it by the weight."""

    default_parameters = {"weight": 0.0, "delay": None, "tau_c": 1000.0, "tau_d": 200.0, "w_min": 0.0, "w_max": 1.0}
    translations = _plain(*default_parameters)
    parameter_checks: dict[str, Any] = {}


class Vogels2011Rule(STDPTimingDependence):
    """The rule of Vogels et al. 2011; its step is `A_plus` x w_max."""

    default_parameters = {"tau": 20.0, "alpha": 0.12, "A_plus": 0.01, "A_minus": 0.01}
    translations = _plain(*default_parameters)


class SpikeSourcePoissonVariable(StandardCellType):
    """Poisson trains whose rates change at listed times."""

    default_parameters = {"rates": Sequence([1.0]), "starts": Sequence([0.0]), "durations": Sequence([])}
    translations = _plain(*default_parameters)
    recordable = ["spikes"]
    injectable = False
    receptor_types = ()
    conductance_based = False
    default_initial_values: dict[str, float] = {}
    units = {"spikes": "ms"}


def cells() -> dict[str, Any]:
    """PyNN's cells as sPyNNaker has them: they record both names of a synaptic input and receive dopamine."""
    found = {}
    for name, kind in CELLS.items():
        if name.startswith("SpikeSource"):
            found[name] = kind
            continue
        inputs = {"gsyn_exc": "uS", "gsyn_inh": "uS"}
        words = {
            "recordable": list(dict.fromkeys([*kind.recordable, *inputs])),
            "units": {**inputs, **kind.units},
            "receptor_types": ("excitatory", "inhibitory", "reward", "punishment"),
        }
        found[name] = type(name, (kind,), words)
    found["Izhikevich"] = Absent("sPyNNaker's Izhikevich, whose synaptic currents are exponential,")
    return found


def synapses() -> dict[str, Any]:
    """PyNN's synapses as sPyNNaker has them: the receptor decides, not the sign of a weight."""
    return {name: type(name, (kind,), {"parameter_checks": {}}) for name, kind in SYNAPSES.items()}


def public_names() -> dict[str, Any]:
    """What sPyNNaker's module offers beyond PyNN's, by name."""
    ours = {
        "Neuromodulation": Neuromodulation,
        "Vogels2011Rule": Vogels2011Rule,
        "SpikeSourcePoissonVariable": SpikeSourcePoissonVariable,
    }
    every = cells()
    ours["MultapseConnector"] = FixedTotalNumberConnector
    return {**every, **synapses(), **ours, "IFCurDelta": every["IF_curr_delta"], "IFCurrDelta": every["IF_curr_delta"]}


def converted(name: str) -> Any:
    """A function of `neo_convertor`: of results without a spike."""

    def convert(*args: Any, **words: Any) -> Any:
        SESSION.read = True
        if name in ("count_spikes", "convert_spiketrains_count"):
            return 0
        return np.empty((0, 2 if "spike" in name else 3))

    return convert


def delta_jump(values: dict[str, Any], step: float) -> NDArray[np.float64]:
    """Of each neuron the jump in mV that a weight of 1 nA makes, which is a current that lasts one step.

    Args:
        values: parameters of the neurons, in PyNN's units.
        step: ms.
    """
    return np.asarray(values["tau_m"] / values["cm"] * -np.expm1(-step / values["tau_m"]))
