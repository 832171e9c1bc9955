"""Several engines of the same network. A single call of a kernel advances, reads or sets all engines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.interrupts import Interruptible, end_if_stopped
from neuro.program.program import Floats, Ints
from neuro_event.host import reading
from neuro_event.loop import tables as t, together


class EventEngines:
    """Engines of the same network with different seeds; see `neuro.program.together.Engines`.

    The kernels do not support several threads, currents that change, and probes that are read during a run. In such
    cases the engines run in turn.
    """

    def __init__(self, engines: Sequence[Any]) -> None:
        self._engines = list(engines)
        first = self._engines[0]
        self._program, self._at = first._program, first._arrays
        self._reached: Ints = np.zeros(len(engines), dtype=np.int64)
        self._plain = all(
            len(e._arrays.net["edges"][0]) == 2 and e._changing is None and not e._has_probes for e in engines
        )
        self._run = t.stage_entry("run").address()
        self._stop = first.share_stop(self._engines)
        self._addresses: list[int] = []
        parts, moves = self._program.projections, self._at.moves_of.items()
        signals = range(len(self._program.signals))
        self._gated_moves = [[k for q, k in moves if parts[q].gate == signal] for signal in signals]
        self._taught_moves = [[k for q, k in moves if parts[q].signal == signal] for signal in signals]

    @property
    def _views(self) -> Ints:
        """Addresses of the tables of arrays of all engines. An address changes when an engine replaces an array."""
        addresses = [engine._view for engine in self._engines]
        if addresses != self._addresses:
            self._addresses, self._of_addresses = addresses, np.array(addresses, dtype=np.int64)
        return self._of_addresses

    def run(self, steps: int, forget: bool) -> None:
        """Advance all engines by a number of steps. If `forget` is true, no spikes are recorded."""
        begin = self._engines[0]._step
        last = begin + steps + 1
        reached = self._reached
        reached[:] = begin + 1
        if self._plain:
            for engine in self._engines:
                engine.join_rows()
            arrays = self._at
            args = (begin + 1, last, arrays.longest_slice, arrays.reach, self._program.resolution, forget, reached)
            with Interruptible(self._stop):
                try:
                    together.run_all(self._run, self._views, *args)
                    end_if_stopped(self._stop)
                except BaseException:  # the engines are at different steps
                    for engine in self._engines:
                        engine._torn = True
                    raise
        for k, engine in enumerate(self._engines):
            # If a log or a record was full, the engine enlarges it and runs the remaining steps alone.
            engine._step = int(reached[k]) - 1 if self._plain else begin
            if engine._step < begin + steps:
                engine.run(begin + steps - engine._step)
            elif engine._flags[0, 0] or engine._flags[0, 1]:
                engine._check_flags()
            if forget and not self._plain:
                engine.forget(engine._step)

    def list_spikes(self, lists: Sequence[tuple[int, Ints, Ints, Ints]]) -> None:
        """Let listed populations emit spikes.

        Args:
            lists: (population, offsets, ticks after the present step, ids), sorted by engine, tick, id. `offsets` has
                the first entry of each engine and the end, (engines + 1,). No id occurs twice in a tick. Spikes that
                were injected earlier stay.
        """
        step, at_once = self._engines[0]._step, []
        for each in lists:
            population, offsets, ticks, ids = each
            if any(engine._spike_lists.pending(population, step) for engine in self._engines):
                for k, engine in enumerate(self._engines):
                    entries = slice(offsets[k], offsets[k + 1])
                    engine.inject(population, step + ticks[entries], ids[entries])
                continue
            at_once.append(each)
            # First reserve memory for all populations: an engine that gets more memory replaces its table of arrays.
            n = len(ticks) if len(self._engines) == 1 else int((offsets[1:] - offsets[:-1]).max())
            for engine in self._engines:
                if engine._spike_lists.reserve(population, n, step):
                    engine._pack()
        views = self._views
        for population, offsets, ticks, ids in at_once:
            place = self._engines[0]._spike_lists.place(population)
            together.list_all(views, population, place, offsets, ticks, ids, step)

    def fired(self, population: int) -> Ints:
        """Return the number of spikes of each neuron, shape (engines, neurons)."""
        place = self._at.places[population]
        if self._at.net["pops"][population, t.COUNTS] >= 0:
            return np.stack([engine.fired(population) for engine in self._engines])
        out = np.empty((len(self._engines), place.end - place.begin), dtype=np.int64)
        together.fired_by_all(self._views, population, out)
        return out if place.inside is None else np.ascontiguousarray(out[:, place.inside])

    def set_rate(self, population: int, rates: Floats) -> None:
        """Set the rates of a poisson_generator in Hz, shape (engines, neurons)."""
        if self._at.net["pops"][population, t.COUNTS] >= 0:
            for engine, engine_rates in zip(self._engines, rates, strict=True):
                engine.set(population, {"rate": engine_rates})
            return
        mean = np.multiply(rates, self._program.resolution * 1e-3)
        together.rate_all(self._views, population, mean, np.exp(-mean), self._engines[0]._step)
        for engine, engine_rates in zip(self._engines, rates, strict=True):
            engine._changed_parameters[f"{population}.rate"] = engine_rates.copy()

    def signal(self, signal: int, values: Floats) -> None:
        """Set a signal, shape (engines, targets)."""
        part = self._program.signals[signal]
        place = self._at.places[part.target]
        inner = values if place.inside is None else np.ascontiguousarray(values[:, place.outside])
        views, step = self._views, self._engines[0]._step
        for k in self._gated_moves[signal]:
            together.gate_all(views, k, inner)
        for k in self._taught_moves[signal]:
            together.teach_all(views, k, inner)
        if any(self._program.projections[q].signal == signal for q in self._at.shared_of):
            for engine, engine_values in zip(self._engines, values, strict=True):
                engine.signal(signal, engine_values)
            return
        for q, k in self._at.plastic_of.items():
            if self._program.projections[q].signal == signal:
                for engine in self._engines:
                    engine._synapse_reader.drop()
                together.signal_all(views, k, inner, step, self._program.resolution)

    def clear(self, projection: int, which: NDArray[np.bool_]) -> None:
        """Set the states of synapses that learn by moves to 0 in the engines where `which` is true, (engines,)."""
        together.clear_all(self._views, self._at.moves_of[projection], which)

    def merge(self, projection: int, before: Floats) -> Floats:
        """Set the weights of all engines to `before` plus the sum of the changes of all engines, and return them."""
        arrays, order = self._at, self._at.synapses[projection].order
        after = before.copy() if order is None else before[order]
        together.merge_all(self._views, arrays.moves_of[projection], after, np.zeros_like(after))
        return reading.by_id(after, order)
