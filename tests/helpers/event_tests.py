"""What tests of events and of codes share."""

import warnings
from itertools import pairwise

import numpy as np
from hypothesis import given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load
from neuro.events.formats import Damage
from neuro.events.source import WHOLE
from refused import refused as refusal  # noqa: F401  (tests of events take it from here)


def rows(events):
    """Events, or a piece of a file, as a list of (t, x, y, p)."""
    return list(zip(*(getattr(events, name).tolist() for name in "txyp"), strict=True))


def random_events(n, size=(34, 34), length=200_000, seed=0):
    """Events at random times below a length, us, and random places."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, length, n))
    return Events(t, rng.integers(0, size[0], n), rng.integers(0, size[1], n), rng.integers(0, 2, n), size)


def parts_of(events, cuts):
    """Parts of a recording that is cut in some places."""
    return [events[begin:end] for begin, end in pairwise([0, *sorted(cuts), len(events)])]


def read_pieces(reader, block=WHOLE):
    """The events of a file, the bytes at which they begin, and the damage after them; None: there is none."""
    found, places = [], []
    try:
        for piece in reader.pieces(block):
            found += rows(piece)
            places += map(piece.place, range(piece.t.size))
            assert piece.highest in (None, tuple(max(values.tolist(), default=-1) for values in (piece.x, piece.y)))
            assert not piece.ordered or (np.diff(piece.t) >= 0).all()
    except Damage as damage:
        return found, places, damage.args
    return found, places, None


@st.composite
def damaged(draw, data):
    """A file, cut or with bytes flipped or inserted, more often near its beginning."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.one_of(st.integers(0, min(len(data), 300)), st.integers(0, len(data))))
        how = draw(st.sampled_from(["cut", "flip", "insert"]))
        if how == "cut":
            data = data[:at]
        elif how == "insert":
            data = data[:at] + draw(st.binary(min_size=1, max_size=12)) + data[at:]
        elif at < len(data):
            data = data[:at] + bytes([data[at] ^ draw(st.integers(1, 255))]) + data[at + 1 :]
    return data


def damage_is_told(files, format, examples=80):
    """Files that are damaged anywhere give events or an `EventFileError`, whose byte is one of theirs.

    `files` are whole ones, which are damaged here, or draws damaged ones.
    """

    @given(st.sampled_from(files).flatmap(damaged) if isinstance(files, list) else files)
    @settings(max_examples=examples)
    def run(data):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EventFileWarning)
            for strict in (True, False):
                offset = None
                try:
                    assert isinstance(load(data, format=format, strict=strict), Events)
                except EventFileError as error:
                    offset = error.offset
                assert offset is None or 0 <= offset <= len(data)

    run()
