"""Cut a stream of events into pseudo-frames where the motion is, not by the clock."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def msd_segments(t: npt.NDArray[np.int64], *, tau: float = 0.02, threshold: float = 150.0) -> npt.NDArray[np.int64]:
    """Segment events with a motion symbol detector.

    A leaky integrate-and-fire neuron adds 1 at every event and decays in between. When it reaches
    the threshold, the events since the last segment are one segment and the neuron begins at 0.

    Args:
        t: (n,) times, us, non-decreasing.
        tau: decay time constant, s.
        threshold: potential at which a segment is complete, events.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``. Events after the last
        complete segment belong to none.

    Raises:
        ValueError: ``tau`` or ``threshold`` is not positive.

    Source: thesis section 6.2.1, lines 2321-2334, with tau in s (table 3 prints ms; figure 43 has 0.02);
        Zhao et al., IEEE TNNLS 26:1963, 2015.
    """
    if not tau > 0:
        raise ValueError(f"tau is {tau} s, expected more than 0")
    if not threshold > 0:
        raise ValueError(f"threshold is {threshold} events, expected more than 0")
    from neuro.events._segmentation_kernels import msd

    bounds = np.zeros(len(t) + 1, np.int64)
    n = msd(np.ascontiguousarray(t, np.int64), 1e6 * tau, threshold, bounds)
    return bounds[: n + 1]
