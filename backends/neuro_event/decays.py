"""What is left of a trace after some steps: read from tables, which hold the first steps."""

# mypy: ignore-errors
import math

from neuro.kernels.jit import merged

DECAYS = 2048
"""Steps for which decays are kept in tables."""


@merged
def decayed(table, steps, h, tau, k):
    """What is left after some steps of a trace that decays with tau[k]; `table` holds it for the first steps."""
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau[k])


@merged
def left(table, steps, h, tau):
    """Likewise of one time constant; where it is 0, nothing is ever left."""
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau) if tau > 0.0 else 0.0
