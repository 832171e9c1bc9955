"""What quantising looks at: one population of a program, all that arrives at it, and when.

One rule says when a spike acts; delay registers, their memory and refused delays follow from it. Input of most neurons
acts in the step in which it arrives: a spike over a delay of D steps acts after D. NEST's synaptic currents
(`I_syn_ex`, `I_syn_in`) move the potential a step after they arrive, so there it acts after D + 1. A chip's current
acts at once, so its spike must be that much later. How the delay register counts is a family's own.
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
    """What a user has set; a family's `neuro.chips.arithmetic.Option` says what there is.

    Attributes:
        values: by option, then by part, e.g. {"scales": {"exc": 50000.0}}.
    """

    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def of(self, option: str, part: str) -> Any:
        """What is set of a part, None if nothing is."""
        return self.values.get(option, {}).get(part)


class Inputs:
    """A population of neurons and the projections onto it.

    Args:
        program: the whole network.
        index: which population.
        modes: sign modes that are kept whatever the weights are now, by projection.
        check_only: find refusals only; weights of synapses that do not learn are not quantised.

    Attributes:
        spikes, currents: indices of the projections that carry spikes, and currents.
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
        """Steps from the emission of a spike of a projection to the update that sees it, shape as its delays."""
        return lag(self.program, index) if self.keeps(index) else longest_lag(self.program, index)

    def keeps(self, index: int) -> bool:
        """Whether the words of a projection are wanted."""
        return not self._check_only or bool(self.program.projections[index].synapse.learns)

    def learns(self, index: int) -> bool:
        """Whether the weights of a projection change."""
        synapse = self.program.projections[index].synapse
        return bool(synapse.learns) and not synapse.delays

    def range_of(self, index: int) -> Floats:
        """The weights of a projection, followed by the bounds between which learning may move them."""
        part = self.program.projections[index]
        if part.synapse.learns in ("pairs", "trials", "chip"):
            bounds = np.concatenate([np.ravel(end) for end in part.synapse.bounds()])
            return np.concatenate((part.weight, bounds[np.isfinite(bounds)]))
        return part.weight

    def sign_mode(self, index: int) -> str:
        """The signs that the weights of a projection have or may come to have."""
        if kept := self._modes.get(self.program.projections[index].name):
            return kept
        low, high = self._bounds[index]
        if low >= 0.0:
            return "excitatory"
        return "inhibitory" if high <= 0.0 else "mixed"

    def bounds(self, index: int) -> tuple[float, float]:
        """The smallest and the largest weight of a projection that carries spikes, or 0 if there is none such."""
        return self._bounds[index]

    @cached_property
    def _bounds(self) -> dict[int, tuple[float, float]]:
        found = {}
        for index in self.spikes:
            weight = self.range_of(index)
            found[index] = (float(weight.min(initial=0.0)), float(weight.max(initial=0.0)))
        return found

    @property
    def low(self) -> float:
        """The most negative weight that arrives, at most 0."""
        return min((low for low, _ in self._bounds.values()), default=0.0)

    @property
    def high(self) -> float:
        """The most positive weight that arrives, at least 0."""
        return max((high for _, high in self._bounds.values()), default=0.0)

    @cached_property
    def current(self) -> float:
        """The largest current in pA that generators may add to one neuron."""
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
        """The target of every synapse of a projection, in the order of its weights."""
        return self.program.connections(index)[1]


def constants_of(part: Population, resolution: float) -> Floats:
    """The constants of a population's exact integration, one row, or one a neuron where they differ."""
    model = part.model
    assert isinstance(model, Neuron)
    columns = [part.parameters[word] for word in model.quantities()]
    size = max(column.size for column in columns)
    rows = np.stack([np.broadcast_to(column, size) for column in columns], axis=1)
    different, back = np.unique(rows, axis=0, return_inverse=True)
    constants = np.zeros((len(different), model.width))
    for row, c in zip(different, constants, strict=True):
        model.arithmetic.constants(row, resolution, c)
    found: Floats = constants[back.reshape(-1)]
    return found


def falls(part: Population) -> NDArray[np.bool_]:
    """Of each neuron, or of the one that all are like, whether V_m falls at a spike instead of being reset."""
    found: NDArray[np.bool_] = part.parameters.get("reset_by_subtraction", np.zeros(1)) != 0.0
    return found


def fall_register(part: Population, unit: float) -> dict[str, Ints]:
    """How far the voltage register falls at a spike, of `unit` a mV; none where V_m is reset."""
    if not falls(part).any():
        return {}
    p = part.parameters
    return {"fall": np.atleast_1d(np.rint(unit * (p["V_th"] - p["V_reset"]) * falls(part)).astype(np.int64))}


def has_lowest(part: Population) -> bool:
    """Whether its potential is bounded from below."""
    return bool(np.isfinite(part.parameters.get("V_min", np.array([-np.inf]))).any())


def of_lowest(part: Population) -> Iterator[Problem]:
    """Lowest potentials that one register of a population cannot be."""
    if not has_lowest(part):
        return
    p = part.parameters
    if np.unique(p["V_min"]).size > 1:
        why = "one register of a core holds the lowest potential of its neurons"
        yield refused(part, "V_min differs from neuron to neuron", why, "use one V_min for all")
    elif np.any(p["V_min"] > p["E_L"]):
        what = f"V_min = {p['V_min'].max():g} mV"
        yield refused(part, what, "the lowest potential is above E_L", "lower V_min")


def of_falls(part: Population, how: str) -> Iterator[Problem]:
    """What a chip lacks, or does otherwise, of neurons whose potential falls at a spike."""
    if not falls(part).any():
        return
    if np.any(part.parameters["t_ref"] > 0.0):
        why = "a neuron that is held would fire with what is left of its voltage"
        yield refused(part, "reset_by_subtraction with t_ref above 0", why, "give it t_ref: 0")
    yield approximated(part, "reset_by_subtraction", how)
    if np.any(part.parameters.get("threshold_rises", np.zeros(1)) != 0.0):
        why = "a compartment fires at its threshold, also with what is left after a spike"
        yield approximated(part, "threshold_rises", why)
    if np.any(part.parameters.get("max_spikes", np.ones(1)) > 1.0):
        why = "a neuron fires once in a step here: what is left above the threshold fires in the next"
        yield approximated(part, "max_spikes above 1", why)


def value_at(part: Population, name: str, neuron: int) -> float:
    """A parameter of one neuron."""
    return float(np.broadcast_to(part.parameters[name], part.size)[neuron])


def too_short(part: Population, name: str, resolution: float) -> Iterator[Problem]:
    """A time constant below a step."""
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
    """A finite time constant beyond the longest that a decay register holds; `infinite`: it also holds no decay."""
    tau = part.parameters[name]
    longest = float(tau[np.isfinite(tau)].max(initial=0.0))
    if longest > limit * (1.0 + 1e-9):
        way = f"use at most {limit:.6g} ms, a coarser resolution" + (", or .inf for no leak" if infinite else "")
        yield refused(
            part,
            f"{name} = {longest:g} ms",
            f"{register} holds at most {limit:.6g} ms at a resolution of {resolution:g} ms",
            way if infinite else way.replace(", a ", " or a "),
        )


def one_kernel(inputs: Inputs, index: int, gains: int) -> list[Problem]:
    """A shared kernel onto neurons whose weights would need different scales; `gains` is how many there are."""
    part = inputs.program.projections[index]
    if part.grid is None or gains == 1:
        return []
    message, way = "a shared kernel onto neurons that differ", "give the neurons the same time constants and C_m"
    return [refused(part, message, "a kernel has one scale", way)]


def converging(inputs: Inputs, index: int, sign: float, weight: Floats | None = None) -> Floats:
    """Sum of the weights of one sign that each neuron could receive of a projection in one step, as magnitudes.

    Args:
        inputs: the population.
        index: of the projection.
        sign: 1 or -1.
        weight: in place of the projection's.
    """
    part, n = inputs.program.projections[index], inputs.part.size
    source = inputs.program.populations[part.source].size
    low, high = inputs.bounds(index)
    if weight is None and (high if sign > 0.0 else -low) <= 0.0:
        return np.zeros(n)
    given = part.weight if weight is None else weight
    if part.layout == "csr" and given.size > 1:
        total = np.zeros(n)
        arriving(part.targets, given, sign, total)
        return total
    own = np.maximum(sign * given, 0.0)
    if part.grid is not None:
        per_map: Floats = np.broadcast_to(own, part.size).reshape(part.grid.maps, -1).sum(axis=1)
        return np.repeat(per_map, n // part.grid.maps)
    if part.layout == "one_to_one":
        return np.broadcast_to(own, n)
    if part.layout == "dense":
        column: Floats = np.broadcast_to(own, source * n).reshape(source, n).sum(axis=0)
        return column
    counted = np.bincount(part.targets, weights=np.broadcast_to(own, part.size), minlength=n)
    return counted.astype(np.float64)


def refused(part: Population | Projection, what: str, why: str, way_out: str) -> Problem:
    """A problem of a part that keeps a program from running."""
    return Problem(True, f"{_named(part)}: {what}", why, way_out, part.origin)


def approximated(part: Population | Projection, what: str, why: str, way_out: str = "") -> Problem:
    """A problem of a part, or of a property of it, that changes what a program does."""
    return Problem(False, f"{_named(part)}: {what}" if what else _named(part), why, way_out, part.origin)


def _named(part: Population | Projection) -> str:
    return f"{'population' if isinstance(part, Population) else 'projection'} '{part.name}'"


LEARN_ELSEWHERE = f"run it on event: {SAVE_FROZEN}"
"""The way out for delays that a chip cannot learn."""


def foreign(program: Program, chip: Chip, index: int) -> Problem | None:
    """Why a synapse model cannot be on a chip: another family has its registers, or synapses share weights; or None."""
    part = program.projections[index]
    if part.grid is not None and part.synapse.learns in ("pairs", "chip"):
        why = "its synapses are spelled out, so each would learn a weight of its own"
        return refused(part, part.synapse.name, f"a shared kernel that learns: {why}", LEARN_ELSEWHERE)
    other = part.synapse.chip
    if not other or other == chip.arithmetic:
        return None
    return refused(
        part, part.synapse.name, f"it is in the registers or programs of {other}", f"backend '{other}' runs it"
    )


def no_rule(program: Program, index: int) -> Problem | None:
    """Why no learning engine can run a synapse model onto these neurons; None if one can."""
    part = program.projections[index]
    synapse, target = part.synapse, program.populations[part.target].model
    if isinstance(target, parrot_neuron) and synapse.learns in ("pairs", "chip"):
        why = "the host relays the spikes of parrots, so there is no weight to learn"
        way = "learn at the next projection"
    elif synapse.chip not in ("", "spinnaker") and not target.chip and not isinstance(target, parrot_neuron):
        why, way = f"its weights are mantissas, but {target.name} has mV and pA", "use static or stdp, or a loihi_lif"
    elif words := synapse.per_synapse():
        why = f"{', '.join(words)} of each synapse: a rule of the chip is one for the whole projection"
        way = "give all synapses one number, split the projection, or run on event"
    elif synapse.learns == "pairs" and target.chip:
        why, way = f"its weights are in mV or pA, but {target.name} has registers", "use loihi_learning"
        if target.chip == "spinnaker":
            way = "use iaf_psc_exp or iaf_psc_delta"
    else:
        return None
    return refused(part, synapse.name, why, way)


LARGEST_SIGNAL = 4.0
"""Dopamine that a signal may set, in those of one dopamine spike, 1/tau_n, where nothing says more."""


def largest_signal(program: Program, index: int, options: Options) -> float:
    """Return the largest dopamine in 1/ms that the signal of a projection sets: an option, the signal, or a default.

    Raises:
        ModelError: the signal is computed, and nothing says it.
    """
    part = program.projections[index]
    signal = program.signals[part.signal] if part.signal >= 0 else None
    largest = options.of("signals", part.name)
    if signal is not None and not largest:
        largest = signal.largest
        if largest is None and signal.values is not None:
            message = f"its signal '{signal.name}' is computed: the largest value is not known"
            hint = f"'largest' in its values says it, or the option signals={{'{part.name}': ...}}"
            raise ModelError(message, hint=hint)
    return float(largest or LARGEST_SIGNAL / part.synapse.parameters().get("tau_n", 1.0))


def acts_late(model: Model) -> bool:
    """Whether input moves the potential only in the step after its arrival."""
    return any(state.name.startswith("I_syn") for state in model.states) and not isinstance(model, cuba_lif)


def lag(program: Program, index: int) -> NDArray[np.int32]:
    """Steps from the emission of a spike of a projection to the update of its target that sees it.

    Args:
        program: has the projection.
        index: of the projection.

    Returns:
        shape (1,) where the projection has one delay and keeps it, else one per synapse.
    """
    part = program.projections[index]
    late = acts_late(program.populations[part.target].model)
    delay = np.broadcast_to(part.delay, part.size) if part.synapse.delays else part.delay
    return np.add(delay, late, dtype=np.int32)


def longest_lag(program: Program, index: int) -> NDArray[np.int32]:
    """The longest lag of a projection, now or when its delays have learnt, shape (1,), or none without synapses."""
    part = program.projections[index]
    late = acts_late(program.populations[part.target].model)
    if part.synapse.delays:
        _, most = part.delay_range(program.resolution)
        return np.array([most + late], dtype=np.int32)
    return (
        np.add(part.delay.max(keepdims=True), late, dtype=np.int32) if part.delay.size else part.delay.astype(np.int32)
    )


def register(lag: NDArray[np.int32], of_one: int) -> NDArray[np.int32]:
    """What a delay register holds for some lags; `of_one` is what it holds for a lag of one step."""
    return lag + np.int32(of_one - 1)


def has_two_inputs(model: Model) -> bool:
    """Whether the synapses onto a neuron name one of two inputs."""
    return isinstance(model, Neuron) and model.receptors == 2 and not model.signed
