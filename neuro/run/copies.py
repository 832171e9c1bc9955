"""Many copies of a network as one simulation, and control steps that cost one call, however many copies there are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core.clock import NEVER, Clock
from neuro.core.english import a
from neuro.core.errors import ModelError
from neuro.model.parts import Population, Projection, Signal
from neuro.model.views import View
from neuro.program.program import Floats, Ints, Program, Projection as Resolved
from neuro.program.together import together
from neuro.run.ports import Port
from neuro.run.simulation import Simulation

Listed = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]


LOOK = 1000
"""Steps after which control steps look at all states for NaN."""


class Copies:
    """Copies of a network with seeds of their own; made by `neuro.compile(net, copies=n, seed=s)`.

    Copy k is the simulation of seed s + k, bit for bit. `copies[k]` reads and sets one of them; what is named here is
    done to all in one call, and its arrays have a first axis, an entry for each copy.
    """

    def __init__(self, sims: Sequence[Simulation]) -> None:
        self._sims = list(sims)
        self.program: Program = sims[0].program
        self._clock = Clock(self.program.resolution)
        self._engines = together(self.program, [sim._engine for sim in sims])
        parts = self.program.populations
        self._due = 0
        self._one_by_one = bool(
            self.program.probes or self.program.synapse_probes or any(part.stream is not None for part in parts)
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
        self._check_together()
        if self._one_by_one:
            for sim in self._sims:
                sim.run(ms)
            return
        self._advance(_steps(self._clock, ms), forget=False)

    def _advance(self, steps: int, forget: bool) -> None:
        self._engines.run(steps, forget)
        now = self._sims[0]._engine.step
        # To look at all states takes as long as a control step of a small network.
        if not forget or now >= self._due or now < steps:
            self._due = now + LOOK
            for sim in self._sims:
                sim._watch.look()

    def _check_together(self) -> None:
        if len({sim._engine.step for sim in self._sims}) > 1:
            times = ", ".join(f"{sim.time:g}" for sim in self._sims[:4])
            raise ModelError(f"copies: they stand at {times} ... ms: expected one time", hint="run all, or reset all")

    def reset(self, weights: bool = False) -> None:
        """Back to time 0, as `Simulation.reset`."""
        for sim in self._sims:
            sim.reset(weights)

    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: a number, one for each copy (copies, 1), or for each copy and neuron (copies, neurons)."""
        index = self._sims[0].handles.signal(of)
        part = self.program.signals[index]
        size = self.program.populations[part.target].size
        self._engines.signal(index, self._each(values, size, f"signal '{part.name}'"))

    def clear(self, of: Projection | str, which: ArrayLike | None = None) -> None:
        """Let the states of the synapses of a projection that learns by moves be 0, as at an episode's end.

        Args:
            of: the projection.
            which: whether of each copy, (copies,), bool; of all if not given.
        """
        index = _learns_by_moves(self.program, self._sims[0].handles.projection(of)).index
        chosen = np.ones(len(self), dtype=np.bool_) if which is None else np.ascontiguousarray(which, dtype=np.bool_)
        if chosen.shape != (len(self),):
            raise ModelError(f"clear: which has shape {list(chosen.shape)}: expected [{len(self)}], one for each copy")
        self._engines.clear(index, chosen)

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
        return Stepper(self, ms, emit, count)

    def _each(self, values: ArrayLike, size: int, what: str) -> Floats:
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in ((), (len(self), 1), (len(self), size)):
            message = f"{what}: an array of shape {list(array.shape)}: expected [{len(self)}, {size}], copies first"
            raise ModelError(message)
        if not np.isfinite(array).all():
            raise ModelError(f"{what}: a value is not finite: expected numbers")
        return np.ascontiguousarray(np.broadcast_to(array, (len(self), size))) + 0.0


class CopiesPort:
    """Something of all copies that is set or read again and again; made by `Copies.port`."""

    def __init__(self, copies: Copies, ports: Sequence[Port], of: Any, what: str | None) -> None:
        self._copies, self._ports, self._what = copies, ports, what
        handles = copies[0].handles
        self._signal = handles.signal(of) if what is None else None
        self._population: int | None = None
        if what in ("counts", "rate"):
            neurons = handles.neurons(of)
            drawn = neurons.part.kind == "poisson" or what == "counts"
            self._population = neurons.index if neurons.ids is None and drawn else None
        if self._population is not None and what == "counts":
            self._before = copies._engines.fired(self._population)

    def __repr__(self) -> str:
        return f"CopiesPort({self._ports[0].text}, {len(self._ports)} copies)"

    def set(self, values: ArrayLike) -> None:
        """Set the values, (copies, n), (copies, 1) or one for all; they act from the next step on.

        Raises:
            ModelError: as of `Port.set`.
        """
        if self._signal is not None:
            self._copies.signal(self._copies.program.signals[self._signal].name, values)
            return
        if self._population is not None and self._what == "rate":
            size = self._copies.program.populations[self._population].size
            rates = self._copies._each(values, size, self._ports[0].text)
            if rates.size and rates.min() >= 0.0 and rates.max() * self._copies.program.resolution <= 1e6:
                self._copies._engines.set_rate(self._population, rates)
                return
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
            now = self._copies._engines.fired(self._population)
            new, self._before = now - self._before, now
            return new
        if self._what == "spikes":
            raise ModelError("port: spikes of copies are not equally many: expected 'counts'", hint="copies[k].port")
        return np.stack([port.get() for port in self._ports])


class Stepper:
    """Control steps of one length: spikes in, run, counts out; made by `Simulation.stepper` and `Copies.stepper`.

    Spikes are not recorded in its steps, so memory does not grow; `counts` of a port and `sim.counts()` go on.

    Attributes:
        ms: the length of a control step.
        ticks: in steps of the network.
    """

    def __init__(self, copies: Copies, ms: float, emit: Sequence[Any], count: Sequence[Any]) -> None:
        self._copies, self.ms, self.ticks = copies, ms, _steps(copies._clock, ms)
        handles, program = copies[0].handles, copies.program
        self._emit = [handles.neurons(part).index for part in emit]
        self._count = [handles.neurons(part).index for part in count]
        for index in self._emit:
            part = program.populations[index]
            if part.kind != "listed" or part.stream is not None:
                raise ModelError(f"stepper: '{part.name}' is {a(part.said)}: expected a spike_generator")
        if copies._one_by_one:
            raise ModelError(
                "stepper: the network has probes or streams: expected one without", hint="use run and ports"
            )
        self._before = [copies._engines.fired(index) for index in self._count]
        self._offsets = {1: np.array([0, 1], dtype=np.int64)}

    def step(self, *spikes: Listed) -> list[Ints]:
        """One control step.

        Args:
            spikes: of each population of `emit` (ticks, ids), sorted by tick, then id, no id twice in a tick; ticks are
                steps from now, 1 to `ticks`. Of several copies (offsets, ticks, ids): those of copy k are
                `offsets[k] : offsets[k + 1]`.

        Returns:
            of each population of `count` how often each neuron spiked, (copies, neurons).

        Raises:
            ModelError: a tick or an id is out of bounds, or a state became NaN.
        """
        copies = self._copies
        copies._check_together()
        if len(spikes) != len(self._emit):
            raise ModelError(f"step: spikes of {len(spikes)} populations: expected {len(self._emit)}")
        lists = [self._list(index, each) for index, each in zip(self._emit, spikes, strict=True)]
        copies._engines.list_spikes(lists)
        copies._advance(self.ticks, forget=True)
        now = [copies._engines.fired(index) for index in self._count]
        counts = [after - before for after, before in zip(now, self._before, strict=True)]
        self._before = now
        return counts

    def _list(self, index: int, given: Listed) -> tuple[int, Ints, Ints, Ints]:
        part, n = self._copies.program.populations[index], len(self._copies)
        *first, ticks, ids = (np.ascontiguousarray(each, dtype=np.int64) for each in given)
        offsets = first[0] if first else np.array([0, len(ticks)], dtype=np.int64)
        if offsets.shape != (n + 1,) or offsets[0] != 0 or offsets[-1] != len(ticks) or len(ids) != len(ticks):
            message = f"step: spikes of '{part.name}': expected (offsets, ticks, ids) with {n + 1} offsets"
            raise ModelError(message if n > 1 else f"step: spikes of '{part.name}': expected as many ticks as ids")
        if len(ticks) and not (ticks.min() > 0 and ticks.max() <= self.ticks):
            found = f"ticks {ticks.min()} to {ticks.max()}"
            raise ModelError(f"step: spikes of '{part.name}': {found}: expected 1 to {self.ticks}")
        if len(ids) and not (ids.min() >= 0 and ids.max() < part.size):
            raise ModelError(
                f"step: spikes of '{part.name}': ids {ids.min()} to {ids.max()}: expected 0 to {part.size - 1}"
            )
        return index, offsets, ticks, ids


def _steps(clock: Clock, ms: float) -> int:
    steps = clock.step(ms, "run")
    if not 0 <= steps < NEVER:
        raise ModelError(f"run = {ms:g} ms: expected a finite time >= 0 ms")
    return steps


class _learns_by_moves:
    """A projection by index whose synapses learn by moves."""

    def __init__(self, program: Program, index: int) -> None:
        part: Resolved = program.projections[index]
        if part.synapse.learns != "moves":
            raise ModelError(f"clear: '{part.name}' has {part.synapse.name}: expected a rule that learns by moves")
        self.index = index
