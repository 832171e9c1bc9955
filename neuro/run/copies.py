"""Many copies of a network as one simulation: what is done to all is one call, however many there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from neuro.core.errors import ModelError
from neuro.model.parts import Population, Projection, Signal
from neuro.model.views import View
from neuro.program.program import Floats, Program
from neuro.run.ports import Port, Ports
from neuro.run.simulation import Simulation
from neuro.run.stepper import Joined, Stepper


class Copies:
    """Copies of a network with seeds of their own; made by `neuro.compile(net, copies=n, seed=s)`.

    Copy k is the simulation of seed s + k, bit for bit. `copies[k]` reads and sets one of them; what is named here is
    done to all in one call, and its arrays have a first axis, an entry for each copy.
    """

    def __init__(self, sims: Sequence[Simulation]) -> None:
        self._sims = list(sims)
        self.program: Program = sims[0].program
        self._joined = Joined(sims[0]._run, [sim._engine for sim in sims], [sim._watch for sim in sims])
        self._ports = Ports(self._sims, {}, self._joined.engines)
        self._signals: dict[int, Port] = {}

    def __repr__(self) -> str:
        return f"Copies({len(self)} of {self.program.name!r}, backend={self._sims[0].backend!r}, time={self.time:g} ms)"

    def __len__(self) -> int:
        return len(self._sims)

    def __getitem__(self, copy: int) -> Simulation:
        return self._sims[copy]

    def __iter__(self) -> Iterator[Simulation]:
        return iter(self._sims)

    @property
    def time(self) -> float:
        """The end of the last finished step in ms, of all copies."""
        return self._sims[0].time

    def run(self, ms: float) -> None:
        """Advance all by a multiple of the resolution, as `Simulation.run` does.

        Raises:
            ModelError: as of that; and copies that were run apart do not stand at one time.
        """
        steps = self._joined.run.steps(ms)
        self._joined.check_together()
        self._advance(steps, forget=False)

    def _advance(self, steps: int, forget: bool) -> None:
        """Run all; with `forget` what was recorded before is dropped, or not recorded."""
        if self._joined.plain:
            self._joined.advance(steps, forget)
            return
        for sim in self._sims:
            if forget:
                sim.forget(sim.time)
            sim.run(self._joined.run.clock.ms(steps))

    def reset(self, weights: bool = False) -> None:
        """Back to time 0, as `Simulation.reset`."""
        for sim in self._sims:
            sim.reset(weights)

    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: a number, one for each copy (copies, 1), or for each copy and neuron (copies, neurons)."""
        index = self._sims[0].handles.signal(of)
        if index not in self._signals:
            self._signals[index] = self.port(of)
        self._signals[index].set(values)

    def clear(self, of: Projection | str, which: ArrayLike | None = None) -> None:
        """Let the states of the synapses of a projection that learns by moves be 0, as at an episode's end.

        Args:
            of: the projection.
            which: whether of each copy, (copies,), bool; of all if not given.
        """
        index = self._moves(of, "clear")
        chosen = np.ones(len(self), dtype=np.bool_) if which is None else np.ascontiguousarray(which, dtype=np.bool_)
        if chosen.shape != (len(self),):
            raise ModelError(f"clear: which has shape {list(chosen.shape)}: expected [{len(self)}], one for each copy")
        self._joined.engines.clear(index, chosen)

    def merge(self, of: Projection | str, before: ArrayLike) -> Floats:
        """Let all have the same weights, of a projection that learns by moves: what each has learnt is added up.

        Args:
            of: the projection.
            before: weights that all copies had at first, (synapses,), as `weights` and `get` list them.

        Returns:
            the weights that all have now: `before` and the sum of what each has added to it.
        """
        index = self._moves(of, "merge")
        size, given = self.program.projections[index].size, np.asarray(before, dtype=np.float64)
        if given.shape != (size,):
            raise ModelError(f"merge: before has shape {list(given.shape)}: expected [{size}], one for each synapse")
        return self._joined.engines.merge(index, given)

    def _moves(self, of: Projection | str, what: str) -> int:
        index = self._sims[0].handles.projection(of)
        part = self.program.projections[index]
        if part.synapse.learns != "moves":
            raise ModelError(f"{what}: '{part.name}' has {part.synapse.name}: expected a rule that learns by moves")
        return index

    def port(self, of: Population | View | Projection | Signal | str, what: str | None = None) -> Port:
        """A port as of `Simulation.port` whose arrays have a first axis, an entry for each copy."""
        return self._ports.port(of, what)

    def stepper(
        self, ms: float, emit: Sequence[Population | str] = (), count: Sequence[Population | str] = ()
    ) -> Stepper:
        """Control steps of `ms`: spikes in, run, counts out, in one call; see `Stepper`.

        Args:
            ms: the length of a control step.
            emit: populations of spike_generator that are given spikes at each.
            count: populations whose spikes are counted.

        Raises:
            ModelError: there is no such population, or one of `emit` is another model.
        """
        return Stepper(self._joined, ms, emit, count)
