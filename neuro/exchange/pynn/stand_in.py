"""Modules that stand for the simulators of PyNN while a script runs: each is the recorder.

A name that has no counterpart gives a part that accepts everything and is a problem of the line that uses it, so that a
script goes on and all its problems are found.
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
from pyNN import utility
from pyNN.utility import script_tools

from neuro.exchange.pynn import recorder, spinnaker
from neuro.exchange.pynn.clock import STATE
from neuro.exchange.pynn.session import SESSION
from neuro.exchange.pynn.standard import Absent

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
            return spinnaker.converted(name)
        if self.spinnaker and name == "neo_convertor":
            return import_module(f"{self.__name__}.{name}")
        if self.spinnaker and name in spinnaker.EXTRAS:
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
        vars(module).update(recorder.public_names())
        if module.spinnaker:
            vars(module).update(spinnaker.public_names())
        return module

    def exec_module(self, module: ModuleType) -> None:
        """The script is written for this simulator."""
        if isinstance(module, Simulator) and module.spinnaker:
            STATE.written_for_spinnaker()


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
