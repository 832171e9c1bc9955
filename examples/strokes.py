"""Four maps learn four strokes by reward: trials, first spikes and R-STDP. The network is `strokes.yaml`.

An image is a stroke of five pixels somewhere in 7 x 7 and some noise. Bright pixels spike first. Writes strokes.png.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import neuro

STROKES = np.array([np.eye(5)[2][:, None] + 0 * np.eye(5), np.eye(5)[2] + 0 * np.eye(5), np.eye(5), np.eye(5)[::-1]])
NAMES = ("-", "|", "\\", "/")


def batch(rng, n):
    """Labels, and the spikes of n images: times in ms, pixels, and where each image begins."""
    labels = rng.integers(len(STROKES), size=n)
    images = rng.uniform(0.0, 0.4, (n, 7, 7)) * (rng.random((n, 7, 7)) < 0.2)
    for image, label in zip(images, labels, strict=True):
        row, column = rng.integers(3, size=2)
        image[row : row + 5, column : column + 5] += STROKES[label] * rng.uniform(0.7, 1.0, (5, 5))
    trial, row, column = np.nonzero(images > 0.1)
    bright = images[trial, row, column].clip(0.0, 1.0)
    times = np.rint(neuro.coding.intensity_to_latency(bright, 0.0, 1.0, window=31.0))
    return labels, times, row * 7 + column, np.searchsorted(trial, np.arange(n + 1))


rng = np.random.default_rng(0)
sim = neuro.compile(neuro.load(Path(__file__).with_name("strokes.yaml")), seed=1)
for epoch in range(5):
    labels, times, ids, offsets = batch(rng, 200)
    results = sim.trials(times, ids, offsets, labels, learn=True, epoch=epoch)
    print(f"epoch {epoch}: {np.mean(results.label == labels):.0%} right while learning")

labels, times, ids, offsets = batch(rng, 200)
results = sim.trials(times, ids, offsets)
print(f"new images: {np.mean(results.label == labels):.0%} right, decided after {results.step.mean():.0f} ms")
for name, kernel in zip(NAMES, sim.weights("image_strokes")[:, 0], strict=True):
    print(f"what the map for {name} has learnt:")
    print("\n".join("  " + "".join(" .:*#"[int(4.99 * w)] for w in line) for line in kernel))

figure, axes = plt.subplots(1, 4, figsize=(8, 2.4), layout="constrained")
for name, kernel, ax in zip(NAMES, sim.weights("image_strokes")[:, 0], axes, strict=True):
    shown = ax.imshow(kernel, vmin=0.0, vmax=1.0, cmap="Greys")
    ax.set(title=f"map for {name}", xticks=[], yticks=[])
figure.colorbar(shown, ax=axes, label="weight (mV)")
figure.savefig("strokes.png", dpi=100)
