"""Compiled loops of placing: synapses by target, and filling a core neuron by neuron.

A line is one source neuron of one projection, see `neuro.chips.placing.incoming`.
"""

# mypy: ignore-errors
from neuro.chips.placing import packing
from neuro.kernels.jit import kernel, subkernel

NEURONS, AXONS, MEMORY, EDGES, LINES, KERNELS = range(6)
"""What is counted of a core while it fills: neurons, axons in, bits, axons out, lines; bits of kernels."""

_ROW_BITS = packing.ROW_WORDS * packing.WORD_BITS
_WORD_BITS = packing.WORD_BITS
SHARED = packing.SHARED
block_bits = subkernel(packing.block_bits)
index_bits = subkernel(packing.index_bits)


@kernel
def onto(begin, end, targets, count):
    """Count the synapses of a projection onto each of its targets."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            count[targets[e]] += 1


@kernel
def scatter(begin, end, targets, first, position, line):
    """Enter the synapses of a projection behind those that their targets already have."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            t = targets[e]
            line[position[t]] = first + i
            position[t] += 1


@kernel
def fill(queue, begin, end, core, rows, graph, sends, limits, load, marks):
    """Add the neurons queue[begin:end] to a core until one does not fit; returns its position, or end.

    Args:
        queue: neurons in the order in which they are taken.
        begin: position of the first.
        end: the position after the last.
        core: a number that no other core has had: marks of other cores are void.
        rows: whether synapses lie in rows, not in blocks.
        graph: ends, line, first, source, projection, bits and sources of `Incoming`; where ends are all 0, synapses
            are not looked at.
        sends: axons out of each neuron, as far as known.
        limits: most of NEURONS, AXONS, MEMORY and EDGES.
        load: the same of this core so far, and LINES and KERNELS.
        marks: core and count (core << 32 | count) of each line, core of each source, longest row and its core of each
            projection, and the lines that reach this core.
    """
    ends, line, first, source_of, projection_of, all_bits, sources = graph
    mark, source_core, longest, row_core, lines = marks
    most_axons, most_memory = limits[AXONS], limits[MEMORY]
    axons, memory, n_lines = load[AXONS], load[MEMORY], load[LINES]
    empty = core << 32
    stopped = end
    for position in range(begin, end):
        if load[NEURONS] == limits[NEURONS]:
            stopped = position
            break
        t = queue[position]
        before = index_bits(load[NEURONS])
        load[NEURONS] += 1
        width = index_bits(load[NEURONS])
        if width != before and not rows:  # one bit more for all synapses of the core
            memory = load[KERNELS]
            for k in range(n_lines):
                own_bits = all_bits[projection_of[lines[k]]]
                memory += 0 if own_bits == SHARED else block_bits(mark[lines[k]] - empty, own_bits + width)
        past, to_source, bits, one, projection, shared = 0, 0, 0, 0, 0, False
        for e in range(ends[t], ends[t + 1]):
            own = line[e]
            if own >= past:  # lines of a neuron lie by projection
                projection = projection_of[own]
                past = first[projection + 1]
                to_source = source_of[own] - own
                shared = all_bits[projection] == SHARED
                bits = all_bits[projection] + width
                one = block_bits(1, bits)
            count = mark[own] - empty
            if count <= 0:
                count = 0
                if not rows:
                    lines[n_lines] = own
                    n_lines += 1
                if source_core[own + to_source] != core:
                    source_core[own + to_source] = core
                    axons += 1
            count += 1
            mark[own] = empty + count
            if shared:
                pass
            elif not rows:
                memory += one if count == 1 else block_bits(count, bits) - block_bits(count - 1, bits)
            else:
                if row_core[projection] != core:
                    row_core[projection] = core
                    longest[projection] = 0
                    memory += sources[projection] * _ROW_BITS
                if count > longest[projection]:
                    longest[projection] = count
                    memory += sources[projection] * _WORD_BITS
            if axons > most_axons or memory > most_memory:
                stopped = position
                break
        if stopped < end:
            break
        load[EDGES] += sends[t]
        if axons > most_axons or memory > most_memory or load[EDGES] > limits[EDGES]:
            stopped = position
            break
    load[AXONS], load[MEMORY], load[LINES] = axons, memory, n_lines
    return stopped
