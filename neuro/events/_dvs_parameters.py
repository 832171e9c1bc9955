"""What the pixels of an event camera are like."""

from __future__ import annotations

from dataclasses import dataclass
from math import log
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.core.checks import check_fields
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity

Image = npt.NDArray[Any]

LOWEST_THRESHOLD = 0.01
"""A drawn threshold is never less, log units. Source: v2e, emulator.py (`torch.clamp`)."""

GREYS = 255.0
"""v2e's full scale, in whose units its lin-log curve is written."""


@dataclass(frozen=True, slots=True)
class DVSParameters:
    """What the pixels of an event camera are like; the names are v2e's where the meaning is.

    Attributes:
        pos_thres: rise of the natural log of the intensity that makes an ON event.
        neg_thres: fall that makes an OFF event, as a positive number.
        sigma_thres: standard deviation of both from pixel to pixel, log units; none is below 0.01.
        refractory_period_s: time after an event in which the pixel sees nothing, s; its reference is
            what it sees when it wakes.
        leak_rate_hz: ON events of a pixel that looks at nothing, Hz.
        noise_rate_cov_decades: standard deviation of the decimal log of a pixel's leak rate.
        shot_noise_rate_hz: further events at random times, ON and OFF alike, of a pixel in the dark, Hz.
        shot_noise_bright: share of them that is left at full scale; straight in between.
        cutoff_hz: bandwidth (-3 dB) of a pixel at full scale, Hz; lower where it is darker, in
            proportion to the intensity + 8 %; 0 for no limit.
        linear_below: intensity below which the curve is a straight line through 0 in place of the log,
            as a share of full scale; 0 for none.
        floor: intensity that is added to all light (dark current), as a share of full scale.

    Raises:
        ModelError: a value is out of its range.

    Source: Hu, Liu, Delbruck, "v2e", CVPRW 2021, section 4, and its emulator_utils.py (curve, low
        pass, noise). Sizes of the defaults: Lichtsteiner et al., IEEE JSSC 43:566, 2008 (thresholds,
        mismatch); Nozaki and Delbruck, IEEE TED 64:3239, 2017 (leak).

    Example:
        >>> DVSParameters.ideal(pos_thres=0.1).leak_rate_hz
        0.0
    """

    pos_thres: float = quantity(0.2, at_least=LOWEST_THRESHOLD)
    neg_thres: float = quantity(0.2, at_least=LOWEST_THRESHOLD)
    sigma_thres: float = quantity(0.03, at_least=0)
    refractory_period_s: float = quantity(1e-4, "s", at_least=0)
    leak_rate_hz: float = quantity(0.1, "Hz", at_least=0)
    noise_rate_cov_decades: float = quantity(0.1, at_least=0)
    shot_noise_rate_hz: float = quantity(0.1, "Hz", at_least=0)
    shot_noise_bright: float = quantity(0.25, at_least=0, at_most=1)
    cutoff_hz: float = quantity(0.0, "Hz", at_least=0)
    linear_below: float = quantity(20.0 / GREYS, at_least=0, at_most=1)
    floor: float = quantity(0.0, at_least=0)

    def __post_init__(self) -> None:
        check_fields(self)
        if 0.0 < self.linear_below <= 2.0 / GREYS:
            raise ModelError(f"linear_below is {self.linear_below}, expected 0 or more than 2/255")
        if self.linear_below == 0.0 and self.floor < 1e-9:
            raise ModelError(
                f"linear_below is 0 and floor is {self.floor}, expected at least 1e-9 of one",
                hint="the log of black is not finite",
            )

    @classmethod
    def ideal(cls, **changes: Any) -> DVSParameters:
        """Equal pixels without noise, leak, refractory period and limit of bandwidth.

        Args:
            **changes: parameters that differ from that.
        """
        nothing = ("sigma_thres", "refractory_period_s", "leak_rate_hz", "shot_noise_rate_hz")
        return cls(**{**dict.fromkeys(nothing, 0.0), **changes})

    def log_intensity(self, light: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """The curve of a pixel: the log of the intensity, a straight line where it is dark.

        Args:
            light: intensities as shares of full scale, any shape.

        Returns:
            Natural log of the share; at `linear_below` both parts meet.

        Source: v2e, emulator_utils.py, `lin_log`: x ln(T)/T up to T = 20 of 255, ln(x) above.
        """
        floor, knee, slope, height = self.curve()
        seen = np.asarray(light, np.float64) + floor
        above = np.log(np.maximum(seen, knee))
        return np.asarray(np.where(seen > knee, above, seen * slope + height))

    def curve(self) -> tuple[float, float, float, float]:
        """What is added to the light, where the log begins, slope and height at 0 of the line below it."""
        knee = self.linear_below
        if knee == 0.0:
            return self.floor, 0.0, 0.0, 0.0
        return self.floor, knee, log(GREYS * knee) / knee, -log(GREYS)


def shares(image: Image) -> npt.NDArray[np.float64]:
    """An image's intensities as shares of full scale.

    Args:
        image: as for `DVS.see`.
    """
    top = float(np.iinfo(str(image.dtype)).max) if image.dtype.kind == "u" else 1.0
    return np.asarray(image, np.float64) / top
