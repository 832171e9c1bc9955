"""What tests of the drone share."""

from collections.abc import Callable
from typing import Any

import pytest

from neuro import ModelError
from neuro_drone.scenario import load

SHORT = load("A60", **{"task": {"ball": {"lap": 1.5, "speed": 0.15}}})
"""A lap of 500 steps."""


def refused(call: Callable[[], Any]) -> str:
    """The message of the error that a call ends with."""
    with pytest.raises(ModelError) as error:
        call()
    return str(error.value)


def stop_at(step: int) -> Callable[[Any], None]:
    """A report that ends a training as Ctrl-C does."""

    def report(progress: Any) -> None:
        if progress.step >= step:
            raise KeyboardInterrupt

    return report
