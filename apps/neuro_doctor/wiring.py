"""The connections of a program: single neurons, sums of weights, signs, and paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from neuro.apps import common, fan_out
from neuro.extend import Neuron, Population, Program, Projection, Synapse

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MOST_STEPS = 1500
"""Largest number of steps of a single neuron's response."""
TINY = 1e-3
"""First weight in the measurement of a postsynaptic potential. The weight is changed until the potential is small
enough for conductances to be nearly linear, and far above rounding errors."""


def has_threshold(part: Population) -> bool:
    """Return whether a population has a potential and a fixed threshold, and can be simulated neuron by neuron."""
    model = part.model
    if not isinstance(model, Neuron) or model.chip or model.relay or model.most:
        return False
    return (
        bool(model.states)
        and model.states[0].name == "V_m"
        and bool(np.isfinite(part.parameters.get("V_th", np.inf)).all())
    )


class Cell:
    """The first neuron of a population with a threshold (see `has_threshold`), simulated alone.

    Args:
        part: the population.
        h: step, ms.

    Attributes:
        rest: V_m without input, mV.
        threshold: threshold of V_m, mV.
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
        """Difference between threshold and rest, mV."""
        return self.threshold - self.rest

    @cached_property
    def steps(self) -> int:
        """Steps of a response: five times the longest time constant of potential and input, 20 to `MOST_STEPS`."""
        skip = ("tau_minus", "tau_w", "tau_sfa", "tau_theta")
        taus = [v for w, v in self.parameters.items() if w.startswith("tau") and w not in skip and math.isfinite(v)]
        if "g_L" in self.parameters and self.parameters["g_L"] > 0.0:
            taus.append(self.parameters["C_m"] / self.parameters["g_L"])
        return min(MOST_STEPS, max(20, math.ceil(5.0 * max(taus, default=10.0) / self.h)))

    def follow(self, inputs: Floats, first_only: bool = False, current: float = 0.0) -> tuple[Floats, bool]:
        """Simulate V_m from rest to the first spike.

        Args:
            inputs: sum of weights that arrives at each receptor per step.
            first_only: True applies the inputs in the first step only, False in each step.
            current: constant current, pA.

        Returns:
            V_m at the end of each step, mV, and whether the neuron fired.
        """
        states = np.zeros((len(self.model.states), 1))
        for row, state in zip(states, self.model.states, strict=True):
            row[0] = self.part.initial[state.name][0]
        states[0, 0] = self.rest
        x = np.zeros((max(2, self.model.receptors), 1))
        x[: inputs.size, 0] = inputs
        fired, i_0 = np.zeros(1, dtype=np.uint8), np.array([current])
        draw = (np.array([1.0 - 2.0**-53]),) if self.model.draws else ()  # a draw that makes no stochastic spike
        potentials: list[float] = []
        for _ in range(self.steps):
            self.model.arithmetic.step(states, self.constants, x, i_0, 0, 1, fired, *draw)
            if fired[0]:
                return np.array([*potentials, self.threshold]), True
            potentials.append(states[0, 0])
            if first_only:
                x[:] = 0.0
        return np.array(potentials), False

    @cached_property
    def _without_input(self) -> Floats:
        return self.follow(np.zeros(1), first_only=True)[0]

    def slope(self, receptor: int) -> float:
        """Return the signed peak of the postsynaptic potential of a small weight, mV per unit of weight.

        The result is 0 if no response can be measured, because the model fires at once without input.
        """
        v = self.response(receptor)
        return float(v[np.abs(v).argmax()])

    def to_fire(self, receptor: int) -> float:
        """Return the weight of a single spike that makes the neuron fire; infinite if no weight does.

        For a linear model the weight follows from the response; else a bisection finds the weight within 10 %.
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
        """Return the postsynaptic potential of a small weight at the end of each step, mV per unit of weight."""
        if receptor not in self._responses:
            self._responses[receptor] = self._measure(receptor)
        return self._responses[receptor]

    def _measure(self, receptor: int) -> Floats:
        sign = -1.0 if self.model.receptors == 2 and receptor == 1 else 1.0
        x = np.zeros(max(2, self.model.receptors))
        weight, change = TINY, np.zeros(1)
        for _ in range(8):  # the unit of a weight is unknown, so search for a weight with a small effect
            x[receptor] = sign * weight
            v, _ = self.follow(x, first_only=True)
            n = min(v.size, self._without_input.size)
            change = v[:n] - self._without_input[:n]
            peak = float(np.abs(change).max(initial=0.0))
            if peak < 1e-7 * max(1.0, abs(self.distance)):
                weight *= 1e3
            elif peak > 0.01 * abs(self.distance):
                weight /= 1e3
            else:
                break
        unit: Floats = change / (sign * weight)
        return unit if unit.size and np.isfinite(unit).all() else np.zeros(1)


MOST_SYNAPSES = 5_000_000
"""Largest number of synapses of a projection whose weights are summed for each neuron; larger ones are skipped."""

SETTLED = 50
"""Regular spikes after which short-term plasticity counts as steady."""


def is_short_term(rule: Synapse) -> bool:
    """Return whether a rule is short-term plasticity.

    The rule ignores postsynaptic spikes, and sends a varying share of a fixed weight.
    """
    return rule.learns == "pairs" and not rule.post and hasattr(rule.arithmetic, "sent")


@dataclass(frozen=True, slots=True)
class Weights:
    """Summary of the initial weights of a projection.

    Attributes:
        synapses: number of synapses; for a grid all synapses of its kernels.
        least, largest: least and largest weight; 0 without synapses.
        above, below: sums over all synapses of the weights >= 0, and of the weights < 0.
    """

    synapses: int
    least: float
    largest: float
    above: float
    below: float

    @property
    def mean(self) -> float:
        """Mean weight of a synapse; 0 without synapses."""
        return (self.above + self.below) / self.synapses if self.synapses else 0.0


class Wiring:
    """The connections of a program. Populations and projections are given by their indices.

    Args:
        program: the program.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self._cells: dict[int, Cell] = {}
        self._pushes: dict[int, tuple[float, float]] = {}

    def cell(self, population: int) -> Cell | None:
        """Return the first neuron of a population, None if the population has no threshold."""
        if population not in self._cells and has_threshold(self.program.populations[population]):
            self._cells[population] = Cell(self.program.populations[population], self.program.resolution)
        return self._cells.get(population)

    @cached_property
    def weights(self) -> list[Weights]:
        """Summary of the weights of each projection."""
        return [self._weights(index, part) for index, part in enumerate(self.program.projections)]

    def _weights(self, index: int, part: Projection) -> Weights:
        count = int(fan_out(self.program, index).sum()) if part.carries == "spikes" else part.size
        if not count or not part.weight.size:
            return Weights(count, 0.0, 0.0, 0.0, 0.0)
        per_weight, w = count / part.weight.size, part.weight
        below = float(w.sum(where=w < 0.0)) * per_weight
        return Weights(count, float(w.min()), float(w.max()), float(w.sum()) * per_weight - below, below)

    def efficacy(self, projection: int, per_step: float) -> float:
        """Return the share of weights that a projection sends at a steady rate; 1 without short-term plasticity.

        The rule's own functions run on regular spikes of the first synapse.

        Args:
            projection: index of the projection.
            per_step: spikes of a source neuron per step.
        """
        rule = self.program.projections[projection].synapse
        if per_step <= 0.0 or rule.draws or not is_short_term(rule):
            return 1.0
        values, gap = rule.parameters(), self.program.resolution / per_step
        decays = [math.exp(-gap / values[trace.tau]) if values.get(trace.tau) else 0.0 for trace in rule.pre]
        pre = [trace.adds * x / (1.0 if trace.nearest else 1.0 - x) for trace, x in zip(rule.pre, decays, strict=True)]
        c = common(rule.constants_of(rule.vector(), self.program.resolution))
        y = np.concatenate([np.ones((1, 1)), rule.first_states()[:, :1]])
        for _ in range(SETTLED):
            rule.arithmetic.on_pre(y, 0, c, pre, ())
        return float(rule.sends()(y, 0, c))

    def onto(self, population: int, carries: str = "spikes") -> list[int]:
        """Return the projections onto a population."""
        return [q for q in self._ends[1][population] if self.program.projections[q].carries == carries]

    def out_of(self, population: int) -> list[int]:
        """Return the projections from a population."""
        return self._ends[0][population]

    @cached_property
    def _ends(self) -> tuple[list[list[int]], list[list[int]]]:
        """Projections from each population, and projections onto each population."""
        outgoing: list[list[int]] = [[] for _ in self.program.populations]
        incoming: list[list[int]] = [[] for _ in self.program.populations]
        for q, part in enumerate(self.program.projections):
            outgoing[part.source].append(q)
            incoming[part.target].append(q)
        return outgoing, incoming

    def receptors(self, projection: int) -> tuple[tuple[int, float], tuple[int, float]]:
        """Return the receptor and the sign of its input for weights >= 0, and both for weights < 0."""
        part = self.program.projections[projection]
        model = self.program.populations[part.target].model
        factor = -1.0 if part.receptor is not None and part.receptor.negated else 1.0
        if part.receptor is not None:
            return (part.receptor.index, factor), (part.receptor.index, factor)
        second = 1 if isinstance(model, Neuron) and model.receptors == 2 else 0
        return (0, 1.0), (second, 1.0)

    def pushes(self, projection: int) -> tuple[float, float]:
        """Return two sums in the unit of the weights: of excitatory weights, >= 0, and of inhibitory weights, <= 0."""
        if projection not in self._pushes:
            self._pushes[projection] = self._sums(projection)
        return self._pushes[projection]

    def _sums(self, projection: int) -> tuple[float, float]:
        part, w = self.program.projections[projection], self.weights[projection]
        cell = self.cell(part.target)
        up = down = 0.0
        for total, (receptor, factor) in zip((w.above, w.below), self.receptors(projection), strict=True):
            slope = 1.0 if cell is None else cell.slope(receptor) or 1.0
            signed = abs(total) * np.sign(total * factor * slope)
            up, down = up + max(signed, 0.0), down + min(signed, 0.0)
        return up, down

    def reached(self, begin: Iterable[int], excite: bool = True) -> set[int]:
        """Return the populations that spikes of some populations reach through synapses, including these populations.

        Args:
            begin: the first populations.
            excite: True follows synapses that excite or may learn to; False follows all synapses whose weight is not 0
                or may change.
        """
        begin = set(begin)
        return begin | self._after(begin, lambda q: self.may_excite(q) or (not excite and self.pushes(q)[1] < 0.0))

    def _after(self, begin: Iterable[int], passes: Callable[[int], bool]) -> set[int]:
        """Return the populations that some populations reach through projections for which `passes` holds."""
        reached, new = set[int](), list(begin)
        while new:
            targets = {self.program.projections[q].target for q in self.out_of(new.pop()) if passes(q)} - reached
            reached |= targets
            new += targets
        return reached

    def may_excite(self, projection: int) -> bool:
        """Return whether some synapses of a projection excite, or may learn to."""
        learns = self.program.projections[projection].synapse.learns != ""
        return self.pushes(projection)[0] > 0.0 or (learns and self.weights[projection].synapses > 0)

    def excites_itself(self, population: int) -> bool:
        """Return whether spikes of a population return to it through projections that excite on the whole."""
        return population in self._after([population], lambda q: self.pushes(q)[0] > -self.pushes(q)[1])

    def loops(self, population: int) -> list[int]:
        """Return the excitatory projections onto a population from populations that it reaches itself."""
        reached_populations = self.reached([population])
        return [
            q
            for q in self.onto(population)
            if self.program.projections[q].source in reached_populations and self.pushes(q)[0] > 0.0
        ]

    def names(self, projections: Iterable[int]) -> str:
        """Return the names of the first five projections, for messages."""
        return ", ".join(f"'{self.program.projections[q].name}'" for q in list(projections)[:5])

    def drive(self, population: int, per_step: dict[int, float], excite: bool = False) -> Floats:
        """Return the mean sum of weights that arrives at each receptor of a neuron per step.

        Args:
            population: index of the neuron's population.
            per_step: mean spikes of a neuron per step, by source population.
            excite: True counts excitatory weights only.
        """
        cell = self.cell(population)
        part = self.program.populations[population]
        x = np.zeros(max(2, getattr(part.model, "receptors", 1)))
        for q in self.onto(population):
            p, w = self.program.projections[q], self.weights[q]
            spikes = per_step.get(p.source, 0.0)
            spikes *= self.efficacy(q, spikes)
            for total, (receptor, factor) in zip((w.above, w.below), self.receptors(q), strict=True):
                arriving = spikes * total * factor / part.size
                if not excite or cell is None or arriving * cell.slope(receptor) > 0.0:
                    x[receptor] += arriving
        return x

    def strongest(self, population: int, most: dict[int, float]) -> Floats | None:
        """Return the largest sum of excitatory weights that can arrive at the receptors of one neuron in a step.

        None if a projection has more than `MOST_SYNAPSES` synapses, or the population has no threshold.

        Args:
            population: index of the neuron's population.
            most: most spikes of a neuron per step, by source population.
        """
        part, cell = self.program.populations[population], self.cell(population)
        sums = np.zeros((max(2, getattr(part.model, "receptors", 1)), part.size))
        for q in self.onto(population):
            p = self.program.projections[q]
            if self.weights[q].synapses > MOST_SYNAPSES or cell is None:
                return None
            sides = self.receptors(q)
            _, post, place = self.program.synapses(q)
            if not place.size:
                continue
            w = np.broadcast_to(p.weight, max(p.weight.size, 1 + int(place.max())))[place]
            for chosen, (receptor, factor) in zip((w >= 0.0, w < 0.0), sides, strict=True):
                arriving = w[chosen] * factor
                helps = arriving * cell.slope(receptor) > 0.0
                amounts = arriving[helps] * most[p.source]
                sums[receptor] += np.bincount(post[chosen][helps], amounts, minlength=part.size)
        pushes = sum(sums[k] * (cell.slope(k) if cell else 0.0) for k in range(len(sums)))
        largest: Floats = sums[:, int(np.argmax(pushes))]
        return largest

    def inputs_of_each(self, population: int) -> Ints | None:
        """Return the number of synapses onto each neuron of a population; None for more than `MOST_SYNAPSES`."""
        size = self.program.populations[population].size
        total = np.zeros(size, dtype=np.int64)
        for q in self.onto(population):
            p = self.program.projections[q]
            if self.weights[q].synapses > MOST_SYNAPSES:
                return None
            if p.layout == "dense":
                total += self.program.populations[p.source].size
            elif p.layout == "one_to_one":
                total += 1
            else:
                total += np.bincount(self.program.synapses(q)[1], minlength=size)
        return total

    def current(self, population: int) -> float:
        """Return the largest mean current from generators into a neuron of a population, pA."""
        size, total = self.program.populations[population].size, 0.0
        for q in self.onto(population, "current"):
            source = self.program.populations[self.program.projections[q].source]
            names = ("amplitude",) if source.schedule is not None else ("amplitude", "offset", "mean")
            w = self.weights[q]
            mean = sum(source.largest(word) for word in names if source.schedule or word in source.parameters)
            total += mean * (w.above + w.below) / size
        return total
