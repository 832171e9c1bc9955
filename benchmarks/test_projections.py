"""Time of projections with few synapses: ten thousand projections, and the microcircuit with few inputs."""

import pytest
from microcircuit import circuit, events
from networks import many_projections

import neuro

WINDOW_MS = 100.0
SILENCE = []


@pytest.mark.parametrize("rate", [0.0, 5.0])
def test_ten_thousand_projections(least_cpu, figure, rate):
    """Measure a biological second of 10,000 projections of 100 x 100 neurons with drawn delays, silent and at 5 Hz."""
    sim = neuro.compile(many_projections(rate), seed=1)
    sim.run(20.0)
    taken = least_cpu(lambda: sim.run(WINDOW_MS), rounds=5) / WINDOW_MS * 1e3
    if rate == 0.0:
        SILENCE.append(taken)
        figure("10,000 projections in silence", taken, "s/bio s", "at most 1")
    else:
        figure("10,000 projections at 5 Hz, beside silence", taken - min(SILENCE, default=0.0), "s/bio s", "at most 2")


def test_short_rows(least_cpu, figure):
    """Measure the time per event of the microcircuit with a tenth of its neurons and inputs, with drive and neurons."""
    sim = neuro.compile(circuit(0.1), seed=1)
    sim.run(WINDOW_MS)
    before, rounds = events(sim), 10
    taken = least_cpu(lambda: sim.run(WINDOW_MS), rounds=rounds)
    figure("a tenth of the microcircuit", taken / ((events(sim) - before) / rounds) * 1e9, "ns/event", "at most 20")
