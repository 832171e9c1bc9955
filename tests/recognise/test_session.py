"""Decisions while events arrive: the same however a stream is cut, those of `scores_at`, and in bounded memory."""

import gc
import tracemalloc
from dataclasses import dataclass, replace
from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from neuro.events import Events
from neuro_recognise.deciding import Decision
from neuro_recognise.method import METHODS, choose
from neuro_recognise.methods.descriptor import Boe
from neuro_recognise.observations import observed
from neuro_recognise.recogniser import learn, method_of
from refused import refusals_of, refused

SIZE = (12, 12)


def recording(label, seed, length_us=40_000, n=400, begin=0):
    """A bar that stands (0) or lies (1), or a diagonal (2), with noise."""
    rng = np.random.default_rng([seed, label])
    t = np.sort(rng.integers(0, length_us, n)) + begin
    along, across = rng.integers(0, 12, n), 5 + rng.integers(0, 2, n)
    x, y = [(across, along), (along, across), (along, along)][label]
    noise = rng.random(n) < 0.2
    x, y = np.where(noise, rng.integers(0, 12, n), x), np.where(noise, rng.integers(0, 12, n), y)
    return Events(t, x, y, rng.integers(0, 2, n), SIZE)


def trained(name, **values):
    method = method_of(name, values=values).fitting(SIZE)
    shown = observed(method, [recording(k % 3, k) for k in range(18)], ("standing", "lying", "diagonal"))
    return learn(method, replace(shown, labels=np.arange(18) % 3), "")


@pytest.fixture(scope="module")
def hats():
    return trained("hats", readout="ridge", cell=4, radius=1, tau=5.0)


@pytest.fixture(scope="module")
def boe():
    return trained("boe", threshold=20.0)


STREAM = (recording(0, 50), recording(1, 51, begin=47_000), recording(2, 52, 9000, 300, begin=110_000))


def together(parts):
    return Events(*(np.concatenate([getattr(p, name) for p in parts]) for name in "txyp"), SIZE)


def same(one, other):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        for name in Decision.__slots__:
            assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name


@given(
    cuts=st.lists(st.integers(0, 1100), max_size=30),
    every=st.sampled_from([3.7, 10.0]),
    window=st.sampled_from([5.0, 30.0, 1000.0]),
    gap=st.sampled_from([None, 1.0, 8.0]),
)
@settings(max_examples=12, deadline=None)
@pytest.mark.parametrize("name", ["hats", "boe"])
def test_decisions_do_not_depend_on_how_the_stream_is_cut(name, request, cuts, every, window, gap):
    recogniser, stream = request.getfixturevalue(name), together(STREAM)
    options = {"every_ms": every, "window_ms": window, "gap_ms": gap}
    whole, parts = recogniser.session(**options), recogniser.session(**options)
    expected = whole.feed(stream) + whole.end()
    found = [one for a, b in pairwise([0, *sorted(cuts), len(stream)]) for one in parts.feed(stream[a:b])]
    same(found + parts.end(), expected)


@pytest.fixture(scope="module")
def remus():
    return trained("remus", epochs=2, threshold=40.0, theta=8.0, field=5)


@pytest.mark.parametrize("name", ["hats", "boe", "remus"])
@pytest.mark.parametrize("window", [25.0, 500.0])
def test_decisions_are_those_of_scores_at_for_the_events_of_their_stretch(name, window, request):
    recogniser, stream = request.getfixturevalue(name), together(STREAM)
    session = recogniser.session(every_ms=4.0, window_ms=window, gap_ms=6.0)
    said = session.feed(stream) + session.end()
    begins = sorted({one.at_us - round(1000 * one.after_ms) for one in said})
    firsts = [int(one.t[0]) for one in STREAM]
    assert begins == firsts if window > 40 else set(firsts) < set(begins)
    for begin, stop in pairwise([*begins, 1 << 60]):
        stretch = stream[np.searchsorted(stream.t, begin) : np.searchsorted(stream.t, stop)]
        own = [one for one in said if begin <= one.at_us < stop]
        expected = recogniser.scores_at(stretch, [one.after_ms for one in own])
        np.testing.assert_allclose([one.scores for one in own], expected, rtol=1e-12)
        assert [one.label for one in own] == choose(expected).tolist()
    if name != "remus":
        assert [recogniser.predict(one)[0] for one in STREAM] == [0, 1, 2]


@pytest.mark.parametrize(("name", "size"), [*((name, (11, 12)) for name in sorted(METHODS)), ("tar_hats", SIZE)])
def test_a_recording_that_grows_shows_what_it_shows_at_once(name, size):
    method, events = replace(METHODS[name](), size=size).fitting(SIZE), together(STREAM)[:700]
    events, observer = events[(events.x < 11) | (events.t % 50 == 0)], method.observer()
    for begin, end in pairwise([0, 0, 1, 5, 300, 301, len(events)]):
        observer.add(events[begin:end])
        expected, found = method.observe(events[:end]), observer.evidence()
        assert list(found) == list(expected)
        for part in expected:
            assert found[part].dtype == expected[part].dtype
            assert np.array_equal(found[part], expected[part])


@dataclass(frozen=True)
class Counting(Boe):
    """Notes how many events it is shown at once."""

    def observe(self, events):
        SHOWN.append(len(events))
        return super().observe(events)


SHOWN: list[int] = []


def test_an_endless_stream_is_forgotten(boe):
    counting = replace(boe, method=Counting(**{name: getattr(boe.method, name) for name in ("size", "segmenter")}))
    session = counting.session(every_ms=10.0, window_ms=20.0)
    SHOWN.clear()
    said = [one for k in range(20) for one in session.feed(recording(k % 3, k, 10_000, 100, begin=10_000 * k))]
    assert len(said) >= 18
    assert len(SHOWN) == len(said)
    assert 100 < max(SHOWN) <= 330


def test_a_clock_a_reset_and_empty_parts(hats):
    session, events = hats.session(every_ms=2.0, window_ms=9.0), recording(0, 7, 3000, 50)
    assert [one.after_ms for one in session.feed(events)] == [2.0]
    first = int(events.t[0])
    assert [one.at_us - first for one in session.feed(events[:0], until_us=first + 6000)] == [4000, 6000]
    assert [one.at_us - first for one in session.feed(events[:0], until_us=10**9)] == [8000]
    assert (session.feed(events[:0], until_us=2 * 10**9), session.end()) == ([], [])
    session, events = hats.session(every_ms=2.0), recording(0, 7, 3000, 50)
    assert (len(session.feed(events, until_us=int(events.t[0]) + 6000)), session.end()) == (3, [])
    session = hats.session(every_ms=2.0)
    session.feed(events[:1])
    assert [one.after_ms for one in session.end()] == [0.0]
    session, fresh = hats.session(every_ms=5.0), hats.session(every_ms=5.0)
    session.feed(STREAM[1])
    session.reset()
    same(session.feed(STREAM[0]) + session.end(), fresh.feed(STREAM[0]) + fresh.end())
    session, fresh, stream = hats.session(every_ms=5.0), hats.session(every_ms=5.0), STREAM[0]
    said = session.feed(stream[:0])
    for part in (stream[:7], stream[:0], stream[7:]):
        columns = (part.t.tolist(), part.x.astype(np.int64), part.y.astype(np.uint8), part.p > 0)
        said += session.feed(Events(*columns, SIZE) if len(part) else part)
    same(said, fresh.feed(stream))
    session = hats.session()
    session.feed(STREAM[1])
    before, first, last = int(STREAM[1].t[-1]), int(STREAM[0].t[0]), int(STREAM[2].t[-1])
    told = f"time runs back from {before} to {first} us: expected the next part"
    assert refused(session.feed, STREAM[0]).startswith(told)
    told = f"until_us is {last - 1} us, expected at least {last}, the time of"
    assert refused(session.feed, STREAM[2], until_us=last - 1).startswith(told)
    wide = Events(np.arange(100), np.arange(100) % 20, np.zeros(100, int), np.zeros(100, int), (20, 12))
    session = hats.session(every_ms=1)
    session.feed(wide[:10])
    session.feed(wide[10:])
    assert refused(session.end) == refused(hats.scores, wide)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hats", "boe"])
def test_memory_stays_flat_however_long_a_stream_is(name, request):
    session, held = request.getfixturevalue(name).session(every_ms=10.0, window_ms=20.0), []
    tracemalloc.start()
    for k in range(80):
        session.feed(recording(k % 3, 1, 10_000, 100, begin=10_000 * k))
        if k in (19, 79):
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert held[1] - held[0] < 20_000  # bytes; the events alone of the 60 parts between are 78,000


def test_what_a_session_refuses(hats, messages):
    messages(refusals_of(messages.cases, locals()))
