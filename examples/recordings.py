"""The recordings that `neuro example` gives, made by the pixel model of an event camera; always the same bytes."""

import io
import zipfile
from pathlib import Path

import numpy as np

from neuro.events import DVSParameters, Events, dvs_events, save

PIXELS = DVSParameters(pos_thres=0.35, neg_thres=0.35, leak_rate_hz=0.05, shot_noise_rate_hz=0.05)
EPOCH = (2000, 1, 1, 0, 0, 0)  # in a zip, so that its bytes do not depend on when it is made


def strokes(sensor, segments, width):
    """A picture of dark strokes on light ground: (height, width), grey values of 8 bits.

    Args:
        sensor: width and height, px.
        segments: (n, 4) x and y of both ends, px.
        width: of a stroke, px.
    """
    y, x = np.mgrid[: sensor[1], : sensor[0]].astype(float)
    nearest = np.full(x.shape, np.inf)
    for x0, y0, x1, y1 in np.asarray(segments, float):
        along, length = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)), (x1 - x0) ** 2 + (y1 - y0) ** 2
        share = np.clip(along / length, 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0)))
    ink = np.clip(width / 2 + 0.5 - nearest, 0.0, 1.0)
    return np.rint(200 - 90 * ink).astype(np.uint8)


def figure(t_ms):
    """Trunk, head, legs and arms of a person who walks to the right at two steps a second."""
    x, swing = 8 + 0.048 * t_ms, 0.5 * np.sin(2 * np.pi * t_ms / 1000.0)
    hip, neck, limbs = (x, 28.0), (x + 1, 16.0), []
    for sign in (-1, 1):
        limbs.append((*hip, hip[0] + 15 * np.sin(sign * swing), hip[1] + 15 * np.cos(swing)))
        limbs.append((*neck, neck[0] + 10 * np.sin(-sign * swing), neck[1] + 10 * np.cos(swing)))
    return [(*hip, *neck), (x + 1, 13.0, x + 2, 10.0), *limbs]


def walk() -> Events:
    """A second of it, an image a millisecond."""
    t_ms = np.arange(1001)
    images = np.stack([strokes((64, 48), figure(t), 2.0) for t in t_ms])
    return dvs_events(1000 * t_ms, images, PIXELS, seed=1)


def corners(sides):
    """The sides of a regular polygon about 0: (sides, 4), px."""
    angles = np.pi / 4 + 2 * np.pi * np.arange(sides + 1) / sides
    points = np.stack([8 * np.cos(angles), 8 * np.sin(angles)], axis=1)
    return np.hstack([points[:-1], points[1:]])


SHAPES = {"cross": np.array([(-8.0, 0, 8, 0), (0, -8, 0, 8)]), "ring": corners(16), "square": corners(4)}


def shape(segments, seed) -> Events:
    """A shape that moves once round a small triangle, of a place and a size of its own."""
    rng = np.random.default_rng(seed)
    size, place = rng.uniform(0.8, 1.1), 16.5 + rng.uniform(-2.0, 2.0, 2)
    t_ms = np.arange(0, 151, 2)
    path = np.array([(0.0, 0.0), (1.5, 3.0), (3.0, 0.0), (0.0, 0.0)])
    moved = np.stack([np.interp(t_ms, (0, 50, 100, 150), path[:, k]) for k in (0, 1)], axis=1)
    images = np.stack([strokes((34, 34), size * segments + np.tile(place + at, 2), 2.0) for at in moved])
    return dvs_events(1000 * t_ms, images, PIXELS, seed=seed)


def shapes(count=12) -> bytes:
    """A zip of class folders with recordings in N-MNIST's format."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for label, (name, segments) in enumerate(SHAPES.items()):
            for k in range(count):
                save(shape(segments, 100 * label + k), "one.bin", replace=True)
                archive.writestr(zipfile.ZipInfo(f"{name}/{k:02}.bin", EPOCH), Path("one.bin").read_bytes())
    Path("one.bin").unlink()
    return content.getvalue()


if __name__ == "__main__":
    save(walk(), "walk.dat")
    Path("shapes.zip").write_bytes(shapes())
    for file in ("walk.dat", "shapes.zip"):
        print(f"{file}: {Path(file).stat().st_size:,} bytes")
