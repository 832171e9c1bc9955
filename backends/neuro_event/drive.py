"""Currents that change at every step: from what the generators emit to the neurons, one line after the other."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, kernel
from neuro_event.tables import (
    AS_LISTED,
    BEGIN,
    BEGINS,
    BLOCK,
    CHARGED,
    COLUMN_AT,
    DRIVEN,
    END,
    FIRST_VALUE,
    HOW,
    LATE,
    LINE_ENDS,
    LINE_STRIDE,
    LINE_WEIGHT,
    NUMBER,
    SHARE,
    TO_ALL,
    VALUES,
)
from neuro_event.views import net_of


@kernel
def drive(view, thread, step):
    """Before the neurons of a step: the external current of those whose current changes; they never sleep."""
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        row = net.pops[line[DRIVEN]]
        for block in range(net.edges[row[NUMBER], thread], net.edges[row[NUMBER], thread + 1]):
            net.busy[block] = step
            if line[CHARGED] < 0:
                lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
                if line[BEGINS] == 1:
                    net.current[lo:hi] = 0.0
                add_line(view, k, row, lo, hi, step, net.current)


@kernel
def charge(view, thread, step):
    """After the neurons of a step: what currents to a receptor add to the state in which it keeps its own."""
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        if line[CHARGED] >= 0:
            row = net.pops[line[DRIVEN]]
            lo = net.edges[row[NUMBER], thread] * BLOCK
            hi = min(row[END], net.edges[row[NUMBER], thread + 1] * BLOCK)
            add_line(view, k, row, lo, hi, step, net.state[line[CHARGED]])


@inner
def add_line(view, number, row, lo, hi, step, out):
    """Add what arrives along a line in a step; where it charges a state, its share."""
    net = net_of(view)
    line, rows = net.lines[number], net.emitted_rows[number]
    begin, weight, stride = row[BEGIN], line[LINE_WEIGHT], line[LINE_STRIDE]
    at = step - 1 - net.emitted_from[0]
    if line[HOW] == AS_LISTED:
        for i in range(lo, hi):
            total = 0.0
            place = line[LINE_ENDS] + i - begin
            for k in range(net.line_ends[place], net.line_ends[place + 1]):
                value = line[FIRST_VALUE] + rows[at - net.line_lates[k]] * line[VALUES] + net.line_columns[k]
                total += net.emitted[value] * net.line_weights[weight + k * stride]
            out[i] += total if line[CHARGED] < 0 else net.shares[line[SHARE] + i - begin] * total
        return
    first = line[FIRST_VALUE] + rows[at - line[LATE]] * line[VALUES] + line[COLUMN_AT]
    each = np.int64(line[HOW] != TO_ALL)
    if line[CHARGED] >= 0:
        for i in range(lo, hi):
            arrived = net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
            out[i] += net.shares[line[SHARE] + i - begin] * arrived
    elif each == 0 and stride == 0:
        arrived = net.emitted[first] * net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += arrived
    elif each == 1 and stride == 0:
        emitted, factor = net.emitted[first + lo - begin : first + hi - begin], net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += emitted[i - lo] * factor
    else:
        for i in range(lo, hi):
            out[i] += net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
