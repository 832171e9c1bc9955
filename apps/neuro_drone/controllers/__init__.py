"""The controllers of the drone behind one interface, by name.

`CONTROLLERS` is the table. A new controller is a class with the methods of `Controller` (of `Learner` if it learns), a
frozen dataclass of settings, and one row.
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
    """A controller that flies the drone."""

    def begin(self) -> None:
        """Begin an episode."""

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> npt.NDArray[np.float64]:
        """Return the action.

        Args:
            counts: (8, 8) events of the last step in each field of the picture.
            info: the environment's `info`; only the oracle uses it.

        Returns:
            (axes,) in [-1, 1]: right, down the picture, and up; along a line right and turn right.
        """

    def learn(self, info: Mapping[str, Any]) -> None:
        """Learn from the result of the last action.

        Args:
            info: the environment's `info`; `info["supervised_error"]` is the signed error on each axis, in [-1, 1].
        """


@runtime_checkable
class Learner(Controller, Protocol):
    """A controller that learns."""

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Return the learnt arrays for the model file."""

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the state for a checkpoint, from which learning continues bit for bit."""

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore the result of `learnt` or `state`."""

    def frozen(self) -> Controller:
        """Return a copy that does not learn, so that no episode depends on an earlier one."""


ERROR, REWARD, ORACLE, NOBODY = "the error", "the reward", "the oracle", "-"
"""Teachers of controllers: the supervised error, the reward, the oracle, and no teacher."""


@dataclass(frozen=True, slots=True)
class ControllerKind:
    """A row of the table.

    Attributes:
        what: description for lists.
        maker: class or function of scenario, seed and settings.
        settings: default settings.
        taught: teacher: `ERROR`, `REWARD`, `ORACLE` or `NOBODY`.
    """

    what: str
    maker: Callable[[Scenario, int, Any], Controller | Spiking]
    settings: ControllerSettings
    taught: str = ERROR

    @property
    def learns(self) -> bool:
        """Return whether the controller is trained."""
        return self.taught != NOBODY


CONTROLLERS: dict[str, ControllerKind] = {
    "nothing": ControllerKind("never moves", Nothing, NothingSettings(), taught=NOBODY),
    "oracle": ControllerKind(
        "proportional to the true error, which no other controller sees", Oracle, Gain(), taught=NOBODY
    ),
    "centroid": ControllerKind("proportional to the mean position of the events", Centroid, Gain(), taught=NOBODY),
    "static": ControllerKind("the network with weights by side", Spiking, SpikingSettings(start="sign"), taught=NOBODY),
    "static-linear": ControllerKind(
        "the network with weights by distance", Spiking, SpikingSettings(start="linear"), taught=NOBODY
    ),
    "lms": ControllerKind("linear in the counts, trained on the same error by least mean squares", LMS, LMSSettings()),
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
    "ppo": ControllerKind("deep reinforcement learning of a stochastic policy", PPO, PPOSettings(), taught=REWARD),
    "clone": ControllerKind("imitates the oracle: behavioural cloning", Imitation, ImitationSettings(), taught=ORACLE),
    "dagger": ControllerKind(
        "imitates the oracle also on its own flights: DAgger",
        Imitation,
        ImitationSettings(expert=0.5),
        taught=ORACLE,
    ),
    "random-search": ControllerKind(
        "linear in the centroid, weights by random search",
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
"""Defaults that differ for a line, by class of the controller. `spiking.LINE` has those of the spiking network."""


HEIGHT: dict[Any, dict[str, Any]] = {
    Oracle: {"gain": 4.0},
    Centroid: {"gain": (8.0, 2.0, 1.0)},
    Imitation: {"gain": 4.0},
}
"""Defaults that differ for a drone that also climbs, by class of the controller.

Climbing moves the ball's picture down, and flying forward makes the picture taller, so gains that suit a single axis
make both oscillate.
"""


def make(name: str, scenario: Scenario, seed: int = 0, settings: Mapping[str, Any] | None = None) -> Any:
    """Return a controller before learning: a `Controller`, or a `Spiking` network.

    Args:
        name: a name of `CONTROLLERS`.
        scenario: scenario of the flights.
        seed: seed of everything random in the controller.
        settings: changed settings by name. A spiking network also has the parameters of its file as settings.

    Raises:
        ModelError: there is no such controller or setting, or a value is out of its range.
    """
    kind = kind_of(name)
    if scenario.axes == 3 and isinstance(kind.maker, type) and issubclass(kind.maker, Deep):
        raise ModelError(f"controller '{name}' has two axes: expected a scenario with task.ball.axes = 2")
    return kind.maker(scenario, seed, _settings(name, scenario, settings or {}))


def settings_of(name: str, scenario: Scenario, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return all settings of a controller, with defaults, as plain data.

    A model stores the settings, so later changes of the defaults do not change its flight.

    Args:
        name: a name of `CONTROLLERS`.
        scenario: scenario of the flights.
        settings: changed settings, as for `make`. The result does not contain a `Network` object.

    Raises:
        ModelError: see `make`.
    """
    return _settings(name, scenario, settings).as_words()


def _settings(name: str, scenario: Scenario, settings: Mapping[str, Any]) -> ControllerSettings:
    kind = kind_of(name)
    defaults = LINE if isinstance(scenario.task, Line) else HEIGHT if scenario.axes == 3 else {}
    return replace(kind.settings, name=name).changed({**defaults.get(kind.maker, {}), **settings})


def kind_of(name: str) -> ControllerKind:
    """Return the row of a controller.

    Raises:
        ModelError: there is no such controller.
    """
    if name not in CONTROLLERS:
        raise unknown("controller", name, CONTROLLERS)
    return CONTROLLERS[name]
