"""Reading layer S2: which class a recording is, and how sure that is."""

from __future__ import annotations

import numpy as np

from neuro import ModelError
from neuro_recognise.hfirst.spikes import Floats, Heard

READINGS = ("hard", "soft", "potentials")


def scores(heard: Heard, reading: str = "hard") -> Floats:
    """A number for each class, the larger the likelier.

    Args:
        heard: from `s2_heard`.
        reading: "hard": spikes of the class; "soft": its share of all spikes; "potentials": V_m summed over the C1
            spikes, mV.

    Raises:
        ModelError: there is no such reading.
    """
    if reading not in READINGS:
        raise ModelError(f"reading = {reading!r}: expected one of {', '.join(READINGS)}")
    if reading == "potentials":
        return np.asarray(heard.potentials.sum(axis=0))
    counts = np.bincount(heard.spikes.ids, minlength=heard.potentials.shape[1]).astype(np.float64)
    return counts / max(1.0, counts.sum()) if reading == "soft" else counts


def decisive(heard: Heard, reading: str = "hard") -> Floats:
    """The same, but of classes with equal spikes those with larger summed potentials have more, by less than a spike.

    The authors' code takes the first of such classes. Where S2 heard nothing all are NaN.

    Args:
        heard: from `s2_heard`.
        reading: see `scores`.
    """
    found = scores(heard, reading)
    if not len(heard.potentials):
        return np.full_like(found, np.nan)
    if reading == "potentials":
        return found
    ranks = scores(heard, "potentials").argsort().argsort() / len(found)
    return np.asarray(found + ranks / (1 if reading == "hard" else max(1, heard.spikes.ids.size)))


def decide(heard: Heard, reading: str = "hard") -> int:
    """The class of a recording by `decisive`, -1 if S2 heard nothing.

    Args:
        heard: from `s2_heard`.
        reading: see `scores`.
    """
    found = decisive(heard, reading)
    return -1 if np.isnan(found).all() else int(found.argmax())
