"""What passes between the layers of HFirst."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


class LayerSpikes(NamedTuple):
    """Spikes of one population in order of time: times in ms from the start of the network's time, and neurons."""

    times: Floats
    ids: Ints


class LayerResponse(NamedTuple):
    """What layer S2 did with the C1 spikes of a recording.

    Attributes:
        spikes: its spikes; neurons are classes.
        potentials: (C1 spikes, classes) V_m after each C1 spike, mV.
    """

    spikes: LayerSpikes
    potentials: Floats
