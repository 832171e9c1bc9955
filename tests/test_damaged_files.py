"""A damaged file of any kind is refused with a message, or read as it was; see `flips` for more of them."""

import os

from flips import KINDS, table, tried

FLIPS = int(os.environ.get("NEURO_FLIPS", "0"))
LONG = ("state, event", "recogniser, hats", "recogniser, hots")
"""Kinds that take seconds to make; they are read as others are."""


def test_damaged_files(tmp_path):
    kinds = [kind for kind in KINDS if FLIPS or kind not in LONG]
    counts, told = tried(kinds, FLIPS or 16, 5, tmp_path)
    assert told == [], table(counts)
    assert all(found["refused"] > found["unchanged"] for found in counts.values()), table(counts)
