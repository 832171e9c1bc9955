"""Random networks without anything to round: all backends give the same spikes, potentials and counts."""

import warnings

import pytest
from hypothesis import HealthCheck, given, reject, settings, strategies as st

import neuro
from neuro.model.network import Network
from neuro.program.backend import OverflowWarning
from neuro.run.compiled import ApproximationWarning
from neuro.testing import Found, observe
from neuro.testing.case import differences
from neuro.testing.strategies import exact_networks

STEPS = 150
SETTINGS = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def outcome(net: Network, backend: str, seed: int, cuts: list[int]) -> Found:
    """Run in pieces; where a register overflows no chip can equal the reference."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ApproximationWarning)
        warnings.simplefilter("error", OverflowWarning)
        sim = neuro.compile(net, backend, seed=seed)
        done = 0
        for stop in sorted({*cuts, STEPS}):
            try:
                sim.run((stop - done) * net.resolution)
            except OverflowWarning:
                reject()
            done = stop
    return observe(sim)


@pytest.mark.parametrize("backend", ["event", "loihi", "spinnaker"])
@SETTINGS
@given(net=exact_networks(), seed=st.integers(0, 5), cuts=st.lists(st.integers(1, STEPS - 1), max_size=2))
def test_every_backend_equals_the_reference(backend: str, net: Network, seed: int, cuts: list[int]):
    found = outcome(net, backend, seed, cuts)
    assert differences(outcome(net, "reference", seed, []), found, exact=False) == []
