"""Cut a stream of events into pseudo-frames where the motion is, not by the clock."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro.events._arguments import positive
from neuro.events.segmentation._cutter import NONE, Times, bounds


class MSD:
    """A motion symbol detector: a leaky integrate-and-fire neuron that all events reach.

    It adds 1 at every event and decays exponentially in between. When it reaches the threshold, the events since
    the last segment are one segment and the neuron begins at 0.

    Args:
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.

    Raises:
        ModelError: `tau` or `threshold` is not positive.
    """

    def __init__(self, tau: float = 0.02, threshold: float = 150.0) -> None:
        self._tau_us = 1e6 * positive("tau", tau, "s")
        self._threshold = positive("threshold", threshold, "events")
        self._v, self._last, self._seen = 0.0, 0, 0

    def cuts(self, t: Times) -> Times:
        """The ends of segments; see `Cutter`."""
        from neuro.events.segmentation._kernel import msd

        if not self._seen and t.size:
            self._last = int(t[0])
        found = np.empty(t.size, np.int64)
        n, self._v, self._last = msd(t, self._tau_us, self._threshold, self._v, self._last, found)
        self._seen += t.size
        return found[:n] + (self._seen - t.size)

    def end(self) -> Times:
        """None: what is below the threshold is left over."""
        return NONE


def msd_segments(
    t: npt.NDArray[np.integer], *, tau: float = 0.02, threshold: float = 150.0, rest: bool = False
) -> Times:
    """Segment events with a motion symbol detector.

    A leaky integrate-and-fire neuron adds 1 at every event and decays in between. When it reaches
    the threshold, the events since the last segment are one segment and the neuron begins at 0.

    Args:
        t: (n,) times, us, non-decreasing.
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.
        rest: whether events after the last complete segment are one more.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``. Without `rest`, events after the last
        complete segment belong to none.

    Raises:
        ModelError: `tau` or `threshold` is not positive, or `t` is not in order.

    Source: thesis section 6.2.1, lines 2321-2334, with tau in s (table 3 prints ms; figure 43 has 0.02);
        Zhao et al., IEEE TNNLS 26:1963, 2015.
    """
    return bounds(MSD(tau, threshold), t, rest)
