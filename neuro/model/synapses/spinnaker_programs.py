"""Synapse that learns by one of SpiNNaker's released programs, with the parameters of the program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.errors import ModelError, here
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Trace

TIMINGS = ("pair", "nearest", "triplet", "vogels", "recurrent")
ADDITIVE, MULTIPLICATIVE = "additive", "multiplicative"
_COUNT: dict[str, Any] = {"kind": "integer", "at_least": -32768, "at_most": 32767}


@dataclass(frozen=True, kw_only=True, eq=False)
class spinnaker_learning(Modulated):
    """Synapse that learns by one of the ten released programs of SpiNNaker, with the integers of the program.

    `timing` and `dependence` name the program. With `dopamine` or `signal` the program is a neuromodulated one: the
    rule changes an eligibility between `c_min` and `c_max`, and dopamine changes the weight between `Wmin` and `Wmax`.
    An additive step is given as a share of the largest weight, or of c_max if there is dopamine. A multiplicative step
    is given as a share of the distance to a bound. A negative Wmax makes the synapse inhibitory; the chip stores
    magnitudes. A spike of `dopamine` adds `concentration` to n of a neuron, and a negative concentration punishes.
    Targets are `iaf_psc_exp`, `iaf_psc_delta` or `spinnaker_lif`; the weights of the last are 16-bit words. Only the
    timing "recurrent" uses the accumulators and windows.
    Source: sPyNNaker 7.4.1 (released machine code).
    """

    equation: ClassVar[str] = "each packet of the source applies the program to the post spikes since the last packet"
    source: ClassVar[str] = "sPyNNaker 7.4.1, plastic synapses"
    learns: ClassVar[str] = "chip"
    chip: ClassVar[str] = "spinnaker"
    pre: ClassVar[tuple[Trace, ...]] = ()
    post: ClassVar[tuple[Trace, ...]] = ()
    states: ClassVar[tuple[State, ...]] = (State("c", "", "eligibility, or the accumulator of the recurrent rule"),)

    timing: str = quantity("pair", "", "rule that selects pairs of spikes", kind="word", words=TIMINGS)
    dependence: str = quantity(
        ADDITIVE, "", "dependence of a step on the weight", kind="word", words=(ADDITIVE, MULTIPLICATIVE)
    )
    A_plus: float = quantity(0.01, "", "step at a post spike; with vogels at either spike")
    A_minus: float = quantity(0.01, "", "step at a pre spike")
    A3_plus: float = quantity(0.01, "", "triplet step at a post spike")
    A3_minus: float = quantity(0.01, "", "triplet step at a pre spike")
    tau_plus: float = quantity(20.0, "ms", "time constant of the pre trace; with vogels of both traces", above=0)
    tau_minus: float = quantity(20.0, "ms", "time constant of the post trace", above=0)
    tau_x: float = quantity(101.0, "ms", "time constant of the slow pre trace of triplets", above=0)
    tau_y: float = quantity(114.0, "ms", "time constant of the slow post trace of triplets", above=0)
    alpha: float = quantity(0.12, "", "with vogels: depression by a pre spike", at_least=0, below=16)
    accumulator_depression: int = quantity(-6, "", "count at which a pre spike depresses", **_COUNT)
    accumulator_potentiation: int = quantity(3, "", "count at which a post spike potentiates", **_COUNT)
    mean_pre_window: float = quantity(35.0, "ms", "mean window after a pre spike", above=0)
    mean_post_window: float = quantity(35.0, "ms", "mean window after a post spike", above=0)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", nonzero=True, of_value=True)
    c_min: float = quantity(0.0, "", "smallest eligibility, in the unit of the weight", at_least=0)
    c_max: float = quantity(100.0, "", "largest eligibility, in the unit of the weight", above=0)
    tau_c: float = quantity(1000.0, "ms", "time constant of the eligibility", above=0)
    tau_n: float = quantity(200.0, "ms", "time constant of dopamine", above=0)
    concentration: float = quantity(0.005, "1/ms", "increase of n per dopamine spike", nonzero=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.measured and (self.Wmin * self.Wmax < 0.0 or abs(self.Wmin) > abs(self.Wmax)):
            message = f"{self.name}.Wmin = {self.Wmin:g}: expected 0 to Wmax = {self.Wmax:g}"
            raise ModelError(message, path=("Wmin",), where=here())

    @property
    def taught(self) -> bool:
        """True if the program is neuromodulated."""
        return self.dopamine is not None or self.signal is not None
