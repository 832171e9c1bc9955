"""PyNN's cells, synapses and current sources with PyNN's names and units, and the additions of sPyNNaker.

Source: PyNN 0.13, sPyNNaker 7.3 and PyNN8Examples.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyNN import standardmodels
from pyNN.connectors import FixedTotalNumberConnector
from pyNN.parameters import ParameterSpace, Sequence
from pyNN.standardmodels import (
    StandardCellType,
    StandardSynapseType,
    STDPTimingDependence,
    STDPWeightDependence,
    build_translations,
    cells,
    electrodes,
    synapses,
)

from neuro_exchange.pynn.session import MOST_SAMPLES, SESSION


class Absent:
    """Replacement of a simulator's part that has no counterpart here. Each call adds a problem for the calling line."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __call__(self, *args: Any, **options: Any) -> Absent:
        """Add a problem for the line that calls the part."""
        SESSION.problem(f"{self._name} has no counterpart")
        return self

    def __getattr__(self, name: str) -> Absent:
        if name.startswith("__"):
            raise AttributeError(name)
        return Absent(f"{self._name}.{name}")

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def present(part: Any, replacement: Any) -> Any:
    """Return the part. If it is absent, add a problem and return the replacement, so that the script continues."""
    return replacement() if isinstance(part, Absent) and part() else part


def _with_pynn_names(kind: Any, **attributes: Any) -> Any:
    """Return a subclass of a PyNN class, whose parameters keep PyNN's names and units."""
    names = build_translations(*((word, word) for word in kind.default_parameters))
    return type(kind.__name__, (kind,), {"translations": names, "standard_receptor_type": True, **attributes})


def _standard(module: Any, base: Any) -> dict[str, Any]:
    kinds = (kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, base))
    return {kind.__name__: kind for kind in kinds if getattr(kind, "default_parameters", None)}


CELLS = {name: _with_pynn_names(kind) for name, kind in _standard(cells, standardmodels.StandardCellType).items()}
PLACEHOLDER = type(
    "Placeholder",
    (CELLS["IF_curr_exp"],),
    {
        "can_record": lambda self, *variable: True,
        "units": defaultdict(lambda: "mV"),
        "receptor_types": ("excitatory", "inhibitory", "reward", "punishment"),
    },
)
"""Replacement of cells without a counterpart, so that the script continues."""
CELLS = {name: kind for name, kind in CELLS.items() if name not in ("PointNeuron", "MultiCompartmentNeuron")}


class Delayed:
    """Base class of synapses whose default delay is the shortest one."""

    def _get_minimum_delay(self) -> float:
        return SESSION.experiment.min_delay


_PLAIN = {
    name: kind
    for name, kind in _standard(synapses, standardmodels.StandardSynapseType).items()
    if name != "STDPMechanism"
}
SYNAPSES = {name: _with_pynn_names(type(name, (Delayed, kind), {})) for name, kind in _PLAIN.items()}
_BASES = (standardmodels.STDPWeightDependence, standardmodels.STDPTimingDependence)
DEPENDENCES = {name: _with_pynn_names(kind) for base in _BASES for name, kind in _standard(synapses, base).items()}


class STDPMechanism(Delayed, synapses.STDPMechanism):
    """PyNN's STDP."""

    base_translations = build_translations(*((word, word) for word in ("weight", "delay", "dendritic_delay_fraction")))

    def __init__(self, timing_dependence: Any = None, weight_dependence: Any = None, *args: Any, **words: Any) -> None:
        if not words.pop("backprop_delay", True):  # an argument of sPyNNaker
            SESSION.problem("'backprop_delay' is False: delays here are dendritic")
        timing = present(timing_dependence, DEPENDENCES["SpikePairRule"])
        weight = present(weight_dependence, DEPENDENCES["AdditiveWeightDependence"])
        super().__init__(timing, weight, *args, **words)

    def _build_translations(self) -> None:
        self.translations = dict(self.base_translations)
        for component in (self.timing_dependence, self.weight_dependence):
            self.translations.update(component.translations if component else {})


class _Source:
    """Base class of current sources. A source stores the parameters, and the neurons that receive the current."""

    def __init__(self, **parameters: Any) -> None:
        parameters.pop("rng", None)
        times = np.asarray(parameters.get("times", ()), dtype=float)
        if np.any(np.diff(times, prepend=-np.finfo(float).tiny) <= 0) or np.any(times < 0):
            raise ValueError("Step current timestamps should be monotonically increasing, and not negative.")
        space = ParameterSpace(self.default_parameters, self.get_schema(), shape=(1,))  # type: ignore[attr-defined]
        space.update(**parameters)
        object.__setattr__(self, "_space", space)

    def inject_into(self, cells: Any) -> None:
        """Store the neurons that receive the current."""
        if any(not cell.celltype.injectable for cell in cells):
            raise TypeError("Can't inject current into a spike source.")
        SESSION.changed("a current is injected")
        SESSION.experiment.currents.append((self, [int(cell) for cell in cells], SESSION.where()))

    def set_native_parameters(self, parameters: Any) -> None:
        """Change parameters of the source."""
        SESSION.changed("a current is changed")
        self._space.update(**dict(parameters.items()))  # type: ignore[attr-defined]

    def get_native_parameters(self) -> Any:
        """Return the parameters of the source."""
        return self._space  # type: ignore[attr-defined]

    def record(self) -> None:
        """Do nothing: there are no results."""

    def _get_data(self) -> tuple[Any, Any]:
        SESSION.read = True
        times = np.arange(min(MOST_SAMPLES, round(SESSION.t / SESSION.dt) + 1)) * SESSION.dt
        return times, np.zeros(times.size)

    def values(self) -> dict[str, Any]:
        """Return the parameters as numbers and arrays."""
        space = deepcopy(self._space)  # type: ignore[attr-defined]  # a space can be evaluated only once
        space.evaluate(simplify=True)
        return {name: getattr(value, "value", value) for name, value in space.as_dict().items()}


SOURCES = {
    name: _with_pynn_names(type(name, (_Source, kind), {}))
    for name, kind in _standard(electrodes, standardmodels.StandardCurrentSource).items()
}


SPINNAKER_EXTRAS = ("extra_models", "external_devices")
"""Modules of sPyNNaker with its additions to PyNN."""


def _unchanged(*words: str) -> Any:
    return build_translations(*((word, word) for word in words))


class Neuromodulation(Delayed, StandardSynapseType):
    """Synapses that release dopamine: a spike raises the dopamine of the target by the weight."""

    default_parameters = {"weight": 0.0, "delay": None, "tau_c": 1000.0, "tau_d": 200.0, "w_min": 0.0, "w_max": 1.0}
    translations = _unchanged(*default_parameters)
    parameter_checks: dict[str, Any] = {}


class Vogels2011Rule(STDPTimingDependence):
    """The learning rule of Vogels et al. 2011, with the step `A_plus`."""

    default_parameters = {"tau": 20.0, "alpha": 0.12, "A_plus": 0.01, "A_minus": 0.01}
    translations = _unchanged(*default_parameters)


class SpikeNearestPairRule(STDPTimingDependence):
    """STDP of nearest pairs. After each source spike, only the first target spike counts."""

    default_parameters = {"tau_plus": 20.0, "tau_minus": 20.0, "A_plus": 0.01, "A_minus": 0.01}
    translations = _unchanged(*default_parameters)


class PfisterSpikeTriplet(STDPTimingDependence):
    """STDP of pairs and triplets. A step of the weight is w_max times an amplitude, such as `A_plus`."""

    default_parameters = {
        **{"tau_plus": 20.0, "tau_minus": 20.0, "tau_x": 101.0, "tau_y": 114.0},
        **{"A_plus": 0.01, "A_minus": 0.01},
    }
    translations = _unchanged(*default_parameters)


class WeightDependenceAdditiveTriplet(STDPWeightDependence):
    """Bounds of weights that learn by triplets, and the amplitudes of triplets."""

    default_parameters = {"w_min": 0.0, "w_max": 1.0, "A3_plus": 0.01, "A3_minus": 0.01}
    translations = _unchanged(*default_parameters)


class RecurrentRule(STDPTimingDependence):
    """Rule with a counter per synapse. Pairs within random windows raise or lower the counter.

    The weight changes when the counter reaches the lower or the upper limit.
    """

    default_parameters = {
        **{"accumulator_depression": -6, "accumulator_potentiation": 3, "mean_pre_window": 35.0},
        **{"mean_post_window": 35.0, "dual_fsm": True, "A_plus": 0.01, "A_minus": 0.01},
    }
    translations = _unchanged(*default_parameters)


class SpikeSourcePoissonVariable(StandardCellType):
    """Poisson spikes with rates that change at listed times."""

    default_parameters = {"rates": Sequence([1.0]), "starts": Sequence([0.0]), "durations": Sequence([])}
    translations = _unchanged(*default_parameters)
    recordable = ["spikes"]
    injectable = False
    receptor_types = ()
    conductance_based = False
    default_initial_values: dict[str, float] = {}
    units = {"spikes": "ms"}


_ADDITIONS = (
    *(Neuromodulation, Vogels2011Rule, SpikeNearestPairRule, PfisterSpikeTriplet),
    *(WeightDependenceAdditiveTriplet, RecurrentRule, SpikeSourcePoissonVariable),
)


def spinnaker_names() -> dict[str, Any]:
    """Return the parts of sPyNNaker's module by name.

    In sPyNNaker every cell can record its synaptic inputs as `gsyn_exc` and `gsyn_inh`, and has receptors for dopamine.
    The receptor determines the sign of a weight, so the sign of the number is not checked.
    """
    parts: dict[str, Any] = {name: kind for name, kind in CELLS.items() if name.startswith("SpikeSource")}
    for name, kind in CELLS.items():
        if name not in parts:
            inputs = {"gsyn_exc": "uS", "gsyn_inh": "uS"}
            attributes = {
                "recordable": list(dict.fromkeys([*kind.recordable, *inputs])),
                "units": {**inputs, **kind.units},
                "receptor_types": ("excitatory", "inhibitory", "reward", "punishment"),
            }
            parts[name] = type(name, (kind,), attributes)
    parts["Izhikevich"] = Absent("sPyNNaker's Izhikevich, whose synaptic currents are exponential,")
    parts["IFCurDelta"] = parts["IFCurrDelta"] = parts["IF_curr_delta"]
    unchecked = {**SYNAPSES, "STDPMechanism": STDPMechanism}
    parts |= {name: type(name, (kind,), {"parameter_checks": {}}) for name, kind in unchecked.items()}
    parts |= {kind.__name__: kind for kind in _ADDITIONS}
    return parts | {"MultapseConnector": FixedTotalNumberConnector}


def converted(name: str) -> Any:
    """Return a function that replaces one of sPyNNaker's `neo_convertor` and returns empty results."""

    def convert(*args: Any, **options: Any) -> Any:
        SESSION.read = True
        if name in ("count_spikes", "convert_spiketrains_count"):
            return 0
        return np.empty((0, 2 if "spike" in name else 3))

    return convert


def delta_jump(values: dict[str, Any], step: float) -> NDArray[np.float64]:
    """Return the jump of each neuron's potential in mV for a weight of 1 nA: a current of 1 nA for one step.

    Args:
        values: parameters of the neurons, in PyNN's units.
        step: length of a step in ms.
    """
    return np.asarray(values["tau_m"] / values["cm"] * -np.expm1(-step / values["tau_m"]))
