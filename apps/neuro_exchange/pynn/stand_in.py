"""Replacements of PyNN's simulators while a script runs, which store the parts that the script builds.

Results have no spikes. The classes are subclasses of PyNN's common classes, so names, checks, connectors and random
numbers are PyNN's. A name without a counterpart gives a part that accepts every call. Each call adds a problem for
the calling line, and the script continues, so that all problems are found. Only the process of the script imports this
module, see `confined`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

import pyNN
from pyNN import common, connectors, core, errors, random, space, standardmodels, utility
from pyNN.network import Network
from pyNN.utility import script_tools

from neuro_exchange.pynn.parts import Assembly, Population, PopulationView, Projection
from neuro_exchange.pynn.session import SESSION, SIMULATOR, end, reset, run, run_until, setup
from neuro_exchange.pynn.standard import (
    CELLS,
    DEPENDENCES,
    SOURCES,
    SPINNAKER_EXTRAS,
    SYNAPSES,
    Absent,
    STDPMechanism,
    converted,
    spinnaker_names,
)


def list_standard_models() -> list[str]:
    """Return the names of the cells."""
    return list(CELLS)


def public_names() -> dict[str, Any]:
    """Return the parts of PyNN's module for a simulator by name."""
    queries = common.build_state_queries(SIMULATOR)
    names = ("get_current_time", "get_time_step", "get_min_delay", "get_max_delay", "num_processes", "rank")
    kinds = {name: kind for name, kind in vars(connectors).items() if name.endswith("Connector")}
    parts = (
        *(setup, end, run, run_until, reset, list_standard_models),
        *(STDPMechanism, Population, PopulationView, Assembly, Projection),
    )
    return {
        **kinds,
        **{part.__name__: part for part in parts},
        **dict(zip(names, queries, strict=True)),
        **{"run_for": run, "initialize": common.initialize, "set": common.set},
        "create": common.build_create(Population),
        "connect": common.build_connect(Projection, connectors.FixedProbabilityConnector, SYNAPSES["StaticSynapse"]),
        "record": (record := common.build_record(SIMULATOR)),
        "record_v": lambda source, filename: record(["v"], source, filename),
        "record_gsyn": lambda source, filename: record(["gsyn_exc", "gsyn_inh"], source, filename),
        **CELLS,
        **SYNAPSES,
        **DEPENDENCES,
        **SOURCES,
        **{"space": space, "random": random, "errors": errors, "core": core, "Space": space.Space},
        **{"NumpyRNG": random.NumpyRNG, "GSLRNG": random.GSLRNG, "RandomDistribution": random.RandomDistribution},
        **{"NativeRNG": random.NumpyRNG, "StandardCellType": standardmodels.StandardCellType},
        **{"Line": space.Line, "Grid2D": space.Grid2D, "Grid3D": space.Grid3D},
        **{"state": SESSION, "Network": Network},
    }


_GENERAL = (
    *("common", "connectors", "core", "descriptions", "errors", "models", "morphology", "network", "parameters"),
    *("random", "recording", "serialization", "space", "standardmodels", "utility"),
)
"""Modules of PyNN that all simulators share."""
_SPINNAKER = ("spynnaker", "spynnaker7", "spynnaker8", "pynn_spinnaker", "spinn_front_end_common", "spinn_utilities")
_OTHERS = ("pynn_genn", "pynn_brainscales", "pynn_brainscales2")
_SIMULATORS = ("nest", "neuron", "brian", "brian2", "arbor", "moose", "nengo", "pygenn")
"""Packages that a script must not import: the networks that they build are not recorded."""


def _no_operation(*args: Any, **options: Any) -> None:
    """Replacement of functions that place neurons on a machine."""


class Simulator(ModuleType):
    """Replacement of a simulator's module. Names without a counterpart are `Absent`."""

    __path__: list[str] = []
    spinnaker = False

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        if "neo_convertor" in self.__name__:
            return converted(name)
        if self.spinnaker and name == "neo_convertor":
            return import_module(f"{self.__name__}.{name}")
        if self.spinnaker and name in SPINNAKER_EXTRAS:
            return self
        if self.spinnaker and name.startswith(("set_", "add_", "get_", "activate_", "extract_")):
            SESSION.note(f"{name} is ignored: it concerns only the machine")
            return _no_operation
        if self.spinnaker and name == "name":
            return lambda: "neuro"
        return Absent(f"{self.__name__}.{name}")


class Finder(MetaPathFinder, Loader):
    """Import hook that finds the replacements before Python finds a simulator."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a replacement, or None for all other modules.

        Raises:
            ImportError: the module is a simulator's own package.
        """
        first, _, submodule = fullname.partition(".")
        if first in _SIMULATORS:
            raise ImportError(f"'{first}' is imported directly, and its networks cannot be recorded", name=fullname)
        is_backend = first == "pyNN" and submodule.partition(".")[0] not in ("", *_GENERAL)
        is_replaced = first in (*_SPINNAKER, *_OTHERS) or is_backend
        return ModuleSpec(fullname, self, is_package=True) if is_replaced else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Create the replacement of a module."""
        module = Simulator(spec.name)
        module.spinnaker = "spinnaker" in spec.name.lower() or "spynnaker" in spec.name
        vars(module).update(public_names())
        if module.spinnaker:
            vars(module).update(spinnaker_names())
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Register that a script imports sPyNNaker."""
        if isinstance(module, Simulator) and module.spinnaker:
            SESSION.written_for_spinnaker()


def _get_simulator(*arguments: Any) -> Any:
    """PyNN's `get_simulator`. A missing argument gets the first of the choices that its help names."""
    required = [argument for argument in arguments if not argument[0].startswith("-") and len(argument) == 2]
    for name, text in required[len(sys.argv) - 2 :] if len(sys.argv) > 1 else []:
        choices = re.search(r"either (\w+) or \w+", text)
        if choices is None:
            break
        sys.argv.append(choices[1])
        SESSION.note(f"argument '{name}' is missing: assuming '{choices[1]}' ({text})")
    return _pynn_get_simulator(*arguments)


_pynn_get_simulator = script_tools.get_simulator


def install() -> None:
    """Let imports of PyNN's simulators find the replacements from now on."""
    for name in [name for name in sys.modules if name.startswith("pyNN.mock")]:
        del sys.modules[name]
    if hasattr(pyNN, "mock"):
        del pyNN.mock
    sys.meta_path.insert(0, Finder())
    utility.get_simulator = script_tools.get_simulator = _get_simulator
