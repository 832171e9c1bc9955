"""Read and set states, parameters, signals, weights and rules of an engine between two steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Ints
from neuro_event.building import build, layout, learning, move_rules, projections, shared_kernels
from neuro_event.host import reading
from neuro_event.host.running import Running
from neuro_event.loop import arrivals, histories, moves, steps, tables as t


class Settable(Running):
    """A running program whose values can be read and set. Populations, projections and signals are given by index."""

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a state or parameter of all neurons or of some. Sleeping neurons are updated in a copy."""
        p = self._program.populations[population]
        if layout.has_states(p):
            states = [s.name for s in type(p.model).states]
            if name in states:
                return self._neuron_reader.state(population, states.index(name), ids, self._step)
        values = self._parameter(population, name)
        return values if ids is None else values[ids]

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Set states and parameters. New values act from the next step on."""
        for name, value in values.items():
            self._set(population, name, value)

    def _set(self, population: int, name: str, values: Floats) -> None:
        part, place = self._program.populations[population], self._arrays.places[population]
        if name in part.parameters:
            self._changed_parameters[f"{population}.{name}"] = values.copy()
        if part.kind == "poisson":
            build.set_rate(self._arrays, population, values, self._step)
            return
        if not layout.has_states(part):
            assert self._changing is not None
            self._changing.currents.set(population, name, values, self._step)
            self._changing.drives.changed()
            return
        if part.kind == "neuron":
            steps.wake_population(self._view, population, self._step, self._program.resolution)
            if self._changing is not None and any(
                name == tau for _, tau in getattr(part.model, "filters", {}).values()
            ):
                self._changing.drives.changed()
        inner = place.by_place(values) if values.size > 1 else values
        states = [s.name for s in type(part.model).states]
        if name in states:
            self._arrays.net["state"][states.index(name), place.begin : place.end] = inner
            return
        rows = build.parameters(self._arrays, population)
        rows = np.repeat(rows, part.size, axis=0) if inner.size > len(rows) else rows.copy()
        rows[:, list(part.parameters).index(name)] = inner
        if name == "tau_minus":
            self._arrays.net["tau_minus"][place.begin : place.end] = inner
        if name == "t_ref" and self._arrays.net["pops"][population, t.HISTORY] >= 0:
            learning.widen_histories(self._arrays, population, float(inner.min()))
        build.rebuild_constants(self._arrays, {population: rows})
        self._pack()

    def signal(self, signal: int, values: Floats) -> None:
        """Set the values of a signal at its targets.

        For synapses that learn from pairs, the values are the dopamine concentration. For synapses that learn by moves,
        the values are the signal of `teach`, or the gate.
        """
        for q, k in self._arrays.moves_of.items():
            part = self._program.projections[q]
            if signal in (part.signal, part.gate):
                inner = np.ascontiguousarray(self._arrays.places[part.target].by_place(values), dtype=np.float64)
                if part.gate == signal:
                    first = self._arrays.plastic["move_table"][k, t.MOVE_TARGET]
                    self._arrays.plastic["move_gate"][first : first + inner.size] = inner
                if part.signal == signal:
                    moves.teach_moves(self._view, k, inner)
        for q, k in self._arrays.shared_of.items():
            part = self._program.projections[q]
            if part.signal == signal:
                first = self._arrays.plastic["shared_table"][k, t.SHARED_TARGET]
                levels = self._arrays.plastic["shared_n"][first : first + self._program.populations[part.target].size]
                levels[:] = self._arrays.places[part.target].by_place(values)
        for q, k in self._arrays.plastic_of.items():
            part = self._program.projections[q]
            if part.signal == signal:
                inner = np.ascontiguousarray(self._arrays.places[part.target].by_place(values), dtype=np.float64)
                self._synapse_reader.write_back(k, self._step)
                histories.write_signal(self._view, k, inner, self._step, self._program.resolution)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return a state of the synapses, in the order of the program's weights."""
        if projection in self._arrays.plastic_of:
            return self._synapse_reader.synapses(projection, name, self._step)
        p = self._program.projections[projection]
        if projection in self._arrays.moves_of:
            row, span = self._move_states(projection, name)
            return reading.by_id(self._arrays.plastic["move_y"][row, span], self._arrays.synapses[projection].order)
        if name == "delay":
            return reading.by_id(
                self._arrays.net["late"][learning.delay_slice(self._arrays, projection)],
                self._arrays.synapses[projection].order,
            )
        if self._arrays.net["pops"][p.target, t.RELAY] == 1:
            return np.broadcast_to(self._relay_weights.get(projection, p.weight), p.size).copy()
        return reading.weights(self._arrays, projection)

    def _move_states(self, projection: int, name: str) -> tuple[int, slice]:
        """Return the row and the synapses of a state in `move_y`, for a projection that learns by moves."""
        p = self._program.projections[projection]
        first = self._arrays.plastic["move_table"][self._arrays.moves_of[projection], t.MOVE_SYNAPSE]
        row = 0 if name == "weight" else 1 + [s.name for s in type(p.synapse).states].index(name)
        return row, slice(first, first + p.size)

    def set_synapses(self, projection: int, name: str, values: Floats) -> None:
        """Set a state of the synapses of a projection that learns by moves."""
        row, span = self._move_states(projection, name)
        order = self._arrays.synapses[projection].order
        self._arrays.plastic["move_y"][row, span] = values[order] if order is not None and values.size > 1 else values
        if values.any():
            moves.mark_all_live(self._view, self._arrays.moves_of[projection])

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Set the parameters of a synapse model, in the form of `Synapse.vector`."""
        if projection in self._arrays.moves_of:
            move_rules.set_move_rule(self._arrays, projection, parameters)
        if projection in self._arrays.shared_of:
            shared_kernels.set_shared_rule(self._arrays, projection, parameters)
        if projection in self._arrays.plastic_of:
            self._synapse_reader.drop()
            reading.catch_up_all(self._arrays, self._view, self._arrays.plastic_of[projection], self._step)
            if learning.set_numbers(self._arrays, projection, parameters, self._step):
                self._pack()
        self._rules[projection] = parameters.copy()
        self._trial_rules.pop(projection, None)

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or the chosen weights. Spikes under way keep the old weights."""
        net, source = self._arrays.net, self._program.projections[projection].source
        keeps_counts = net["projections"][projection, t.DENSE_COUNTS] == 1
        moved = [projection] if self._step > 0 and not self._learns(projection) else []
        if keeps_counts:  # from now on the generator lists its spikes, for all its projections
            moved = [q for q, p in enumerate(self._program.projections) if p.source == source]
        for q in moved:
            if lag := projections.give_ring(self._arrays, q):
                self._pack()
                arrivals.carry(self._view, q, lag, self._step)
        if keeps_counts:
            net["projections"][moved, t.DENSE_COUNTS] = 0
            net["pops"][source, t.COUNTS] = t.NONE
        self._write_weights(projection, weights, chosen)

    def _learns(self, projection: int) -> bool:
        """Return whether spike pairs or moves change the weights of a projection."""
        return any(
            projection in numbers
            for numbers in (self._arrays.plastic_of, self._arrays.moves_of, self._arrays.shared_of)
        )

    def _write_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        part, row = self._program.projections[projection], self._arrays.net["projections"][projection]
        if part.size == 0:
            return
        if self._changing is not None and part.source in self._changing.currents:
            self._changing.currents.set_weights(projection, weights, self._step)
            self._changing.drives.changed()
        order = self._arrays.synapses[projection].order
        inner = weights[order] if order is not None and weights.size > 1 else weights
        if projection in self._arrays.plastic_of:
            k = self._arrays.plastic_of[projection]
            self._synapse_reader.drop()
            if self._arrays.plastic["table"][k, t.EAGER] == 0:
                reading.catch_up_all(self._arrays, self._view, k, self._step)
            first = self._arrays.plastic["table"][k, t.FIRST_SYNAPSE]
            mask = slice(None) if chosen is None else chosen if order is None else chosen[order]
            for array in (self._arrays.plastic["y"][0], self._arrays.plastic["sent"]):
                array[first : first + part.size][mask] = np.broadcast_to(inner, part.size)[mask]
            return
        if self._arrays.net["pops"][part.target, t.RELAY] == 1:
            self._relay_weights[projection] = weights.copy()
            return
        if projection in self._arrays.moves_of:
            self._arrays.plastic["move_y"][self._move_states(projection, "weight")] = inner
        inner = part.arriving(inner)
        if projections.copy_shared_weights(self._arrays):
            self._pack()
        first, stride = int(row[t.WEIGHT]), int(row[t.WEIGHT_STRIDE])
        if first < 0 or (inner.size > 1 and stride == 0 and part.size > 1):
            row[t.WEIGHT], row[t.WEIGHT_STRIDE] = self._arrays.net["weights"].size, int(inner.size > 1)
            self._arrays.net["weights"] = np.concatenate([self._arrays.net["weights"], inner])
            self._pack()
        else:
            self._arrays.net["weights"][first : first + (part.size if stride else 1)] = inner
        if not self._learns(projection):
            row[t.SIGN] = layout.sign(inner)
        if projection in self._arrays.joined and row[t.LAG] > 0 and not self._arrays.rows_outdated:
            layout.clear_joined_rows(self._arrays)
            self._pack()
