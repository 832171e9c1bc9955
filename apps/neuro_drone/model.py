"""A trained controller in one file.

```
/            attributes: format "neuro drone model 1", controller, seed, steps and episode, settings and scenario
             (JSON), and the versions of neuro, python, numpy and numba
/learnt      arrays, what the controller has learnt: of a network the weights of each projection
/history     arrays, one value an episode of the training: steps, error_px, lost
/curve       arrays, one value a test along the training: steps, error_px, lost; older files have none
/network     the files of the network before learning, if the controller has one
```
"""

from __future__ import annotations

import hashlib
import json
import platform
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import hdf5, provenance, record_input
from neuro_drone.controllers import Controller, Learner, kind_of, make
from neuro_drone.scenario import Scenario

FORMAT = "neuro drone model 1"
_NETWORK = "network.yaml"
_GROUPS = ("learnt", "history", "network", "curve")
Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """What training gives, and all that testing needs.

    Attributes:
        controller: its name.
        scenario: that it was trained in.
        seed: of the training.
        steps: of the training.
        episode: most steps of one.
        settings: of the controller, all of them; of a network also the parameters that were set.
        learnt: arrays, see `Learner.learnt`.
        history: (episodes,) each: steps, error_px (mean of the episode) and lost (whether the target was).
        network: files of the network before learning by name, or none.
        curve: (tests,) each: steps of the training, error_px with frozen weights and lost, see `Curve`.
    """

    controller: str
    scenario: Scenario
    seed: int
    steps: int
    episode: int
    settings: Mapping[str, Any] = field(default_factory=dict)
    learnt: Arrays = field(default_factory=dict)
    history: Arrays = field(default_factory=dict)
    network: Arrays = field(default_factory=dict)
    curve: Arrays = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """The arguments of the training without its steps, as plain data; the network as a hash."""
        digest = hashlib.blake2b(digest_size=16)
        for name in sorted(self.network):
            digest.update(name.encode() + self.network[name].tobytes())
        return {
            "controller": self.controller,
            "scenario": self.scenario.as_words(),
            "seed": self.seed,
            "episode": self.episode,
            "settings": dict(self.settings),
            "network": digest.hexdigest(),
        }

    def trained(self, steps: int, learnt: Arrays, history: Arrays, curve: Arrays) -> Model:
        """The same with what came of a training."""
        return replace(self, steps=steps, learnt=learnt, history=history, curve=curve)

    def learner(self, scenario: Scenario | None = None) -> Controller:
        """The controller with what it has learnt; if it can learn, it goes on.

        Args:
            scenario: another one than that of the training.
        """
        settings = dict(self.settings)
        if self.network:
            own = kind_of(self.controller).settings.own()
            settings = {name: settings[name] for name in settings.keys() & own.keys()} | {
                "network": unpacked(self.network)
            }
        made = make(self.controller, scenario or self.scenario, self.seed, settings)
        if isinstance(made, Learner):
            made.restore(self.learnt)
        return made

    def frozen(self, scenario: Scenario | None = None, backend: str = "event") -> Controller:
        """The controller with what it has learnt, which learns no more.

        Args:
            scenario: another one than that of the training.
            backend: what runs it, if it is a spiking network.
        """
        with warnings.catch_warnings(action="ignore", category=neuro.ApproximationWarning):  # of learning
            made = self.learner(scenario)
        return made.frozen(backend) if isinstance(made, Learner) else made

    def save(self, path: Path) -> None:
        """Write the file; another model of that name is replaced once the new one is complete.

        Raises:
            ModelError: it cannot be written, or something else has that name.
        """
        with hdf5.writing(path, FORMAT, record=provenance(seed=self.seed, network=self.told()["network"])) as file:
            for name in ("controller", "seed", "steps", "episode"):
                file.attrs[name] = getattr(self, name)
            file.attrs["settings"] = json.dumps(dict(self.settings))
            file.attrs["scenario"] = json.dumps(self.scenario.as_words())
            file.attrs.update({"python": platform.python_version(), "neuro": neuro.__version__})
            file.attrs.update({name: version(name) for name in ("numpy", "numba")})
            for group in _GROUPS:
                hdf5.put(file, group, getattr(self, group))

    @classmethod
    def load(cls, path: Path) -> Model:
        """Read a file.

        Raises:
            ModelError: there is no such file, it is something else, or damaged.
        """
        with hdf5.reading(path, FORMAT) as file:
            record_input(path)
            return cls(
                str(file.attrs["controller"]),
                Scenario.from_words(json.loads(file.attrs["scenario"])),
                int(file.attrs["seed"]),
                int(file.attrs["steps"]),
                int(file.attrs["episode"]),
                json.loads(file.attrs["settings"]),
                *(hdf5.take(file, group) if group in file else {} for group in _GROUPS),
            )


def packed(net: neuro.Network) -> dict[str, npt.NDArray[np.uint8]]:
    """The files of a network by name, as bytes: YAML, and what it keeps beside it."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / _NETWORK)
        return {file.name: np.fromfile(file, np.uint8) for file in sorted(Path(folder).iterdir())}


def unpacked(files: Arrays) -> neuro.Network:
    """The network that `packed` took."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            data.tofile(Path(folder) / Path(name).name)
        return neuro.load(Path(folder) / _NETWORK)
