"""Run with python -m pytest. Then change network.yaml or the world, and state here what must stay true."""

from run import returns


def test_it_learns_to_follow():
    assert returns() > returns(dopamine=0.0) + 20.0
