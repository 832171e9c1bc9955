"""Compiled loops of placing: filling a core neuron by neuron, and counting what reaches each core.

A line is one source neuron of one projection, see `neuro.chips.placing.incoming`.
"""

# mypy: ignore-errors
from neuro.chips.placing import packing
from neuro.kernels.jit import inner, kernel

NEURONS, AXONS, MEMORY, EDGES, LINES = range(5)
"""What is counted of a core while it fills: neurons, axons in, bits, axons out, lines that reach it."""

_ROW_BITS = packing.ROW_WORDS * packing.WORD_BITS
_WORD_BITS = packing.WORD_BITS
block_bits = inner(packing.block_bits)
index_bits = inner(packing.index_bits)


@kernel
def scatter(source, target, first, position, line):
    """Enter the synapses of a projection behind those that their targets already have."""
    for e in range(source.size):
        t = target[e]
        line[position[t]] = first + source[e]
        position[t] += 1


@kernel
def scatter_rows(row_ends, target, first, position, line):
    """The same of a projection whose synapses lie by source, without a list of sources."""
    for i in range(row_ends.size - 1):
        for e in range(row_ends[i], row_ends[i + 1]):
            t = target[e]
            line[position[t]] = first + i
            position[t] += 1


@kernel
def scatter_all(sources, targets, first, position, line):
    """Enter the synapses of a projection in which every source reaches every target."""
    for t in range(targets):
        at = position[t]
        for i in range(sources):
            line[at + i] = first + i
        position[t] = at + sources


@kernel
def fill(queue, begin, end, core, rows, graph, sends, limits, load, marks):
    """Add the neurons queue[begin:end] to a core until one does not fit; returns its position, or end.

    Args:
        queue: neurons in the order in which they are taken.
        begin: position of the first.
        end: the position after the last.
        core: a number that no other core has had: marks of other cores are void.
        rows: whether synapses lie in rows, not in blocks.
        graph: ends, line, source, projection, bits and sources of `Incoming`.
        sends: axons out of each neuron, as far as known.
        limits: most of NEURONS, AXONS, MEMORY and EDGES.
        load: the same of this core so far, and LINES.
        marks: count and core of each line, core of each source, longest row and its core of each projection, and
            the lines that reach this core.
    """
    for position in range(begin, end):
        if load[NEURONS] == limits[NEURONS]:
            return position
        t = queue[position]
        width = _widen(rows, graph, load, marks)
        for e in range(graph[0][t], graph[0][t + 1]):
            _add(graph[1][e], core, rows, width, graph, load, marks)
            if load[AXONS] > limits[AXONS] or load[MEMORY] > limits[MEMORY]:
                return position
        load[EDGES] += sends[t]
        if load[AXONS] > limits[AXONS] or load[MEMORY] > limits[MEMORY] or load[EDGES] > limits[EDGES]:
            return position
    return end


@inner
def _widen(rows, graph, load, marks):
    """One neuron more; where its index needs another bit, all synapses of the core do."""
    before = index_bits(load[NEURONS])
    load[NEURONS] += 1
    width = index_bits(load[NEURONS])
    if width != before and not rows:
        load[MEMORY] = 0
        for k in range(load[LINES]):
            line = marks[5][k]
            load[MEMORY] += block_bits(marks[0][line], graph[4][graph[3][line]] + width)
    return width


@inner
def _add(line, core, rows, width, graph, load, marks):
    """One synapse more."""
    count, line_core, source_core, longest, row_core, lines = marks
    source, projection = graph[2][line], graph[3][line]
    if line_core[line] != core:
        line_core[line] = core
        count[line] = 0
        lines[load[LINES]] = line
        load[LINES] += 1
        if source_core[source] != core:
            source_core[source] = core
            load[AXONS] += 1
    count[line] += 1
    if not rows:
        bits = graph[4][projection] + width
        load[MEMORY] += block_bits(count[line], bits) - block_bits(count[line] - 1, bits)
        return
    if row_core[projection] != core:
        row_core[projection] = core
        longest[projection] = 0
        load[MEMORY] += graph[5][projection] * _ROW_BITS
    if count[line] > longest[projection]:
        longest[projection] = count[line]
        load[MEMORY] += graph[5][projection] * _WORD_BITS


@kernel
def reach(queue, core, begin, end, ends, line, source, line_core, source_core, place, kept, found):
    """Which lines reach which core, and with how many synapses; returns how many such pairs there are.

    Args:
        queue: neurons in the order in which they were taken.
        core: of each piece of the queue, ascending.
        begin: where each piece begins in the queue.
        end: the position after its last.
        ends: of `Incoming`.
        line: likewise.
        source: likewise.
        line_core: work space per line, all -1.
        source_core: work space per neuron, all -1.
        place: work space per line.
        kept: work space per neuron.
        found: is filled: line, core, synapses, and whether it is the first line of its source that reaches the core.
    """
    n = 0
    for p in range(core.size):
        for position in range(begin[p], end[p]):
            t = queue[position]
            for e in range(ends[t], ends[t + 1]):
                own = line[e]
                s = source[own]
                if line_core[own] != core[p]:
                    line_core[own] = core[p]
                    place[own] = n
                    found[0][n] = own
                    found[1][n] = core[p]
                    found[2][n] = 0
                    found[3][n] = 0
                    if source_core[s] != core[p]:
                        source_core[s] = core[p]
                        kept[s] = n
                        found[3][n] = 1
                    elif own < found[0][kept[s]]:
                        found[3][kept[s]] = 0
                        found[3][n] = 1
                        kept[s] = n
                    n += 1
                found[2][place[own]] += 1
    return n


@kernel
def weigh(queue, core, begin, end, graph, index, marks, sends, axons_in, memory):
    """Count what reaches each core without listing it: for machines of so many cores that a list would be too long.

    The pieces of the queue are those of `reach`; `graph` has ends, line, source, projection and bits of `Incoming`, and
    `index` the bits that tell the neurons of each core apart. Work space: a count of each line (0), the lowest line of
    each source (-1), and room for the lines and sources that reach a core. Filled are the cores that each source
    reaches (`sends`), and the sources and the bits of memory of each core.
    """
    ends, line, source, projection, bits = graph
    count, lowest, lines, sources = marks
    first = 0
    while first < core.size:
        own = core[first]
        last = first
        n = m = 0
        while last < core.size and core[last] == own:
            for position in range(begin[last], end[last]):
                t = queue[position]
                for e in range(ends[t], ends[t + 1]):
                    k = line[e]
                    if count[k] == 0:
                        lines[n] = k
                        n += 1
                        if lowest[source[k]] < 0:
                            lowest[source[k]] = k
                            sources[m] = source[k]
                            m += 1
                    count[k] += 1
            last += 1
        taken = 0
        for i in range(n):
            k = lines[i]
            taken += block_bits(count[k], bits[projection[k]] + index[own])
            count[k] = 0
        for i in range(m):
            sends[sources[i]] += 1
            lowest[sources[i]] = -1
        axons_in[own] = m
        memory[own] = taken
        first = last


@kernel
def travel(queue, core, begin, end, ends, line, source, begins, places, reached, lowest, found):
    """The moves of one spike of each line, a spike sent for each core, without a list of lines and cores.

    The pieces of the queue and the synapses are those of `reach`. `begins` has the column, the row, the chip's column
    and the chip's row where each source begins, `places` the same of each core; `reached` and `lowest` (-1) are work
    space per neuron. `found` is filled by line: cores, those on the tile, columns, rows and chips that a spike moves.
    """
    first = 0
    while first < core.size:
        own = core[first]
        last = first
        m = 0
        while last < core.size and core[last] == own:
            for position in range(begin[last], end[last]):
                t = queue[position]
                for e in range(ends[t], ends[t + 1]):
                    k = line[e]
                    s = source[k]
                    if lowest[s] < 0:
                        reached[m] = s
                        m += 1
                        lowest[s] = k
                    elif k < lowest[s]:
                        lowest[s] = k
            last += 1
        for i in range(m):
            s = reached[i]
            k = lowest[s]
            lowest[s] = -1
            east = abs(places[0][own] - begins[0][s])
            south = abs(places[1][own] - begins[1][s])
            found[0][k] += 1
            found[1][k] += east == 0 and south == 0
            found[2][k] += east
            found[3][k] += south
            found[4][k] += abs(places[2][own] - begins[2][s]) + abs(places[3][own] - begins[3][s])
        first = last


@kernel
def spread(source, core, begin, places, cores, local, along, across):
    """Add destinations to the links that sources use: first along their row, then along columns.

    `source` and `core` are pairs, `begin` and `places` the columns and rows of sources and of cores. Filled are the
    cores of each source and those on its tile (`local`), how far it goes west and east (`along`), and north and south
    in each column (`across`).
    """
    for e in range(source.size):
        s, k = source[e], core[e]
        east, south = places[0][k] - begin[0][s], places[1][k] - begin[1][s]
        cores[s] += 1
        local[s] += east == 0 and south == 0
        along[0, s] = max(along[0, s], east)
        along[1, s] = max(along[1, s], -east)
        across[0, s, places[0][k]] = max(across[0, s, places[0][k]], south)
        across[1, s, places[0][k]] = max(across[1, s, places[0][k]], -south)
