"""Parts of a network as callers name them: by name, by the part itself, or by a view of a population."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.shapes import End, end_of
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError, unknown
from neuro.model.network import Network
from neuro.model.parts import Part, Population, Probe, Projection, Side, Signal
from neuro.model.views import Laid, View, named, view
from neuro.program import program as resolved
from neuro.program.backend import Engine
from neuro.program.program import Ints, Program

_SMALL = 1_000_000
"""Synapses of a projection up to which their ends are kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Neurons:
    """Neurons of a population that a caller names.

    Attributes:
        index: of the population in the program.
        part: the population there.
        end: which of its neurons.
        view: the view that was named, if one was.
    """

    index: int
    part: resolved.Population
    end: End
    view: View | None = None

    @property
    def ids(self) -> Ints | None:
        """The neurons in their order, None for all."""
        return self.end.ids

    @property
    def text(self) -> str:
        """What was named, for messages."""
        return f"'{self.part.name}'" if self.view is None else repr(self.view)

    def among(self) -> NDArray[np.bool_]:
        """Whether each neuron of the population is one of them."""
        mask = np.zeros(self.part.size, dtype=np.bool_)
        mask[slice(None) if self.ids is None else self.ids] = True
        return mask


class Handles:
    """Finds parts of a compiled network.

    Args:
        net: the network that was compiled.
        program: its resolved form.
    """

    def __init__(self, net: Network, program: Program) -> None:
        self._net, self._program = net, program
        self._populations = {part.name: index for index, part in enumerate(program.populations)}
        self._projections = {part.name: index for index, part in enumerate(program.projections)}
        self._signals = {part.name: index for index, part in enumerate(program.signals)}
        self._probes = {part.name: index for index, part in enumerate(net.probes.values())}
        self._said = tuple(net.probes.values())
        self._whole = {
            part.name: Neurons(index, part, End(part.shape, None, part.size))
            for index, part in enumerate(program.populations)
        }
        self._ends: dict[int, tuple[Ints, Ints]] = {}

    def neurons_or_projection(self, of: Population | View | Projection | str) -> Neurons | int:
        """The neurons, or the index of the projection.

        Raises:
            ModelError: this network has neither, or the view reaches beyond its population.
        """
        if isinstance(of, (Population, View)) or (isinstance(of, str) and (of in self._whole or "[" in of)):
            return self.neurons(of)
        if isinstance(of, Mapping) and len(of) == 1:
            return self.neurons(named(of, self._net.populations))
        if isinstance(of, Projection) or (isinstance(of, str) and of in self._projections):
            return self.projection(of)
        raise _none("population or projection", of, [*self._populations, *self._projections])

    def neurons(self, of: Population | View | str) -> Neurons:
        """The neurons of a population, or of a view of one.

        Raises:
            ModelError: this network has no such population, or the view reaches beyond it.
        """
        if isinstance(of, str) and of in self._whole:
            return self._whole[of]
        of = named(of, self._net.populations)
        population = of.population if isinstance(of, View) else of
        index = self._find("population", Population, population, self._populations, self._net.populations)
        part = self._program.populations[index]
        if not isinstance(of, View):
            return self._whole[part.name]
        return Neurons(index, part, end_of(of, part.shape), of)

    def neurons_or_ids(self, of: Side, population: int, word: str) -> Neurons:
        """The neurons of a population or a view, or those of a population that ids name.

        Args:
            of: the population, the view, or ids.
            population: the one that ids are of.
            word: where they were said, for messages.

        Raises:
            ModelError: this network has no such population, or no neuron with one of the ids.
        """
        if isinstance(of, (Population, View, str, Mapping)):
            return self.neurons(of)
        part = self._program.populations[population]
        try:
            chosen = view(part, [of] if isinstance(of, (int, np.integer)) else np.asarray(of))
        except ModelError as error:
            raise error.at(None, word) from None
        return Neurons(population, part, end_of(chosen, part.shape), chosen)

    def recorded(self, probe: resolved.Probe) -> Neurons:
        """The neurons that a probe records."""
        part = self._program.populations[probe.population]
        shape = part.shape if probe.ids is None else probe.ids.shape
        return Neurons(probe.population, part, End(shape, probe.ids, part.size))

    def projection(self, of: Projection | str) -> int:
        """The index of a projection."""
        return self._find("projection", Projection, of, self._projections, self._net.projections)

    def signal(self, of: Signal | str) -> int:
        """The index of a signal that a program sets.

        Raises:
            ModelError: the network has no such signal, or the description sets it.
        """
        index = self._find("signal", Signal, of, self._signals, self._net.signals)
        if self._program.signals[index].values is not None:
            part = self._program.signals[index]
            message = f"signal '{part.name}' has values, which set it while the network runs"
            hint = "leave 'values' out where a program sets it"
            raise ModelError(f"{message}: expected one without", where=part.origin, hint=hint)
        return index

    def probe(self, of: Probe | str) -> Probe:
        """A probe, as it was said; its traces are named by `Probe.traces`."""
        for probe in self._said:
            if not isinstance(probe.record, str):
                for state, name in probe.traces().items():
                    if of == name:
                        return replace(probe, name=name, record=state)
        return self._said[self._find("probe", Probe, of, self._probes, self._net.probes)]

    def of_trace(self, name: str) -> str:
        """The name of the probe that records a trace."""
        return next(probe.name for probe in self._said if name in probe.traces().values())

    def recording(self, name: str) -> resolved.Probe:
        """The probe of a population that records a trace."""
        return next(probe for probe in self._program.probes if probe.name == name)

    def ends(self, index: int) -> tuple[Ints, Ints]:
        """Source and target of every synapse of a projection, in the order of the weights."""
        if index in self._ends:
            return self._ends[index]
        ends: tuple[Ints, Ints] = self._program.connections(index)
        for ids in ends:
            ids.flags.writeable = False
        if len(ends[0]) <= _SMALL:
            self._ends[index] = ends
        return ends

    def _find(
        self, word: str, kind: type[Part], of: object, known: Mapping[str, int], parts: Mapping[str, Laid | Part]
    ) -> int:
        if isinstance(of, str) and of in known:
            return known[of]
        if not isinstance(of, kind):
            raise _none(word, of, known)
        if parts.get(of.name) is not of:
            message = f"{word} '{of.name}' is a part of another network: expected one of '{self._net.name}'"
            raise ModelError(message, hint=f"'{of.name}' names the one here" if of.name in known else "")
        return known[of.name]


class Run:
    """A network in execution, as the parts of a simulation share it.

    Args:
        net: the network that was compiled.
        backend: the name of the backend.
        program: its resolved form.
        engine: runs it.

    Attributes:
        clock: of the network.
        handles: finds its parts.
        rules: the present synapse models of projections, changed in place.
    """

    def __init__(self, net: Network, backend: str, program: Program, engine: Engine) -> None:
        self.net, self.backend, self.program, self.engine = net, backend, program, engine
        self.clock, self.handles = Clock(program.resolution), Handles(net, program)
        self.rules = {index: part.synapse for index, part in enumerate(program.projections)}

    def steps(self, ms: float) -> int:
        """Return the time of a run in steps.

        Raises:
            ModelError: the time is no multiple of the resolution, or not finite.
        """
        steps = self.clock.step(ms, "run")
        if not 0 <= steps < NEVER:
            raise ModelError(f"run = {ms:g} ms: expected a finite time >= 0 ms")
        return steps


def _none(word: str, found: object, known: Iterable[str]) -> ModelError:
    """The error for what is no part of that word."""
    if isinstance(found, Part):
        return ModelError(f"found the {found.word} '{found.name}': expected a {word} or its name")
    if isinstance(found, View):
        return ModelError(f"found the view {found}: expected a {word} or its name")
    if isinstance(found, (list, tuple)) and any(isinstance(each, (Part, View)) for each in found):
        return ModelError(f"found several parts: expected a {word} or its name", hint="one call for each")
    return unknown(word, found, known)
