"""The codes by name."""

from __future__ import annotations

from collections.abc import Callable

from neuro.coding.arguments import Floats
from neuro.coding.latency import intensity_to_latency, log_intensity_to_latency, rank
from neuro.coding.rates import population, rate
from neuro.coding.trains import burst, phase, poisson
from neuro.core.registry import Registry

CODES: Registry[Callable[..., Floats]] = Registry(
    "code",
    (intensity_to_latency, log_intensity_to_latency, rank, poisson, phase, burst),
    group="neuro.codes",
)
"""All codes by name: functions of values and named parameters that give spike times.

The times have the shape of the values, or one more axis with the spikes of each; NaN is no spike.
"""

RATE_CODES: Registry[Callable[..., Floats]] = Registry("rate code", (rate, population), group="neuro.rate_codes")
"""All codes by name that give values, in Hz if they are rates: of the shape of theirs, or with one more axis."""
