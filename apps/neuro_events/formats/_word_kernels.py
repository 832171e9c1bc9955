# mypy: ignore-errors
"""Compiled decoder of all layouts of `_words` and of the packets of AEDAT 3.1, and encoder of Event Stream."""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import types
from numba.extending import intrinsic

from neuro.apps import inlined, ir
from neuro.extend import kernel, subkernel
from neuro_events.formats._words import (
    ADDED,
    BEGIN,
    CLOCK,
    GAPS,
    HALF,
    OTHER,
    PERIOD,
    SECOND,
    STARTED,
    STATES,
    STOPPED,
    WRAPS,
)

U = np.uint32
BLOCK = 1024
"""Number of words that are decoded in one vectorised loop if all of them are events, which is the usual case."""
SURE = 8
"""Number of such blocks in a row after which the next block is decoded before its words are checked."""
NEAR = PERIOD // 16
NEVER = np.iinfo(np.int64).min
"""Time before all others, us."""


@cache
def word(size, is_big):
    """Return a function (bytes, offset) -> number for words of a size (bytes) and byte order."""
    kind = types.uint64 if size == 8 else types.uint32

    def typed(typingctx, data, at):
        def codegen(context, builder, signature, arguments):
            view = context.make_array(signature.args[0])(context, builder, arguments[0])
            place = builder.gep(view.data, [arguments[1]])
            value = builder.load(builder.bitcast(place, ir.IntType(8 * size).as_pointer()))
            value.align = 1
            value = builder.bswap(value) if is_big and size > 1 else value
            return builder.zext(value, ir.IntType(kind.bitwidth)) if 8 * size < kind.bitwidth else value

        return kind(data, types.intp), codegen

    return intrinsic(typed)


@cache
def field(place, is_big=False):
    """Return a function (bytes, offset of an event) -> value of a field."""
    read, byte = word(place.size, is_big), place.byte
    kind = np.uint64 if place.size == 8 else U
    shift, mask, last = kind(place.shift), kind((1 << place.bits) - 1), kind(max(place.backwards - 1, 0))
    backwards = place.backwards > 0

    def value(data, at):
        bits = (read(data, at + byte) >> shift) & mask
        return (last - bits) & mask if backwards else bits

    return inlined(value)


@cache
def oddity(layout):
    """Return a function (bytes, offset) -> number that is 0 if the word is an event."""
    read, byte = word(layout.odd.size, layout.is_big), layout.odd.byte
    kind = np.uint64 if layout.odd.size == 8 else U
    mask, value, differs = kind(layout.odd.mask), kind(layout.odd.value), layout.odd.differs

    def is_odd(data, at):
        bits = read(data, at + byte) & mask
        return bits ^ value if differs else kind(bits == value)

    return inlined(is_odd)


TIME_HIGH = 8
NEAR_HIGH = (1 << 28) // 16
T_BITS = 34


@subkernel
def time_high(state, value):
    """Update the state with a TIME_HIGH of EVT 2.0, and return the time that it states, with low bits of 0."""
    if state[SECOND] >= (1 << 28) - NEAR_HIGH and value < NEAR_HIGH:
        state[ADDED] += 1 << T_BITS
    state[STARTED] = 1
    state[SECOND] = value
    return state[ADDED] + (value << 6)


def _counting_rule(layout):
    """Return the rule for words that are counted, or at which decoding stops."""
    read, byte = word(layout.odd.size, layout.is_big), layout.odd.byte
    kind = np.uint64 if layout.odd.size == 8 else U
    none, first, all_first, size = kind(layout.none), kind(max(layout.first, 0)), layout.first < 0, layout.size

    def count(data, at, begin, state):
        bits = read(data, at + byte)
        if bits & none:
            state[STOPPED] = 1
            return 0, begin
        state[OTHER if all_first or bits & first else SECOND] += 1
        return size, begin

    return count


_word_4 = word(4, False)


def _time_high(data, at, begin, state):
    bits = np.int64(_word_4(data, at))
    if bits >> 28 == TIME_HIGH:
        return 4, time_high(state, bits & 0x0FFFFFFF)
    state[OTHER] += 1
    return 4, begin


def _overflow(data, at, begin, state):
    return 5, begin + (1 << 13)


def _silence(data, at, begin, state):
    return 1, begin + (SILENCE_US if data[at] == SILENCE else 0)


_OTHERS = {"time_high": _time_high, "overflow": _overflow, "silence": _silence}
"""Rules for words that are not events: (bytes, offset, us to add, state) -> size of the word (0: stop), us to add."""


@inlined
def _signed(raw):
    return np.int64(np.int32(raw))


@inlined
def _unsigned(raw):
    return np.int64(raw)


@cache
def decoder(layout, how=kernel):
    """Return the decoder of a layout, which is the function `decode` below.

    Args:
        layout: a `Layout`.
        how: `kernel`, or `subkernel` for a decoder that kernels call.
    """
    x_of, y_of, p_of, t_of = (field(getattr(layout, name), layout.is_big) for name in "xypt")
    is_odd, others = oddity(layout), inlined(_OTHERS.get(layout.others) or _counting_rule(layout))
    size, rule, least = layout.size, layout.rule, layout.least or layout.size
    group, clocked, waits = layout.group, rule in (WRAPS, HALF), layout.waits
    time_of = _signed if layout.is_signed else _unsigned
    sign = U(1 << 31 if layout.is_signed else 0)

    @subkernel
    def run(data, at, begin, t, x, y, p):
        """Decode words as events, without branches, so that the compiler can vectorise the loop.

        Returns:
            The largest x and y, True if time never runs back, and 0 if all words are events.
        """
        x_max = y_max = fell = last = U(0)
        odd = is_odd(data, at) & 0
        for k in range(t.size):
            offset = at + size * k
            raw = t_of(data, offset)
            column = x_of(data, offset)
            row = y_of(data, offset)
            odd |= is_odd(data, offset)
            t[k] = now = begin + time_of(raw)
            x[k] = column
            y[k] = row
            p[k] = p_of(data, offset)
            if rule == GAPS:
                begin = now
            x_max = max(x_max, U(column))
            y_max = max(y_max, U(row))
            rank = raw ^ sign  # in the order of signed times
            fell |= U(rank < last)
            last = rank
        return x_max, y_max, rule == GAPS or fell == 0, odd

    @subkernel
    def count_leading_events(data, at, count):
        """Return the number of events in the groups before the first word that is not an event."""
        k = 0
        while k < count:
            end = min(k + group, count)
            odd = is_odd(data, at + size * k)
            for i in range(k + 1, end):
                odd |= is_odd(data, at + size * i)
            if odd:
                break
            k = end
        return k

    @subkernel
    def one_by_one(data, at, stop, begin, clock, last_time, state, t, x, y, p):
        """Decode word after word, up to the byte `stop`. In a separate function the variables stay in registers.

        Returns:
            The number of events, the next byte, `begin`, `clock`, the last time, the largest x and y, and True if time
            never runs back.
        """
        n = np.int64(0)
        x_max = y_max = U(0)
        ordered = True
        waiting = waits and not state[STARTED]
        while at < stop:
            odd = is_odd(data, at)
            if clocked:
                raw = np.int64(t_of(data, at))
                if rule == WRAPS:
                    begin += PERIOD if clock >= PERIOD - NEAR and raw < NEAR else 0
                elif raw - clock < -PERIOD // 2:
                    begin += PERIOD
                elif clock >= 0 and begin > 0 and raw - clock > PERIOD // 2:
                    begin -= PERIOD
                clock = raw
            if odd or waiting:
                used, begin = others(data, at, begin, state)
                at += used
                waiting = waits and not state[STARTED]
                if used == 0:
                    break
                continue
            if least < size and at + size > data.size:
                break
            raw = t_of(data, at)
            now = begin + time_of(raw)
            column = x_of(data, at)
            row = y_of(data, at)
            polarity = p_of(data, at)
            place = np.uint64(n)  # unsigned, because each store would test the sign of a signed index
            t[place] = now
            x[place] = column
            y[place] = row
            p[place] = polarity
            x_max = max(x_max, U(column))
            y_max = max(y_max, U(row))
            ordered &= now >= last_time
            last_time = now
            if rule == GAPS:
                begin = now
            n += 1
            at += size
        return n, at, begin, clock, last_time, x_max, y_max, ordered

    def decode(data, state, t, x, y, p):
        """Decode bytes that begin with a word.

        Args:
            data: (n,) uint8.
            state: (STATES,) int64, updated.
            t: (n // size,) int64, output, as are the other columns.
            x: uint16.
            y: uint16.
            p: uint8.

        Returns:
            The number of events, the number of bytes used, the largest x and y, and True if time never runs back.
        """
        n = at = np.int64(0)
        x_max = y_max = U(0)
        ordered = True
        begin, clock, last_time = state[BEGIN], state[CLOCK], NEVER
        patience = 1  # number of groups to decode word by word, doubled at each block that does not begin with events
        clean = SURE  # number of blocks in a row with events only
        while at + least <= data.size and not state[STOPPED]:
            count = min(BLOCK, (data.size - at) // size)
            waiting = waits and not state[STARTED]
            lead = 0 if waiting else count if clean >= SURE else count_leading_events(data, at, count)
            end = n + lead
            if lead:
                column, row, rises, odd = run(data, at, begin, t[n:end], x[n:end], y[n:end], p[n:end])
                if odd:
                    clean = 0
                    continue
            clean = clean + 1 if lead == count else 0
            patience = 1 if lead else min(2 * patience, 32)
            stop = at + size * max(1, min(group * patience, count))
            if lead:
                first, last = t[n] - begin, t[end - 1] - begin
                if not clocked or (rises and first >= clock and (rule == WRAPS or last - clock <= PERIOD // 2)):
                    x_max = max(x_max, column)
                    y_max = max(y_max, row)
                    ordered &= rises and t[n] >= last_time
                    last_time = t[end - 1]
                    if clocked:
                        clock = last
                    if rule == GAPS:
                        begin = last_time
                    n = end
                    at += size * lead
                    stop = at + size * min(group, count - lead)
            stop = min(stop, data.size + 1 - least)
            count, at, begin, clock, last_time, column, row, rises = one_by_one(
                data, at, stop, begin, clock, last_time, state, t[n:], x[n:], y[n:], p[n:]
            )
            n += count
            x_max, y_max = max(x_max, column), max(y_max, row)
            ordered &= rises
            if least < size and at < stop:
                break
        state[BEGIN], state[CLOCK] = begin, clock
        return n, at, x_max, y_max, ordered

    decode.__name__ = "decode"
    return how(decode)


HEADER = 28
POLARITY, EVENT = 1, 8
"""Type of polarity events, and the size of one, bytes."""
SKIP, LEFT, CAMERA = range(STATES, STATES + 3)
"""Indices into the state, after those of a layout. `SKIP`: bytes to skip. `LEFT`: polarity events that remain in the
packet. `CAMERA`: the camera to read, -1 for all."""

_word_2 = word(2, False)


@subkernel
def number(data, at):
    """Return a little-endian signed 32-bit number."""
    return np.int64(np.int32(_word_4(data, at)))


@subkernel
def is_wrong(data, at):
    """Return whether the header of a packet is invalid, because a size, count or time is impossible."""
    size, offset = number(data, at + 4), number(data, at + 8)
    capacity, count, valid = number(data, at + 16), number(data, at + 20), number(data, at + 24)
    has_wrong_counts = size <= 0 or not 0 <= valid <= count <= capacity
    is_polarity = _word_2(data, at) == POLARITY
    return has_wrong_counts or not 0 <= offset < size or number(data, at + 12) < 0 or (is_polarity and size != EVENT)


@cache
def packet_decoder(layout):
    """Return a decoder of packets, with arguments as `decode`; `SECOND` counts events of other types or cameras."""
    decode = decoder(layout, subkernel)

    def decode_packets(data, state, t, x, y, p):
        n = at = np.int64(0)
        x_max = y_max = U(0)
        ordered = True
        while True:
            n_skipped = min(state[SKIP], data.size - at)
            at += n_skipped
            state[SKIP] -= n_skipped
            n_ready = min(state[LEFT], (data.size - at) // EVENT)
            if n_ready:
                end = at + n_ready * EVENT
                count, _, column, row, rises = decode(data[at:end], state, t[n:], x[n:], y[n:], p[n:])
                ordered &= rises and (n == 0 or count == 0 or t[n] >= t[n - 1])
                x_max, y_max = max(x_max, column), max(y_max, row)
                n += count
                at = end
                state[LEFT] -= n_ready
            if state[SKIP] or state[LEFT] or at + HEADER > data.size:
                break
            if is_wrong(data, at):
                state[STOPPED] = 1
                break
            count = number(data, at + 20)
            state[BEGIN] = number(data, at + 12) << 31
            is_other_camera = state[CAMERA] >= 0 and state[CAMERA] != _word_2(data, at + 2)
            if _word_2(data, at) != POLARITY or is_other_camera:
                state[SKIP] = count * number(data, at + 4)
                state[SECOND] += count
            else:
                state[LEFT] = count
            at += HEADER
        return n, at, x_max, y_max, ordered

    return kernel(decode_packets)


SILENCE, SILENCE_US = 0xFF, 127
"""Byte of Event Stream for silence, and the us that it adds."""


@kernel
def encode_event_stream(t, x, y, p, now, out):
    """Encode events as Event Stream.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        now: time of the event before the first one, us.
        out: uint8, output: 5 bytes per event, and one more byte for each full `SILENCE_US` between two events.
    """
    at = 0
    for k in range(t.size):
        gap = t[k] - now
        now = t[k]
        while gap >= SILENCE_US:
            out[at] = SILENCE
            gap -= SILENCE_US
            at += 1
        out[at] = gap << 1 | p[k]
        out[at + 1] = x[k] & 0xFF
        out[at + 2] = x[k] >> 8
        out[at + 3] = y[k] & 0xFF
        out[at + 4] = y[k] >> 8
        at += 5
