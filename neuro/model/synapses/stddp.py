"""Delays that move arrivals to the post spike."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import DELAY, DelayRule, Trace


@dataclass(frozen=True, kw_only=True, eq=False)
class stddp(DelayRule):
    """Spike-timing-dependent delay plasticity: weights stay, and inputs that come together arrive together.

    Where a pre spike arrives before a post spike, its synapse gets a longer delay, where it arrives after it, a shorter
    one. A post spike pairs with the last pre spike that set out before it, a pre spike with the last post spike before.
    The window is A dt exp(-|dt|/tau) or, with `by_step`, one step of the network up to |dt| = tau.
    Source: Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32, which gives the direction; the windows are choices.
    """

    equation: ClassVar[str] = "d += A dt exp(-|dt|/tau), or a step, dt = t_post - (t_pre + d)"
    source: ClassVar[str] = "Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    post: ClassVar[tuple[Trace, ...]] = (Trace(""),)

    A: float = quantity(0.1, "", "share of dt by which a delay changes at most", above=0, at_most=1)
    tau: float = quantity(20.0, "ms", "time constant of the window; with by_step its end", above=0)
    by_step: bool = quantity(False, "", "change by one step, however far apart", kind="boolean")


D_MIN, D_MAX, A, TAU, BY_STEP, STEP = range(6)


def constants(p, h, c):
    """The parameters and the step."""
    c[:5] = p[:5]
    c[STEP] = h


def on_post(y, e, c, pre, post):
    """Move the last arrival, or the one to come, towards this post spike."""
    y[DELAY, e] = moved(y[DELAY, e], pre[0] - y[DELAY, e], c)


def on_pre(y, e, c, pre, post):
    """Move the arrival of this pre spike towards the last post spike, which is over."""
    y[DELAY, e] = moved(y[DELAY, e], -(post[0] + y[DELAY, e]), c)


def moved(delay, late, c):
    """A delay after a pair whose post spike comes `late` ms after the arrival."""
    apart = abs(late)
    if c[BY_STEP] != 0.0:
        change = math.copysign(min(c[STEP], apart), late) if apart <= c[TAU] else 0.0
    else:
        change = c[A] * late * math.exp(-apart / c[TAU]) if apart < math.inf else 0.0
    return min(c[D_MAX], max(c[D_MIN], delay + change))
