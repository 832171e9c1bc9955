"""Conversion between milliseconds and steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, words_of
from neuro.core.quantities import in_ms
from neuro.core.values import shown

NEVER = 2**62
"""Step of an infinite time."""
LARGEST = 2**40
"""Largest time, in steps."""

TOLERANCE = 1e-6
"""Largest distance of a time on the grid from a multiple of the resolution, in steps."""


class Clock:
    """Conversion between times in ms and whole steps.

    Multiples of the resolution are on the grid, and so are times at most a millionth of a step from a multiple. If a
    millisecond is a whole number of steps, `ms` returns the double nearest to the decimal number (3 steps of 0.1 ms are
    0.3 ms).

    Args:
        resolution: length of a step in ms.
    """

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        per_ms = round(1.0 / resolution)
        self._per_ms = float(per_ms) if per_ms >= 1 and abs(per_ms * resolution - 1.0) < 1e-12 else 0.0

    def ms(self, step: int) -> float:
        """Return the time of a step in ms."""
        return step / self._per_ms if self._per_ms else step * self.resolution

    def array_ms(self, steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times of many steps in ms."""
        if self._per_ms:
            return steps / self._per_ms
        return steps.astype(np.float64) * self.resolution

    def floor(self, ms: Any, label: str) -> int:
        """Return the last step at or before a time; -1 or `NEVER` for infinite times.

        Args:
            ms: time as a number, or as text with a unit, e.g. "1 s".
            label: name of the value in the message.

        Raises:
            ModelError: the value is not a time.
        """
        if type(ms) is not float:
            ms = in_ms(ms, label)
        if not is_number(ms) or math.isnan(ms):
            raise ModelError(f"{label} = {shown(ms)}: expected a time in ms", path=words_of(label))
        if not math.isfinite(ms):
            return NEVER if ms > 0 else -1
        return math.floor(float(ms) / self.resolution + TOLERANCE)

    def between(self, since: Any, until: Any) -> tuple[int, int]:
        """Return the last step at or before `since`, and the last at or before `until`. None means no bound.

        Raises:
            ModelError: a value is not a time, or the end is before the begin.
        """
        since_step = -1 if since is None else self.floor(since, "since")
        until_step = NEVER if until is None else self.floor(until, "until")
        if since is not None and until is not None and since_step > until_step:
            message = f"since = {in_ms(since, 'since'):g} ms and until = {in_ms(until, 'until'):g} ms"
            raise ModelError(f"{message}: expected an end after the begin")
        return since_step, until_step

    def floors(self, times: NDArray[np.float64], label: str) -> NDArray[np.int64]:
        """Return the last step at or before each of many finite times.

        Raises:
            ModelError: a time is too late. The message names the first one.
        """
        quotients = times / self.resolution
        self._refuse_long(times, quotients, label)
        return np.floor(quotients + TOLERANCE).astype(np.int64)

    def step(self, ms: Any, label: str) -> int:
        """Return the step of a time that must lie on the grid; `NEVER` for infinity.

        Args:
            ms: time as a number, or as text with a unit, e.g. "1 s".
            label: name of the value in the message, e.g. "duration".

        Raises:
            ModelError: the value is not a time, or lies between two steps. The message names the nearest valid times.
        """
        if type(ms) is not float:
            ms = in_ms(ms, label)
        if not is_number(ms) or math.isnan(ms):
            raise ModelError(f"{label} = {shown(ms)}: expected a time in ms", path=words_of(label))
        quotient = float(ms) / self.resolution
        if math.isinf(float(ms)):
            return NEVER if quotient > 0 else -NEVER
        if abs(quotient) > LARGEST:
            raise self._too_long(float(ms), label)
        step = round(quotient)
        if abs(quotient - step) > TOLERANCE:
            raise self._off_grid(float(ms), label)
        return step

    def steps(self, times: NDArray[np.float64], label: str) -> NDArray[np.int64]:
        """Return the steps of many finite times that must lie on the grid.

        Raises:
            ModelError: a time does not lie on the grid. The message names the first one.
        """
        quotients = times / self.resolution
        self._refuse_long(times, quotients, label)
        steps = np.rint(quotients)
        is_on_grid = np.abs(quotients - steps) <= TOLERANCE
        if not is_on_grid.all():
            bad = int(np.flatnonzero(~is_on_grid.ravel())[0])
            raise self._off_grid(float(times.ravel()[bad]), f"{label}[{bad}]" if times.size > 1 else label)
        return steps.astype(np.int64)

    def _refuse_long(self, times: NDArray[np.float64], quotients: NDArray[np.float64], label: str) -> None:
        too_long = np.flatnonzero(np.isfinite(times.ravel()) & (np.abs(quotients.ravel()) > LARGEST))
        if too_long.size:
            name = f"{label}[{too_long[0]}]" if times.size > 1 else label
            raise self._too_long(float(times.ravel()[too_long[0]]), name)

    def _too_long(self, ms: float, label: str) -> ModelError:
        return ModelError(
            f"{label} = {ms:g} ms: expected at most {self.ms(LARGEST):g} ms, 2^40 steps", path=words_of(label)
        )

    def _off_grid(self, ms: float, label: str) -> ModelError:
        if not math.isfinite(ms):
            return ModelError(f"{label} = {ms}: expected a finite time in ms", path=words_of(label))
        step_below = math.floor(ms / self.resolution)
        nearest = [f"{self.ms(step):.12g}" for step in (step_below, step_below + 1) if step > 0]
        message = f"{label} = {ms:.12g} ms: expected a multiple of the resolution, {self.resolution:g} ms"
        hint = f"the nearest {'is' if len(nearest) == 1 else 'are'} {' or '.join(nearest)} ms" if nearest else ""
        return ModelError(message, hint=hint, path=words_of(label), kind="resolution")
