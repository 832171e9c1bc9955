"""One neuron of a population alone: what an input does to its potential.

The functions of the model run as they stand, so this holds for every model with a potential and a threshold.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from neuro.model.neurons import Neuron
from neuro.program.program import Floats, Population

MOST_STEPS = 1500
TINY = 1e-3
"""The weight with which the measuring of a postsynaptic potential begins. It is changed until the potential is small
enough for conductances to be nearly linear, and far above the rounding of a potential."""


def has_threshold(part: Population) -> bool:
    """Whether a population has a potential and a fixed threshold, and its neurons are stepped one by one."""
    model = part.model
    if not isinstance(model, Neuron) or model.chip or model.relay or model.most:
        return False
    return (
        bool(model.states)
        and model.states[0].name == "V_m"
        and bool(np.isfinite(part.parameters.get("V_th", np.inf)).all())
    )


class Cell:
    """The first neuron of a population that `has_threshold`.

    Args:
        part: the population.
        h: length of a step in ms.

    Attributes:
        rest: where V_m is without input, in mV.
        threshold: in mV.
    """

    def __init__(self, part: Population, h: float) -> None:
        assert isinstance(part.model, Neuron)
        self.part, self.model, self.h = part, part.model, h
        self.parameters = {word: float(values[0]) for word, values in part.parameters.items()}
        self.constants = np.zeros(self.model.width)
        self.model.arithmetic.constants(list(self.parameters.values()), h, self.constants)
        self.rest = self.parameters.get("E_L", float(part.initial["V_m"][0]))
        self.threshold = self.parameters["V_th"]
        self._responses: dict[int, Floats] = {}

    @property
    def distance(self) -> float:
        """From rest to the threshold, in mV."""
        return self.threshold - self.rest

    @cached_property
    def steps(self) -> int:
        """Five of the longest time constant of potential and input."""
        skip = ("tau_minus", "tau_w", "tau_sfa", "tau_theta")
        taus = [v for w, v in self.parameters.items() if w.startswith("tau") and w not in skip and math.isfinite(v)]
        if "g_L" in self.parameters and self.parameters["g_L"] > 0.0:
            taus.append(self.parameters["C_m"] / self.parameters["g_L"])
        return min(MOST_STEPS, max(20, math.ceil(5.0 * max(taus, default=10.0) / self.h)))

    def follow(self, inputs: Floats, first_only: bool = False, current: float = 0.0) -> tuple[Floats, bool]:
        """V_m from rest, up to the first spike.

        Args:
            inputs: what arrives at each receptor in a step.
            first_only: whether it arrives in the first step alone, else in each.
            current: a constant current in pA.

        Returns:
            V_m at the end of each step, and whether it reached the threshold.
        """
        states = np.zeros((len(self.model.states), 1))
        for row, state in zip(states, self.model.states, strict=True):
            row[0] = self.part.initial[state.name][0]
        states[0, 0] = self.rest
        x = np.zeros((max(2, self.model.receptors), 1))
        x[: inputs.size, 0] = inputs
        fired, i_0 = np.zeros(1, dtype=np.uint8), np.array([current])
        never = (np.array([1.0 - 2.0**-53]),) if self.model.draws else ()
        found: list[float] = []
        for _ in range(self.steps):
            self.model.arithmetic.step(states, self.constants, x, i_0, 0, 1, fired, *never)
            if fired[0]:
                return np.array([*found, self.threshold]), True
            found.append(states[0, 0])
            if first_only:
                x[:] = 0.0
        return np.array(found), False

    @cached_property
    def _alone(self) -> Floats:
        return self.follow(np.zeros(1), first_only=True)[0]

    def slope(self, receptor: int) -> float:
        """Peak of the potential after one spike, in mV per unit of weight, as of a small weight; signed as the weight.

        0 where the model fires by itself at once, so that nothing can be measured.
        """
        v = self.response(receptor)
        return float(v[np.abs(v).argmax()])

    def to_fire(self, receptor: int) -> float:
        """The weight of a single spike that makes the neuron fire; infinite where none does.

        Of a linear model it follows from the response; elsewhere it is searched for, by halves, to a tenth.
        """
        slope = self.slope(receptor)
        if slope == 0.0 or self.distance <= 0.0:
            return math.inf
        weight = self.distance / slope
        if self.model.linear:
            return weight
        x, low, high = np.zeros(max(2, self.model.receptors)), 0.0, math.inf
        for _ in range(16):
            x[receptor] = weight
            if self.follow(x, first_only=True)[1]:
                high = weight
            else:
                low = weight
            if high < 1.1 * low:
                break
            weight = 4.0 * low if math.isinf(high) else 0.5 * (low + high)
        return high

    def response(self, receptor: int) -> Floats:
        """The potential after one spike at the end of each step, in mV per unit of weight, as of a small weight."""
        if receptor not in self._responses:
            self._responses[receptor] = self._measured(receptor)
        return self._responses[receptor]

    def _measured(self, receptor: int) -> Floats:
        sign = -1.0 if self.model.receptors == 2 and receptor == 1 else 1.0
        x = np.zeros(max(2, self.model.receptors))
        weight, change = TINY, np.zeros(1)
        for _ in range(8):  # the unit of a weight is not known, so look for one with a small effect
            x[receptor] = sign * weight
            v, _ = self.follow(x, first_only=True)
            n = min(v.size, self._alone.size)
            change = v[:n] - self._alone[:n]
            peak = float(np.abs(change).max(initial=0.0))
            if peak < 1e-7 * max(1.0, abs(self.distance)):
                weight *= 1e3
            elif peak > 0.01 * abs(self.distance):
                weight /= 1e3
            else:
                break
        unit: Floats = change / (sign * weight)
        return unit if unit.size and np.isfinite(unit).all() else np.zeros(1)
