"""What decides on the actions: all controllers behind one small interface, by name.

`CONTROLLERS` is the table; a new controller is a class with the methods of `Controller` (of `Learner` if it learns), a
frozen dataclass of its settings and one row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import unknown
from neuro_drone.controllers.deep import DDPG, DQN, DDPGSettings, Deep, DQNSettings
from neuro_drone.controllers.imitation import Imitation, ImitationSettings
from neuro_drone.controllers.ppo import PPO, PPOSettings
from neuro_drone.controllers.simple import (
    LMS,
    Centroid,
    ControllerSettings,
    Gain,
    LMSSettings,
    Nothing,
    NothingSettings,
    Oracle,
    RandomSearch,
    RandomSearchSettings,
)
from neuro_drone.controllers.spiking import Spiking, SpikingSettings
from neuro_drone.parts import Line
from neuro_drone.scenario import Scenario

__all__ = ["CONTROLLERS", "Controller", "ControllerKind", "Learner", "make", "settings_of"]


class Controller(Protocol):
    """What flies the drone."""

    def begin(self) -> None:
        """An episode begins."""

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> npt.NDArray[np.float64]:
        """Decide.

        Args:
            counts: (8, 8) events of the last step in each field of the picture.
            info: what the environment gave beside them; only the oracle looks at it.

        Returns:
            (axes,) in [-1, 1]: to the right and down the picture, and up; of a line to the right and turn right.
        """

    def learn(self, info: Mapping[str, Any]) -> None:
        """Hear what the last action led to: `info["supervised_error"]` is the signed error of each axis, in [-1, 1]."""


@runtime_checkable
class Learner(Controller, Protocol):
    """A controller that learns."""

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """What was learnt, for the model file."""

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """All that it takes to go on with learning bit for bit, for a checkpoint."""

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take up what `learnt` or `state` gave."""

    def frozen(self) -> Controller:
        """The same as it is now, without learning; each of its episodes is the same whatever came before."""


ERROR, REWARD, ORACLE, NOBODY = "the error", "the reward", "the oracle", "-"
"""What teaches a controller: the supervised error, which then also steers; the reward alone; the oracle; nothing."""


@dataclass(frozen=True, slots=True)
class ControllerKind:
    """A row of the table.

    Attributes:
        what: it is, for lists.
        maker: class or function of scenario, seed and settings.
        settings: the defaults.
        taught: by what, see `ERROR`, `REWARD`, `ORACLE` and `NOBODY`.
    """

    what: str
    maker: Callable[[Scenario, int, Any], Controller | Spiking]
    settings: ControllerSettings
    taught: str = ERROR

    @property
    def learns(self) -> bool:
        """Return whether the controller is trained at all."""
        return self.taught != NOBODY


CONTROLLERS: dict[str, ControllerKind] = {
    "nothing": ControllerKind("never moves", Nothing, NothingSettings(), taught=NOBODY),
    "oracle": ControllerKind("in proportion to the true error, which no other one sees", Oracle, Gain(), taught=NOBODY),
    "centroid": ControllerKind("in proportion to where the events are on average", Centroid, Gain(), taught=NOBODY),
    "static": ControllerKind("the network with weights by side", Spiking, SpikingSettings(start="sign"), taught=NOBODY),
    "static-linear": ControllerKind(
        "the network with weights by distance", Spiking, SpikingSettings(start="linear"), taught=NOBODY
    ),
    "lms": ControllerKind("linear in the counts, learnt from the same error by least mean squares", LMS, LMSSettings()),
    "snn": ControllerKind("the network, learning by dopamine from equal weights", Spiking, SpikingSettings()),
    "snn-static-init": ControllerKind(
        "the network, learning from weights by side", Spiking, SpikingSettings(start="sign")
    ),
    "snn-eta0": ControllerKind(
        "a check: the network without dopamine", Spiking, SpikingSettings(parameters={"eta": 0.0})
    ),
    "snn-flipped": ControllerKind(
        "a check: the network with dopamine of the wrong sign", Spiking, SpikingSettings(parameters={"eta": -0.1})
    ),
    "snn-loihi": ControllerKind(
        "the network, learning on the emulated Loihi", Spiking, SpikingSettings(backend="loihi")
    ),
    "dqn": ControllerKind("deep reinforcement learning on nine actions", DQN, DQNSettings(), taught=REWARD),
    "ddpg": ControllerKind("deep reinforcement learning on continuous actions", DDPG, DDPGSettings(), taught=REWARD),
    "ppo": ControllerKind("deep reinforcement learning of likely actions", PPO, PPOSettings(), taught=REWARD),
    "clone": ControllerKind(
        "acts as the oracle did, behavioural cloning", Imitation, ImitationSettings(), taught=ORACLE
    ),
    "dagger": ControllerKind(
        "acts as the oracle would where it flew itself",
        Imitation,
        ImitationSettings(expert=0.5),
        taught=ORACLE,
    ),
    "random-search": ControllerKind(
        "linear in the centroid, its weights by random search",
        RandomSearch,
        RandomSearchSettings(),
        taught=REWARD,
    ),
}
"""The controllers by name."""

LINE: dict[Any, dict[str, Any]] = {
    Oracle: {"gain": (8.0, 4.0)},
    LMS: {"gain": (8.0, 4.0), "coding": "rows", "mu": 0.005},
    Imitation: {"gain": (8.0, 4.0), "coding": "rows"},
}
"""Defaults that differ for a line, see `spiking.LINE`."""


HEIGHT: dict[Any, dict[str, Any]] = {
    Oracle: {"gain": 4.0},
    Centroid: {"gain": (8.0, 2.0, 1.0)},
    Imitation: {"gain": 4.0},
}
"""Defaults that differ for a drone that also climbs: a drone that climbs sees the ball further down, and one that flies
forward sees it taller, so that both axes swing with gains that suit one."""


def make(name: str, scenario: Scenario, seed: int = 0, settings: Mapping[str, Any] | None = None) -> Any:
    """A controller before learning: a `Controller`, or a `Spiking` network, which acts as its world says.

    Args:
        name: one of `CONTROLLERS`.
        scenario: what it is going to fly in.
        seed: of everything random in it.
        settings: values by name that differ from its defaults; of a spiking network also the network's parameters.

    Raises:
        ModelError: there is no such controller or setting, or a value is out of its bounds.
    """
    kind = kind_of(name)
    if scenario.axes == 3 and isinstance(kind.maker, type) and issubclass(kind.maker, Deep):
        raise ModelError(f"controller '{name}' has two axes: expected a scenario with task.ball.axes = 2")
    return kind.maker(scenario, seed, _settings(name, scenario, settings or {}))


def settings_of(name: str, scenario: Scenario, settings: Mapping[str, Any]) -> dict[str, Any]:
    """All settings that `make` would take, defaults too, as plain data.

    A model keeps them, so that it flies the same whatever becomes of the defaults.

    Args:
        name: one of `CONTROLLERS`.
        scenario: what it is going to fly in.
        settings: as for `make`; a network that is no name and no file is left out.

    Raises:
        ModelError: as `make`.
    """
    return _settings(name, scenario, settings).as_words()


def _settings(name: str, scenario: Scenario, settings: Mapping[str, Any]) -> ControllerSettings:
    kind = kind_of(name)
    own = LINE if isinstance(scenario.task, Line) else HEIGHT if scenario.axes == 3 else {}
    return replace(kind.settings, name=name).changed({**own.get(kind.maker, {}), **settings})


def kind_of(name: str) -> ControllerKind:
    """The row of a controller.

    Raises:
        ModelError: there is none.
    """
    if name not in CONTROLLERS:
        raise unknown("controller", name, CONTROLLERS)
    return CONTROLLERS[name]
