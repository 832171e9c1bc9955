"""A trained controller and its file.

```
/            attributes: format "neuro drone model 2", controller, seed, steps and episode, settings and scenario
             (JSON), and the versions of neuro, python, numpy and numba
/learnt      learnt arrays of the controller; for a network the weights of each projection that learns
/world       groups, learnt arrays of the encoders and teachers of the network's world, if there are any
/history     arrays, one value per episode of the training: returns, lengths, steps
/curve       arrays, one value per test during the training: steps, error_px, lost
/network     the files of the network before learning, if the controller has one
```
"""

from __future__ import annotations

import hashlib
import json
import platform
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

import neuro
from neuro.apps import hdf5, provenance, record_input
from neuro_drone.controllers import kind_of, make
from neuro_drone.controllers.pilot import BLOCK, loop_of
from neuro_drone.controllers.spiking import Spiking
from neuro_drone.scenario import Scenario

FORMAT = "neuro drone model 2"
_NETWORK = "network.yaml"
_GROUPS = ("learnt", "history", "network", "curve")
Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The result of a training, with everything that a test needs.

    Attributes:
        controller: name of the controller.
        scenario: scenario of the training.
        seed: seed of the training.
        steps: steps of the training.
        episode: longest episode of the training, steps.
        settings: all settings of the controller; for a network also its changed parameters.
        learnt: learnt arrays, see `Learner.learnt`.
        history: returns, lengths and steps, (episodes,) each, see `neuro.Log`.
        network: files of the network before learning, by name; empty for other controllers.
        curve: steps of the training, error_px with frozen weights, and lost flights, (tests,) each, see `train.Curve`.
        world: learnt arrays of the encoders and teachers of the network's world, by name.
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
    world: Mapping[str, Arrays] = field(default_factory=dict)

    def training_arguments(self) -> dict[str, Any]:
        """Return the arguments of the training as plain data, without `steps`, and with a hash of the network."""
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

    def make_controller(self, scenario: Scenario) -> Any:
        """Return the controller before learning, made with the stored settings for a scenario."""
        settings = dict(self.settings)
        if self.network:
            own_settings = kind_of(self.controller).settings.own()
            settings = {name: settings[name] for name in settings.keys() & own_settings.keys()}
            # the stored network already has its parameters and initial weights
            settings |= {"network": unpack_network(self.network), "start": "equal"}
        return make(self.controller, scenario, self.seed, settings)

    def loop(
        self,
        env: gymnasium.Env[Any, Any],
        *,
        learns: bool = False,
        backend: str = "event",
        record: bool = False,
        block: int | None = None,
    ) -> neuro.ClosedLoop:
        """Return the closed loop in which the trained controller flies.

        Args:
            env: a `DroneEnv`, possibly wrapped. Its scenario may differ from that of the training.
            learns: True keeps learning, on the backend of the training, if the controller learns.
            backend: backend of a spiking network that does not learn.
            record: True records the spikes of a network.
            block: control steps per block; default the value of the network's world.

        Raises:
            ModelError: the network does not fit the scenario, or the backend refuses it.
        """
        scenario: Scenario = env.unwrapped.scenario  # type: ignore[attr-defined]  # a DroneEnv, see env
        learns, controller = learns and kind_of(self.controller).learns, self.make_controller(scenario)
        if isinstance(controller, Spiking):
            return self._network_loop(controller, env, learns, backend, record, block)
        if self.learnt:
            controller.restore(self.learnt)
            controller = controller if learns else controller.frozen()
        return loop_of(controller, env, seed=self.seed, learns=learns, block=block or BLOCK)

    def _network_loop(
        self, controller: Spiking, env: Any, learns: bool, backend: str, record: bool, block: int | None
    ) -> neuro.ClosedLoop:
        options: dict[str, Any] = {"seed": self.seed, "record": record, "block": block}
        trained = controller.loop(env, **options)
        if self.learnt:
            trained.pilot.put({"learnt": self.learnt, **self.world})
        if learns:
            return trained
        frozen = neuro.closed_loop(trained.network(frozen=True), env, backend=backend, learns=False, **options)
        frozen.pilot.put({"learnt": {}, **self.world})
        return frozen

    def save(self, path: Path) -> None:
        """Write the model to a file. An existing model file is replaced once the new one is complete.

        Raises:
            ModelError: the file cannot be written, or exists and is no model.
        """
        with hdf5.writing(
            path, FORMAT, record=provenance(seed=self.seed, network=self.training_arguments()["network"])
        ) as file:
            for name in ("controller", "seed", "steps", "episode"):
                file.attrs[name] = getattr(self, name)
            file.attrs["settings"] = json.dumps(dict(self.settings))
            file.attrs["scenario"] = json.dumps(self.scenario.as_words())
            file.attrs.update({"python": platform.python_version(), "neuro": neuro.__version__})
            file.attrs.update({name: version(name) for name in ("numpy", "numba")})
            for group in _GROUPS:
                hdf5.put(file, group, getattr(self, group))
            for name, arrays in self.world.items():
                hdf5.put(file, f"world/{name}", arrays)

    @classmethod
    def load(cls, path: Path) -> Model:
        """Read a model from a file.

        Raises:
            ModelError: the file is missing, damaged, or no model.
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
                **{group: hdf5.take(file, group) for group in _GROUPS},
                world={name: hdf5.take(file["world"], name) for name in file.get("world", ())},
            )


def pack_network(net: neuro.Network) -> dict[str, npt.NDArray[np.uint8]]:
    """Return the files of a saved network by name, as bytes: the YAML file and its data files."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / _NETWORK)
        return {file.name: np.fromfile(file, np.uint8) for file in sorted(Path(folder).iterdir())}


def unpack_network(files: Arrays) -> neuro.Network:
    """Load a network from the result of `pack_network`."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            data.tofile(Path(folder) / Path(name).name)
        net = neuro.load(Path(folder) / _NETWORK)
    net.world_origin = None  # the file is temporary, so errors must not name it
    return net
