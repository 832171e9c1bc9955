"""A damaged file of any kind is refused with a message or read as it was; see `flips`, also for more and other seeds."""

import os

from flips import KINDS, table, tried

FLIPS = int(os.environ.get("NEURO_FLIPS", "24"))
SEED = int(os.environ.get("NEURO_FLIPS_SEED", "5"))


def test_damaged_files(tmp_path):
    counts, told = tried(KINDS, FLIPS, SEED, tmp_path)
    assert told == [], table(counts)
    assert all(found["refused"] > found["unchanged"] for found in counts.values()), table(counts)
