"""Run me with python -m pytest; then change network.yaml, and say here what must stay true."""

from run import seen


def test_the_grid_sees_who_walks():
    spikes = seen()
    assert spikes.shape == (6, 8)
    assert spikes[1:6].sum() > 20
    assert spikes[0].sum() == 0  # nobody is up there
