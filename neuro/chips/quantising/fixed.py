"""A program in a chip's integers: registers, weight words and delays, with what rounding did to each.

This is all that the chip backend sees beside the program itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from neuro.model.synapses.loihi_rule import LearningRule
from neuro.program.program import Floats, Ints

Words = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Rounding:
    """A quantity that a register holds.

    Attributes:
        quantity: as the language names it, e.g. "tau_m".
        unit: of `wanted` and `got`.
        wanted, got: the described value and the one that the register stands for, of the neuron where they differ most.
        error: their difference relative to what matters (for a potential, the distance of V_th from E_L).
    """

    quantity: str
    unit: str
    wanted: float
    got: float
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedPopulation:
    """A population in registers.

    Attributes:
        name: of the population.
        kind: "source" and "current" (generators, on the host), "relay", or which of its family's integer steps it
            takes, e.g. "loihi_lif".
        registers: by name, shape (1,) where all neurons share it, else (size,).
        initial: state registers at step 0, likewise.
        volt: units of the voltage register per mV.
        rest: potential in mV where the voltage register is 0, shape (1,) or (size,).
        ampere: units of the current registers per pA of the excitatory and the inhibitory current, shape (1,) or
            (size,); empty where currents have no meaning.
        drive: units per pA that a constant current adds to the register that holds it.
        rounding: what the registers differ in from the description.
    """

    name: str
    kind: str
    registers: dict[str, Ints] = field(default_factory=dict)
    initial: dict[str, Ints] = field(default_factory=dict)
    volt: float = 1.0
    rest: Floats = field(default_factory=lambda: np.zeros(1))
    ampere: tuple[Floats, ...] = ()
    drive: Floats = field(default_factory=lambda: np.zeros(1))
    rounding: tuple[Rounding, ...] = ()


@dataclass(frozen=True, slots=True)
class WeightRounding:
    """What rounding does to the weights of a projection.

    Attributes:
        saturated: share of the weights that are larger than the largest mantissa.
        zeroed: share of the weights other than 0 that become 0.
        worst: largest relative error of a weight that does not become 0.
        rms: root of the mean squared error relative to the root of the mean squared weight.
    """

    saturated: float
    zeroed: float
    worst: float
    rms: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedProjection:
    """A projection in words.

    Attributes:
        name: of the projection.
        mantissas: what the weight memory holds, shape (1,) where shared, else one per synapse (of a grid: per weight of
            its kernels). On SpiNNaker the sign says the receptor.
        words: what a spike adds to the input of its target (Loihi: in units of 64).
        low, high: smallest and largest mantissa; `grain` is the step between two.
        exponent: Loihi's weight exponent; SpiNNaker: 0.
        sign_mode: Loihi's; "" elsewhere.
        bits: of a mantissa.
        step: weight in the unit of the language per mantissa, shape (1,) or one per mantissa; `step_below` that of
            negative ones, which on SpiNNaker go to another receptor.
        lag: steps from the emission of a spike to the update that sees it, shape (1,) or one per synapse; see
            `neuro.chips.arrival_rule`.
        delay: the delay register, likewise.
        rule: of synapses that learn on the chip, else None.
        n_scale: dopamine in 1/ms of one unit of the modulatory traces.
        native: whether the weights of the language are the mantissas, bits that the chip drops included.
        shift: by how many bits the sum of a step is shifted down before it is added to that of other projections.
        wraps: whether that sum is a two's complement of 24 bits.
        receptor: 1 where it goes to the second input of neurons in registers, the imaginary one.
        rounding: what became of the weights.
    """

    name: str
    mantissas: Words
    words: Words
    low: int
    high: int
    grain: int
    exponent: int
    sign_mode: str
    bits: int
    step: Floats
    step_below: Floats
    lag: Words
    delay: Words
    rule: LearningRule | None = None
    n_scale: float = 0.0
    native: bool = False
    shift: int = 0
    wraps: bool = False
    receptor: int = 0
    rounding: WeightRounding = WeightRounding(0.0, 0.0, 0.0, 0.0)

    @property
    def apart(self) -> bool:
        """Whether the sum of a step is not simply added to that of other projections."""
        return bool(self.shift or self.wraps or self.receptor)

    def weights(self, mantissas: Words | Floats) -> Floats:
        """What mantissas stand for, in the unit of the language."""
        steps: Floats = np.where(mantissas < 0, self.step_below, self.step)
        return mantissas * steps

    def acting(self, words: Words) -> Floats:
        """What words send, in the unit of the language: less than their mantissas where bits were lost."""
        return self.weights(words.astype(np.float64) * 2.0 ** -(self.exponent + self.shift))

    def exact(self, weights: Floats) -> Floats:
        """Weights in units of a mantissa, before rounding."""
        values: Floats = weights / np.where(weights < 0.0, self.step_below, self.step)
        return values
