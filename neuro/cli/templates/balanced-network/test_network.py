"""Run with python -m pytest. Then change network.yaml, and state here what must stay true."""

from run import firing


def test_it_fires_irregularly():
    rate, irregularity = firing()
    assert 5 < rate < 60
    assert irregularity > 0.6


def test_the_same_seed_gives_the_same_run():
    assert firing(seed=3) == firing(seed=3)


def test_more_noise_more_spikes():
    assert firing(noise=4000.0)[0] > firing(noise=3000.0)[0]
