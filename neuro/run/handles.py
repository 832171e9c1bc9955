"""Resolution of what callers pass to name a part: its name, the part itself, or a view of a population."""

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
from neuro.model.views import HasShape, View, view, view_of_index
from neuro.program import program as resolved
from neuro.program.backend import Engine
from neuro.program.program import Ints, Program

_SMALL = 1_000_000
"""Largest number of synapses of a projection whose sources and targets are cached."""


@dataclass(frozen=True, slots=True, eq=False)
class Neurons:
    """Neurons of a population that a caller names.

    Attributes:
        index: index of the population in the program.
        part: the population in the program.
        end: the selected neurons of the population.
        view: the view that was named, if any.
    """

    index: int
    part: resolved.Population
    end: End
    view: View | None = None

    @property
    def ids(self) -> Ints | None:
        """Selected neurons in their order, None for all."""
        return self.end.ids

    @property
    def text(self) -> str:
        """Text of the population or view for messages."""
        return f"'{self.part.name}'" if self.view is None else repr(self.view)

    def mask(self) -> NDArray[np.bool_]:
        """Return a mask of the population that is True for the selected neurons."""
        is_selected = np.zeros(self.part.size, dtype=np.bool_)
        is_selected[slice(None) if self.ids is None else self.ids] = True
        return is_selected


class Handles:
    """Finds parts of a compiled network by name, object or view.

    Args:
        net: the network that was compiled.
        program: the compiled network.
    """

    def __init__(self, net: Network, program: Program) -> None:
        self._net, self._program = net, program
        self._populations = {part.name: index for index, part in enumerate(program.populations)}
        self._projections = {part.name: index for index, part in enumerate(program.projections)}
        self._signals = {part.name: index for index, part in enumerate(program.signals)}
        self._probes = {part.name: index for index, part in enumerate(net.probes.values())}
        self._declared_probes = tuple(net.probes.values())
        self._whole_populations = {
            part.name: Neurons(index, part, End(part.shape, None, part.size))
            for index, part in enumerate(program.populations)
        }
        self._ends: dict[int, tuple[Ints, Ints]] = {}

    def neurons_or_projection(self, of: Population | View | Projection | str) -> Neurons | int:
        """Return the neurons, or the index of the projection.

        Raises:
            ModelError: this network has no such part, or the view exceeds its population.
        """
        if isinstance(of, (Population, View)) or (isinstance(of, str) and (of in self._whole_populations or "[" in of)):
            return self.neurons(of)
        if isinstance(of, Mapping) and len(of) == 1:
            return self.neurons(view_of_index(of, self._net.populations))
        if isinstance(of, Projection) or (isinstance(of, str) and of in self._projections):
            return self.projection(of)
        raise _wrong_part("population or projection", of, [*self._populations, *self._projections])

    def neurons(self, of: Population | View | str) -> Neurons:
        """Return the neurons of a population or view.

        Raises:
            ModelError: this network has no such population, or the view exceeds its population.
        """
        if isinstance(of, str) and of in self._whole_populations:
            return self._whole_populations[of]
        of = view_of_index(of, self._net.populations)
        population = of.population if isinstance(of, View) else of
        index = self._find("population", Population, population, self._populations, self._net.populations)
        part = self._program.populations[index]
        if not isinstance(of, View):
            return self._whole_populations[part.name]
        return Neurons(index, part, end_of(of, part.shape), of)

    def neurons_or_ids(self, of: Side, population: int, word: str) -> Neurons:
        """Return the neurons of a population or view, or the neurons with some ids.

        Args:
            of: the population, the view, or ids.
            population: index of the population that the ids belong to.
            word: name of the argument, for messages.

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
        """Return the neurons that a probe records."""
        part = self._program.populations[probe.population]
        shape = part.shape if probe.ids is None else probe.ids.shape
        return Neurons(probe.population, part, End(shape, probe.ids, part.size))

    def projection(self, of: Projection | str) -> int:
        """Return the index of a projection."""
        return self._find("projection", Projection, of, self._projections, self._net.projections)

    def signal(self, of: Signal | str) -> int:
        """Return the index of a signal that the caller sets.

        Raises:
            ModelError: the network has no such signal, or the description sets it.
        """
        index = self._find("signal", Signal, of, self._signals, self._net.signals)
        if self._program.signals[index].values is not None:
            part = self._program.signals[index]
            message = f"signal '{part.name}' has values in the description"
            hint = "leave 'values' out to set the signal with sim.signal"
            raise ModelError(f"{message}: expected a signal without values", where=part.origin, hint=hint)
        return index

    def probe(self, of: Probe | str) -> Probe:
        """Return a probe as described. A trace is found by its name in `Probe.traces`."""
        for probe in self._declared_probes:
            if not isinstance(probe.record, str):
                for state, name in probe.traces().items():
                    if of == name:
                        return replace(probe, name=name, record=state)
        return self._declared_probes[self._find("probe", Probe, of, self._probes, self._net.probes)]

    def probe_name(self, name: str) -> str:
        """Return the name of the probe that records a trace."""
        return next(probe.name for probe in self._declared_probes if name in probe.traces().values())

    def recording(self, name: str) -> resolved.Probe:
        """Return the probe of a population that records a trace."""
        return next(probe for probe in self._program.probes if probe.name == name)

    def ends(self, index: int) -> tuple[Ints, Ints]:
        """Return source and target of every synapse of a projection, in the order of the weights."""
        if index in self._ends:
            return self._ends[index]
        ends: tuple[Ints, Ints] = self._program.connections(index)
        for ids in ends:
            ids.flags.writeable = False
        if len(ends[0]) <= _SMALL:
            self._ends[index] = ends
        return ends

    def _find(
        self, word: str, kind: type[Part], of: object, indices: Mapping[str, int], parts: Mapping[str, HasShape | Part]
    ) -> int:
        if isinstance(of, str) and of in indices:
            return indices[of]
        if not isinstance(of, kind):
            raise _wrong_part(word, of, indices)
        if parts.get(of.name) is not of:
            message = f"{word} '{of.name}' is a part of another network: expected one of '{self._net.name}'"
            raise ModelError(message, hint=f"pass the name '{of.name}'" if of.name in indices else "")
        return indices[of.name]


class Run:
    """A network in execution: the state that the parts of a simulation share.

    Args:
        net: the network that was compiled.
        backend: the name of the backend.
        program: the compiled network.
        engine: the engine that runs the program.

    Attributes:
        clock: the clock of the network.
        handles: finds parts of the network.
        rules: the present synapse models of projections, changed in place.
    """

    def __init__(self, net: Network, backend: str, program: Program, engine: Engine) -> None:
        self.net, self.backend, self.program, self.engine = net, backend, program, engine
        self.clock, self.handles = Clock(program.resolution), Handles(net, program)
        self.rules = {index: part.synapse for index, part in enumerate(program.projections)}

    def steps(self, ms: float) -> int:
        """Return the duration of a run in steps.

        Raises:
            ModelError: the time is not a multiple of the resolution, or not finite.
        """
        steps = self.clock.step(ms, "run")
        if not 0 <= steps < NEVER:
            raise ModelError(f"run = {ms:g} ms: expected a finite time >= 0 ms")
        return steps


def _wrong_part(word: str, value: object, names: Iterable[str]) -> ModelError:
    """Return the error for an object that is not the expected kind of part."""
    if isinstance(value, Part):
        return ModelError(f"found the {value.word} '{value.name}': expected a {word} or its name")
    if isinstance(value, View):
        return ModelError(f"found the view {value}: expected a {word} or its name")
    if isinstance(value, (list, tuple)) and any(isinstance(item, (Part, View)) for item in value):
        return ModelError(f"found several parts: expected a {word} or its name", hint="call it once for each part")
    return unknown(word, value, names)
