"""Currents that change at every step: from what the generators emit to the neurons, one line after the other."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of


@kernel
def drive(view, thread, step):
    """Before the neurons of a step: the external current of those whose current changes; they never sleep."""
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        row = net.pops[line[t.DRIVEN]]
        for block in range(net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]):
            if net.stop[0] == t.AT_ONCE:
                return
            # A current that changes at each step keeps its neurons awake.
            net.busy[block] = step
            if line[t.CHARGED] < 0:
                lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
                if line[t.BEGINS] == 1:
                    net.current[lo:hi] = 0.0
                add_line(view, k, row, lo, hi, step, net.current)


@kernel
def charge(view, thread, step):
    """After the neurons of a step: what currents to a receptor add to the state in which it keeps its own."""
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        if line[t.CHARGED] >= 0:
            row = net.pops[line[t.DRIVEN]]
            lo = net.edges[row[t.NUMBER], thread] * t.BLOCK
            hi = min(row[t.END], net.edges[row[t.NUMBER], thread + 1] * t.BLOCK)
            add_line(view, k, row, lo, hi, step, net.state[line[t.CHARGED]])


@subkernel
def add_line(view, number, row, lo, hi, step, out):
    """Add what arrives along a line in a step; where it charges a state, its share."""
    net = net_of(view)
    line, rows = net.lines[number], net.emitted_rows[number]
    begin, weight, stride = row[t.BEGIN], line[t.LINE_WEIGHT], line[t.LINE_STRIDE]
    # Currents are worked out in NumPy for a stretch of steps; what is emitted at the end of a step acts in the next.
    at = step - 1 - net.emitted_from[0]
    if line[t.HOW] == t.AS_LISTED:
        for i in range(lo, hi):
            total = 0.0
            place = line[t.LINE_ENDS] + i - begin
            for k in range(net.line_ends[place], net.line_ends[place + 1]):
                value = line[t.FIRST_VALUE] + rows[at - net.line_lates[k]] * line[t.VALUES] + net.line_columns[k]
                total += net.emitted[value] * net.line_weights[weight + k * stride]
            out[i] += total if line[t.CHARGED] < 0 else net.shares[line[t.SHARE] + i - begin] * total
        return
    first = line[t.FIRST_VALUE] + rows[at - line[t.LATE]] * line[t.VALUES] + line[t.COLUMN_AT]
    each = np.int64(line[t.HOW] != t.TO_ALL)
    if line[t.CHARGED] >= 0:
        for i in range(lo, hi):
            arrived = net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
            out[i] += net.shares[line[t.SHARE] + i - begin] * arrived
    # One value for all is multiplied once.
    elif each == 0 and stride == 0:
        arrived = net.emitted[first] * net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += arrived
    elif each == 1 and stride == 0:
        # Views of neighbours, so that the loop is vectorised.
        emitted, factor = net.emitted[first + lo - begin : first + hi - begin], net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += emitted[i - lo] * factor
    else:
        for i in range(lo, hi):
            out[i] += net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
