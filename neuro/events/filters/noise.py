"""Events that nothing in the scene made."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from neuro.core.keyed_random import key
from neuro.events._events import Events
from neuro.events.filters._filter import Filter, FilterError, State

MOST = 1 << 28
"""Noise events that may be asked of one part; they take 6 GB."""


@dataclass(frozen=True, eq=False)
class ShotNoise(Filter):
    """Add events at random times and pixels, ON and OFF alike, from the first event of a recording to its last.

    The noise is a Poisson process; what it does at a time depends on the seed, the sensor, the rate and that time only,
    so a recording that is read from the middle gets the same noise there. It comes before other events of its time.

    Attributes:
        rate_hz: noise events of each pixel, Hz.
        seed: of the noise, not negative.

    Source: shot noise as independent Poisson events per pixel, Hu, Liu, Delbruck, v2e, CVPR Workshops 2021,
        section 3.
    """

    word = "noise"
    rate_hz: float = 0.1
    seed: int = 0

    def _check(self) -> None:
        self._expect_positive("rate_hz", " Hz")
        self._expect_whole("seed", 0)

    def _fresh(self) -> State:
        return (None,)

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._noise_kernel import merge, sprinkle

        (done,) = self._state
        first = int(events.t[0]) if done is None else done + 1
        last = int(events.t[-1])
        width, height = self.sensor_size
        mean_us = 1e6 / (self.rate_hz * width * height)
        room = self._room(last - first + 1, mean_us)
        t, pixel, p = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.uint8)
        n = sprinkle(first, last, np.uint64(key(self.seed, "events", "noise")), mean_us, width * height, t, pixel, p)
        out = tuple(np.empty(n + len(events), a.dtype) for a in (events.t, events.x, events.y, events.p))
        merge(t[:n], pixel[:n], p[:n], width, events.t, events.x, events.y, events.p, *out)
        self._hold(last)
        return self._of(events, out)

    def _room(self, span_us: int, mean_us: float) -> int:
        """Room for the noise; 12 standard deviations more than expected do not happen."""
        expected = span_us / mean_us
        if expected > MOST:
            raise FilterError(
                f"ShotNoise: {span_us} us would get {expected:.3g} noise events, expected at most {MOST} in one part; "
                "cut the recording, or look for a jump in its times"
            )
        return int(expected + 12 * sqrt(expected) + 64)
