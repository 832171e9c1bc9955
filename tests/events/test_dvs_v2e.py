"""The DVS model beside the published equations of v2e, on a moving edge and a flicker.

Source: Hu, Liu, Delbruck, "v2e", CVPRW 2021, section 4; times of sub-steps, and the low pass by Euler steps, whose
output is that of the image before, as in its emulator.py.
"""

import numpy as np
import pytest

from neuro.events import DVS, DVSParameters

THRESHOLD = 0.2


def lin_log(grey):
    return np.round(np.where(grey <= 20, grey * np.log(20) / 20, np.log(np.maximum(grey, 1))), 8)


def v2e(times, images, cutoff_hz):
    """Equal pixels without noise: t (us), x, y, p of all events, by image."""
    seen = base = lin_log(images[0].astype(float))
    found = [np.zeros((0, 4))]
    for before, now, image in zip(times, times[1:], images[1:], strict=False):
        target = lin_log(image.astype(float))
        if cutoff_hz:
            step = np.minimum((image + 20) / 275 * (now - before) * 2e-6 * np.pi * cutoff_hz, 1)
            shown, seen = seen, seen + step * (target - seen)
        else:
            shown = target
        count = np.trunc((shown - base) / THRESHOLD + np.copysign(1e-7, shown - base)).astype(int)
        base, steps = base + THRESHOLD * count, np.abs(count).max(initial=0)
        for k in range(steps):
            y, x = np.nonzero(np.abs(count) > k)
            t = np.full(len(x), before + (now - before) * (k + 1) / steps)
            found.append(np.stack([t, x, y, count[y, x] > 0], axis=1))
    return np.concatenate(found)


def edge(t_us):
    """A blurred edge from 50 to 200 goes over 24 pixels at 200 px/s."""
    x = np.arange(24)
    return np.tile(np.rint(50 + 150 / (1 + np.exp((x - 3 - 2e-4 * t_us) / 0.7))), (5, 1)).astype(np.uint8)


def flicker(t_us):
    """Pixels of different brightness at 10 Hz."""
    mean = np.random.default_rng(0).uniform(60, 140, (5, 24))
    return np.rint(mean * (1 + 0.8 * np.sin(2e-5 * np.pi * t_us))).astype(np.uint8)


def by_pixel(t, x, y, p):
    """Pixels with polarities, and times, sorted by pixel and then by time."""
    order = np.lexsort((t, x, y))
    return np.stack([y, x, p], axis=1)[order].astype(int), t[order]


@pytest.mark.parametrize("scene", [edge, flicker])
@pytest.mark.parametrize(("step_us", "cutoff_hz", "apart_us"), [(1000, 0.0, 1000), (5000, 0.0, 5000), (50, 100.0, 100)])
def test_the_events_are_those_of_v2e(scene, step_us, cutoff_hz, apart_us):
    """The same at each pixel; times differ by less than an image, with the low pass by its two Euler steps."""
    times = range(0, 180_001, step_us)
    images = [scene(t) for t in times]
    mine = DVS((24, 5), DVSParameters.ideal(cutoff_hz=cutoff_hz)).record(zip(times, images, strict=True))
    where, t = by_pixel(mine.t, mine.x, mine.y, mine.p)
    theirs, their_t = by_pixel(*v2e(times, images, cutoff_hz).T)
    assert len(where) >= (600 if scene is edge else 3000)
    np.testing.assert_array_equal(where, theirs)
    assert np.abs(t - their_t).max() < apart_us
