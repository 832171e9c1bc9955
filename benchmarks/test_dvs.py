"""Pixels per second of the event camera model, and the time of a call in a control loop."""

import time

import numpy as np
import pytest

from neuro.events import DVS, DVSParameters

IDEAL = DVSParameters.ideal()
NOISY = DVSParameters(sigma_thres=0.05, leak_rate_hz=0.1, shot_noise_rate_hz=5.0, refractory_period_s=0.01)
"""The "noisy" pixels of v2e, without the limit of bandwidth."""
LIMITED = DVSParameters(
    sigma_thres=0.05, leak_rate_hz=0.1, shot_noise_rate_hz=5.0, refractory_period_s=0.01, cutoff_hz=30.0
)
WARM_UP = 3


def moving_edge(kind, size=(346, 260), images=400):
    """Return images of an upright edge that moves by half a pixel from image to image."""
    rows = 0.2 + 0.6 * np.clip(0.5 * np.arange(images)[:, None] + 20.5 - np.arange(size[0]), 0, 1)
    shown = rows * 255 if kind == "uint8" else rows
    return np.repeat(shown.astype(kind)[:, None], size[1], 1)


def texture(size=(346, 260), images=60):
    """Return images in which every pixel changes in every image, by less than a threshold."""
    return (0.5 + 0.02 * np.random.default_rng(0).random((images, size[1], size[0]))).astype(np.float32)


def cost(images, parameters):
    """Return the process time of an image at 1 kHz in s, and the number of events in an image."""
    camera = DVS(images.shape[:0:-1], parameters)
    events = 0
    for k, image in enumerate(images):
        if k == WARM_UP:
            began, events = time.process_time(), 0
        events += len(camera.see(image, 1000 * k))
    n = len(images) - WARM_UP
    return (time.process_time() - began) / n, events / n


@pytest.mark.parametrize("kind", ["float32", "uint8"])
@pytest.mark.parametrize(
    ("what", "parameters", "aim"),
    [("ideal", IDEAL, "at least 200"), ("noisy", NOISY, "at least 50"), ("noisy, 30 Hz", LIMITED, "at least 50")],
)
def test_moving_edge(figure, kind, what, parameters, aim):
    images = moving_edge(kind)
    took, events = min(cost(images, parameters) for _ in range(3))
    figure(f"DVS 346x260 edge at 1 kHz, {what}, {kind}", images[0].size / took / 1e6, "M pixels/s", aim)
    assert events > 100


@pytest.mark.parametrize(("what", "parameters"), [("ideal", IDEAL), ("noisy", NOISY), ("noisy, 30 Hz", LIMITED)])
def test_every_pixel_changes(figure, what, parameters):
    images = texture()
    took, _ = min(cost(images, parameters) for _ in range(3))
    figure(f"DVS 346x260, every pixel changes, {what}", images[0].size / took / 1e6, "M pixels/s")


@pytest.mark.parametrize("side", [64, 128])
def test_control_loop(figure, side):
    still, _ = min(cost(np.full((1000, side, side), 0.5, np.float32), IDEAL) for _ in range(3))
    figure(f"camera.see of {side}x{side}, nothing moves", 1e6 * still, "us", "at most 50")
    edge, _ = min(cost(moving_edge("float32", (side, side), 2 * side), DVSParameters()) for _ in range(3))
    figure(f"camera.see of {side}x{side}, an edge, default pixels", 1e6 * edge, "us")
