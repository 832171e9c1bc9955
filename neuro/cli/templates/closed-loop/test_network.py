"""Run with python -m pytest. Then change network.yaml or the world, and state here what must stay true."""

from run import follow


def test_it_learns_to_follow():
    errors = follow()
    assert errors[-100:].mean() < 0.5 * errors[:100].mean()


def test_without_dopamine_it_learns_nothing():
    errors = follow(dopamine=0.0)
    assert errors[-100:].mean() > 0.8 * errors[:100].mean()
