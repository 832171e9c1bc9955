"""The tables of the projections: synapses, weights, delays and rings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.model.neurons import Neuron
from neuro.program.program import Floats, Ints
from neuro_event.building import joined_rows, layout
from neuro_event.building.layout import EventArrays, aligned_zeros
from neuro_event.building.shared_kernels import learns_shared
from neuro_event.loop import tables as t
from neuro_event.loop.operations import NEURONS


def add_projections(arrays: EventArrays) -> None:
    """Lay out all projections, and the buffer for the input and the rings."""
    program, pops, h = arrays.program, arrays.net["pops"], arrays.program.resolution
    parts: dict[str, list[NDArray[Any]]] = {"rows": [], "targets": [], "weights": [], "delays": []}
    ends = dict.fromkeys(parts, 0)

    def put(name: str, values: NDArray[Any]) -> int:
        """Append values to an array of all projections; return the index of the first."""
        parts[name].append(values)
        ends[name] += values.size
        return ends[name] - values.size

    table = np.full((len(program.projections), t.PROJECTION_COLUMNS), t.NONE, dtype=np.int64)
    ring = layout.input_rows(program) * arrays.net["empty_input"].shape[1]
    for q, (part, arranged, row) in enumerate(zip(program.projections, arrays.synapses, table, strict=True)):
        longest = part.delay_range(h)[1]
        own_delays = layout.has_own_delays(part)
        row[t.SOURCE], row[t.TARGET], row[t.LAYOUT] = part.source, part.target, arranged.layout
        row[t.RECEPTOR] = t.NONE if part.receptor is None else part.receptor.index
        row[t.LAG], row[t.WAKE_ALL], row[t.DENSE_COUNTS] = longest, NEVER, 0
        row[t.SENDS_AT_ONCE] = int(program.sends_at_once(part))
        if q in arrays.joined:
            continue
        if arranged.layout == t.CSR:
            row[t.SYNAPSE] = put("targets", arranged.targets)
            row_ends = layout.split_rows(arranged.row_ends, arranged.targets, layout.edges_of(arrays, q))
            row[t.ROW] = put("rows", row_ends + row[t.SYNAPSE])
        part_w = layout.internal_weights(program, q, arranged.order) if part.weight.size else np.zeros(1)
        row[t.WEIGHT] = put("weights", part_w)
        learns = part.synapse.learns == "moves" or learns_shared(part)
        row[t.WEIGHT_STRIDE], row[t.SIGN] = int(part_w.size > 1 or learns), t.MIXED if learns else layout.sign(part_w)
        delay = part.delay[arranged.order] if part.delay.size > 1 and arranged.order is not None else part.delay
        if delay.size == 0:
            delay = np.ones(1, dtype=np.int32)
        if not own_delays:
            delay = delay[:1]
        elif delay.size != part.size:
            delay = np.broadcast_to(delay, max(1, part.size))
        row[t.DELAY], row[t.DELAY_STRIDE] = put("delays", delay.astype(np.int32)), int(own_delays)
        blocks = int(pops[part.target, t.LAST_BLOCK] - pops[part.target, t.FIRST_BLOCK])
        # From this number of spikes in a step on, nearly all blocks of the target get input, so all are marked at once.
        if arranged.layout == t.DENSE:
            row[t.WAKE_ALL] = 1
        elif part.grid is not None:  # several spikes may reach the same blocks
            g = part.grid
            rows, columns = (-(-n // g.stride) for n in (g.kernel_height, g.kernel_width))
            marks = min(rows, g.rows) * (1 + min(columns, g.columns) * g.maps / t.BLOCK)
            row[t.WAKE_ALL] = 1 if marks > blocks else NEVER
            row[t.CHANNEL_HEIGHT], row[t.CHANNEL_WIDTH] = g.height, g.width
            row[t.MAPS], row[t.ROWS], row[t.COLUMNS] = g.maps, g.rows, g.columns
            row[t.DEPTH], row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH] = g.kernels[1:]
            row[t.STRIDE], row[t.TOP], row[t.LEFT], row[t.REACH] = g.stride, g.top, g.left, g.reach
            row[t.CHANNELS_INSIDE] = g.channels if arrays.places[part.source].inside is not None else 0
        elif arranged.targets.size:
            row[t.WAKE_ALL] = 1 + 2 * blocks * (arranged.row_ends.size - 1) // arranged.targets.size
        if q in arrays.plastic_of or learns_shared(part) or own_delays:
            ring = _place_ring(arrays, row, longest, ring)
        else:
            row[t.LAG] = int(delay[0]) if delay.size else 1
    kinds = {array.name: array.kind for array in t.NET_ARRAYS}
    arrays.net |= {name: _concatenated(values, np.dtype(kinds[name])) for name, values in parts.items()}
    arrays.net["projections"] = table
    if any(part.synapse.learns in ("moves", "trials") or learns_shared(part) for part in program.projections):
        copy_shared_weights(arrays)
    if any(part.synapse.delays and part.synapse.learns == "trials" for part in program.projections):
        arrays.net["late"] = arrays.net["delays"] * h
    set_buffer(arrays, np.full(ring, -0.0))
    list_incoming(arrays)


def copy_shared_weights(arrays: EventArrays) -> bool:
    """Copy the array of weights before a change, if it shares memory with the program. Return whether it did."""
    shared = any(
        np.may_share_memory(arrays.net["weights"], p.weight)
        for q, p in enumerate(arrays.program.projections)
        if q not in arrays.joined
    )
    if shared:
        arrays.net["weights"] = arrays.net["weights"].copy()
    return shared


def _place_ring(arrays: EventArrays, row: Ints, longest: int, at: int) -> int:
    """Give a projection a ring that begins at `at` in the buffer. Return the end of the ring.

    `longest` is the longest delay in steps.
    """
    slots, n = layout.power_of_two(longest + arrays.longest_slice + 1), arrays.program.populations[row[t.TARGET]].size
    row[t.LAG] = 0
    row[t.RING], row[t.RING_MASK], row[t.RING_SIZE] = at, slots - 1, n
    return int(at + slots * n * arrays.net["pops"][row[t.TARGET], t.RECEPTORS])


def give_ring(arrays: EventArrays, q: int) -> int:
    """Give a projection a ring. From now on, emitted spikes are delivered into the ring at once.

    Return the delay in steps after which spikes were read from the log before, or 0 if the projection had a ring.
    """
    row, buf = arrays.net["projections"][q], arrays.net["buf"]
    if (lag := int(row[t.LAG])) == 0:
        return 0
    if q in arrays.joined:
        leave_joined_rows(arrays, q)
    end = _place_ring(arrays, row, arrays.program.projections[q].delay_range(arrays.program.resolution)[1], buf.size)
    set_buffer(arrays, np.concatenate([buf, np.full(end - buf.size, -0.0)]))
    list_incoming(arrays)
    return lag


def leave_joined_rows(arrays: EventArrays, q: int) -> None:
    """Move a projection out of the joined rows, because a projection with a ring needs rows of its own."""
    row, net = arrays.net["projections"][q], arrays.net
    if row[t.WEIGHT] < 0:
        w = joined_rows.weights(arrays, q)
        row[t.WEIGHT], row[t.WEIGHT_STRIDE], row[t.SIGN] = net["weights"].size, int(w.size > 1), layout.sign(w)
        net["weights"] = np.concatenate([net["weights"], w])
    row_ends, targets, delay, local = joined_rows.synapses(arrays, q)
    rows = layout.split_rows(row_ends, targets, local) + net["targets"].size
    for name, column, values in (("rows", t.ROW, rows), ("targets", t.SYNAPSE, targets), ("delays", t.DELAY, delay)):
        row[column] = net[name].size
        net[name] = np.concatenate([net[name], values], dtype=net[name].dtype)
    row[t.DELAY_STRIDE] = 1


def set_buffer(arrays: EventArrays, buf: Floats) -> None:
    """Copy `buf` to aligned memory and use it for the input and the rings."""
    rows, n = arrays.net["empty_input"].shape
    arrays.net["buf"] = aligned_zeros(buf.size, np.float64)
    arrays.net["buf"][:] = buf
    arrays.net["x"] = arrays.net["buf"][: rows * n].reshape(rows, n)


def _concatenated(parts: list[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    """Concatenate arrays, without a copy if all are neighbouring views of the same array."""
    non_empty = [p for p in parts if p.size]
    base = non_empty[0] if len(non_empty) == 1 else (non_empty[0].base if non_empty else None)
    if base is not None and base.dtype == dtype and base.size == sum(p.size for p in non_empty):
        places = [p.ctypes.data for p in non_empty]
        expected = base.ctypes.data + np.cumsum([0, *(p.nbytes for p in non_empty[:-1])])
        if base.flags.c_contiguous and np.array_equal(places, expected):
            return base
    return np.concatenate([np.zeros(0, dtype=dtype), *parts]).astype(dtype, copy=False)


def list_incoming(arrays: EventArrays) -> None:
    """List the projections into each population: first projections without a ring, then projections with a ring.

    The spikes of a projection without a ring are read from the spike log when they arrive. Projections that carry
    currents are not listed. Projections with a ring that are not plastic are also listed in `at_emission`.
    """
    incoming: list[int] = []
    pops, rows = arrays.net["pops"], arrays.net["projections"]
    for k, population in enumerate(arrays.program.populations):
        sources = [(q, p.source) for q, p in enumerate(arrays.program.projections) if p.target == k]
        arriving = [q for q, source in sources if pops[source, t.KIND] != t.CURRENT]
        for first, last, ringed in ((t.ARRIVALS, t.ARRIVALS_END, False), (t.RINGS, t.RINGS_END, True)):
            pops[k, first] = len(incoming)
            incoming += [q for q in arriving if (rows[q, t.LAG] == 0) == ringed]
            pops[k, last] = len(incoming)
        # The loop adds the input to the first collecting state after a step, if the model allows it and all deliveries
        # mark the few blocks where input arrives.
        model = population.model
        is_alone = pops[k, t.GROUP] < 0 and pops[k, t.CARRIED] != 1 and arrays.joined.isdisjoint(arriving)
        is_listed = (rows[arriving, t.LAYOUT] == t.CSR) & (rows[arriving, t.LAG] > 0)
        pops[k, t.COLLECTS] = t.NONE
        can_collect = is_alone and bool(np.all(is_listed & (rows[arriving, t.WAKE_ALL] > 1)))
        if can_collect and isinstance(model, Neuron) and type(model) in NEURONS and model.collects:
            pops[k, t.COLLECTS] = [state.name for state in type(model).states].index(model.collects[0])
    arrays.net["incoming"] = np.array(incoming, dtype=np.int64)
    ringed_rows = np.flatnonzero(rows[:, t.LAG] == 0)
    arrays.net["at_emission"] = np.setdiff1d(ringed_rows, list(arrays.plastic_of)).astype(np.int64)
    layout.clear_joined_rows(arrays)
