"""Read states that the kernels compute lazily. A read updates copies of the states, so it does not change the run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Ints
from neuro_event.building import learning
from neuro_event.building.layout import EventArrays
from neuro_event.loop import histories, steps, tables as t
from neuro_event.loop.lazy_rules import APPLIED
from neuro_event.loop.tables import table_of


class NeuronReader:
    """A copy of the states of neurons, in which sleeping neurons are updated to the present step for a read."""

    def __init__(self, arrays: EventArrays) -> None:
        self._arrays = arrays
        self._copied: dict[str, NDArray[Any]] = {}

    def state(self, population: int, row: int, ids: Ints | None, step: int) -> Floats:
        """Return a copy of a state at `step`, of all neurons of a population or of some.

        `row` is the index of the state. A read takes time in proportion to the number of blocks that it reads.
        """
        place, pop = self._arrays.places[population], self._arrays.net["pops"][population]
        if ids is None:
            blocks = np.arange(pop[t.FIRST_BLOCK], pop[t.LAST_BLOCK])
            return place.by_id(self._awake(population, blocks, step)[row, place.begin : place.end].copy())
        neurons = place.begin + (ids if place.inside is None else place.inside[ids])
        values: Floats = self._awake(population, neurons // t.BLOCK, step)[row, neurons]
        return values

    def _awake(self, population: int, blocks: Ints, step: int) -> Floats:
        """Return all states, (states, neurons), in which the given blocks are updated to `step`."""
        net = self._arrays.net
        rows: Floats = net["state"]
        asleep = net["awake"][blocks] == 0
        if not asleep.any():
            return rows
        if not self._copied:
            self._copied = {name: np.empty_like(net[name]) for name in ("state", "awake", "busy", "fired", "scratch")}
            self._table = table_of({**net, **self._copied}, self._arrays.plastic)
        blocks = np.unique(blocks)
        for name, shape in (("awake", (-1, 1)), ("busy", (-1, 1)), ("fired", (-1, t.BLOCK)), ("state", (-1, t.BLOCK))):
            lead = net[name].shape[:-1]
            self._copied[name].reshape(*lead, *shape)[..., blocks, :] = net[name].reshape(*lead, *shape)[..., blocks, :]
        steps.wake_blocks(self._table.ctypes.data, population, blocks, step, self._arrays.program.resolution)
        rows = self._copied["state"]
        return rows


class SynapseReader:
    """A copy of the states of synapses, in which plastic synapses are updated to the present step for a read."""

    def __init__(self, arrays: EventArrays, table: Ints) -> None:
        self._arrays, self._view = arrays, table.ctypes.data
        self._y = np.empty_like(arrays.plastic["y"])
        self._reached = np.empty_like(arrays.plastic["reached"])
        self._table = table_of(arrays.net, {**arrays.plastic, "y": self._y, "reached": self._reached})
        self._other_view = self._table.ctypes.data
        self._updated: tuple[int, int] | None = None  # plastic projection and step of the copy

    def synapses(self, projection: int, name: str, step: int) -> Floats:
        """Return a state of the synapses of a plastic projection at a step, in the order of the program's weights."""
        arrays = self._arrays
        part, arranged = arrays.program.projections[projection], arrays.synapses[projection]
        k = arrays.plastic_of[projection]
        first = arrays.plastic["table"][k, t.FIRST_SYNAPSE]
        columns = slice(first, first + part.size)
        if name == "n":
            return by_id(concentration(arrays, self._view, k, step)[arranged.targets], arranged.order)
        if name == "K_plus":
            return by_id(np.repeat(trace(arrays, k, step), np.diff(arranged.row_ends)), arranged.order)
        if not part.synapse.modulated and name == "weight":
            return by_id(self._sent_weights(k, columns, arranged.targets, arranged.row_ends), arranged.order)
        row = 0 if name == "weight" else 1 + [s.name for s in type(part.synapse).states].index(name)
        if arrays.plastic["table"][k, t.EAGER]:
            return by_id(arrays.plastic["y"][row, columns], arranged.order)
        if self._updated != (k, step):
            self._y[:, columns] = arrays.plastic["y"][:, columns]
            self._reached[columns] = arrays.plastic["reached"][columns]
            histories.catch_up(
                self._other_view, k, arrays.program.populations[part.target].size, step, arrays.program.resolution
            )
            self._updated = k, step
        return by_id(self._y[row, columns], arranged.order)

    def write_back(self, k: int, step: int) -> None:
        """Copy the states that a read in this step has updated back to the kernels, before a signal acts.

        Otherwise the signal would have to update the states again.
        """
        arrays, row = self._arrays, self._arrays.plastic["table"][k]
        if self._updated == (k, step) and row[t.MODULATED] >= 0:
            first = row[t.FIRST_SYNAPSE]
            columns = slice(first, first + arrays.program.projections[row[t.PROJECTION]].size)
            arrays.plastic["y"][:, columns] = self._y[:, columns]
            arrays.plastic["reached"][columns] = self._reached[columns]
        self.drop()

    def drop(self) -> None:
        """Discard the copy, because a state or a weight was set."""
        self._updated = None

    def _sent_weights(self, k: int, columns: slice, targets: NDArray[np.int32], row_ends: Ints) -> Floats:
        """Return the weights at the last pre spike of each synapse.

        A synapse on which a post spike has acted since has its weight in `sent`, the others in `y`.
        """
        arrays = self._arrays
        if arrays.plastic["table"][k, t.EAGER]:
            return arrays.plastic["sent"][columns]
        p = arrays.program.projections[arrays.plastic["table"][k, t.PROJECTION]]
        first_history = arrays.net["pops"][p.target, t.HISTORY]
        last = learning.source_traces(arrays, arrays.plastic["table"][k], arrays.plastic["spiked"])[0][0]
        applied = arrays.plastic["past"][first_history + targets, APPLIED]
        changed_since = applied > np.repeat(last, np.diff(row_ends))
        return np.where(changed_since, arrays.plastic["sent"][columns], arrays.plastic["y"][0, columns])


def concentration(arrays: EventArrays, view: int, k: int, step: int) -> Floats:
    """Return the dopamine concentration at every target of plastic projection k at a step, (targets,)."""
    projection = arrays.program.projections[arrays.plastic["table"][k, t.PROJECTION]]
    out = np.empty(arrays.program.populations[projection.target].size)
    histories.concentrations(view, k, out, step, arrays.program.resolution)
    return out


def trace(arrays: EventArrays, k: int, step: int) -> Floats:
    """Return the trace K+ of every source of plastic projection k at a step, (sources,)."""
    row = arrays.plastic["table"][k]
    if row[t.EAGER]:
        return learning.first_trace(arrays, k, step)
    traces, times = (learning.source_traces(arrays, row, arrays.plastic[name])[0][0] for name in ("k_plus", "k_time"))
    faded: Floats = traces * np.exp(-(step - times) * arrays.program.resolution / arrays.plastic["tau"][k, 0])
    return faded


def by_id(values: Floats, order: Ints | None) -> Floats:
    """Reorder values of synapses from internal order to the order of the program's weights."""
    if order is None:
        return values.copy()
    out = np.empty_like(values)
    out[order] = values
    return out


def weights(arrays: EventArrays, projection: int) -> Floats:
    """Return the weights of a projection that does not learn from pairs, in the order of the program's weights."""
    p, row = arrays.program.projections[projection], arrays.net["projections"][projection]
    first = row[t.WEIGHT]
    if first < 0:
        return np.broadcast_to(p.weight, p.size).copy()
    if p.size == 0 or row[t.WEIGHT_STRIDE] == 0:
        return p.arriving(np.full(p.size, arrays.net["weights"][first]))
    return p.arriving(by_id(arrays.net["weights"][first : first + p.size], arrays.synapses[projection].order))


def catch_up_all(arrays: EventArrays, view: int, k: int, step: int) -> None:
    """Update plastic projection k to `step`, before a value is set. Afterwards the stored traces are their values."""
    if arrays.plastic["table"][k, t.EAGER]:
        learning.to_values(arrays, k, step)
        return
    p = arrays.program.projections[arrays.plastic["table"][k, t.PROJECTION]]
    n_sources, n_targets = arrays.program.populations[p.source].size, arrays.program.populations[p.target].size
    histories.catch_up_histories(view, p.target, n_targets, step, arrays.program.resolution)
    histories.update_traces(view, k, n_sources, n_targets, step, arrays.program.resolution)
