"""A trained controller in one file.

```
/            attributes: format "neuro drone model 2", controller, seed, steps and episode, settings and scenario
             (JSON), and the versions of neuro, python, numpy and numba
/learnt      arrays, what the controller has learnt: of a network the weights of each projection that learns
/world       groups, what the encoders and teachers of the network's world have learnt, if that is anything
/history     arrays, one value an episode of the training: returns, lengths, steps
/curve       arrays, one value a test along the training: steps, error_px, lost
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
    """What training gives, and all that testing needs.

    Attributes:
        controller: its name.
        scenario: that it was trained in.
        seed: of the training.
        steps: of the training.
        episode: most steps of one.
        settings: of the controller, all of them; of a network also the parameters that were set.
        learnt: arrays, see `Learner.learnt`.
        history: (episodes,) each: returns, lengths and steps, see `neuro.Log`.
        network: files of the network before learning by name, or none.
        curve: (tests,) each: steps of the training, error_px with frozen weights and lost, see `Curve`.
        world: what encoders and teachers of the network's world have learnt, by name.
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

    def made(self, scenario: Scenario) -> Any:
        """Return the controller of `make` before learning, for a scenario."""
        settings = dict(self.settings)
        if self.network:
            own = kind_of(self.controller).settings.own()
            settings = {name: settings[name] for name in settings.keys() & own.keys()}
            settings |= {"network": unpacked(self.network), "start": "equal"}
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
        """Return the closed loop in which the controller flies, with what it has learnt.

        Args:
            env: a `DroneEnv`, perhaps wrapped, whose scenario may be another than that of the training.
            learns: whether it goes on learning, if it can, on what it learnt on.
            backend: what runs a spiking network that learns no more.
            record: whether spikes of a network are kept.
            block: control steps of a block, in place of those of the network's world.

        Raises:
            ModelError: the network does not fit the scenario, or the backend refuses it.
        """
        scenario: Scenario = env.unwrapped.scenario  # type: ignore[attr-defined]  # as said above
        learns, made = learns and kind_of(self.controller).learns, self.made(scenario)
        if isinstance(made, Spiking):
            return self._network_loop(made, env, learns, backend, record, block)
        if self.learnt:
            made.restore(self.learnt)
            made = made if learns else made.frozen()
        return loop_of(made, env, seed=self.seed, learns=learns, block=block or BLOCK)

    def _network_loop(
        self, made: Spiking, env: Any, learns: bool, backend: str, record: bool, block: int | None
    ) -> neuro.ClosedLoop:
        words: dict[str, Any] = {"seed": self.seed, "record": record, "block": block}
        trained = made.loop(env, **words)
        if self.learnt:
            trained.pilot.put({"learnt": self.learnt, **self.world})
        if learns:
            return trained
        frozen = neuro.closed_loop(trained.network(frozen=True), env, backend=backend, learns=False, **words)
        frozen.pilot.put({"learnt": {}, **self.world})
        return frozen

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
            for name, arrays in self.world.items():
                hdf5.put(file, f"world/{name}", arrays)

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
                **{group: hdf5.take(file, group) for group in _GROUPS},
                world={name: hdf5.take(file["world"], name) for name in file.get("world", ())},
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
        net = neuro.load(Path(folder) / _NETWORK)
    net.world_origin = None  # what is wrong with its world is not in that file
    return net
