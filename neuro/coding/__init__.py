"""Numbers to spikes and back.

An encoder is a function of an array of values and named parameters. Those of `CODES` give spike times, those of
`RATE_CODES` rates, which `poisson` makes into spikes. Decoders are functions of counts or spike times.
"""

from neuro.coding.codes import CODES, RATE_CODES
from neuro.coding.decoders import first_to_fire, highest_rate, population_vector, rank_order, van_rossum
from neuro.coding.encoders import (
    burst,
    intensity_to_latency,
    log_intensity_to_latency,
    phase,
    poisson,
    population,
    rank,
    rate,
)

__all__ = [
    "CODES",
    "RATE_CODES",
    "burst",
    "first_to_fire",
    "highest_rate",
    "intensity_to_latency",
    "log_intensity_to_latency",
    "phase",
    "poisson",
    "population",
    "population_vector",
    "rank",
    "rank_order",
    "rate",
    "van_rossum",
]
