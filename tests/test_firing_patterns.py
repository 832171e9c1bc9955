"""The twenty patterns of `examples/firing_patterns.py`: what each is known by, and the published file itself."""

import runpy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from beside import beside

EXAMPLE = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "firing_patterns.py"))
LETTERS = {name[0]: pattern for name, pattern in EXAMPLE["PATTERNS"].items()}
GAP = 9.4  # ms, longer than any within a burst


@cache
def response(letter):
    return EXAMPLE["response"](LETTERS[letter])


def bursts(times):
    """How many spikes each burst has."""
    return [part.size for part in np.split(times, np.flatnonzero(np.diff(times) > GAP) + 1)]


(SPIKES,) = beside(__file__, "SPIKES")


@pytest.mark.parametrize(("letter", "sizes", "begin", "end"), SPIKES)
def test_each_pattern_has_its_spikes(letter, sizes, begin, end):
    spikes = response(letter)[3]
    assert bursts(spikes) == sizes
    assert spikes[0] > begin
    assert spikes[-1] <= end


def test_adaptation_and_classes_show_in_the_intervals():
    adapting, first, second = (np.diff(response(letter)[3]) for letter in "FGH")
    assert np.all(np.diff(adapting) > 0.0)
    assert first[0] > 40.0  # class 1 begins at a low rate, 25 Hz here
    assert second[0] <= 20.0  # class 2 at a high one


def test_a_spike_leaves_its_mark_below_the_threshold():
    times, v, _, spikes = response("J")
    after = v[times > spikes[0] + 5.0]
    assert np.flatnonzero(np.diff(np.sign(after - v[0]))).size >= 2  # it swings around rest
    times, v, _, spikes = response("Q")
    assert v[(times > spikes[0] + 1.0) & (times < spikes[0] + 5.0)].min() > v[0] + 10.0  # and here stays above


@pytest.mark.parametrize("letter", [k for k, pattern in LETTERS.items() if pattern.other is not None])
def test_those_in_equations_are_the_published_file_step_for_step(letter):
    """figure1.m: V by Euler, then u by the new V, then the reset."""
    pattern = LETTERS[letter]
    (a, b, c, d), v, h = pattern.abcd, pattern.v, pattern.step
    u = b * v if pattern.u is None else pattern.u
    slope, offset = (4.1, 108.0) if letter in "GL" else (5.0, 140.0)
    expected = []
    for k in range(round(pattern.ms / h)):
        v += h * (0.04 * v**2 + slope * v + offset - u + pattern.current(k * h))
        u += h * a * (b * (v + 65.0) if letter == "R" else b * v - u)
        if v > 30.0:
            v, u = c, u + d
            expected.append((k + 1) * h)
    np.testing.assert_allclose(response(letter)[3], expected, rtol=1e-12)
