"""Decisions while events arrive: parts of a stream go in, and what is decided at each moment that passed comes out.

A session looks at one stretch of the stream after the other. A stretch begins at its first event, with nothing known of
what was before. It ends after a window, after a pause without events, or when `end` is called; the next event begins
another. So an endless stream takes no more memory and time than its window, and a decision is that of `scores_at` for
the events of its stretch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from neuro import ModelError
from neuro.events import Events
from neuro_recognise.deciding.held import Held, margins
from neuro_recognise.deciding.stopping import Rule
from neuro_recognise.method import SILENT, Observer, choose
from neuro_recognise.shown import Evidence, Floats

WINDOW_MS = 1000.0
"""How long a stretch is where nothing says how long recordings are."""


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """What is decided at a moment.

    Attributes:
        at_us: the moment, in the time of the events; all events up to it and of its very time count.
        after_ms: since the first event of the stretch.
        label: index of the class, -1 where nothing speaks for any.
        scores: (classes,) what speaks for each.
        margin: how far the largest score is above the second, NaN where nothing speaks for any.
        confidence: share of held-out recordings that were decided rightly among those with such a margin or a larger
            one at this moment; NaN where none were kept (see `learn_early`).
        settled: whether the allowed error was met at this moment or one before of the stretch; False without one.
    """

    at_us: int
    after_ms: float
    label: int
    scores: Floats
    margin: float
    confidence: float
    settled: bool


class Session:
    """Decides every few ms; made by `Recogniser.session`.

    Args:
        observer: gives what sees a stretch grow.
        ask: gives the scores, (classes,), for the evidence of a time after the first event of a stretch, us.
        every_us: from moment to moment, from the first event of a stretch on.
        window_us: the longest stretch.
        gap_us: a pause without events that ends a stretch; None for none.
        held: how good held-out decisions were; None where that is not known.
        rule: says when the allowed error is met; None where it is not asked.
    """

    def __init__(
        self,
        observer: Callable[[], Observer],
        ask: Callable[[int, Evidence], Floats],
        every_us: int,
        window_us: int,
        gap_us: int | None = None,
        held: Held | None = None,
        rule: Rule | None = None,
    ) -> None:
        self._make, self._ask, self._held, self._rule = observer, ask, held, rule
        self._every, self._window, self._gap = every_us, window_us, gap_us
        self.reset()

    def reset(self) -> None:
        """Forget all events and the time: the next event, of this stream or another recording, begins a stretch."""
        self._clock: int | None = None
        self._forget()

    def _forget(self) -> None:
        """Forget all events: the next one begins a stretch."""
        self._begin: int | None = None
        self._last = 0
        self._next = self._every
        self._settled = False
        self._observer = self._make()

    def feed(self, events: Events, until_us: int | None = None) -> list[Decision]:
        """Take in the next events of the stream.

        Args:
            events: not before those of the part before; may be none.
            until_us: time up to which this is all, us, for moments that pass without events; None: up to the last
                event, whose own time may go on in the next part.

        Returns:
            What was decided at each moment that passed, in order; the same for the stream, however it is cut.

        Raises:
            ModelError: time runs back, or the events do not fit the recogniser.
        """
        decided: list[Decision] = []
        _check_events(events)
        self._check_clock(events, until_us)
        while len(events):
            if self._begin is None:
                self._begin = self._last = int(events.t[0])
            stop = self._stretch(events)
            decided += self._take(events[:stop])
            events = events[stop:]
            if len(events):
                decided += self._pass(self._end())
                self._forget()
        if until_us is not None:
            decided += self._pass(until_us + 1)
            if self._begin is not None and until_us >= self._end():
                self._forget()
        return decided

    def end(self) -> list[Decision]:
        """Say that no more events come: what is decided of the stretch under way at its last event.

        The next event begins another stretch.
        """
        decided: list[Decision] = []
        if self._begin is not None:
            decided, length = self._pass(self._last), self._last - self._begin
            if self._next == self._every or length > self._next - self._every:  # not where the clock went beyond it
                decided.append(self._decide(length))
        self._forget()
        return decided

    def _check_clock(self, events: Events, until_us: int | None) -> None:
        before, first = self._clock, int(events.t[0]) if len(events) else until_us
        if before is not None and first is not None and first < before:
            raise ModelError(
                f"time runs back from {before} to {first} us: expected the next part of the same stream",
                hint="reset() before another recording",
            )
        last = int(events.t[-1]) if len(events) else before
        if until_us is not None and last is not None and until_us < last:
            raise ModelError(f"until_us is {until_us} us, expected at least {last}, the time of the last event")
        self._clock = until_us if until_us is not None else last

    def _end(self) -> int:
        """From when on no event belongs to the stretch under way, us."""
        assert self._begin is not None
        whole = self._begin + self._window + 1
        return whole if self._gap is None else min(whole, self._last + self._gap + 1)

    def _stretch(self, events: Events) -> int:
        """How many of the next events belong to the stretch under way."""
        assert self._begin is not None
        stop = int(np.searchsorted(events.t, self._begin + self._window, "right"))
        if self._gap is not None:
            pauses = np.flatnonzero(np.diff(events.t[:stop], prepend=self._last) > self._gap)
            stop = int(pauses[0]) if pauses.size else stop
        return stop

    def _take(self, events: Events) -> list[Decision]:
        """See events of the stretch under way, and decide at the moments between them."""
        assert self._begin is not None
        decided: list[Decision] = []
        while len(events):
            stop = int(np.searchsorted(events.t, self._begin + self._next, "right"))
            if stop:
                self._observer.add(events[:stop])
                self._last = int(events.t[stop - 1])
            events = events[stop:]
            if len(events):
                decided += self._pass(int(events.t[0]))
        return decided

    def _pass(self, now_us: int) -> list[Decision]:
        """Decide at the moments of the stretch that lie before a time."""
        if self._begin is None:
            return []
        decided: list[Decision] = []
        while self._begin + self._next < min(now_us, self._end()):
            decided.append(self._decide(self._next))
            self._next += self._every
        return decided

    def _decide(self, after_us: int) -> Decision:
        assert self._begin is not None
        scores = self._ask(after_us, self._observer.evidence())
        label, margin = int(choose(scores[None])[0]), float(margins(scores))
        wrong = float("nan") if label == SILENT or self._held is None else self._held.error(after_us, margin)
        self._settled = self._settled or (self._rule is not None and self._rule.met(wrong))
        when = self._begin + after_us
        return Decision(when, after_us / 1000.0, label, scores, margin, 1.0 - wrong, self._settled)


def _check_events(given: object) -> None:
    if not isinstance(given, Events):
        hint = "Events(t, x, y, p, (width, height)) of neuro.events takes arrays; p is 1 or 0"
        raise ModelError(f"feed: found {type(given).__name__}, expected Events", hint=hint)
