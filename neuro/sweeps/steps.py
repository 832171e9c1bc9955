"""What a run tells on its way, and how it ends early where a tuning sees that it is worse than others."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from neuro.core.checks import is_number
from neuro.core.errors import ModelError
from neuro.core.values import shown

Worse = Callable[[int, float], bool]
"""Is told a step and its value, and says whether the run is so much worse than others that it is to end."""


class Pruned(Exception):
    """A run ends early: at this step others were better. Raised by `report_step`; to be let through."""


@dataclass
class Heard:
    """What a run has reported.

    Attributes:
        worse: says whether it is to end; None where nothing is pruned.
        steps: value by step.
    """

    worse: Worse | None = None
    steps: dict[str, float] = field(default_factory=dict)


_heard: ContextVar[Heard | None] = ContextVar("heard", default=None)


def report_step(value: float, step: int) -> None:
    """Tell how good a run is so far, so that a tuning which prunes can end it where others were better.

    Called by a function that `neuro.tune` calls, after each epoch say. It does nothing where nothing is pruned, so the
    function runs as well by itself.

    Args:
        value: of the objective, as far as it is known.
        step: of what grows in the run, from 0 on: the epoch; each at most once.

    Raises:
        Pruned: the run is to end. Not an error: let it through.
        ModelError: the value is no finite number, or the step none from 0 on.
    """
    if not is_number(value) or not math.isfinite(value):
        raise ModelError(f"report_step: value = {shown(value)}: expected a finite number")
    if isinstance(step, bool) or not isinstance(step, int) or step < 0:
        raise ModelError(f"report_step: step = {shown(step)}: expected a whole number >= 0")
    heard = _heard.get()
    if heard is None:
        return
    heard.steps[str(step)] = float(value)
    if heard.worse is not None and heard.worse(step, float(value)):
        raise Pruned(f"step {step}: {value:g}")


@contextmanager
def hearing(worse: Worse | None) -> Iterator[Heard]:
    """Gather what is reported inside."""
    heard = Heard(worse)
    token = _heard.set(heard)
    try:
        yield heard
    finally:
        _heard.reset(token)
