"""When to stop: recordings that were held out from training say how often a decision of this margin was wrong.

At each moment the error of all held-out decisions with at least a margin bounds the error of stopping at that margin.
A session stops at the first moment at which this bound is below a level. The level is the one with which the held-out
recordings are decided soonest while at most the allowed share of all of them is decided wrongly, those that never meet
it and are decided at their end included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_recognise.shown import Floats, Ints

__all__ = ["Held", "Rule", "margins", "stopped", "stopping_rule"]

LEVELS = 60
"""Levels that are tried, up to three times the allowed error: those who stop late are wrong less often than the level
says, since they were not stopped before."""


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
    """

    times_us: Ints
    margins: Floats
    right: npt.NDArray[np.bool_]

    def error(self, after_us: int, margin: float) -> float:
        """Share of wrong decisions among those with this margin or a larger one, at the moment before a time.

        A larger margin never has the larger share: the least of those of all smaller margins is taken.

        Returns:
            NaN before the first moment, and where nothing was held out.
        """
        moment = int(np.searchsorted(self.times_us, after_us, "right")) - 1
        if moment < 0 or np.isnan(margin):
            return float("nan")
        from_margin, share = self._curves[moment]
        place = max(0, int(np.searchsorted(from_margin, margin, "right")) - 1)
        return float(share[place]) if share.size else float("nan")

    def errors(self, margins: Floats) -> Floats:
        """`error` of many decisions.

        Args:
            margins: (recordings, moments) of these or of other recordings, NaN where nothing was decided.

        Returns:
            (recordings, moments), NaN where nothing was decided.
        """
        found = np.full(margins.shape, np.nan)
        for moment, (from_margin, share) in enumerate(self._curves):
            there = np.flatnonzero(~np.isnan(margins[:, moment]))
            place = np.searchsorted(from_margin, margins[there, moment], "right") - 1
            if share.size:
                found[there, moment] = share[np.maximum(0, place)]
        return found

    @cached_property
    def _curves(self) -> list[tuple[Floats, Floats]]:
        """Of each moment margins, ascending, and the error from each on."""
        return [self._curve(moment) for moment in range(len(self.times_us))]

    def _curve(self, moment: int) -> tuple[Floats, Floats]:
        there = ~np.isnan(self.margins[:, moment])
        from_margin, which = np.unique(self.margins[there, moment], return_inverse=True)
        wrong = np.bincount(which, ~self.right[there, moment], len(from_margin))
        number = np.bincount(which, minlength=len(from_margin))
        share = np.cumsum(wrong[::-1])[::-1] / np.cumsum(number[::-1])[::-1]
        return from_margin, np.minimum.accumulate(share)


@dataclass(frozen=True, slots=True)
class Rule:
    """When to stop for an allowed error.

    Attributes:
        allowed: share of recordings that may be decided wrongly.
        level: error of a margin at a moment (`Held.error`) at or below which is stopped.
        error: share of the held-out recordings that were decided wrongly with it.
        mean_ms: when they were decided.
    """

    allowed: float
    level: float
    error: float
    mean_ms: float

    def met(self, error: float) -> bool:
        """Whether to stop at a decision of this error; never at NaN."""
        return error <= self.level


def stopping_rule(held: Held, allowed: float) -> Rule:
    """The rule that stops soonest within an allowed error.

    Args:
        held: what was decided of held-out recordings.
        allowed: share of all recordings that may be decided wrongly.

    Raises:
        ModelError: it is no share, or more of the held-out recordings are decided wrongly even at their end.
    """
    if not 0 < allowed < 1:
        raise ModelError(f"allow = {allowed:g}: expected a share of recordings between 0 and 1")
    at_end = 1.0 - float(held.right[:, -1].mean())
    if at_end > allowed:
        raise ModelError(
            f"allow = {allowed:g}: {at_end:.1%} of the {len(held.right)} held-out recordings are decided wrongly even "
            "at their end",
            hint=f"allow at least {np.ceil(1000 * at_end) / 1000:g}",
        )
    errors = held.errors(held.margins)
    tried = [_tried(held, errors, allowed, level) for level in np.linspace(0.0, 3.0 * allowed, LEVELS + 1)]
    fitting = [rule for rule in tried if rule.error <= allowed]
    return min(fitting, key=lambda rule: rule.mean_ms, default=_tried(held, errors, allowed, -1.0))


def stopped(errors: Floats, level: float) -> Ints:
    """(recordings,) the moment at which each is decided: the first that meets the level, else the last.

    Args:
        errors: (recordings, moments) `Held.error` of each decision.
        level: at or below which is stopped.
    """
    met = errors <= level
    found: Ints = np.where(met.any(axis=1), met.argmax(axis=1), met.shape[1] - 1)
    return found


def _tried(held: Held, errors: Floats, allowed: float, level: float) -> Rule:
    at = stopped(errors, level)
    error = 1.0 - float(held.right[np.arange(len(at)), at].mean())
    return Rule(allowed, float(level), error, float(held.times_us[at].mean()) / 1000.0)
