"""Many copies of a network as one simulation: what is done to all is one call, however many there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.errors import ModelError
from neuro.kernels.jit import kernel
from neuro.model.parts import Population, Projection, Signal
from neuro.model.views import View
from neuro.program.program import Floats, Program
from neuro.run.ports import Port
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
        self._joined = Joined(
            self.program, sims[0].handles, [sim._engine for sim in sims], [sim._watch for sim in sims]
        )

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
        self._joined.check_together()
        if not self._joined.plain:
            for sim in self._sims:
                sim.run(ms)
            return
        self._joined.advance(self._joined.steps(ms), forget=False)

    def reset(self, weights: bool = False) -> None:
        """Back to time 0, as `Simulation.reset`."""
        for sim in self._sims:
            sim.reset(weights)

    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: a number, one for each copy (copies, 1), or for each copy and neuron (copies, neurons)."""
        index = self._sims[0].handles.signal(of)
        part = self.program.signals[index]
        size = self.program.populations[part.target].size
        self._joined.engines.signal(index, self._each(values, size, f"signal '{part.name}'"))

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

    def port(self, of: Population | View | Projection | Signal | str, what: str | None = None) -> CopiesPort:
        """A port as of `Simulation.port` whose arrays have a first axis, an entry for each copy."""
        return CopiesPort(self, [sim.port(of, what) for sim in self._sims], of, what)

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

    def _each(self, values: ArrayLike, size: int, what: str) -> Floats:
        array, copies = np.asarray(values, dtype=np.float64), len(self._sims)
        if array.shape not in ((), (copies, 1), (copies, size)):
            message = f"{what}: an array of shape {list(array.shape)}: expected [{copies}, {size}], copies first"
            raise ModelError(message)
        each = np.empty((copies, size))
        # Four calls of numpy would take as long as some ticks of a small network.
        if not _fill(each, np.ascontiguousarray(array if array.ndim else array.reshape(1, 1))):
            raise ModelError(f"{what}: a value is not finite: expected numbers")
        return each


@kernel
def _fill(each: Floats, values: Floats) -> bool:
    """Fill the rows of `each` with as many values, or with one, -0.0 as 0.0; return whether all are finite."""
    finite = True
    for k in range(each.shape[0]):
        for i in range(each.shape[1]):
            value = values[k if values.shape[0] > 1 else 0, i if values.shape[1] > 1 else 0]
            finite &= np.isfinite(value)
            each[k, i] = value + 0.0
    return finite


class CopiesPort:
    """Something of all copies that is set or read again and again; made by `Copies.port`."""

    def __init__(self, copies: Copies, ports: Sequence[Port], of: Any, what: str | None) -> None:
        self._copies, self._ports, self._what = copies, ports, what
        handles = copies[0].handles
        self._signal, self._text = handles.signal(of) if what is None else None, ports[0].text
        if self._signal is not None:
            self._size = copies.program.populations[copies.program.signals[self._signal].target].size
        self._population: int | None = None
        if what in ("counts", "rate"):
            neurons = handles.neurons(of)
            drawn = neurons.part.kind == "poisson" or what == "counts"
            self._population = neurons.index if neurons.ids is None and drawn else None
        if self._population is not None and what == "counts":
            self._before = copies._joined.engines.fired(self._population)

    def __repr__(self) -> str:
        return f"CopiesPort({self._ports[0].text}, {len(self._ports)} copies)"

    def set(self, values: ArrayLike) -> None:
        """Set the values, (copies, n), (copies, 1) or one for all; they act from the next step on.

        Raises:
            ModelError: as of `Port.set`.
        """
        if self._signal is not None:
            self._copies._joined.engines.signal(self._signal, self._copies._each(values, self._size, self._text))
            return
        if self._population is not None and self._what == "rate":
            size = self._copies.program.populations[self._population].size
            rates = np.asarray(values, dtype=np.float64)
            if rates.shape != (len(self._ports), size):
                rates = self._copies._each(values, size, self._ports[0].text)
            # What is not finite is not within the bounds either.
            if rates.size and rates.min() >= 0.0 and rates.max() * self._copies.program.resolution <= 1e6:
                self._copies._joined.engines.set_rate(self._population, rates + 0.0)  # -0.0 is 0.0
                return
            self._copies._each(values, size, self._ports[0].text)
        array = np.asarray(values)
        if array.ndim and array.shape[0] != len(self._ports):
            found = f"shape {list(array.shape)}"
            raise ModelError(f"port: {self._ports[0].text}: {found}: expected {len(self._ports)} copies first")
        for k, port in enumerate(self._ports):
            port.set(array if array.ndim == 0 else array[k, 0] if array.shape[1:] == (1,) else array[k])

    def get(self) -> NDArray[Any]:
        """The values of now, (copies, n).

        Raises:
            ModelError: it can only be set; or spikes are asked for, which are not equally many.
        """
        if self._population is not None and self._what == "counts":
            now = self._copies._joined.engines.fired(self._population)
            new, self._before = now - self._before, now
            return new
        if self._what == "spikes":
            raise ModelError("port: spikes of copies are not equally many: expected 'counts'", hint="copies[k].port")
        return np.stack([port.get() for port in self._ports])
