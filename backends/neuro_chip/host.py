"""What the host does for the chip between trials: a rule on weights that the chip cannot change itself."""

# mypy: ignore-errors
from functools import cache

import numpy as np

from neuro.core.clock import NEVER
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import compiled, kernel, subkernel


@subkernel
def rounded(exact, low, high, grain, draw):
    """The mantissa below or above, so that the mean is exact; draw is uniform in [0, 1)."""
    # Rounded to nearest, lessons below half a grain would never move a weight; drawn, their mean is exact.
    floor = np.floor(exact / grain)
    mantissa = np.int64(floor + (draw < exact / grain - floor)) * grain
    return min(max(mantissa, low), high)


@kernel
def ages(first, begin, sources, delay, now, resolution, since):
    """For each source the ms from the arrival of its first spike to step `now`; -inf where it has not fired.

    `first` is of all neurons, `begin` where the sources' population begins there; `delay` is one, or one per source.
    """
    for k in range(sources.size):
        fired = first[begin + sources[k]]
        late = delay[k if delay.size > 1 else 0]
        since[k] = -np.inf if fired == NEVER else (now - fired - late) * resolution


@cache
def teacher(teach):
    """The pass over the inputs of one neuron, compiled for a rule's `teach`."""
    function = compiled(teach)

    @kernel
    def learn(mantissas, step, low, high, grain, slots, since, lesson, rule, key, count):
        """The rule for the inputs of one neuron.

        Args:
            mantissas: all weights, changed.
            step: weight per mantissa.
            low: the smallest mantissa.
            high: the largest.
            grain: the step between two.
            slots: which weight each input has.
            since: ms from the arrival of its spike to the moment of the lesson.
            lesson: what the rule is told.
            rule: constants of the rule.
            key: of the draws.
            count: how many changes there were, this one included; each has draws of its own.
        """
        # Keyed by how many lessons there were: the same draws however trials are cut into calls.
        base = step_word(key, count)
        for k in range(slots.size):
            w = function(mantissas[slots[k]] * step, since[k], lesson, rule)
            mantissas[slots[k]] = rounded(w / step, low, high, grain, uniform(base, slots[k]))

    return learn


@cache
def grower(encourage):
    """The pass over a range of weights, compiled for a rule's `encourage`."""
    function = compiled(encourage)

    @kernel
    def grow(mantissas, step, low, high, grain, begin, end, rule, key, count):
        """The rule for all weights from begin to end; arguments as of `teacher`."""
        base = step_word(key, count)
        for k in range(begin, end):
            w = function(mantissas[k] * step, rule)
            mantissas[k] = rounded(w / step, low, high, grain, uniform(base, k))

    return grow
