import numpy as np
import pytest

from neuro_remus.features import Spikes
from neuro_remus.settings import Settings


@pytest.fixture(scope="session")
def letters():
    """C1 spikes of 24 noisy recordings of three shapes on a small sheet, three frames each; two more are empty."""
    rng = np.random.default_rng(2)
    shapes = [rng.permutation(4 * 64)[:30] for _ in range(3)]
    times, ids, counts, sample = [], [], [], []
    labels = np.arange(26) % 3
    for k in range(24):
        for _ in range(3):
            seen = np.unique(np.concatenate([rng.permutation(shapes[labels[k]])[:26], rng.permutation(256)[:8]]))
            ticks = np.where(np.isin(seen, shapes[labels[k]]), rng.integers(0, 8, len(seen)), 6)
            order = np.lexsort((seen, ticks))
            times.append(ticks[order].astype(float))
            ids.append(seen[order])
            counts.append(len(seen))
            sample.append(k)
    return Spikes(
        np.concatenate(times), np.concatenate(ids), np.concatenate(([0], np.cumsum(counts))), np.array(sample),
        labels, tuple(f"{k}.bin" for k in range(26)), ("a", "b", "c"), (4, 8, 8),
    )  # fmt: skip


@pytest.fixture(scope="session")
def small():
    """Settings that go with `letters`."""
    return Settings(epochs=3).changed({"size": [16, 16], "window": 10.0, "field": 7, "theta": 16.0})
