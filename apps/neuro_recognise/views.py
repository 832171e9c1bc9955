"""What a method makes of a recording on the way, to look at: pictures, or spikes of trials, each from a time on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from neuro_recognise.shown import Array, Floats, Ints

__all__ = ["Pictures", "TrialView", "View"]


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """Pictures, each shown from its time on until that of the next.

    Attributes:
        name: what they are.
        at_ms: (pictures,) since the first event, ascending.
        images: (pictures, rows, columns), from 0 on; all are drawn on one scale.
        told: a few words on each; none for ().
    """

    name: str
    at_ms: Floats
    images: Array
    told: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class TrialView:
    """Spikes of the trials of a network, each shown from its time on until that of the next.

    Attributes:
        name: whose spikes, e.g. "input spikes of each frame".
        at_ms: (trials,) since the first event of the recording, ascending.
        length_ms: of a trial.
        size: number of neurons.
        offsets: (trials + 1,) trial i has ``times[offsets[i]:offsets[i + 1]]``.
        times: (spikes,) ms, since the beginning of the trial.
        ids: (spikes,) neurons.
        told: a few words on each trial, such as the winner; none for ().
        bands: names of groups of equally many neurons, in the order of their ids; none for ().
    """

    name: str
    at_ms: Floats
    length_ms: float
    size: int
    offsets: Ints
    times: Floats
    ids: Ints
    told: tuple[str, ...] = ()
    bands: tuple[str, ...] = ()


View: TypeAlias = Pictures | TrialView
