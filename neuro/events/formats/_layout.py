"""Layouts of words as data, which one decoder and one encoder interpret."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events

PERIOD = 1 << 32
"""us; times of a clock of 32 bits."""


class Field(NamedTuple):
    """Some bits of a word.

    Example: the columns of a DAVIS346, which are counted from the right, are ``Field(12, 10, backwards=346)``: an
    address of 245 << 12 is column 100.

    Attributes:
        shift: its lowest bit.
        bits: number of bits.
        byte: where in the event the word begins.
        size: bytes of the word: 1, 2, 4 or 8.
        backwards: number of values where they are counted from the last one, else 0.
    """

    shift: int
    bits: int
    byte: int = 0
    size: int = 4
    backwards: int = 0


class Odd(NamedTuple):
    """Words that are no events: those whose bits of `mask` are `value`, or differ from it.

    Attributes:
        mask: bits of the word.
        value: what they are compared with.
        differs: whether words that differ are no events, rather than those that are equal.
        byte: where the word begins.
        size: bytes of the word.
    """

    mask: int = 0
    value: int = 0
    differs: bool = True
    byte: int = 0
    size: int = 4


WRAPS, HALF, GAPS = 1, 2, 3
"""Rules of time. Without one, the field is added to what other words say (`BEGIN`). `WRAPS`: a clock of 32 bits begins
again where it falls from the last sixteenth of its range to the first. `HALF`: it does so where it falls by more than
half its range, and returns where it rises by as much. `GAPS`: the field is the time since the event before."""


class Layout(NamedTuple):
    """How the bytes of an event are laid out.

    Attributes:
        size: bytes of an event.
        t: time, us.
        x: column, px.
        y: row, px.
        p: polarity, 1 = ON.
        odd: words that are no events; without a mask there are none.
        others: name of the rule for those words in `_word_kernels`; "" counts them.
        none: bits of the odd word that no word of the layout has: the data end before one that does.
        first: bits of the odd word of those that are counted as `OTHER`, the rest as `SECOND`; -1: all are.
        rule: of time; 0, `WRAPS`, `HALF` or `GAPS`.
        is_big: whether the highest byte of a word comes first.
        is_signed: whether the time may be below 0.
        waits: whether events before the first word that tells the time are left out.
        least: bytes of the shortest thing that is no event; 0: those of an event.
        group: words of which one that is no event makes the decoder look at each.
    """

    size: int
    t: Field
    x: Field
    y: Field
    p: Field
    odd: Odd = Odd()
    others: str = ""
    none: int = 0
    first: int = -1
    rule: int = 0
    is_big: bool = False
    is_signed: bool = False
    waits: bool = False
    least: int = 0
    group: int = 32


OTHER, STARTED, STOPPED, BEGIN, CLOCK, SECOND, ADDED, STATES = range(8)
"""State of a decoder: words left out; whether a word told the time; whether the bytes that follow are none of the
layout; us to add to the times of events; the last time of a clock, -1 before the first. By the format: words of a
second kind that were left out, or the last TIME_HIGH; us that the wraps of TIME_HIGH add."""


def encoded(layout: Layout, events: Events) -> npt.NDArray[np.uint8]:
    """Return the bytes (n, size) of events for which the layout has room; of times the upper bits are left out."""
    out = np.empty((len(events), layout.size), np.uint8)
    words: dict[tuple[int, int], Any] = {}
    for name in "txyp":
        field: Field = getattr(layout, name)
        if not field.bits:
            continue
        kind = np.dtype(f"u{field.size}").type
        values = getattr(events, name)
        if field.backwards:
            values = kind(field.backwards - 1) - values.astype(kind)
        if name == "t" and field.bits < 8 * field.size:
            values = values.astype(kind) & kind((1 << field.bits) - 1)
        if field.shift:
            values = values.astype(kind, copy=False) << kind(field.shift)
        place = field.byte, field.size
        words[place] = words[place] | values if place in words else values
    for (byte, size), values in words.items():
        order = ">" if layout.is_big else "<"
        word = np.dtype({"names": ["w"], "formats": [f"{order}u{size}"], "offsets": [byte], "itemsize": layout.size})
        out.view(word)["w"][:, 0] = values
    return out


def first_state(more: int = 0) -> npt.NDArray[np.int64]:
    """The state of a decoder before any word, with room for so many more numbers."""
    state = np.zeros(STATES + more, np.int64)
    state[CLOCK] = -1
    return state
