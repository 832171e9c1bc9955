"""Ears: a tone excites its channel, silence is silent, pieces of a sound are heard as the whole."""

import numpy as np
import pytest
from scipy.signal import gammatone, sosfreqz

from neuro.coding import Cochlea, HairCells, MelBands, crossings
from neuro.coding.ears import _gammatone
from refused import refusals_of

RATE = 8000.0


def tone(frequency, seconds=0.3):
    return np.sin(2 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE)


@pytest.mark.parametrize("channel", [0, 7, 15, 23, 31])
def test_a_tone_excites_its_channel(channel):
    ear = Cochlea(RATE, 32)
    heard = ear.hear(tone(ear.centres[channel]))[1200:]
    assert (heard.mean(axis=0).argmax(), heard[:, channel].max()) == (channel, pytest.approx(1.0, abs=0.03))


@pytest.mark.parametrize("frequency", [300.0, 1000.0, 2500.0])
def test_the_filter_is_that_of_scipy(frequency):
    b, a = gammatone(frequency, "iir", fs=RATE)
    w = np.linspace(50.0, 3900.0, 400)
    z = np.exp(-2j * np.pi * w[:, None] / RATE * np.arange(9))
    theirs = np.abs((z[:, : len(b)] @ b) / (z[:, : len(a)] @ a))
    ours = np.abs(sosfreqz(_gammatone(frequency, RATE), worN=w, fs=RATE)[1])
    assert ours / ours.max() == pytest.approx(theirs / theirs.max(), abs=1e-6)


def test_streams_are_heard_as_the_whole():
    sound = np.random.default_rng(0).normal(size=3000)
    whole, cells = Cochlea(RATE, 12), HairCells(12, RATE, gain=20.0)
    heard = whole.hear(sound)
    times, channels = cells.spikes(heard)
    assert len(times) > 100
    whole.reset()
    cells.reset()
    pieces = [whole.hear(piece) for piece in np.split(sound, [1, 50, 50, 1777])]
    assert np.array_equal(np.concatenate(pieces), heard)
    parts = [cells.spikes(piece) for piece in pieces]
    assert np.array_equal(np.concatenate([part[0] for part in parts]), times)
    assert np.array_equal(np.concatenate([part[1] for part in parts]), channels)
    sound, ear = np.random.default_rng(1).normal(size=1600), MelBands(RATE)
    levels = ear.hear(sound)
    assert len(levels) == 20
    ear.reset()
    pieces = [ear.hear(piece) for piece in np.split(sound, [1, 50, 50, 799, 1200])]
    assert [len(piece) for piece in pieces] == [0, 0, 0, 9, 6, 5]
    assert np.array_equal(np.concatenate(pieces), levels)
    bars = np.median(levels) + np.array([-3.0, 0.0, 3.0])
    spikes = crossings(levels, bars)
    assert 0 < spikes[9:].sum() < spikes.sum()
    assert np.array_equal(crossings(levels[9:], bars, before=levels[8]), spikes[9:])
    heard = Cochlea(RATE, 8).hear(np.zeros(800))
    assert not heard.any()
    assert len(HairCells(8, RATE).spikes(heard)[0]) == 0
    assert MelBands(RATE).hear(np.zeros(800)).tolist() == np.full((10, 32), -120.0).tolist()
    assert not crossings(np.full((5, 3), -1.0), [0.0]).any()


def test_cells_bands_and_crossings():
    times, _ = HairCells(1, 100_000.0, gain=2.0, tau=5.0, refractory=2.0).spikes(np.ones((100_000, 1)))
    assert np.diff(times) == pytest.approx(5.0 * np.log(2.0) + 2.0, abs=0.02)  # v = 2 (1 - exp(-t / tau)) reaches 1
    edges = np.linspace(2595 * np.log10(1 + 60 / 700), 2595 * np.log10(1 + 4000 / 700), 34)
    centres = 700 * (10 ** (edges[1:-1] / 2595) - 1)
    assert all(MelBands(RATE).hear(tone(centres[band]))[5:].mean(axis=0).argmax() == band for band in (5, 15, 28))
    spikes = crossings(np.array([[0.0], [2.5], [1.5], [0.0]]), [1.0, 2.0])
    assert spikes.shape == (4, 2, 2, 1)
    assert np.argwhere(spikes[..., 0]).tolist() == [[1, 1, 0], [1, 1, 1], [2, 0, 1], [3, 0, 0]]


def test_what_cannot_be_is_refused(messages):
    messages(refusals_of(messages.cases, globals()))
