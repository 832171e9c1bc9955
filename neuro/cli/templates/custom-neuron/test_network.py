"""Run with python -m pytest. Then change network.yaml, and state here what must stay true."""

import numpy as np
from run import intervals


def test_spikes_come_slower_and_slower():
    between = intervals("cells")
    assert between[-1] > 1.5 * between[0]


def test_without_adaptation_they_are_regular():
    between = intervals("plain")
    assert np.ptp(between) < 0.15  # ms, one step
