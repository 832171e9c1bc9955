"""From the events of a recording to the C1 spikes that layer S2 reads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.coding import log_intensity_to_latency
from neuro.events import Events, msd_segments
from neuro_remus.gabor import gabor_bank

MAX_OUTSIDE = 0.05
"""Share of a recording's events that may lie outside of the field and be left out."""


@dataclass(frozen=True)
class FrontEnd:
    """MSD segmentation, Gabor filters, pooling, log I2L and fusion of the scales.

    Attributes:
        size: width and height of the field, px, from the top left pixel; N-MNIST's.
        tau_msd: decay of the motion symbol detector, s; table 3, line 2453 (printed as ms).
        theta_msd: events that complete a pseudo-frame; table 3, line 2452.
        sizes: sides of the Gabor filters, px; table 2, line 2350.
        sigmas: their effective widths, px; table 2.
        wavelengths: their wavelengths, px; table 2.
        gamma: their aspect ratio; table 2.
        orientations: degrees; table 2.
        literal_gabors: take eq. 122 as printed, not filters of zero mean and unit norm.
        min_response: responses below this share of the frame's largest do not spike; it is r_min of
            eq. 15, which the thesis leaves open.
        window: length of the code, ms.
        resolution: grid of the spike times, ms.

    Source: thesis section 6.2, lines 2317-2395.
    """

    size: tuple[int, int] = (34, 34)
    tau_msd: float = 0.02
    theta_msd: float = 150.0
    sizes: tuple[int, ...] = (3, 5, 7, 9)
    sigmas: tuple[float, ...] = (1.2, 2.0, 2.8, 3.6)
    wavelengths: tuple[float, ...] = (1.5, 2.5, 3.5, 4.6)
    gamma: float = 0.3
    orientations: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    literal_gabors: bool = False
    min_response: float = 0.1
    window: float = 64.0
    resolution: float = 1.0

    @property
    def shape(self) -> tuple[int, int, int]:
        """Orientations, rows and columns of the C1 spikes' ids (C order)."""
        return len(self.orientations), self.size[1] // 2, self.size[0] // 2

    @cached_property
    def bank(self) -> npt.NDArray[np.float64]:
        """The filters, (scales, orientations, side, side)."""
        return gabor_bank(
            self.sizes, self.sigmas, self.wavelengths, self.gamma, self.orientations,
            literal=self.literal_gabors,
        )  # fmt: skip

    def frames(self, events: Events) -> tuple[Events, npt.NDArray[np.int64]]:
        """Cut a recording into pseudo-frames.

        Args:
            events: a recording.

        Returns:
            The events inside the field, and (frames + 1,) bounds: frame i is ``[bounds[i], bounds[i + 1])``.

        Raises:
            ModelError: more than 5 % of the events lie outside of the field.
        """
        width, height = self.size
        inside = (events.x < width) & (events.y < height)
        outside = len(events) - int(np.count_nonzero(inside))
        if outside > MAX_OUTSIDE * len(events):
            raise ModelError(
                f"{outside} of {len(events)} events lie outside of the {width}x{height} field that is "
                f"looked at, expected at most {MAX_OUTSIDE:.0%}; crop the recording round the object first"
            )
        if outside:
            events = events[inside]
        return events, msd_segments(events.t, tau=self.tau_msd, threshold=self.theta_msd)

    def responses(self, events: Events) -> npt.NDArray[np.float64]:
        """C1 responses of every pseudo-frame.

        Args:
            events: a recording.

        Returns:
            (frames, scales, orientations, rows, columns): rectified filter responses, the largest of
            each 2x2 px.

        Raises:
            ValueError: as of `frames`.
        """
        from neuro_remus._frontend_kernels import c1_responses

        width, height = self.size
        events, bounds = self.frames(events)
        out = np.empty((len(bounds) - 1, len(self.sizes), *self.shape))
        sizes = np.array(self.sizes, np.int64)
        c1_responses(events.x, events.y, bounds, self.bank, sizes, height, width, out)
        return out

    def spikes(self, events: Events) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """C1 spikes of every pseudo-frame; of the scales at one place the earliest spike is kept.

        Args:
            events: a recording.

        Returns:
            ``times`` (spikes,) float64, ms from the start of the frame, on the grid of ``resolution``
            in [0, window); ``ids`` (spikes,) int64, indices into `shape`; ``offsets`` (frames + 1,)
            int64: frame i has the spikes ``[offsets[i], offsets[i + 1])``, by time and then by id.

        Raises:
            ValueError: as of `frames`.
        """
        fused = self.responses(events).max(axis=1).reshape(-1, int(np.prod(self.shape)))
        peak = fused.max(axis=1, initial=0.0)
        relative = np.divide(fused, peak[:, None], out=np.zeros_like(fused), where=peak[:, None] > 0)
        frame, ids = np.nonzero(relative >= self.min_response)
        latency = log_intensity_to_latency(relative[frame, ids], self.min_response, 1.0, self.window)
        last = int(np.ceil(self.window / self.resolution)) - 1
        ticks = np.minimum(latency // self.resolution, last).astype(np.int64)
        order = np.argsort(frame * (last + 1) + ticks, kind="stable")
        offsets = np.searchsorted(frame, np.arange(len(peak) + 1))
        times = ticks[order].astype(np.float64) * self.resolution
        return times, ids[order].astype(np.int64), offsets.astype(np.int64)
