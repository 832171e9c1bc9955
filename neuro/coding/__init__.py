"""Encoders of numbers as spikes, and decoders.

An encoder is a function of an array of values and named parameters. Encoders of `CODES` return spike times. Encoders of
`RATE_CODES` return rates, and `poisson` turns rates into spikes. The classes of `FIELDS` encode vectors: each neuron
spikes for the vectors in its field. `Cochlea`, `MelBands`, `HairCells` and `crossings` turn sounds into spikes.
Decoders are functions of counts or spike times.
"""

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names

if TYPE_CHECKING:
    from neuro.coding.codes import CODES as CODES, RATE_CODES as RATE_CODES
    from neuro.coding.decoders import (
        first_to_fire as first_to_fire,
        highest_rate as highest_rate,
        population_vector as population_vector,
        rank_order as rank_order,
        van_rossum as van_rossum,
    )
    from neuro.coding.ears import (
        Cochlea as Cochlea,
        HairCells as HairCells,
        MelBands as MelBands,
        crossings as crossings,
    )
    from neuro.coding.encoders import (
        burst as burst,
        intensity_to_latency as intensity_to_latency,
        log_intensity_to_latency as log_intensity_to_latency,
        phase as phase,
        poisson as poisson,
        population as population,
        rank as rank,
        rate as rate,
    )
    from neuro.coding.fields import (
        FIELDS as FIELDS,
        PERIOD as PERIOD,
        Dimension as Dimension,
        Fields as Fields,
        OneHot as OneHot,
        Places as Places,
        Population as Population,
        Tiles as Tiles,
    )
    from neuro.coding.work import Work as Work, Works as Works, on_numbers as on_numbers


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__)
