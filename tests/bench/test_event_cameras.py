"""Recordings of event cameras, also of small made files."""

from pathlib import Path

import numpy as np
import pytest

from neuro_bench.event_cameras import NMNIST, DVSGesture, PokerDVS
from refused import refused

SHARED = Path(__file__).parents[3] / "shared" / "data"


def written(folder, name, x, y, t):
    """A file of N-MNIST's format, five bytes an event."""
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    t = np.asarray(t, dtype=np.int64)
    rows = np.stack([x, y, (t >> 16) & 0x7F, (t >> 8) & 0xFF, t & 0xFF], axis=1)
    file.write_bytes(rows.astype(np.uint8).tobytes())


@pytest.fixture
def gestures(tmp_path):
    rng = np.random.default_rng(0)
    for label, low in (("clap", 0), ("wave", 64)):
        for k in range(6):
            t = np.sort(rng.integers(0, 2_000_000, 300))
            written(tmp_path, f"{label}/{k}.bin", rng.integers(low, low + 60, 300), rng.integers(0, 128, 300), t)
    return tmp_path


def test_gestures_of_a_folder(gestures):
    both = DVSGesture(gestures).folds()[0].both
    assert (both.frames.shape[1:], both.classes, both.spikes.shape) == ((10, 32, 32), ("clap", "wave"), (2, 32, 32))
    assert both.spikes.at.max() == 59
    left = both.frames[both.labels == 0]
    assert (left[..., 15:] == 0).all()  # 60 px are 15 neurons
    assert left[..., :15].any()


def test_recordings_without_events_in_the_square_are_refused(tmp_path):
    for k in range(10):
        written(tmp_path, f"Train/{k % 2}/{k}.bin", [60], [60], [0])
    assert "has no event in the first 34 px: expected recordings of 'n-mnist'" in refused(NMNIST(tmp_path).folds)


def test_cards_of_poker_dvs():
    file = SHARED / "poker_dvs" / "poker_dvs_shared_aedat2.zip"
    if not file.exists():
        pytest.skip(f"{file} is not there")
    folds = PokerDVS(file).folds()
    assert sum(len(fold.test) for fold in folds) == 87
    assert folds[0].both.classes == ("club", "diamond", "heart", "spade")
