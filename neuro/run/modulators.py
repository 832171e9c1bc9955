"""What modulates learning: how reward differs from what was expected, as numbers for `sim.signal`."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from neuro.coding.arguments import finite, number, positive
from neuro.core.errors import ModelError


def reward_error(reward: ArrayLike, baseline: ArrayLike, rate: float) -> tuple[Any, Any]:
    """Reward less its baseline, and the baseline after it, a running mean: (R - b, b + rate (R - b)).

    Args:
        reward: R, a number or an array, in any unit.
        baseline: b so far; 0 before the first reward.
        rate: share of the error by which the baseline follows, 0 to 1; 0 keeps it.

    Raises:
        ModelError: something is not finite, or the rate is out of its bounds.

    Source: R - b of the thesis' eq. 116; Williams, Mach. Learn. 8:229, 1992 (REINFORCE).
    """
    follows = _share(rate, "rate")
    expected = finite(baseline, "baseline")
    error = finite(reward, "reward") - expected
    return error[()], (expected + follows * error)[()]


def td_error(reward: ArrayLike, value: ArrayLike, next_value: ArrayLike, discount: float) -> Any:
    """The temporal-difference error of one step: reward + discount x next_value - value.

    Args:
        reward: got in the step.
        value: what the critic expected of the state before it.
        next_value: what it expects of the state after it; 0 where an episode ends.
        discount: worth of a reward one step later, 0 to 1.

    Raises:
        ModelError: something is not finite, or the discount is out of its bounds.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., eq. 6.5.
    """
    worth = _share(discount, "discount")
    return (finite(reward, "reward") + worth * finite(next_value, "next_value") - finite(value, "value"))[()]


def td_error_rate(reward: ArrayLike, value: ArrayLike, slope: ArrayLike, tau_r: float) -> Any:
    """The temporal-difference error in continuous time: V' - V / tau_r + r.

    Args:
        reward: r, reward per ms.
        value: V, what the critic expects.
        slope: V', change of it per ms.
        tau_r: time in ms over which rewards are discounted.

    Returns:
        The error per ms.

    Raises:
        ModelError: something is not finite, or tau_r is not above 0.

    Source: Doya, Neural Comput. 12:219, 2000; Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013.
    """
    lost = finite(value, "value") / positive(tau_r, "tau_r")
    return (finite(slope, "slope") - lost + finite(reward, "reward"))[()]


def _share(value: float, name: str) -> float:
    """A number from 0 to 1."""
    if not 0.0 <= number(value, name) <= 1.0:
        raise ModelError(f"{name} is {value}, expected 0 to 1", path=(name,))
    return float(value)
