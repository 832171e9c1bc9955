"""Differences between Loihi 1 and Loihi 2 in the integers of one network.

| rule | Loihi 1 | Loihi 2 |
| --- | --- | --- |
| mantissas in mixed mode | lose their lowest bits towards 0 | rounded down |
| negative weight exponents | shift each weight | shift the sum of a step, rounded down |
| input of a step | 22 bits | 32 bits |
| u + bias | 24 bits | 32 bits |
| u = -2^23 | stays | becomes 2^23 |
| several spikes of a generator in a step | one | a payload |
| refractory period, learning | yes | no |

All weight words are compared. The registers are compared in every step of a run on both chips. A model such as
`loihi_lif` has the registers of one chip as parameters. It is converted to the model of the other chip, here
`loihi2_lif`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import chip
from neuro.chips.quantising import quantise
from neuro.compiler import compile_network
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.tables import Table, as_html, as_text
from neuro.model.network import Network
from neuro.model.neurons import Generator, loihi2_lif, loihi_lif, parrot_neuron
from neuro.model.synapses import loihi2_static, loihi_static, static
from neuro.program.backend import Engine, OverflowWarning, find_backend
from neuro.program.program import Population, Program, Projection

CHIPS = ("loihi", "loihi2")
HEAD = ("part", "where", "Loihi 1", "Loihi 2", "why")
_CLASSES: dict[str, tuple[Any, Any]] = {"loihi": (loihi_lif, loihi_static), "loihi2": (loihi2_lif, loihi2_static)}


@dataclass(frozen=True, slots=True)
class RuleDifference:
    """A difference between the two chips.

    Attributes:
        part: part of the network.
        where: place of the difference, e.g. "weight[3], 5 of 80 weights" or "neuron 2, step 7: v, 1 of 9 neurons".
        loihi, loihi2: value on each chip.
        why: rule that causes a difference of weights or counts, or the reason of a refusal; "" for registers, whose
            difference may follow from earlier differences.
    """

    part: str
    where: str
    loihi: str
    loihi2: str
    why: str


@dataclass(frozen=True, slots=True)
class LoihiRules:
    """The differences of a network, printed as a table.

    Attributes:
        network: name of the network.
        steps: number of compared steps; 0 if one of the chips refuses the network.
        spikes: number of spikes of all neurons on each chip. Without spikes, equal registers mean little.
        differences: all differences; empty if all integers are equal.
    """

    network: str
    steps: int
    spikes: tuple[int, int]
    differences: tuple[RuleDifference, ...]

    def __str__(self) -> str:
        return as_text(self._heading(), self._tables())

    def _repr_html_(self) -> str:
        return as_html(self._heading(), self._tables())

    def _heading(self) -> str:
        count, ran = len(self.differences), "not run"
        if self.steps:
            spikes_1, spikes_2 = self.spikes
            fired = f"{spikes_1:,} spikes" if spikes_1 == spikes_2 else f"{spikes_1:,} and {spikes_2:,} spikes"
            ran = f"{self.steps:,} steps on both, {fired}"
        summary = f"{count} difference{'s' * (count > 1)}" if count else "all words and registers are equal"
        return f"'{self.network}' by the rules of Loihi 1 and Loihi 2: {summary} ({ran})"

    def _tables(self) -> list[Table]:
        rows = tuple((d.part, d.where, d.loihi, d.loihi2, d.why) for d in self.differences)
        return [Table("", HEAD, rows)]


def loihi_rules(net: Network, duration: float = 100.0, seed: int = 0) -> LoihiRules:
    """Return the differences between Loihi 1 and Loihi 2 in the integers of a network.

    Args:
        net: any network.
        duration: duration of the run on both chips, in ms.
        seed: seed of the run.

    Raises:
        ModelError: `net` is not a network, or `duration` is below 0, infinite or off the grid.
    """
    if not isinstance(net, Network):
        raise ModelError(f"loihi_rules: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    steps = Clock(net.resolution).step(duration, "duration")
    if not 0 <= steps < NEVER:
        raise ModelError(f"duration = {duration} ms: expected a finite time >= 0 ms")
    program = compile_network(net, seed)
    programs = []
    for name in CHIPS:  # convert parts that are written for the other Loihi
        populations = tuple(_population(part, name) for part in program.populations)
        native = [part.model.chip == name for part in populations]
        projections = tuple(_projection(part, name, native[part.target]) for part in program.projections)
        programs.append(replace(program, populations=populations, projections=projections))
    fixed = [quantise(p, chip(name)) for p, name in zip(programs, CHIPS, strict=True)]
    differences = [*_refused(fixed), *_words(program, fixed)]
    if any(problem.refused for on_chip in fixed for problem in on_chip.problems):
        return LoihiRules(net.name, 0, (0, 0), tuple(differences))
    engines = [find_backend(name).build(p) for name, p in zip(CHIPS, programs, strict=True)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)  # overflows are reported below
        differences += _registers(program, engines, steps)
    differences += _counted(engines)
    spikes_1, spikes_2 = (_fired(program, engine) for engine in engines)
    return LoihiRules(net.name, steps, (spikes_1, spikes_2), tuple(differences))


def _population(part: Population, name: str) -> Population:
    model = _CLASSES[name][0]
    if not isinstance(part.model, (loihi_lif, loihi2_lif)) or isinstance(part.model, model):
        return part
    required = {"refractory": 1} if name == "loihi2" else {"reset_interval": 0}
    if any(np.any(part.parameters[word] != value) for word, value in required.items()):
        return part  # not converted, so the other chip refuses the population
    quantities = model.quantities()
    common = {word: values for word, values in part.parameters.items() if word in quantities}
    added = {word: np.full(1, float(value)) for word, value in model.defaults().items() if word not in common}
    return replace(part, model=model(), parameters={word: (common | added)[word] for word in quantities})


def _projection(part: Projection, name: str, target_is_native: bool) -> Projection:
    synapse = _CLASSES[name][1]
    if not target_is_native or not isinstance(part.synapse, (loihi_static, loihi2_static, static)):
        return part
    parameters = {} if isinstance(part.synapse, static) else part.synapse.parameters()
    return part if isinstance(part.synapse, synapse) else replace(part, synapse=synapse(**parameters))


def _refused(fixed: list[FixedProgram]) -> Iterator[RuleDifference]:
    """Yield the parts refused by one chip only."""
    reasons = [{p.what: p.why for p in on_chip.problems if p.refused} for on_chip in fixed]
    for name in dict.fromkeys([*reasons[0], *reasons[1]]):
        sides = ["refused" if name in refusals else "accepted" for refusals in reasons]
        yield RuleDifference(name, "", sides[0], sides[1], reasons[0].get(name) or reasons[1][name])


def _words(program: Program, fixed: list[FixedProgram]) -> Iterator[RuleDifference]:
    """Yield the projections whose spikes add different values on the two chips."""
    for index, part in enumerate(program.projections):
        loihi, loihi2 = (on_chip.projections[index] for on_chip in fixed)
        if loihi is None or loihi2 is None:
            continue
        # Values added by a spike to the input of a step, for each weight, before the sum is rounded.
        added, added2 = np.broadcast_arrays(*(w.words.astype(np.float64) / (1 << w.shift) for w in (loihi, loihi2)))
        differing = np.flatnonzero(added != added2)
        if differing.size:
            k, count = differing[0], f"{differing.size:,} of {added.size:,} weights"
            reason = "the sum is shifted, not each weight" if loihi2.shift else "mixed mantissas are rounded down"
            place = f"weight[{k}], {count}"
            yield RuleDifference(part.name, place, f"{added[k]:g}", f"{added2[k]:g}", reason)


def _registers(program: Program, engines: list[Engine], steps: int) -> Iterator[RuleDifference]:
    """Yield the first difference in the registers of each population."""
    equal_so_far = {
        k for k, part in enumerate(program.populations) if not isinstance(part.model, (Generator, parrot_neuron))
    }
    for step in range(1, steps + 1):
        for engine in engines:
            engine.run(1)
        for k in sorted(equal_so_far):
            for name in ("u", "v"):
                loihi, loihi2 = (engine.registers(k, name) for engine in engines)  # type: ignore[attr-defined]
                differing = np.flatnonzero(loihi != loihi2)
                if differing.size and k in equal_so_far:
                    equal_so_far.discard(k)
                    neuron = differing[0]
                    place = f"neuron {neuron}, step {step}: {name}, {differing.size:,} of {loihi.size:,} neurons"
                    values = str(loihi[neuron]), str(loihi2[neuron])
                    yield RuleDifference(program.populations[k].name, place, *values, "")
        if not equal_so_far:  # the engines finish the run for its counts
            for engine in engines:
                engine.run(steps - step)
            break


def _fired(program: Program, engine: Engine) -> int:
    """Return the number of spikes of all neurons."""
    counted = zip(program.populations, engine.counts().spikes, strict=True)
    return sum(int(spikes.sum()) for part, spikes in counted if part.kind == "neuron")


def _counted(engines: list[Engine]) -> Iterator[RuleDifference]:
    """Yield the counts of overflows that differ between the chips."""
    loihi, loihi2 = (dict(engine.counts().native) for engine in engines)
    for name in sorted({*loihi, *loihi2}):
        if loihi.get(name, 0) != loihi2.get(name, 0):
            event, _, part = name.partition(" of ")
            reason = {
                "input wraps": "the input of a step has 22 bits on Loihi 1",
                "drive wraps": "u + bias has 24 bits on Loihi 1",
                "merged spikes": "several spikes of a neuron in a step are one on Loihi 1",
            }.get(event, "")
            yield RuleDifference(part, event, f"{loihi.get(name, 0):,}", f"{loihi2.get(name, 0):,}", reason)
