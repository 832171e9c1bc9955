"""Decisions while events arrive, and rules that stop early but limit the share of wrong decisions.

A session divides the stream into stretches and scores one stretch at a time. A stretch begins at its first event,
without memory of earlier events. A stretch ends after a window, after a pause without events, or when `end` is called.
The next event begins another stretch. The window therefore bounds memory and time even for an endless stream. Each
decision uses the same scores as `scores_at` computes for the events of its stretch.

The error of a decision is estimated from its margin (`Held.error`). A session stops at the first moment at which the
estimated error is at or below a level. A recording that never reaches the level is decided at its end. A larger level
stops earlier. The rule therefore uses the largest level for which the share of wrong decisions over all recordings is
assured to be at most the allowed share.

The error of a held-out recording is estimated from other held-out recordings only (cross-fitting). Levels are tested
from the strictest on. Testing ends at the first level whose bound on the error exceeds the allowed share. Testing many
levels in this order does not weaken the assurance (fixed sequence testing: Angelopoulos et al., Learn then Test, arXiv
2110.01052, 2021).

The bound holds for the mean over recordings drawn like the held-out ones, not for each class. With another mix of
classes the error may be larger, but not larger than the error of the worst class (`Outcome.worst`).

In the file of a recogniser:

```
/early/times_us   moments since the first event, us
/early/margins    (recordings, moments) margins of held-out recordings
/early/right      (recordings, moments) whether the decision was right
/early/labels     (recordings,) index of the true class; missing in older files
/early/learnt/0   learnt arrays and texts of the first moment, by name; /1 has those of the second moment, and so on;
                  missing if all moments use the training on whole recordings
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
"""Number of parts of the held-out recordings for cross-fitting. Errors of each tenth are estimated from the others."""


def margins(scores: Floats) -> Floats:
    """Return the difference between the largest and the second largest score of each row.

    The result is NaN for a row of NaN, and 0 with a single class. E.g. [0.2, 0.9, 0.6] gives 0.3.
    """
    if scores.shape[-1] < 2:
        return np.where(np.isnan(scores[..., 0]), np.nan, 0.0)
    silent = np.isnan(scores).all(axis=-1)
    ordered = np.sort(np.where(np.isnan(scores), -np.inf, scores), axis=-1)
    above: Floats = np.full(silent.shape, np.nan)
    np.subtract(ordered[..., -1], ordered[..., -2], out=above, where=~silent)
    return above


@dataclass(frozen=True, eq=False)
class Held:
    """Decisions on held-out recordings at each moment.

    Attributes:
        times_us: (moments,) times since the first event, us, ascending.
        margins: (recordings, moments) lead of the best class over the second (see `margins`); NaN without a decision.
        right: (recordings, moments) whether the decision was right.
        labels: (recordings,) index of the true class; None if unknown, as in older files.
    """

    times_us: Ints
    margins: Floats
    right: npt.NDArray[np.bool_]
    labels: Ints | None = None

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.right)

    def take(self, chosen: Ints | npt.NDArray[np.bool_]) -> Held:
        """Return the decisions on some of the recordings."""
        labels = None if self.labels is None else self.labels[chosen]
        return Held(self.times_us, self.margins[chosen], self.right[chosen], labels)

    def error(self, after_us: int, margin: float) -> float:
        """Estimate the probability that a decision with this margin is wrong.

        The estimate is from the held-out decisions at the last moment that is not after `after_us`.

        If w of n decisions with this margin or a larger one were wrong, the estimate is (w + 1) / (n + 2), Laplace's
        rule of succession: a single right decision (w = 0, n = 1) gives 1/3, not 0. The estimate never increases with
        the margin, because it is the minimum over all smaller margins.

        Returns:
            The probability; NaN before the first moment, and if there are no held-out decisions.
        """
        moment = int(np.searchsorted(self.times_us, after_us, "right")) - 1
        if moment < 0 or np.isnan(margin):
            return float("nan")
        margin_bounds, error = self._curves[moment]
        place = max(0, int(np.searchsorted(margin_bounds, margin, "right")) - 1)
        return float(error[place]) if error.size else float("nan")

    def errors(self, margins: Floats) -> Floats:
        """Compute `error` for many decisions.

        Args:
            margins: (recordings, moments) margins of these or of other recordings; NaN without a decision.

        Returns:
            (recordings, moments) estimated errors; NaN without a decision.
        """
        errors = np.full(margins.shape, np.nan)
        for moment, (margin_bounds, error) in enumerate(self._curves):
            rows = np.flatnonzero(~np.isnan(margins[:, moment]))
            place = np.searchsorted(margin_bounds, margins[rows, moment], "right") - 1
            if error.size:
                errors[rows, moment] = error[np.maximum(0, place)]
        return errors

    @cached_property
    def parts(self) -> list[tuple[Ints, Held]]:
        """Return a pair for each tenth of the recordings: their indices, and the decisions on the other nine tenths.

        Part k has the recordings k, k + 10, k + 20, ...
        """
        part = np.arange(len(self)) % PARTS
        return [(np.flatnonzero(part == k), self.take(part != k)) for k in range(min(PARTS, len(self)))]

    @cached_property
    def crossed(self) -> Floats:
        """(recordings, moments) `error` of each decision, estimated from the other parts only."""
        errors = np.full(self.margins.shape, np.nan)
        for rows, curve in self.parts:
            errors[rows] = curve.errors(self.margins[rows])
        return errors

    @cached_property
    def _curves(self) -> list[tuple[Floats, Floats]]:
        """A pair for each moment: the margins that occurred, ascending, and the error at or above each margin."""
        curves = []
        for margins, is_right in zip(self.margins.T, self.right.T, strict=True):
            decided = ~np.isnan(margins)
            from_margin, margin_index = np.unique(margins[decided], return_inverse=True)
            n_wrong = np.bincount(margin_index, ~is_right[decided], len(from_margin))
            number = np.bincount(margin_index, minlength=len(from_margin))
            error = (np.cumsum(n_wrong[::-1])[::-1] + 1) / (np.cumsum(number[::-1])[::-1] + 2)
            curves.append((from_margin, np.minimum.accumulate(error)))
        return curves


@dataclass(frozen=True, eq=False)
class Early:
    """Data for decisions while events arrive.

    Attributes:
        held: decisions on held-out recordings at each moment.
        learnt: result of the training for each moment; empty if all moments use the training on whole recordings.
    """

    held: Held
    learnt: tuple[Learnt, ...] = ()

    def at(self, after_us: int) -> Learnt | None:
        """Return the training result of the last moment up to `after_us`; None if moments have no separate trainings.

        Before the first moment, the result of the first moment is returned.
        """
        if not self.learnt:
            return None
        moment = int(np.searchsorted(self.held.times_us, after_us, "right")) - 1
        return self.learnt[max(0, moment)]

    def write(self, group: Any) -> None:
        """Write the data into an open HDF5 group."""
        group["times_us"], group["margins"], group["right"] = self.held.times_us, self.held.margins, self.held.right
        if self.held.labels is not None:
            group["labels"] = self.held.labels
        for moment, learnt in enumerate(self.learnt):
            for name, part in learnt.items():
                group[f"learnt/{moment}/{name}"] = part

    @classmethod
    def read(cls, group: Any) -> Early:
        """Read the data that `write` wrote."""
        labels = group["labels"][()] if "labels" in group else None
        held_out = Held(group["times_us"][()], group["margins"][()], group["right"][()], labels)
        several = group.get("learnt", {})
        learnt = tuple({name: part_of(data) for name, data in several[str(k)].items()} for k in range(len(several)))
        return cls(held_out, learnt)


def part_of(data: Any) -> Any:
    """Read an array or a text from an HDF5 data set."""
    return data.asstr()[()] if data.dtype.kind == "O" else data[()]


ASSURANCE = 0.9
"""Default assurance: one rule in ten may exceed the allowed error."""
ASSUMES = (
    "an allowed error holds for recordings drawn like those that 'early' learnt from, with the same mix of classes"
)
"""Assumption of the bound, printed with results."""
NEVER = -1.0
"""The strictest level; no error is below it, so every recording is decided at its end."""
LEVELS = 60
"""Number of levels that are tested, up to three times the allowed error. A level above the allowed error can still be
assured, because recordings often stop at an error below the level."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A stopping rule for an allowed error.

    Attributes:
        allowed: largest share of recordings that may be decided wrongly.
        assurance: probability, over draws of the held-out recordings, that the share of wrong decisions is not larger.
        level: a session stops as soon as its error (`Held.error`) is at or below this level.
    """

    allowed: float
    assurance: float
    level: float

    def met(self, error: float) -> bool:
        """Return whether to stop at a decision with this error; False for NaN."""
        return error <= self.level


@dataclass(frozen=True, slots=True)
class Outcome:
    """Errors and times of stopping rules, each tested on recordings that were not used to choose it.

    Attributes:
        error: share of wrong decisions.
        interval: 95 % interval of `error` (Clopper and Pearson).
        mean_ms: mean time of the decisions since the first event, ms.
        worst: index of the class with the largest share of wrong decisions; None if the classes are unknown.
        worst_error: share of wrong decisions in the worst class. With any mix of these classes `error` is at most this.
        worst_interval: 95 % interval of `worst_error`.
    """

    error: float
    interval: tuple[float, float]
    mean_ms: float
    worst: int | None = None
    worst_error: float = float("nan")
    worst_interval: tuple[float, float] = (0.0, 1.0)


def stopping_rule(held_out: Held, allowed: float, assurance: float = ASSURANCE) -> Rule:
    """Return the rule that stops earliest within an allowed error.

    Args:
        held_out: decisions on held-out recordings. Later recordings must be drawn from the same distribution.
        allowed: largest share of all recordings that may be decided wrongly.
        assurance: probability that the share is not larger than allowed. With 0.5 the share is larger as often as
            smaller.

    Raises:
        ModelError: an argument is not between 0 and 1, or the held-out recordings do not support the allowed error:
            there are too few, or too many are decided wrongly even at their end.
    """
    if not 0 < allowed < 1:
        raise ModelError(f"allow = {allowed:g}: expected a share of recordings between 0 and 1")
    if not 0 < assurance < 1:
        raise ModelError(f"assurance = {assurance:g}: expected a probability between 0 and 1")
    if (smallest := least_allowed(held_out, assurance)) > allowed:
        n_wrong, n = int(np.count_nonzero(~held_out.right[:, -1])), len(held_out)
        raise ModelError(
            f"allow = {allowed:g}: {n_wrong} of {n} held-out recordings are decided wrongly even at their end, "
            f"which supports {smallest:g} with an assurance of {assurance:g}",
            hint=f"allow at least {smallest:g}, let 'early' learn from more recordings, or ask for less assurance",
        )
    return Rule(allowed, assurance, _level(held_out, allowed, assurance))


def least_allowed(held_out: Held, assurance: float = ASSURANCE) -> float:
    """Return the smallest error that can be allowed.

    This is the bound on the error of decisions at the end of recordings, rounded up to thousandths.
    """
    bound = upper_bound(int(np.count_nonzero(~held_out.right[:, -1])), len(held_out), assurance)
    return float(np.ceil(1000.0 * bound) / 1000.0)


def outcome(held_out: Held, allowed: float, assurance: float = ASSURANCE) -> Outcome:
    """Test stopping rules by cross-fitting.

    The rule for each tenth of the recordings is chosen on the other nine tenths. If those nine tenths cannot
    support the allowed error, their rule decides every recording at its end.
    """
    moments = np.empty(len(held_out), np.int64)
    for rows, curve in held_out.parts:
        moments[rows] = stopped(curve.errors(held_out.margins[rows]), _level(curve, allowed, assurance))
    is_wrong = ~held_out.right[np.arange(len(moments)), moments]
    result = Outcome(*_share(is_wrong), float(held_out.times_us[moments].mean()) / 1000.0)
    if held_out.labels is None:
        return result
    error, worst = max(
        (float(is_wrong[held_out.labels == label].mean()), int(label)) for label in np.unique(held_out.labels)
    )
    return replace(result, worst=worst, worst_error=error, worst_interval=_share(is_wrong[held_out.labels == worst])[1])


def stopped(errors: Floats, level: float) -> Ints:
    """Return the index of the moment at which each recording is decided, (recordings,).

    This is the first moment with an error at or below the level, or else the last moment.

    Args:
        errors: (recordings, moments) `Held.error` of each decision.
        level: largest error at which a recording stops.
    """
    met = errors <= level
    return np.asarray(np.where(met.any(axis=1), met.argmax(axis=1), met.shape[1] - 1))


def upper_bound(wrong: int, n: int, assurance: float) -> float:
    """Return an upper confidence bound on the probability of a wrong decision.

    Args:
        wrong: number of wrong decisions.
        n: number of decisions.
        assurance: confidence level of the one-sided bound, e.g. 0.9. With 0 wrong of 100 the bound is then 0.023.

    Source: Clopper and Pearson, Biometrika 26:404, 1934.
    """
    from scipy.special import betaincinv

    return float(betaincinv(wrong + 1, n - wrong, assurance)) if wrong < n else 1.0


def _level(held_out: Held, allowed: float, assurance: float) -> float:
    """Return the largest level whose bound on the error is within the allowed share, by fixed sequence testing."""
    assured = NEVER
    for level in (NEVER, *np.linspace(0.0, 3.0 * allowed, LEVELS + 1).tolist()):
        moments = stopped(held_out.crossed, level)
        n_wrong = int(np.count_nonzero(~held_out.right[np.arange(len(moments)), moments]))
        if upper_bound(n_wrong, len(held_out), assurance) > allowed:
            break
        assured = level
    return assured


def _share(is_wrong: npt.NDArray[np.bool_]) -> tuple[float, tuple[float, float]]:
    """Return the share of wrong decisions and its 95 % interval."""
    k, n = int(np.count_nonzero(is_wrong)), len(is_wrong)
    return k / n, (1.0 - upper_bound(n - k, n, 0.975), upper_bound(k, n, 0.975))


WINDOW_MS = 1000.0
"""Longest stretch of a session, ms, for a recogniser without early decisions."""


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """A decision at one moment of a session.

    Attributes:
        at_us: time of the decision on the clock of the events, us. Events up to and including this time count.
        after_ms: time since the first event of the stretch, ms.
        label: index of the class, -1 without evidence for any class.
        scores: (classes,) score of each class.
        margin: difference between the largest and the second largest score, NaN without evidence.
        confidence: 1 - `Held.error`, the estimated probability that the decision is right; NaN without held-out
            decisions (see `learn_early`).
        settled: whether the allowed error was met at this or an earlier moment of the stretch; False without a rule.
    """

    at_us: int
    after_ms: float
    label: int
    scores: Floats
    margin: float
    confidence: float
    settled: bool


class Session:
    """Decides at regular intervals while events arrive; created by `Recogniser.session`.

    Args:
        observer: function that returns a new observer for each stretch.
        ask: function that returns the scores, (classes,). Its arguments are the time since the first event of the
            stretch, us, and the evidence.
        every_us: time between decisions, us, counted from the first event of a stretch.
        window_us: longest stretch, us.
        gap_us: longest pause between events of a stretch, us. A longer pause ends the stretch. None for no limit.
        held: decisions on held-out recordings, for `Decision.confidence`; None if unknown.
        rule: stopping rule, for `Decision.settled`; None for no rule.
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
        """Forget all events and the clock, so that another recording may follow."""
        self._clock: int | None = None
        self._forget()

    def _forget(self) -> None:
        """Forget all events, so that the next event begins a stretch."""
        self._begin: int | None = None
        self._last = 0
        self._next = self._every
        self._settled = False
        self._observer = self._make()

    def feed(self, events: Events, until_us: int | None = None) -> list[Decision]:
        """Process the next events of the stream.

        Args:
            events: events at or after the time of the previous ones; may be empty.
            until_us: time up to which no other events will follow, us. Moments up to this time are decided even without
                events. With None, only moments before the last event are decided, because more events may follow at
                the time of the last one.

        Returns:
            The decision at each moment that passed, in order. The decisions do not depend on how the stream is divided
            into parts.

        Raises:
            ModelError: time runs back, or the events do not fit the recogniser.
        """
        decided: list[Decision] = []
        part: object = events
        if not isinstance(part, Events):
            hint = "Events(t, x, y, p, (width, height)) of neuro.events takes arrays; p is 1 or 0"
            raise ModelError(f"feed: found {type(part).__name__}, expected Events", hint=hint)
        previous, first = self._clock, int(events.t[0]) if len(events) else until_us
        if previous is not None and first is not None and first < previous:
            raise ModelError(
                f"time runs back from {previous} to {first} us: expected the next part of the same stream",
                hint="reset() before another recording",
            )
        last = int(events.t[-1]) if len(events) else previous
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
        """End the stretch, and return its remaining decisions, the last one at its last event.

        The next event begins another stretch.
        """
        decided: list[Decision] = []
        if self._begin is not None:
            decided, length = self._pass(self._last), self._last - self._begin
            # Skip the last decision if `until_us` has already led to a decision after the last event.
            if self._next == self._every or length > self._next - self._every:
                decided.append(self._decide(length))
        self._forget()
        return decided

    def _end(self) -> int:
        """Return the time from which no event can belong to the current stretch, us."""
        assert self._begin is not None
        window_end = self._begin + self._window + 1
        return window_end if self._gap is None else min(window_end, self._last + self._gap + 1)

    def _take(self, events: Events) -> list[Decision]:
        """Observe events of the current stretch, and decide at the moments between them."""
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
        """Decide at all moments of the current stretch before `now_us`."""
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
        error = float("nan") if label == SILENT or self._held is None else self._held.error(after_us, margin)
        self._settled = self._settled or (self._rule is not None and self._rule.met(error))
        time_us = self._begin + after_us
        return Decision(time_us, after_us / 1000.0, label, scores, margin, 1.0 - error, self._settled)
