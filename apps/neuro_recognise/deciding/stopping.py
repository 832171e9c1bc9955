"""When to stop: recordings that were held out from training say how often a decision of this margin is wrong.

A session stops at the first moment at which the error of its margin (`Held.error`) is at or below a level; recordings
that never meet it are decided at their end. The level is the largest, so the soonest, for which it is assured that at
most the allowed share of all recordings is decided wrongly.

Held-out recordings are judged by the margins of the others, so no decision vouches for itself. Levels are tried
from the strictest on, and the first whose bound on the error exceeds what is allowed ends it: so trying many does not
weaken the assurance (fixed sequence testing: Angelopoulos et al., Learn then Test, arXiv 2110.01052, 2021).

All of this is of the mean over recordings drawn like those that were held out. It promises nothing of each class, so
with another mix of classes more may be wrong, at most as many as of the worst class (`Outcome.worst`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_recognise.deciding.held import Held
from neuro_recognise.shown import Floats, Ints

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
    _check_shares(allowed, assurance)
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
    found: Ints = np.where(met.any(axis=1), met.argmax(axis=1), met.shape[1] - 1)
    return found


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
        if upper_bound(_wrong(held, stopped(held.crossed, level)), len(held), assurance) > allowed:
            break
        assured = level
    return assured


def _wrong(held: Held, at: Ints) -> int:
    """How many are decided wrongly at these moments."""
    return int(np.count_nonzero(~held.right[np.arange(len(at)), at]))


def _share(wrong: npt.NDArray[np.bool_]) -> tuple[float, tuple[float, float]]:
    """Of wrong decisions, and its 95 % interval."""
    k, n = int(np.count_nonzero(wrong)), len(wrong)
    return k / n, (1.0 - upper_bound(n - k, n, 0.975), upper_bound(k, n, 0.975))


def _check_shares(allowed: float, assurance: float) -> None:
    if not 0 < allowed < 1:
        raise ModelError(f"allow = {allowed:g}: expected a share of recordings between 0 and 1")
    if not 0 < assurance < 1:
        raise ModelError(f"assurance = {assurance:g}: expected a probability between 0 and 1")
