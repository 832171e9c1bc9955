"""Events of one polarity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import Sieve


@dataclass(frozen=True, eq=False)
class Polarity(Sieve):
    """Keep ON or OFF events.

    Attributes:
        keep: 1 = ON, 0 = OFF.
    """

    word = "polarity"
    keep: int = 1

    def _check(self) -> None:
        self._expect(self.keep in (0, 1), "keep", self.keep, "1 (ON) or 0 (OFF)")

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        np.equal(events.p, np.uint8(self.keep), out=keep)
