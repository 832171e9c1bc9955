"""What tests of the drone share."""

from collections.abc import Callable
from typing import Any

from neuro_drone.scenario import load

SHORT = load("A60", **{"task": {"ball": {"lap": 1.5, "speed": 0.15}}})
"""A lap of 500 steps."""


def stop_at(step: int) -> Callable[[Any], None]:
    """A report that ends a training as Ctrl-C does."""

    def report(progress: Any) -> None:
        if progress.step >= step:
            raise KeyboardInterrupt

    return report
