"""Adapter of a controller without a network to the closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop
from neuro.apps import Environments, Moment

if TYPE_CHECKING:
    from neuro_drone.controllers import Controller

BLOCK = 10_000
"""Control steps per block of training, the same as in the network `drone`."""
Floats = npt.NDArray[np.float64]


class ControllerPilot:
    """The pilot of a `neuro.ClosedLoop` with a single environment that is flown by a `Controller` or a `Learner`.

    Args:
        controller: the controller.

    Attributes:
        controller: the controller.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller: Any = controller

    def begin(self, copies: int, block: int) -> None:
        """Begin an episode. An episode that the end of a block interrupts is not continued."""
        self.controller.begin()

    def act(self, observations: Floats, infos: Sequence[Mapping[str, Any]]) -> Floats:
        """Return the action for the environment's last `info`, (1, axes)."""
        (info,) = infos
        action: Floats = self.controller.act(info["counts"], info)
        return action[None]

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Ignore random actions; only `teach` learns."""

    def teach(self, moment: Moment) -> None:
        """Learn from a control step, or begin the next episode."""
        if moment.last[0]:
            self.controller.begin()
        else:
            self.controller.learn(moment.infos[0])

    def merge(self) -> None:
        """Do nothing, since there is only one copy."""

    def arrays(self) -> dict[str, Any]:
        """Return the learnt arrays and the state for a checkpoint."""
        return {"learnt": self.controller.learnt(), "state": self.controller.state()}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Restore a state, or learnt arrays if there is none."""
        self.controller.restore(arrays.get("state", arrays["learnt"]))


def loop_of(controller: Controller, env: Any, *, seed: int = 0, learns: bool = False, block: int = BLOCK) -> ClosedLoop:
    """Return the closed loop in which a controller flies.

    Args:
        controller: the controller.
        env: a `DroneEnv`, possibly wrapped.
        seed: seed of the episodes.
        learns: True lets the controller learn.
        block: control steps per block of learning.
    """
    options: dict[str, Any] = {"step": env.unwrapped.scenario.step, "seed": seed, "learns": learns, "block": block}
    return ClosedLoop(ControllerPilot(controller), Environments(env), **options)
