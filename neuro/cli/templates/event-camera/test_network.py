"""Run with python -m pytest. Then change network.yaml, and state here what must stay true."""

from run import spike_counts


def test_the_grid_sees_who_walks():
    spikes = spike_counts()
    assert spikes[2:5].sum() > 50
    assert spikes[0].sum() == 0  # no events in the top row


def test_stronger_synapses_more_spikes():
    assert spike_counts(w=500.0).sum() > spike_counts(w=300.0).sum()
