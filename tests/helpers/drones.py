"""What tests of the drone share."""

from collections.abc import Callable
from typing import Any

from neuro_drone.controllers.pilot import loop_of
from neuro_drone.evaluate import Flights, Lap, Start, fly_lap, reset_arguments
from neuro_drone.scenario import Scenario, load

SHORT = load("A60", **{"task": {"ball": {"lap": 1.5, "speed": 0.15}}})
"""A lap of 500 steps."""


def stop_at(step: int) -> Callable[[Any], None]:
    """A report that ends a training as Ctrl-C does."""

    def report(progress: Any) -> None:
        if progress.step >= step:
            raise KeyboardInterrupt

    return report


def begin_lap(env: Any, start: Start, index: int = 0) -> dict[str, Any]:
    """Begin a lap of the test; gives the environment's info."""
    seed, options = reset_arguments(start, index)
    return env.reset(seed=seed, options=options)[1]


def lap_of(controller: Any, world: Scenario, start: Start, index: int = 0) -> tuple[Lap, Flights]:
    """A lap of a controller, and its environment as it is then."""
    env = Flights(world, [reset_arguments(start, index)])
    return fly_lap(loop_of(controller, env), env, start), env
