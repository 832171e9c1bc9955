# mypy: ignore-errors
"""Compiled loops that parse and write lines of text, and find the ranges of columns."""

import numpy as np

from neuro.extend import allocating, kernel, subkernel

NOT_A_NUMBER, TOO_FEW, TOO_MANY, NOT_WHOLE, OUT_OF_RANGE = 1, 2, 3, 4, 5
_LOW = np.int64(-922337203685477580)
"""Lowest number whose tenfold fits into int64. Digits are accumulated to a negative number, because int64 reaches one
further below 0 than above."""


@allocating
def parse(data, columns, where, unit, t, x, y, p):
    """Parse lines of numbers.

    Args:
        data: uint8, complete lines.
        columns: number of columns per line.
        where: (4,) int64, columns of t, x, y, p.
        unit: exponent of the unit of time: a time times 10^unit is in us.
        t: int64, us, output; with a place for each line, as the other columns.
        x: uint16, output.
        y: uint16, output.
        p: uint8, output.

    Returns:
        The number of events, the byte and line at which parsing ended, the fault at this line (0: none), and the column
        of the fault.
    """
    n = 0
    at = 0
    line = 0
    values = np.zeros(4, np.int64)
    while at < data.size:
        begin = at
        at = _blanks(data, at)
        if at < data.size and not _no_event(data[at]):
            column = 0
            while at < data.size and data[at] != 10 and data[at] != 13:
                if column == columns:
                    return n, begin, line, TOO_MANY, column
                end = at
                while end < data.size and not _ends(data[end]):
                    end += 1
                for k in range(4):
                    if where[k] == column:
                        truth = _truth(data, at, end) if k == 3 else -1
                        if truth >= 0:
                            values[k] = truth
                            continue
                        values[k], wrong = _number(data, at, end, unit if k == 0 else 0, k == 0 and unit != 0)
                        if (
                            wrong == 0
                            and k
                            and (values[k] < (-1 if k == 3 else 0) or values[k] > (1 if k == 3 else 65535))
                        ):
                            wrong = OUT_OF_RANGE
                        if wrong:
                            return n, begin, line, wrong, column
                at = _blanks(data, end)
                if at < data.size and (data[at] == 44 or data[at] == 59):
                    at = _blanks(data, at + 1)
                column += 1
            if column < columns:
                return n, begin, line, TOO_FEW, column
            t[n] = values[0]
            x[n] = values[1]
            y[n] = values[2]
            p[n] = values[3] > 0
            n += 1
        at = _next_line(data, at)
        line += 1
    return n, data.size, line, 0, 0


@kernel
def rows(data, event, begin):
    """Find the byte and line at which an event begins. If there are fewer events, find where the last event begins.

    Args:
        data: uint8, complete lines.
        event: index of the event.
        begin: (2,) int64, output: byte and line.
    """
    at = 0
    line = 0
    while at < data.size:
        first = _blanks(data, at)
        if first < data.size and not _no_event(data[first]):
            begin[0] = at
            begin[1] = line
            if event == 0:
                return
            event -= 1
        at = _next_line(data, at)
        line += 1


@subkernel
def _next_line(data, at):
    """Return the byte after the end of a line, which is LF, CR LF or CR."""
    while at < data.size and data[at] != 10 and data[at] != 13:
        at += 1
    if at + 1 < data.size and data[at] == 13 and data[at + 1] == 10:
        at += 1
    return at + 1


@subkernel
def _blanks(data, at):
    """Return the next byte that is neither space nor tab."""
    while at < data.size and (data[at] == 32 or data[at] == 9):
        at += 1
    return at


@subkernel
def _no_event(byte):
    """Return whether a line that begins with this byte is empty or a comment."""
    return byte == 10 or byte == 13 or byte == 35 or byte == 37


@subkernel
def _ends(byte):
    """Return whether a byte ends a number: comma, semicolon, space, tab or the end of the line."""
    return byte == 44 or byte == 59 or byte == 32 or byte == 9 or byte == 10 or byte == 13


_TRUE = np.frombuffer(b"true", np.uint8)
_FALSE = np.frombuffer(b"false", np.uint8)


@subkernel
def _truth(data, at, end):
    """Return 1 for "true", 0 for "false", and -1 for other text. Letters may be upper or lower case."""
    if end - at < 4 or end - at > 5:
        return -1
    word = _TRUE if end - at == 4 else _FALSE
    for k in range(end - at):
        if data[at + k] | 32 != word[k]:
            return -1
    return 5 - (end - at)


@subkernel
def _number(data, at, end, unit, rounded):
    """Parse a decimal number, and multiply it by 10^unit. The result is exact, or rounded to the nearest if `rounded`.

    Returns:
        The number, and a fault (0: none).
    """
    negative = at < end and data[at] == 45
    if at < end and (data[at] == 45 or data[at] == 43):
        at += 1
    value = np.int64(0)
    power = unit
    digits = 0
    point = False
    lost = False
    is_full = False
    while at < end:
        digit = np.int64(data[at]) - 48
        if digit == -2 and not point:
            point = True
        elif 0 <= digit <= 9:
            digits += 1
            is_full |= value < _LOW or (value == _LOW and digit > 8)
            if not is_full:
                value = 10 * value - digit
                power -= point
            elif point:
                lost |= digit != 0
            else:
                return value, OUT_OF_RANGE
        else:
            break
        at += 1
    if digits == 0:
        return value, NOT_A_NUMBER
    if at < end:
        if data[at] != 69 and data[at] != 101:
            return value, NOT_A_NUMBER
        at += 1
        negative_exponent = at < end and data[at] == 45
        if at < end and (data[at] == 45 or data[at] == 43):
            at += 1
        if at == end or end - at > 4:
            return value, NOT_A_NUMBER
        exponent = 0
        while at < end:
            digit = np.int64(data[at]) - 48
            if digit < 0 or digit > 9:
                return value, NOT_A_NUMBER
            exponent = 10 * exponent + digit
            at += 1
        power += -exponent if negative_exponent else exponent
    value, wrong = _scaled(value, power, lost, rounded)
    if negative:
        return value, wrong
    if -value < 0:
        wrong = OUT_OF_RANGE
    return -value, wrong


@subkernel
def _scaled(value, power, lost, rounded):
    """Multiply a number <= 0 by a power of ten. `lost` states that digits other than 0 were cut off the number.

    Returns:
        The number, and a fault (0: none).
    """
    while power > 0 and value:
        if value < _LOW:
            return value, OUT_OF_RANGE
        value *= 10
        power -= 1
    last = np.int64(0)
    while power < 0 and (value or last):
        lost |= last != 0
        tenth = (value + 9) // 10
        last = 10 * tenth - value
        value = tenth
        power += 1
    if (lost or last) and not rounded:
        return value, NOT_WHOLE
    return value - (last >= 5), 0


@kernel
def form(t, x, y, p, separator, out):
    """Write events as lines ``t,x,y,p``.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        separator: character code of the separator.
        out: uint8, at least 35 bytes per event, output.

    Returns:
        The number of bytes written.
    """
    at = 0
    for k in range(t.size):
        value = np.uint64(t[k])
        if t[k] < 0:
            out[at] = 45
            at += 1
            value = np.uint64(0) - value
        at = _digits(value, separator, out, at)
        at = _digits(np.uint64(x[k]), separator, out, at)
        at = _digits(np.uint64(y[k]), separator, out, at)
        at = _digits(np.uint64(p[k]), separator, out, at)
        out[at - 1] = 10
    return at


@subkernel
def _digits(value, separator, out, at):
    """Write a number and a separator, and return the next byte."""
    ten = np.uint64(10)
    length = 1
    rest = value // ten
    while rest:
        rest //= ten
        length += 1
    for k in range(length):
        out[at + length - 1 - k] = 48 + value % ten
        value //= ten
    out[at + length] = separator
    return at + length + 1


@kernel
def survey(t, x, y):
    """Return the largest x and y, and whether time never runs back."""
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    runs_back = False
    for k in range(t.size):
        x_max = max(x_max, x[k])
        y_max = max(y_max, y[k])
    for k in range(1, t.size):
        runs_back |= t[k] < t[k - 1]
    return x_max, y_max, not runs_back
