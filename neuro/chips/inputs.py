"""Input of a population for quantising: projections, weights and delays.

One rule determines when a spike acts. Delay registers, the bits of delays and refused delays follow from this rule. The
input of most neurons acts in the step of its arrival: a spike with a delay of D steps acts after D steps. NEST's
synaptic currents (`I_syn_ex`, `I_syn_in`) move the potential one step after they arrive, so a spike acts after D + 1
steps. A chip's current acts at once, so its spike is delayed by that step. Each family has its own encoding of the
delay register.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.description import Chip
from neuro.chips.fixed import Words, arriving
from neuro.core.errors import ModelError
from neuro.model.neurons import Model, Neuron, cuba_lif, parrot_neuron
from neuro.program.backend import SAVE_FROZEN, Problem
from neuro.program.currents import generator_of
from neuro.program.program import Floats, Ints, Population, Program, Projection


@dataclass(frozen=True, slots=True)
class Options:
    """Options set by a user. `neuro.chips.arithmetic.Option` describes the options of a family.

    Attributes:
        values: values by option, then by part, e.g. {"scales": {"exc": 50000.0}}.
    """

    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def of(self, option: str, part: str) -> Any:
        """Return the value of an option for a part, or None."""
        return self.values.get(option, {}).get(part)


class Inputs:
    """A population of neurons and the projections onto it.

    Args:
        program: the whole network.
        index: index of the population.
        modes: fixed sign modes by projection; other modes follow from the weights.
        check_only: whether to find refusals only, without quantising the weights of synapses that do not learn.

    Attributes:
        spikes: indices of the projections that carry spikes.
        currents: indices of the projections that carry currents.
    """

    def __init__(
        self, program: Program, index: int, modes: Mapping[str, str] | None = None, check_only: bool = False
    ) -> None:
        self.program, self.index, self.part = program, index, program.populations[index]
        self._modes, self._check_only = modes or {}, check_only
        incoming = [i for i, p in enumerate(program.projections) if p.target == index]
        self.currents = [i for i in incoming if program.projections[i].carries == "current"]
        self.spikes = [i for i in incoming if i not in self.currents]

    def lag(self, index: int) -> Words:
        """Return the steps from the emission of a spike to its effect, in the shape of the delays."""
        return lag(self.program, index) if self.keeps(index) else longest_lag(self.program, index)

    def keeps(self, index: int) -> bool:
        """Return whether the words of a projection must be kept."""
        return not self._check_only or bool(self.program.projections[index].synapse.learns)

    def learns(self, index: int) -> bool:
        """Return whether the weights of a projection can change."""
        synapse = self.program.projections[index].synapse
        return bool(synapse.learns) and not synapse.delays

    def range_of(self, index: int) -> Floats:
        """Return the weights of a projection, followed by the bounds of its learning rule."""
        part = self.program.projections[index]
        if part.synapse.learns in ("pairs", "trials", "chip"):
            bounds = np.concatenate([np.ravel(end) for end in part.synapse.bounds()])
            return np.concatenate((part.weight, bounds[np.isfinite(bounds)]))
        return part.weight

    def sign_mode(self, index: int) -> str:
        """Return the sign mode for the weights of a projection, now and at the bounds of learning."""
        if mode := self._modes.get(self.program.projections[index].name):
            return mode
        low, high = self._bounds[index]
        if low >= 0.0:
            return "excitatory"
        return "inhibitory" if high <= 0.0 else "mixed"

    def bounds(self, index: int) -> tuple[float, float]:
        """Return the smallest weight (or 0, if smaller) and the largest weight (or 0, if larger) of a projection."""
        return self._bounds[index]

    @cached_property
    def _bounds(self) -> dict[int, tuple[float, float]]:
        bounds = {}
        for index in self.spikes:
            weight = self.range_of(index)
            bounds[index] = (float(weight.min(initial=0.0)), float(weight.max(initial=0.0)))
        return bounds

    @property
    def low(self) -> float:
        """Most negative weight of all projections, at most 0."""
        return min((low for low, _ in self._bounds.values()), default=0.0)

    @property
    def high(self) -> float:
        """Most positive weight of all projections, at least 0."""
        return max((high for _, high in self._bounds.values()), default=0.0)

    @cached_property
    def current(self) -> float:
        """Largest current in pA that generators can add to one neuron."""
        total = 0.0
        for index in self.currents:
            part = self.program.projections[index]
            source = self.program.populations[part.source]
            if generator_of(source).varies:  # refused elsewhere
                continue
            amplitude = source.largest("amplitude")
            fan_in = 1
            if part.layout != "one_to_one":
                _, post = self.program.connections(index)
                fan_in = int(np.bincount(post, minlength=1).max(initial=0))
            total += fan_in * amplitude * float(np.abs(part.weight).max(initial=0.0))
        return total

    def targets(self, index: int) -> Ints:
        """Return the target of every synapse of a projection, in the order of its weights."""
        return self.program.connections(index)[1]


def constants_of(part: Population, resolution: float) -> Floats:
    """Return the constants of exact integration: one row if all neurons are equal, else a row per neuron."""
    model = part.model
    assert isinstance(model, Neuron)
    columns = [part.parameters[word] for word in model.quantities()]
    size = max(column.size for column in columns)
    rows = np.stack([np.broadcast_to(column, size) for column in columns], axis=1)
    distinct, indices = np.unique(rows, axis=0, return_inverse=True)
    constants = np.zeros((len(distinct), model.width))
    for row, c in zip(distinct, constants, strict=True):
        model.arithmetic.constants(row, resolution, c)
    expanded: Floats = constants[indices.reshape(-1)]
    return expanded


def resets_by_subtraction(part: Population) -> NDArray[np.bool_]:
    """Return whether a spike subtracts from V_m instead of resetting V_m; shape (1,) or (neurons,)."""
    subtracts: NDArray[np.bool_] = part.parameters.get("reset_by_subtraction", np.zeros(1)) != 0.0
    return subtracts


def soft_reset_register(part: Population, unit: float) -> dict[str, Ints]:
    """Return the register with the fall of the voltage at a spike, at `unit` units per mV; empty if V_m is reset."""
    if not resets_by_subtraction(part).any():
        return {}
    p = part.parameters
    return {
        "fall": np.atleast_1d(np.rint(unit * (p["V_th"] - p["V_reset"]) * resets_by_subtraction(part)).astype(np.int64))
    }


def has_lowest_potential(part: Population) -> bool:
    """Return whether the potential of a population has a lower bound."""
    return bool(np.isfinite(part.parameters.get("V_min", np.array([-np.inf]))).any())


def lowest_potential_problems(part: Population) -> Iterator[Problem]:
    """Yield problems with lower bounds of potentials that one register per core cannot hold."""
    if not has_lowest_potential(part):
        return
    p = part.parameters
    if np.unique(p["V_min"]).size > 1:
        reason = "one register of a core holds the lowest potential of its neurons"
        yield refused(part, "V_min differs from neuron to neuron", reason, "use one V_min for all")
    elif np.any(p["V_min"] > p["E_L"]):
        subject = f"V_min = {p['V_min'].max():g} mV"
        yield refused(part, subject, "the lowest potential is above E_L", "lower V_min")


def soft_reset_problems(part: Population, chip_reset: str) -> Iterator[Problem]:
    """Yield problems with reset by subtraction. `chip_reset` describes the chip's own reset, for messages."""
    if not resets_by_subtraction(part).any():
        return
    if np.any(part.parameters["t_ref"] > 0.0):
        reason = "a refractory neuron would fire with the remaining voltage"
        yield refused(part, "reset_by_subtraction with t_ref above 0", reason, "give it t_ref: 0")
    yield approximated(part, "reset_by_subtraction", chip_reset)
    if np.any(part.parameters.get("threshold_rises", np.zeros(1)) != 0.0):
        reason = "a compartment fires at its threshold, also with the voltage that remains after a spike"
        yield approximated(part, "threshold_rises", reason)
    if np.any(part.parameters.get("max_spikes", np.ones(1)) > 1.0):
        reason = "a neuron fires once per step here: a voltage that remains above the threshold fires in the next step"
        yield approximated(part, "max_spikes above 1", reason)


def value_at(part: Population, name: str, neuron: int) -> float:
    """Return a parameter of one neuron."""
    return float(np.broadcast_to(part.parameters[name], part.size)[neuron])


def too_short(part: Population, name: str, resolution: float) -> Iterator[Problem]:
    """Yield a problem if a time constant is below a step."""
    shortest = float(part.parameters[name].min())
    if shortest < resolution:
        yield refused(
            part,
            f"{name} = {shortest:g} ms",
            f"it is below a step of {resolution:g} ms",
            "use a finer resolution or a longer time constant",
        )


def too_long(
    part: Population, name: str, resolution: float, limit: float, register: str, infinite: bool
) -> Iterator[Problem]:
    """Yield a problem if a finite time constant exceeds its decay register. `infinite`: it can hold no decay."""
    tau = part.parameters[name]
    longest = float(tau[np.isfinite(tau)].max(initial=0.0))
    if longest > limit * (1.0 + 1e-9):
        way_out = f"use at most {limit:.6g} ms, a coarser resolution" + (", or .inf for no leak" if infinite else "")
        yield refused(
            part,
            f"{name} = {longest:g} ms",
            f"{register} holds at most {limit:.6g} ms at a resolution of {resolution:g} ms",
            way_out if infinite else way_out.replace(", a ", " or a "),
        )


def one_kernel(inputs: Inputs, index: int, gains: int) -> list[Problem]:
    """Return a problem if a shared kernel ends on neurons with several scales; `gains` is their number."""
    part = inputs.program.projections[index]
    if part.grid is None or gains == 1:
        return []
    message, way_out = "a shared kernel onto neurons that differ", "give the neurons the same time constants and C_m"
    return [refused(part, message, "a kernel has one scale", way_out)]


def converging(inputs: Inputs, index: int, sign: float, weight: Floats | None = None) -> Floats:
    """Return the largest input of a sign that each neuron can get from a projection in a step, as a magnitude.

    Args:
        inputs: the population.
        index: index of the projection.
        sign: 1 or -1.
        weight: weights to use instead of the projection's.
    """
    part, n = inputs.program.projections[index], inputs.part.size
    source = inputs.program.populations[part.source].size
    low, high = inputs.bounds(index)
    if weight is None and (high if sign > 0.0 else -low) <= 0.0:
        return np.zeros(n)
    weights = part.weight if weight is None else weight
    if part.layout == "csr" and weights.size > 1:
        total = np.zeros(n)
        arriving(part.targets, weights, sign, total)
        return total
    magnitudes = np.maximum(sign * weights, 0.0)
    if part.grid is not None:
        per_map: Floats = np.broadcast_to(magnitudes, part.size).reshape(part.grid.maps, -1).sum(axis=1)
        return np.repeat(per_map, n // part.grid.maps)
    if part.layout == "one_to_one":
        return np.broadcast_to(magnitudes, n)
    if part.layout == "dense":
        column: Floats = np.broadcast_to(magnitudes, source * n).reshape(source, n).sum(axis=0)
        return column
    counted = np.bincount(part.targets, weights=np.broadcast_to(magnitudes, part.size), minlength=n)
    return counted.astype(np.float64)


def refused(part: Population | Projection, feature: str, reason: str, way_out: str) -> Problem:
    """Return a problem of a part that keeps a program from running."""
    return Problem(True, f"{_label(part)}: {feature}", reason, way_out, part.origin)


def approximated(part: Population | Projection, feature: str, reason: str, way_out: str = "") -> Problem:
    """Return a problem of a part, or of a property, that changes the results of a program."""
    return Problem(False, f"{_label(part)}: {feature}" if feature else _label(part), reason, way_out, part.origin)


def _label(part: Population | Projection) -> str:
    return f"{'population' if isinstance(part, Population) else 'projection'} '{part.name}'"


LEARN_ELSEWHERE = f"run it on event: {SAVE_FROZEN}"
"""Hint for rules whose delays a chip cannot learn."""


def foreign(program: Program, chip: Chip, index: int) -> Problem | None:
    """Return a problem if a synapse model cannot run on a chip, else None.

    Either the model has the registers of another family, or synapses that learn share weights.
    """
    part = program.projections[index]
    if part.grid is not None and part.synapse.learns in ("pairs", "chip"):
        reason = "the chip stores each synapse, so each synapse would learn its own weight"
        return refused(part, part.synapse.name, f"a shared kernel that learns: {reason}", LEARN_ELSEWHERE)
    other = part.synapse.chip
    if not other or other == chip.arithmetic:
        return None
    return refused(
        part, part.synapse.name, f"it is in the registers or programs of {other}", f"backend '{other}' runs it"
    )


def no_rule(program: Program, index: int) -> Problem | None:
    """Return a problem if no learning engine can run a synapse model onto these neurons, else None."""
    part = program.projections[index]
    synapse, target = part.synapse, program.populations[part.target].model
    if isinstance(target, parrot_neuron) and synapse.learns in ("pairs", "chip"):
        why = "the host relays the spikes of parrots, so there is no weight to learn"
        way = "learn at the next projection"
    elif synapse.chip not in ("", "spinnaker") and not target.chip and not isinstance(target, parrot_neuron):
        why, way = f"its weights are mantissas, but {target.name} has mV and pA", "use static or stdp, or a loihi_lif"
    elif parameters := synapse.per_synapse():
        why = f"{', '.join(parameters)} of each synapse: expected one number, because a rule is for a projection"
        way = "give all synapses one number, split the projection, or run on event"
    elif synapse.learns == "pairs" and target.chip:
        why, way = f"its weights are in mV or pA, but {target.name} has registers", "use loihi_learning"
        if target.chip == "spinnaker":
            way = "use iaf_psc_exp or iaf_psc_delta"
    else:
        return None
    return refused(part, synapse.name, why, way)


LARGEST_SIGNAL = 4.0
"""Default for the largest dopamine that a signal sets, in units of one dopamine spike (1/tau_n)."""


def largest_signal(program: Program, index: int, options: Options) -> float:
    """Return the largest dopamine in 1/ms that the signal of a projection sets.

    The value comes from the option `signals`, else from the signal, else from a default.

    Raises:
        ModelError: the signal is computed, and neither the option nor the signal gives a largest value.
    """
    part = program.projections[index]
    signal = program.signals[part.signal] if part.signal >= 0 else None
    largest = options.of("signals", part.name)
    if signal is not None and not largest:
        largest = signal.largest
        if largest is None and signal.values is not None:
            message = f"its signal '{signal.name}' is computed: the largest value is not known"
            hint = f"set 'largest' in its values, or the option signals={{'{part.name}': ...}}"
            raise ModelError(message, hint=hint)
    return float(largest or LARGEST_SIGNAL / part.synapse.parameters().get("tau_n", 1.0))


def acts_late(model: Model) -> bool:
    """Return whether input changes the potential one step after its arrival."""
    return any(state.name.startswith("I_syn") for state in model.states) and not isinstance(model, cuba_lif)


def lag(program: Program, index: int) -> NDArray[np.int32]:
    """Return the steps from the emission of a spike to its effect on the target.

    Args:
        program: the whole network.
        index: index of the projection.

    Returns:
        Steps, shape (1,) if the projection has one constant delay, else one entry per synapse.
    """
    projection = program.projections[index]
    extra = acts_late(program.populations[projection.target].model)
    delay = np.broadcast_to(projection.delay, projection.size) if projection.synapse.delays else projection.delay
    return np.add(delay, extra, dtype=np.int32)


def longest_lag(program: Program, index: int) -> NDArray[np.int32]:
    """Return the longest lag of a projection, now or after delays have learnt, shape (1,); empty without synapses."""
    part = program.projections[index]
    extra = acts_late(program.populations[part.target].model)
    if part.synapse.delays:
        _, longest = part.delay_range(program.resolution)
        return np.array([longest + extra], dtype=np.int32)
    return (
        np.add(part.delay.max(keepdims=True), extra, dtype=np.int32) if part.delay.size else part.delay.astype(np.int32)
    )


def register(lag: NDArray[np.int32], of_one: int) -> NDArray[np.int32]:
    """Return the contents of a delay register for lags; `of_one` is the content for a lag of one step."""
    return lag + np.int32(of_one - 1)


def has_two_inputs(model: Model) -> bool:
    """Return whether each synapse onto a neuron selects one of two inputs."""
    return isinstance(model, Neuron) and model.receptors == 2 and not model.signed
