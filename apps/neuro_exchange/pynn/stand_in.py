"""Modules that stand for the simulators of PyNN while a script runs: each keeps what the script builds.

They answer as if no neuron had fired. Their classes are subclasses of PyNN's own common classes, so names, checks,
connectors and random numbers are PyNN's. A name that has no counterpart gives a part that accepts everything and is a
problem of the line that uses it, so that a script goes on and all its problems are found. Only the process of the
script imports this module, see `confined`.
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
    """Names of the cells."""
    return list(CELLS)


def public_names() -> dict[str, Any]:
    """What a module of PyNN for one simulator offers, by name."""
    queries = common.build_state_queries(SIMULATOR)
    words = ("get_current_time", "get_time_step", "get_min_delay", "get_max_delay", "num_processes", "rank")
    kinds = {name: kind for name, kind in vars(connectors).items() if name.endswith("Connector")}
    ours = (
        *(setup, end, run, run_until, reset, list_standard_models),
        *(STDPMechanism, Population, PopulationView, Assembly, Projection),
    )
    return {
        **kinds,
        **{one.__name__: one for one in ours},
        **dict(zip(words, queries, strict=True)),
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
"""Modules of PyNN that belong to no simulator."""
_SPINNAKER = ("spynnaker", "spynnaker7", "spynnaker8", "pynn_spinnaker", "spinn_front_end_common", "spinn_utilities")
_OTHERS = ("pynn_genn", "pynn_brainscales", "pynn_brainscales2")
_SIMULATORS = ("nest", "neuron", "brian", "brian2", "arbor", "moose", "nengo", "pygenn")
"""Packages that a script must not use beside PyNN: what they build is not seen."""


def _nothing(*args: Any, **words: Any) -> None:
    """Stands for what places neurons on a machine."""


class Simulator(ModuleType):
    """A module of a simulator: the recorder's names, then those that it has not."""

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
            SESSION.note(f"{name} concerns the machine alone and is left out")
            return _nothing
        if self.spinnaker and name == "name":
            return lambda: "neuro"
        return Absent(f"{self.__name__}.{name}")


class Finder(MetaPathFinder, Loader):
    """Finds these modules before Python looks for those of the simulators."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of a module, where it stands for a simulator.

        Raises:
            ImportError: the module is a simulator itself.
        """
        first, _, rest = fullname.partition(".")
        if first in _SIMULATORS:
            raise ImportError(f"'{first}' is used beside PyNN, and what it builds cannot be recorded", name=fullname)
        ours = first in (*_SPINNAKER, *_OTHERS) or (first == "pyNN" and rest.partition(".")[0] not in ("", *_GENERAL))
        return ModuleSpec(fullname, self, is_package=True) if ours else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """A module with the recorder's names."""
        module = Simulator(spec.name)
        module.spinnaker = "spinnaker" in spec.name.lower() or "spynnaker" in spec.name
        vars(module).update(public_names())
        if module.spinnaker:
            vars(module).update(spinnaker_names())
        return module

    def exec_module(self, module: ModuleType) -> None:
        """The script is written for this simulator."""
        if isinstance(module, Simulator) and module.spinnaker:
            SESSION.written_for_spinnaker()


def _get_simulator(*arguments: Any) -> Any:
    """PyNN's, which takes the first of named choices where the user gave no arguments."""
    required = [one for one in arguments if not one[0].startswith("-") and len(one) == 2]
    for name, text in required[len(sys.argv) - 2 :] if len(sys.argv) > 1 else []:
        choices = re.search(r"either (\w+) or \w+", text)
        if choices is None:
            break
        sys.argv.append(choices[1])
        SESSION.note(f"argument '{name}' is '{choices[1]}', since none is given ({text})")
    return _pynn_get_simulator(*arguments)


_pynn_get_simulator = script_tools.get_simulator


def install() -> None:
    """From now on a script that imports a simulator of PyNN gets the recorder."""
    for name in [name for name in sys.modules if name.startswith("pyNN.mock")]:
        del sys.modules[name]
    if hasattr(pyNN, "mock"):
        del pyNN.mock
    sys.meta_path.insert(0, Finder())
    utility.get_simulator = script_tools.get_simulator = _get_simulator
