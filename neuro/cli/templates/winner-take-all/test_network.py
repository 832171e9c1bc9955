"""Run with python -m pytest. Then change network.yaml, and state here what must stay true."""

from run import rates


def test_the_stronger_input_wins():
    left, right = rates(40.0, 32.0)
    assert left > 4 * right
    left, right = rates(32.0, 40.0)
    assert right > 4 * left


def test_inhibition_makes_the_difference():
    left, right = rates(40.0, 32.0, inhibition=0.0)
    assert left < 3 * right
