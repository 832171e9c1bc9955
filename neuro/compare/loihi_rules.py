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

All words are compared, and the registers in every step of a run on both chips. If a
network is given in the registers of one chip, the parameters are converted for the other chip.
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
_OWN: dict[str, tuple[Any, Any]] = {"loihi": (loihi_lif, loihi_static), "loihi2": (loihi2_lif, loihi2_static)}


@dataclass(frozen=True, slots=True)
class RuleDifference:
    """A difference between the two chips.

    Attributes:
        part: part of the network.
        where: synapse, or neuron and step, and quantity.
        loihi, loihi2: value on each chip.
        why: rule that causes the difference, if words and counts show it; "" if the difference follows from earlier
            ones.
    """

    part: str
    where: str
    loihi: str
    loihi2: str
    why: str


@dataclass(frozen=True, slots=True)
class LoihiRules:
    """The differences of a network; it prints as a table.

    Attributes:
        network: its name.
        steps: that were compared on both; 0 where one of the chips refuses the network.
        spikes: of all neurons on either chip. Where there are none, equal registers say little.
        differences: none if all integers are equal.
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
            one, two = self.spikes
            fired = f"{one:,} spikes" if one == two else f"{one:,} and {two:,} spikes"
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
        ModelError: `net` is no network, or `duration` is below 0, infinite or off the grid.
    """
    if not isinstance(net, Network):
        raise ModelError(f"loihi_rules: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    steps = Clock(net.resolution).step(duration, "duration")
    if not 0 <= steps < NEVER:
        raise ModelError(f"duration = {duration} ms: expected a finite time >= 0 ms")
    program = compile_network(net, seed)
    programs = []
    for name in CHIPS:  # convert parts that are given in the other Loihi's registers
        populations = tuple(_population(part, name) for part in program.populations)
        native = [part.model.chip == name for part in populations]
        projections = tuple(_projection(part, name, native[part.target]) for part in program.projections)
        programs.append(replace(program, populations=populations, projections=projections))
    fixed = [quantise(each, chip(name)) for each, name in zip(programs, CHIPS, strict=True)]
    differences = [*_refused(fixed), *_words(program, fixed)]
    if any(problem.refused for each in fixed for problem in each.problems):
        return LoihiRules(net.name, 0, (0, 0), tuple(differences))
    engines = [find_backend(name).build(each) for name, each in zip(CHIPS, programs, strict=True)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)  # they are reported below
        differences += _registers(program, engines, steps)
    differences += _counted(engines)
    one, two = (_fired(program, engine) for engine in engines)
    return LoihiRules(net.name, steps, (one, two), tuple(differences))


def _population(part: Population, name: str) -> Population:
    own = _OWN[name][0]
    if not isinstance(part.model, (loihi_lif, loihi2_lif)) or isinstance(part.model, own):
        return part
    lost = {"refractory": 1} if name == "loihi2" else {"reset_interval": 0}
    if any(np.any(part.parameters[word] != value) for word, value in lost.items()):
        return part  # refused there
    words = own.quantities()
    common = {word: values for word, values in part.parameters.items() if word in words}
    added = {word: np.full(1, float(value)) for word, value in own.defaults().items() if word not in common}
    return replace(part, model=own(), parameters={word: (common | added)[word] for word in words})


def _projection(part: Projection, name: str, native: bool) -> Projection:
    own = _OWN[name][1]
    if not native or not isinstance(part.synapse, (loihi_static, loihi2_static, static)):
        return part
    words = {} if isinstance(part.synapse, static) else part.synapse.parameters()
    return part if isinstance(part.synapse, own) else replace(part, synapse=own(**words))


def _refused(fixed: list[FixedProgram]) -> Iterator[RuleDifference]:
    """Yield the parts that one chip refuses and the other accepts."""
    refused = [{p.what: p.why for p in each.problems if p.refused} for each in fixed]
    for what in dict.fromkeys([*refused[0], *refused[1]]):
        sides = ["refused" if what in each else "accepted" for each in refused]
        yield RuleDifference(what, "", sides[0], sides[1], refused[0].get(what) or refused[1][what])


def _words(program: Program, fixed: list[FixedProgram]) -> Iterator[RuleDifference]:
    """Projections whose spikes add something else."""
    for index, part in enumerate(program.projections):
        one, two = (each.projections[index] for each in fixed)
        if one is None or two is None:
            continue
        # What a spike adds to the input of a step, of each weight, before a sum is rounded.
        first, second = np.broadcast_arrays(*(w.words.astype(np.float64) / (1 << w.shift) for w in (one, two)))
        wrong = np.flatnonzero(first != second)
        if wrong.size:
            at, count = wrong[0], f"{wrong.size:,} of {first.size:,} weights"
            why = "the sum is shifted, not each weight" if two.shift else "mixed mantissas are rounded down"
            where = f"weight[{at}], {count}"
            yield RuleDifference(part.name, where, f"{first[at]:g}", f"{second[at]:g}", why)


def _registers(program: Program, engines: list[Engine], steps: int) -> Iterator[RuleDifference]:
    """Yield the first step in which registers of a population differ."""
    equal_so_far = {
        k for k, part in enumerate(program.populations) if not isinstance(part.model, (Generator, parrot_neuron))
    }
    for step in range(1, steps + 1):
        for engine in engines:
            engine.run(1)
        for k in sorted(equal_so_far):
            for name in ("u", "v"):
                one, two = (engine.registers(k, name) for engine in engines)  # type: ignore[attr-defined]
                wrong = np.flatnonzero(one != two)
                if wrong.size and k in equal_so_far:
                    equal_so_far.discard(k)
                    at = wrong[0]
                    where = f"neuron {at}, step {step}: {name}, {wrong.size:,} of {one.size:,} neurons"
                    yield RuleDifference(program.populations[k].name, where, str(one[at]), str(two[at]), "")
        if not equal_so_far:  # the engines finish the run for its counts
            for engine in engines:
                engine.run(steps - step)
            break


def _fired(program: Program, engine: Engine) -> int:
    """Spikes of all neurons."""
    counted = zip(program.populations, engine.counts().spikes, strict=True)
    return sum(int(spikes.sum()) for part, spikes in counted if part.kind == "neuron")


def _counted(engines: list[Engine]) -> Iterator[RuleDifference]:
    """Overflows that one of the chips has more of."""
    one, two = (dict(engine.counts().native) for engine in engines)
    for name in sorted({*one, *two}):
        if one.get(name, 0) != two.get(name, 0):
            what, _, part = name.partition(" of ")
            why = {
                "input wraps": "the input of a step has 22 bits on Loihi 1",
                "drive wraps": "u + bias has 24 bits on Loihi 1",
                "merged spikes": "several spikes of a neuron in a step are one on Loihi 1",
            }.get(what, "")
            yield RuleDifference(part, what, f"{one.get(name, 0):,}", f"{two.get(name, 0):,}", why)
