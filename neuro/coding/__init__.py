"""Numbers to spikes and back.

An encoder is a function of an array of values and named parameters. Those of `CODES` give spike times, those of
`RATE_CODES` rates, which `poisson` makes into spikes.
"""

from neuro.coding.codes import CODES, RATE_CODES
from neuro.coding.latency import intensity_to_latency, log_intensity_to_latency, rank
from neuro.coding.rates import population, rate
from neuro.coding.trains import burst, phase, poisson

__all__ = [
    "CODES",
    "RATE_CODES",
    "burst",
    "intensity_to_latency",
    "log_intensity_to_latency",
    "phase",
    "poisson",
    "population",
    "rank",
    "rate",
]
