"""Copies of a network with different seeds. One call acts on all copies."""

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
    """Copies of a network with different seeds, made by `neuro.compile(net, copies=n, seed=s)`.

    Copy k gives the same bits as a simulation with seed s + k. `copies[k]` reads and sets one copy. A method of this
    class acts on all copies in one call, and the first axis of an array has an entry for each copy.
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
        """End of the last finished step of all copies in ms."""
        return self._sims[0].time

    def run(self, ms: float) -> None:
        """Advance all copies by a multiple of the resolution, as `Simulation.run` does.

        Raises:
            ModelError: see `Simulation.run`; or the copies are at different times, because they were run separately.
        """
        steps = self._joined.run.steps(ms)
        self._joined.check_together()
        self._advance(steps, forget=False)

    def _advance(self, steps: int, forget: bool) -> None:
        """Run all copies. With `forget`, earlier records are dropped, or the steps of this call are not recorded."""
        if self._joined.plain:
            self._joined.advance(steps, forget)
            return
        for sim in self._sims:
            if forget:
                sim.forget(sim.time)
            sim.run(self._joined.run.clock.ms(steps))

    def reset(self, weights: bool = False) -> None:
        """Return all copies to time 0, as `Simulation.reset`."""
        for sim in self._sims:
            sim.reset(weights)

    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: a number, an array (copies, 1), or an array (copies, neurons)."""
        index = self._sims[0].handles.signal(of)
        if index not in self._signals:
            self._signals[index] = self.port(of)
        self._signals[index].set(values)

    def clear(self, of: Projection | str, which: ArrayLike | None = None) -> None:
        """Set the states of the synapses of a projection to 0, as at the end of an episode.

        Its rule must learn from the moves of an agent (`learns` is "moves").

        Args:
            of: the projection.
            which: the copies to clear, (copies,), bool; default: all.
        """
        index = self._moving_projection(of, "clear")
        chosen = np.ones(len(self), dtype=np.bool_) if which is None else np.ascontiguousarray(which, dtype=np.bool_)
        if chosen.shape != (len(self),):
            raise ModelError(f"clear: which has shape {list(chosen.shape)}: expected [{len(self)}], one for each copy")
        self._joined.engines.clear(index, chosen)

    def merge(self, of: Projection | str, before: ArrayLike) -> Floats:
        """Set the same weights in all copies of a projection that learns by moves, with the sum of all changes.

        Args:
            of: the projection.
            before: weights of all copies before the changes, (synapses,), in the order of `weights` and `get`.

        Returns:
            The new weights of all copies: `before` plus the sum of the changes.
        """
        index = self._moving_projection(of, "merge")
        size, previous = self.program.projections[index].size, np.asarray(before, dtype=np.float64)
        if previous.shape != (size,):
            raise ModelError(f"merge: before has shape {list(previous.shape)}: expected [{size}], one for each synapse")
        return self._joined.engines.merge(index, previous)

    def _moving_projection(self, of: Projection | str, call: str) -> int:
        index = self._sims[0].handles.projection(of)
        part = self.program.projections[index]
        if part.synapse.learns != "moves":
            raise ModelError(f"{call}: '{part.name}' has {part.synapse.name}: expected a rule that learns by moves")
        return index

    def port(self, of: Population | View | Projection | Signal | str, what: str | None = None) -> Port:
        """Return a port as `Simulation.port` does; the first axis of its arrays has an entry for each copy."""
        return self._ports.port(of, what)

    def stepper(
        self, ms: float, emit: Sequence[Population | str] = (), count: Sequence[Population | str] = ()
    ) -> Stepper:
        """Return a stepper for control steps of `ms`: spikes in, run, counts out, in one call; see `Stepper`.

        Args:
            ms: length of a control step.
            emit: populations of spike_generator that receive spikes at each control step.
            count: populations whose spikes are counted.

        Raises:
            ModelError: there is no such population, or a population of `emit` is no spike_generator.
        """
        return Stepper(self._joined, ms, emit, count)
