"""Methods that make a vector of a recording and read classes from it: no network, and nothing learnt on the way."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.apps import part
from neuro.events import Events
from neuro_recognise.method import Answer, Course, Learnt, Method
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.shown import Evidence, Features, Floats


@dataclass(frozen=True)
class Descriptor(Method):
    """Base of these methods.

    Attributes:
        readout: separates classes.
    """

    needs = "recognise"
    by_moment = True

    readout: Readout = part(Readout, Svm())

    @abstractmethod
    def describe(self, events: Events) -> Floats:
        """(values,) of a recording that lies inside the field."""

    def observing(self) -> Mapping[str, Any]:
        """All but the readout."""
        return {name: value for name, value in self.as_words().items() if name != "readout"}

    def observe(self, events: Events) -> Evidence:
        """The vector."""
        return {"vector": self.describe(self.inside(events)).astype(np.float32)}

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Teach the readout."""
        return self.readout.fit(_vectors(shown), shown.labels, len(shown.classes), course)

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """Ask the readout; a recording without events is silent."""
        x = _vectors(shown)
        scores = self.readout.scores(learnt, x)
        return Answer(np.where(x.any(axis=1, keepdims=True), scores, np.nan))


def _vectors(shown: Features) -> Floats:
    return shown.stacked("vector").astype(np.float64)
