"""Recognise objects in event-camera recordings: train, test, compare and use recognisers by one interface.

from neuro_events import recordings
from neuro_recognise import fit

recogniser = fit(recordings("N-MNIST", part="Train"), "hats", seed=1)
recogniser.predict(recordings("N-MNIST", part="Test", classes=recogniser.classes))
"""

from __future__ import annotations

from neuro_recognise.early import learn_early
from neuro_recognise.recogniser import Recogniser, fit

__all__ = ["Recogniser", "fit", "learn_early"]
