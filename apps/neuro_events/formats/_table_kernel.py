# mypy: ignore-errors
"""Events from and to lines of text, and what the columns of any events reach."""

import numpy as np

from neuro.extend import allocating, kernel, subkernel

NOT_A_NUMBER, TOO_FEW, TOO_MANY, NOT_WHOLE, OUT_OF_RANGE = 1, 2, 3, 4, 5
_LOW = np.int64(-922337203685477580)
"""The lowest number that may be multiplied by ten; numbers are gathered below 0, where int64 has one more."""


@allocating
def parse(data, columns, where, unit, t, x, y, p):
    """Read lines of numbers.

    Args:
        data: uint8, whole lines.
        columns: how many a line has.
        where: int64[4], columns of t, x, y, p.
        unit: power of ten by which a time becomes us.
        t: int64, filled.
        x: uint16, filled.
        y: uint16, filled.
        p: uint8, filled.

    Returns:
        events read, byte and line at which it ended, and what is wrong there with which column (0: nothing).
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
def rows(data, wanted, begin):
    """Byte and line at which the event of a number begins, or the last line where there are fewer.

    `begin` is filled: int64[2].
    """
    at = 0
    line = 0
    while at < data.size:
        first = _blanks(data, at)
        if first < data.size and not _no_event(data[first]):
            begin[0] = at
            begin[1] = line
            if wanted == 0:
                return
            wanted -= 1
        at = _next_line(data, at)
        line += 1


@subkernel
def _next_line(data, at):
    """The byte after the end of a line: LF, CR LF, or CR alone."""
    while at < data.size and data[at] != 10 and data[at] != 13:
        at += 1
    if at + 1 < data.size and data[at] == 13 and data[at + 1] == 10:
        at += 1
    return at + 1


@subkernel
def _blanks(data, at):
    """The next byte that is no space or tab."""
    while at < data.size and (data[at] == 32 or data[at] == 9):
        at += 1
    return at


@subkernel
def _no_event(byte):
    """Whether a line that begins with a byte is empty or a comment."""
    return byte == 10 or byte == 13 or byte == 35 or byte == 37


@subkernel
def _ends(byte):
    """Whether a byte ends a number: comma, semicolon, space, tab or the end of the line."""
    return byte == 44 or byte == 59 or byte == 32 or byte == 9 or byte == 10 or byte == 13


_TRUE = np.frombuffer(b"true", np.uint8)
_FALSE = np.frombuffer(b"false", np.uint8)


@subkernel
def _truth(data, at, end):
    """1 for True, 0 for False, in small or capital letters; -1 for anything else."""
    if end - at < 4 or end - at > 5:
        return -1
    word = _TRUE if end - at == 4 else _FALSE
    for k in range(end - at):
        if data[at + k] | 32 != word[k]:
            return -1
    return 5 - (end - at)


@subkernel
def _number(data, at, end, unit, rounded):
    """A decimal number times ten to the power of `unit`; exact, or rounded to the nearest if `rounded`."""
    negative = at < end and data[at] == 45
    if at < end and (data[at] == 45 or data[at] == 43):
        at += 1
    value = np.int64(0)
    power = unit
    digits = 0
    point = False
    lost = False
    full = False
    while at < end:
        digit = np.int64(data[at]) - 48
        if digit == -2 and not point:
            point = True
        elif 0 <= digit <= 9:
            digits += 1
            full |= value < _LOW or (value == _LOW and digit > 8)
            if not full:
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
        down = at < end and data[at] == 45
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
        power += -exponent if down else exponent
    value, wrong = _scaled(value, power, lost, rounded)
    if negative:
        return value, wrong
    if -value < 0:
        wrong = OUT_OF_RANGE
    return -value, wrong


@subkernel
def _scaled(value, power, lost, rounded):
    """A number of at most 0 times a power of ten; `lost`: it had more digits."""
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
def form(t, x, y, p, between, out):
    """Write events as lines ``t,x,y,p``.

    Args:
        t: int64.
        x: uint16.
        y: uint16.
        p: uint8.
        between: the sign between two numbers.
        out: uint8, at least 35 for each event, filled.

    Returns:
        bytes written.
    """
    at = 0
    for k in range(t.size):
        value = np.uint64(t[k])
        if t[k] < 0:
            out[at] = 45
            at += 1
            value = np.uint64(0) - value
        at = _digits(value, between, out, at)
        at = _digits(np.uint64(x[k]), between, out, at)
        at = _digits(np.uint64(y[k]), between, out, at)
        at = _digits(np.uint64(p[k]), between, out, at)
        out[at - 1] = 10
    return at


@subkernel
def _digits(value, between, out, at):
    """Write a number and a comma."""
    ten = np.uint64(10)
    length = 1
    rest = value // ten
    while rest:
        rest //= ten
        length += 1
    for k in range(length):
        out[at + length - 1 - k] = 48 + value % ten
        value //= ten
    out[at + length] = between
    return at + length + 1


@kernel
def survey(t, x, y):
    """Largest x and y, and whether time does not run back."""
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    back = False
    for k in range(t.size):
        x_max = max(x_max, x[k])
        y_max = max(y_max, y[k])
    for k in range(1, t.size):
        back |= t[k] < t[k - 1]
    return x_max, y_max, not back
