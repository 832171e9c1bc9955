"""What the host does for the chip between trials: a rule on weights that the chip cannot change itself."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import compiled, inner, kernel
from neuro.model.synapses import r_stdp

_reward = compiled(r_stdp.arithmetic.reward)
_encourage = compiled(r_stdp.arithmetic.encourage)


@inner
def rounded(exact, low, high, grain, draw):
    """The mantissa below or above, so that the mean is exact; draw is uniform in [0, 1)."""
    floor = np.floor(exact / grain)
    mantissa = np.int64(floor + (draw < exact / grain - floor)) * grain
    return min(max(mantissa, low), high)


@kernel
def reward(mantissas, step, low, high, grain, slots, early, won, rule, key, count):
    """The rule for the inputs of one neuron.

    Args:
        mantissas: all weights, changed.
        step: weight per mantissa.
        low: the smallest mantissa.
        high: the largest.
        grain: the step between two.
        slots: which weight each input has.
        early: whether its spike arrived up to the decision.
        won: whether the trial is rewarded.
        rule: constants of the rule.
        key: of the draws.
        count: how many changes there were, this one included; each has draws of its own.
    """
    base = step_word(key, count)
    for k in range(slots.size):
        w = _reward(mantissas[slots[k]] * step, early[k] != 0, won, rule)
        mantissas[slots[k]] = rounded(w / step, low, high, grain, uniform(base, slots[k]))


@kernel
def encourage(mantissas, step, low, high, grain, begin, end, rule, key, count):
    """The rule for all weights from begin to end; arguments as of `reward`."""
    base = step_word(key, count)
    for k in range(begin, end):
        w = _encourage(mantissas[k] * step, rule)
        mantissas[k] = rounded(w / step, low, high, grain, uniform(base, k))
