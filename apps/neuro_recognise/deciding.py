"""Decisions while events arrive, and when to stop, by how often decisions on held-out recordings were wrong.

A session looks at one stretch of the stream after the other. A stretch begins at its first event, with nothing known of
what was before. It ends after a window, after a pause without events, or when `end` is called; the next event begins
another. So an endless stream takes no more memory and time than its window, and a decision is that of `scores_at` for
the events of its stretch.

A session stops at the first moment at which the error of its margin (`Held.error`) is at or below a level; recordings
that never meet it are decided at their end. The level is the largest, so the soonest, for which it is assured that at
most the allowed share of all recordings is decided wrongly.

Held-out recordings are judged by the margins of the others, so no decision vouches for itself. Levels are tried
from the strictest on, and the first whose bound on the error exceeds what is allowed ends it: so trying many does not
weaken the assurance (fixed sequence testing: Angelopoulos et al., Learn then Test, arXiv 2110.01052, 2021).

All of this is of the mean over recordings drawn like those that were held out. It promises nothing of each class, so
with another mix of classes more may be wrong, at most as many as of the worst class (`Outcome.worst`).

In the file of a recogniser:

```
/early/times_us   moments since the first event, us
/early/margins    (recordings, moments) of held-out recordings
/early/right      (recordings, moments) whether the decision was right
/early/labels     (recordings,) index of the class of each; older files have none
/early/learnt/0   arrays and texts by name, of the first moment; and so on; none where all moments ask what was learnt
                  of whole recordings
```
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_events import Events
from neuro_recognise.method import SILENT, Learnt, Observer, choose
from neuro_recognise.shown import Evidence, Floats, Ints

PARTS = 10
"""Of held-out recordings, when each is judged by the others: tenths leave 90 % to learn from."""


def margins(scores: Floats) -> Floats:
    """How far the largest score of each row is above the second; NaN where all of a row are, 0 with one class."""
    if scores.shape[-1] < 2:
        return np.where(np.isnan(scores[..., 0]), np.nan, 0.0)
    silent = np.isnan(scores).all(axis=-1)
    ordered = np.sort(np.where(np.isnan(scores), -np.inf, scores), axis=-1)
    above: Floats = np.full(silent.shape, np.nan)
    np.subtract(ordered[..., -1], ordered[..., -2], out=above, where=~silent)
    return above


@dataclass(frozen=True, eq=False)
class Held:
    """What was decided of recordings that were held out from training.

    Attributes:
        times_us: (moments,) since the first event, ascending.
        margins: (recordings, moments), NaN where nothing was decided.
        right: (recordings, moments) whether the decision was right.
        labels: (recordings,) index of the class of each; None if not known, as in older files.
    """

    times_us: Ints
    margins: Floats
    right: npt.NDArray[np.bool_]
    labels: Ints | None = None

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.right)

    def take(self, chosen: Ints | npt.NDArray[np.bool_]) -> Held:
        """Some of the recordings."""
        labels = None if self.labels is None else self.labels[chosen]
        return Held(self.times_us, self.margins[chosen], self.right[chosen], labels)

    def error(self, after_us: int, margin: float) -> float:
        """How likely a decision of this margin is wrong, at the moment before a time.

        Of n decisions with this margin or a larger one, w of them wrong, it is (w + 1) / (n + 2), Laplace's rule of
        succession: one right decision does not make certain. A larger margin never has the larger error: the least of
        those of all smaller margins is taken.

        Returns:
            NaN before the first moment, and where nothing was held out.
        """
        moment = int(np.searchsorted(self.times_us, after_us, "right")) - 1
        if moment < 0 or np.isnan(margin):
            return float("nan")
        from_margin, error = self._curves[moment]
        place = max(0, int(np.searchsorted(from_margin, margin, "right")) - 1)
        return float(error[place]) if error.size else float("nan")

    def errors(self, margins: Floats) -> Floats:
        """`error` of many decisions.

        Args:
            margins: (recordings, moments) of these or of other recordings, NaN where nothing was decided.

        Returns:
            (recordings, moments), NaN where nothing was decided.
        """
        found = np.full(margins.shape, np.nan)
        for moment, (from_margin, error) in enumerate(self._curves):
            there = np.flatnonzero(~np.isnan(margins[:, moment]))
            place = np.searchsorted(from_margin, margins[there, moment], "right") - 1
            if error.size:
                found[there, moment] = error[np.maximum(0, place)]
        return found

    @cached_property
    def parts(self) -> list[tuple[Ints, Held]]:
        """Tenths of the recordings, each spread over all, and what was decided of the other nine."""
        part = np.arange(len(self)) % PARTS
        return [(np.flatnonzero(part == k), self.take(part != k)) for k in range(min(PARTS, len(self)))]

    @cached_property
    def crossed(self) -> Floats:
        """(recordings, moments) `error` of each decision, by the other parts alone."""
        found = np.full(self.margins.shape, np.nan)
        for own, others in self.parts:
            found[own] = others.errors(self.margins[own])
        return found

    @cached_property
    def _curves(self) -> list[tuple[Floats, Floats]]:
        """Of each moment margins, ascending, and the error from each on."""
        curves = []
        for margins, right in zip(self.margins.T, self.right.T, strict=True):
            there = ~np.isnan(margins)
            from_margin, which = np.unique(margins[there], return_inverse=True)
            wrong = np.bincount(which, ~right[there], len(from_margin))
            number = np.bincount(which, minlength=len(from_margin))
            error = (np.cumsum(wrong[::-1])[::-1] + 1) / (np.cumsum(number[::-1])[::-1] + 2)
            curves.append((from_margin, np.minimum.accumulate(error)))
        return curves


@dataclass(frozen=True, eq=False)
class Early:
    """What decisions while events arrive need.

    Attributes:
        held: what was decided of held-out recordings, moment by moment.
        learnt: at each of these moments, of beginnings so long; empty where they are not learnt apart.
    """

    held: Held
    learnt: tuple[Learnt, ...] = ()

    def at(self, after_us: int) -> Learnt | None:
        """What was learnt of beginnings so long: of the last moment before, or the first; None if not apart."""
        if not self.learnt:
            return None
        moment = int(np.searchsorted(self.held.times_us, after_us, "right")) - 1
        return self.learnt[max(0, moment)]

    def write(self, group: Any) -> None:
        """Put it into an open group of a file."""
        group["times_us"], group["margins"], group["right"] = self.held.times_us, self.held.margins, self.held.right
        if self.held.labels is not None:
            group["labels"] = self.held.labels
        for moment, learnt in enumerate(self.learnt):
            for name, part in learnt.items():
                group[f"learnt/{moment}/{name}"] = part

    @classmethod
    def read(cls, group: Any) -> Early:
        """What `write` put there."""
        labels = group["labels"][()] if "labels" in group else None
        held = Held(group["times_us"][()], group["margins"][()], group["right"][()], labels)
        several = group.get("learnt", {})
        learnt = tuple({name: part_of(data) for name, data in several[str(k)].items()} for k in range(len(several)))
        return cls(held, learnt)


def part_of(data: Any) -> Any:
    """An array or a text of a file."""
    return data.asstr()[()] if data.dtype.kind == "O" else data[()]


ASSURANCE = 0.9
"""By default one rule in ten may be wrong more often than allowed."""
ASSUMES = (
    "an allowed error holds for recordings drawn like those that 'early' learnt from, with the same mix of classes"
)
"""What the bound assumes, for people."""
NEVER = -1.0
"""The strictest level: all are decided at their end."""
LEVELS = 60
"""Levels that are tried, up to three times the allowed error: recordings that stop late are wrong less often than the
level says, since they were not stopped before."""


@dataclass(frozen=True, slots=True)
class Rule:
    """When to stop for an allowed error.

    Attributes:
        allowed: share of recordings that may be decided wrongly.
        assurance: probability that no larger share is, over all that might have been held out.
        level: error of a margin at a moment (`Held.error`) at or below which is stopped.
    """

    allowed: float
    assurance: float
    level: float

    def met(self, error: float) -> bool:
        """Whether to stop at a decision of this error; never at NaN."""
        return error <= self.level


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of rules, each tried on recordings that it was not chosen with.

    Attributes:
        error: share of wrong decisions.
        interval: its 95 % interval (Clopper and Pearson).
        mean_ms: when was decided.
        worst: index of the class of which most are wrong, as a share; None where classes are not known.
        worst_error: that share, the largest that another mix of the same classes can make of `error`.
        worst_interval: its 95 % interval.
    """

    error: float
    interval: tuple[float, float]
    mean_ms: float
    worst: int | None = None
    worst_error: float = float("nan")
    worst_interval: tuple[float, float] = (0.0, 1.0)


def stopping_rule(held: Held, allowed: float, assurance: float = ASSURANCE) -> Rule:
    """The rule that stops soonest within an allowed error.

    Args:
        held: what was decided of held-out recordings. Those to come have to be like them.
        allowed: share of all recordings that may be decided wrongly.
        assurance: probability with which no larger share is. 0.5 asks for the error to be what is allowed as likely
            below as above.

    Raises:
        ModelError: one is no share, or so few recordings cannot support what is allowed, or more are decided wrongly
            even at their end.
    """
    if not 0 < allowed < 1:
        raise ModelError(f"allow = {allowed:g}: expected a share of recordings between 0 and 1")
    if not 0 < assurance < 1:
        raise ModelError(f"assurance = {assurance:g}: expected a probability between 0 and 1")
    if (least := least_allowed(held, assurance)) > allowed:
        wrong, n = int(np.count_nonzero(~held.right[:, -1])), len(held)
        raise ModelError(
            f"allow = {allowed:g}: {wrong} of {n} held-out recordings are decided wrongly even at their end, "
            f"which supports {least:g} with an assurance of {assurance:g}",
            hint=f"allow at least {least:g}, let 'early' learn from more recordings, or ask for less assurance",
        )
    return Rule(allowed, assurance, _level(held, allowed, assurance))


def least_allowed(held: Held, assurance: float = ASSURANCE) -> float:
    """The smallest error that can be allowed: the bound on that of decisions at the end, in thousandths."""
    bound = upper_bound(int(np.count_nonzero(~held.right[:, -1])), len(held), assurance)
    return float(np.ceil(1000.0 * bound) / 1000.0)


def outcome(held: Held, allowed: float, assurance: float = ASSURANCE) -> Outcome:
    """What rules of nine tenths of the recordings do with the last, of each tenth.

    Where nine tenths cannot support what is allowed, they decide at the end.
    """
    at = np.empty(len(held), np.int64)
    for own, others in held.parts:
        at[own] = stopped(others.errors(held.margins[own]), _level(others, allowed, assurance))
    wrong = ~held.right[np.arange(len(at)), at]
    found = Outcome(*_share(wrong), float(held.times_us[at].mean()) / 1000.0)
    if held.labels is None:
        return found
    error, worst = max((float(wrong[held.labels == label].mean()), int(label)) for label in np.unique(held.labels))
    return replace(found, worst=worst, worst_error=error, worst_interval=_share(wrong[held.labels == worst])[1])


def stopped(errors: Floats, level: float) -> Ints:
    """(recordings,) the moment at which each is decided: the first that meets the level, else the last.

    Args:
        errors: (recordings, moments) `Held.error` of each decision.
        level: at or below which is stopped.
    """
    met = errors <= level
    return np.asarray(np.where(met.any(axis=1), met.argmax(axis=1), met.shape[1] - 1))


def upper_bound(wrong: int, n: int, assurance: float) -> float:
    """The largest probability of being wrong that so few wrong among n do not contradict.

    Args:
        wrong: decisions.
        n: decisions.
        assurance: share of draws of n in which the bound lies above the probability, at least.

    Source: Clopper and Pearson, Biometrika 26:404, 1934.
    """
    from scipy.special import betaincinv

    return float(betaincinv(wrong + 1, n - wrong, assurance)) if wrong < n else 1.0


def _level(held: Held, allowed: float, assurance: float) -> float:
    """The largest of the levels before the first that is not assured."""
    assured = NEVER
    for level in (NEVER, *np.linspace(0.0, 3.0 * allowed, LEVELS + 1).tolist()):
        at = stopped(held.crossed, level)
        wrong = int(np.count_nonzero(~held.right[np.arange(len(at)), at]))
        if upper_bound(wrong, len(held), assurance) > allowed:
            break
        assured = level
    return assured


def _share(wrong: npt.NDArray[np.bool_]) -> tuple[float, tuple[float, float]]:
    """Of wrong decisions, and its 95 % interval."""
    k, n = int(np.count_nonzero(wrong)), len(wrong)
    return k / n, (1.0 - upper_bound(n - k, n, 0.975), upper_bound(k, n, 0.975))


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
        part: object = events
        if not isinstance(part, Events):
            hint = "Events(t, x, y, p, (width, height)) of neuro.events takes arrays; p is 1 or 0"
            raise ModelError(f"feed: found {type(part).__name__}, expected Events", hint=hint)
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
        while len(events):
            if self._begin is None:
                self._begin = self._last = int(events.t[0])
            stop = int(np.searchsorted(events.t, self._begin + self._window, "right"))
            if self._gap is not None:
                pauses = np.flatnonzero(np.diff(events.t[:stop], prepend=self._last) > self._gap)
                stop = int(pauses[0]) if pauses.size else stop
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

    def _end(self) -> int:
        """From when on no event belongs to the stretch under way, us."""
        assert self._begin is not None
        whole = self._begin + self._window + 1
        return whole if self._gap is None else min(whole, self._last + self._gap + 1)

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
