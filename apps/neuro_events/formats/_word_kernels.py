# mypy: ignore-errors
"""The decoder of all layouts of `_words`, with the packets of AEDAT 3.1, and the encoder of Event Stream."""

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
"""Words that are decoded together where all are events, as most are."""
SURE = 8
"""Such blocks in a row after which the next one is decoded before it is looked at."""
NEAR = PERIOD // 16
NEVER = np.iinfo(np.int64).min
"""us; before any time."""


@cache
def word(size, is_big):
    """Return the function (bytes, place) -> number in the words of a size in bytes and an order."""
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
    """Return the function (bytes, place of an event) -> value of a field."""
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
    """Return the function (bytes, place) -> number that is 0 where an event begins."""
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
    """A new TIME_HIGH of EVT 2.0: the time of events whose low bits are 0."""
    if state[SECOND] >= (1 << 28) - NEAR_HIGH and value < NEAR_HIGH:
        state[ADDED] += 1 << T_BITS
    state[STARTED] = 1
    state[SECOND] = value
    return state[ADDED] + (value << 6)


def _counting(layout):
    """Return the rule of words that are counted, or end the data."""
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
"""Rules of words that are no events: (bytes, place, us to add, state) -> bytes of the word, us to add from there on."""


@inlined
def _signed(raw):
    return np.int64(np.int32(raw))


@inlined
def _unsigned(raw):
    return np.int64(raw)


@cache
def decoder(layout, how=kernel):
    """Return the decoder of a layout: see `decode` in it.

    Args:
        layout: a `Layout`.
        how: `kernel`, or `subkernel` for one that kernels call.
    """
    x_of, y_of, p_of, t_of = (field(getattr(layout, name), layout.is_big) for name in "xypt")
    is_odd, others = oddity(layout), inlined(_OTHERS.get(layout.others) or _counting(layout))
    size, rule, least = layout.size, layout.rule, layout.least or layout.size
    group, clocked, waits = layout.group, rule in (WRAPS, HALF), layout.waits
    time_of = _signed if layout.is_signed else _unsigned
    sign = U(1 << 31 if layout.is_signed else 0)

    @subkernel
    def run(data, at, begin, t, x, y, p):
        """Decode words as events, without a branch, so that the compiler makes vector instructions of it.

        Returns the largest x and y, whether time does not run back, and 0 where all words are events.
        """
        x_max = y_max = fell = last = U(0)
        odd = is_odd(data, at) & 0
        for k in range(t.size):
            here = at + size * k
            raw = t_of(data, here)
            column = x_of(data, here)
            row = y_of(data, here)
            odd |= is_odd(data, here)
            t[k] = now = begin + time_of(raw)
            x[k] = column
            y[k] = row
            p[k] = p_of(data, here)
            if rule == GAPS:
                begin = now
            x_max = max(x_max, U(column))
            y_max = max(y_max, U(row))
            rank = raw ^ sign  # in the order of signed times
            fell |= U(rank < last)
            last = rank
        return x_max, y_max, rule == GAPS or fell == 0, odd

    @subkernel
    def leading(data, at, count):
        """Count the events of the groups before the first word that is none."""
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
    def each(data, at, stop, begin, clock, before, state, t, x, y, p):
        """Decode words one by one, up to the byte `stop`: a function of its own, so that registers hold its variables.

        Returns the number of events, the next byte, begin, clock, the last time, largest x and y, whether time does not
        run back.
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
            place = np.uint64(n)  # of a signed index each store would test the sign
            t[place] = now
            x[place] = column
            y[place] = row
            p[place] = polarity
            x_max = max(x_max, U(column))
            y_max = max(y_max, U(row))
            ordered &= now >= before
            before = now
            if rule == GAPS:
                begin = now
            n += 1
            at += size
        return n, at, begin, clock, before, x_max, y_max, ordered

    def decode(data, state, t, x, y, p):
        """Decode bytes that begin with a word.

        Args:
            data: (n,) uint8.
            state: (STATES,) int64, changed.
            t: (one for each `size` bytes,) int64, filled, as are the others.
            x: uint16.
            y: uint16.
            p: uint8.

        Returns:
            number of events and of bytes used, largest x and y, whether time does not run back.
        """
        n = at = np.int64(0)
        x_max = y_max = U(0)
        ordered = True
        begin, clock, before = state[BEGIN], state[CLOCK], NEVER
        patience = 1
        clean = SURE  # blocks before that were all events
        while at + least <= data.size and not state[STOPPED]:
            count = min(BLOCK, (data.size - at) // size)
            waiting = waits and not state[STARTED]
            lead = 0 if waiting else count if clean >= SURE else leading(data, at, count)
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
                    ordered &= rises and t[n] >= before
                    before = t[end - 1]
                    if clocked:
                        clock = last
                    if rule == GAPS:
                        begin = before
                    n = end
                    at += size * lead
                    stop = at + size * min(group, count - lead)
            stop = min(stop, data.size + 1 - least)
            count, at, begin, clock, before, column, row, rises = each(
                data, at, stop, begin, clock, before, state, t[n:], x[n:], y[n:], p[n:]
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
"""The type of polarity events, and bytes of one."""
SKIP, LEFT, CAMERA = range(STATES, STATES + 3)
"""State after that of a layout: bytes to skip, polarity events that the packet still has, the camera or -1 for all."""

_word_2 = word(2, False)


@subkernel
def number(data, at):
    """A little-endian signed 32-bit number."""
    return np.int64(np.int32(_word_4(data, at)))


@subkernel
def is_wrong(data, at):
    """Whether these are not the sizes of a packet: events, their bytes and their times have none below zero."""
    size, offset = number(data, at + 4), number(data, at + 8)
    capacity, count, valid = number(data, at + 16), number(data, at + 20), number(data, at + 24)
    counts = size <= 0 or not 0 <= valid <= count <= capacity
    polarity = _word_2(data, at) == POLARITY
    return counts or not 0 <= offset < size or number(data, at + 12) < 0 or (polarity and size != EVENT)


@cache
def packet_decoder(layout):
    """Return the decoder of packets, as `decoder` does; `SECOND` counts events of other kinds or cameras."""
    decode = decoder(layout, subkernel)

    def decode_packets(data, state, t, x, y, p):
        n = at = np.int64(0)
        x_max = y_max = U(0)
        ordered = True
        while True:
            skipped = min(state[SKIP], data.size - at)
            at += skipped
            state[SKIP] -= skipped
            here = min(state[LEFT], (data.size - at) // EVENT)
            if here:
                end = at + here * EVENT
                count, _, column, row, rises = decode(data[at:end], state, t[n:], x[n:], y[n:], p[n:])
                ordered &= rises and (n == 0 or count == 0 or t[n] >= t[n - 1])
                x_max, y_max = max(x_max, column), max(y_max, row)
                n += count
                at = end
                state[LEFT] -= here
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
"""A byte of Event Stream, and us that it adds."""


@kernel
def encode_event_stream(t, x, y, p, now, out):
    """Encode events.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        now: us, time of the event before.
        out: (5 n and one for each whole `SILENCE_US` between events,) uint8, filled.
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
