"""Spikes of a population that are not listed beforehand: they are asked for while the network runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


class Stretch(NamedTuple):
    """Some spikes by step; with those before, all up to step `until`."""

    until: int
    steps: Ints
    ids: Ints


class Stream(Protocol):
    """Where a population's spikes come from. The caller keeps how far they came, so that many may ask."""

    @property
    def again(self) -> bool:
        """Whether it can be begun several times."""

    @property
    def identity(self) -> str:
        """What tells it from another when a saved state is restored."""

    def after(self, step: int) -> Iterator[Stretch]:
        """All spikes of later steps, in stretches; when they end no more come.

        Raises:
            ModelError: what they are made of is damaged; all spikes before have been given, and a caller that asks
                again for those after the last stretch is told the same.
        """

    def given(self, events: Any) -> tuple[Ints, Ints]:
        """Steps and neurons of what a program gives while the network runs.

        Raises:
            ModelError: it is nothing that can be emitted.
        """
