"""A controller without a network as what acts in the closed loop."""

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
"""Control steps of a block of training, as of the network `drone`."""
Floats = npt.NDArray[np.float64]


class ControllerPilot:
    """A controller, or one that learns, as the pilot of a `neuro.ClosedLoop` with a single environment.

    Args:
        controller: that acts.

    Attributes:
        controller: as given.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller: Any = controller

    def begin(self, copies: int, block: int) -> None:
        """Begin an episode; one that was cut off by the end of a block is over."""
        self.controller.begin()

    def act(self, observations: Floats, infos: Sequence[Mapping[str, Any]]) -> Floats:
        """Return the action for what the environment said, (1, axes)."""
        (info,) = infos
        action: Floats = self.controller.act(info["counts"], info)
        return action[None]

    def explored(self, observations: Floats, rewards: Sequence[float], returns: Sequence[float]) -> None:
        """Learn nothing from random moves."""

    def teach(self, moment: Moment) -> None:
        """Learn from a control step, or begin the next episode."""
        if moment.last[0]:
            self.controller.begin()
        else:
            self.controller.learn(moment.infos[0])

    def merge(self) -> None:
        """There is one copy."""

    def arrays(self) -> dict[str, Any]:
        """Return what was learnt, and all that it takes to go on."""
        return {"learnt": self.controller.learnt(), "state": self.controller.state()}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Go on from a state, or from what was learnt."""
        self.controller.restore(arrays.get("state", arrays["learnt"]))


def loop_of(controller: Controller, env: Any, *, seed: int = 0, learns: bool = False, block: int = BLOCK) -> ClosedLoop:
    """Return the closed loop in which a controller flies.

    Args:
        controller: that acts.
        env: a `DroneEnv`, perhaps wrapped.
        seed: of episodes.
        learns: whether it learns.
        block: control steps of a block of learning.
    """
    words: dict[str, Any] = {"step": env.unwrapped.scenario.step, "seed": seed, "learns": learns, "block": block}
    return ClosedLoop(ControllerPilot(controller), Environments(env), **words)
