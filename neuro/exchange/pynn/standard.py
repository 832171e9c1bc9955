"""PyNN's cells, synapses and current sources, whose parameters keep PyNN's names and units."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from pyNN import standardmodels
from pyNN.parameters import ParameterSpace
from pyNN.standardmodels import build_translations, cells, electrodes, synapses

from neuro.exchange.pynn.clock import MOST_SAMPLES, STATE
from neuro.exchange.pynn.session import SESSION


class Absent:
    """What a simulator has and this language has not."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __call__(self, *args: Any, **words: Any) -> Absent:
        """Note the line that uses it."""
        SESSION.problem(f"{self._name} has no counterpart")
        return self

    def __getattr__(self, name: str) -> Absent:
        if name.startswith("__"):
            raise AttributeError(name)
        return Absent(f"{self._name}.{name}")

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def present(part: Any, instead: Any) -> Any:
    """The part, or another so that the script goes on; that it is absent is a problem."""
    return instead() if isinstance(part, Absent) and part() else part


def _as_it_is(kind: Any, **words: Any) -> Any:
    """A class of PyNN's whose parameters keep PyNN's names and units."""
    names = build_translations(*((word, word) for word in kind.default_parameters))
    return type(kind.__name__, (kind,), {"translations": names, "standard_receptor_type": True, **words})


def _standard(module: Any, base: Any) -> dict[str, Any]:
    found = (kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, base))
    return {kind.__name__: kind for kind in found if getattr(kind, "default_parameters", None)}


CELLS = {name: _as_it_is(kind) for name, kind in _standard(cells, standardmodels.StandardCellType).items()}
PLACEHOLDER = type(
    "Placeholder",
    (CELLS["IF_curr_exp"],),
    {
        "can_record": lambda self, *variable: True,
        "units": defaultdict(lambda: "mV"),
        "receptor_types": ("excitatory", "inhibitory", "reward", "punishment"),
    },
)
"""Stands for cells that are absent, so that the script goes on."""
CELLS = {name: kind for name, kind in CELLS.items() if name not in ("PointNeuron", "MultiCompartmentNeuron")}


class Delayed:
    """A synapse without a delay has the smallest."""

    def _get_minimum_delay(self) -> float:
        return SESSION.experiment.min_delay


_PLAIN = {
    name: kind
    for name, kind in _standard(synapses, standardmodels.StandardSynapseType).items()
    if name != "STDPMechanism"
}
SYNAPSES = {name: _as_it_is(type(name, (Delayed, kind), {})) for name, kind in _PLAIN.items()}
_BASES = (standardmodels.STDPWeightDependence, standardmodels.STDPTimingDependence)
DEPENDENCES = {name: _as_it_is(kind) for base in _BASES for name, kind in _standard(synapses, base).items()}


class STDPMechanism(Delayed, synapses.STDPMechanism):
    """PyNN's STDP."""

    base_translations = build_translations(*((word, word) for word in ("weight", "delay", "dendritic_delay_fraction")))

    def __init__(self, timing_dependence: Any = None, weight_dependence: Any = None, *args: Any, **words: Any) -> None:
        if not words.pop("backprop_delay", True):  # sPyNNaker's
            SESSION.problem("'backprop_delay' is False: here a delay is dendritic")
        timing = present(timing_dependence, DEPENDENCES["SpikePairRule"])
        weight = present(weight_dependence, DEPENDENCES["AdditiveWeightDependence"])
        super().__init__(timing, weight, *args, **words)

    def _build_translations(self) -> None:
        self.translations = dict(self.base_translations)
        for component in (self.timing_dependence, self.weight_dependence):
            self.translations.update(component.translations if component else {})


class _Source:
    def __init__(self, **parameters: Any) -> None:
        parameters.pop("rng", None)
        times = np.asarray(parameters.get("times", ()), dtype=float)
        if np.any(np.diff(times, prepend=-np.finfo(float).tiny) <= 0) or np.any(times < 0):
            raise ValueError("Step current timestamps should be monotonically increasing, and not negative.")
        space = ParameterSpace(self.default_parameters, self.get_schema(), shape=(1,))  # type: ignore[attr-defined]
        space.update(**parameters)
        object.__setattr__(self, "_kept", space)

    def inject_into(self, cells: Any) -> None:
        """Keep which neurons receive it."""
        if any(not cell.celltype.injectable for cell in cells):
            raise TypeError("Can't inject current into a spike source.")
        SESSION.changed("a current is injected")
        SESSION.experiment.currents.append((self, [int(cell) for cell in cells], SESSION.where()))

    def set_native_parameters(self, parameters: Any) -> None:
        """Change its parameters."""
        SESSION.changed("a current is changed")
        self._kept.update(**dict(parameters.items()))  # type: ignore[attr-defined]

    def get_native_parameters(self) -> Any:
        """Its parameters."""
        return self._kept  # type: ignore[attr-defined]

    def record(self) -> None:
        """Record nothing."""

    def _get_data(self) -> tuple[Any, Any]:
        SESSION.read = True
        times = np.arange(min(MOST_SAMPLES, round(STATE.t / STATE.dt) + 1)) * STATE.dt
        return times, np.zeros(times.size)

    def values(self) -> dict[str, Any]:
        """Its parameters, numbers and arrays."""
        space = deepcopy(self._kept)  # type: ignore[attr-defined]  # evaluated ones cannot be evaluated again
        space.evaluate(simplify=True)
        return {name: getattr(value, "value", value) for name, value in space.as_dict().items()}


SOURCES = {
    name: _as_it_is(type(name, (_Source, kind), {}))
    for name, kind in _standard(electrodes, standardmodels.StandardCurrentSource).items()
}
