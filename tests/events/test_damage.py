"""Damaged files of every format: events or an error, never a crash, a hang or a coordinate off the sensor.

A format is met with the file that `conftest.py` has of it.
"""

import faulthandler
import time
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro.events.files as files
from event_tests import damaged
from neuro.events import EVENT, EventFileError, EventFileWarning, Events, load, stream
from neuro.events.formats import FORMATS, HEAD, Damage
from neuro.events.opening import find
from neuro.events.source import Source

NAMES = [f.name for f in FORMATS.values()]
KNOWN = {f.name: f for f in FORMATS.values()}
SECONDS = 5
"""Any file of the tests is read in much less."""


@pytest.fixture(autouse=True)
def limited():
    """End the run, telling where it is, rather than wait for ever."""
    faulthandler.dump_traceback_later(120, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()


def opens(data, name, format):
    """Return whether the format is found, and its header and first events tell the sensor or leave it open."""
    source = Source(data, name)
    try:
        getattr(find(source, format).open(source), "sensor_size", None)
    except (Damage, EventFileError):
        return False
    return True


def told(read, *args, **options):
    """What is read (None for an error), and the warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result, offset = None, None
        try:
            result = read(*args, **options)
        except EventFileError as error:
            offset = error.offset
    assert offset is None or 0 <= offset <= len(args[0])
    assert all(warning.category is EventFileWarning for warning in found), [str(w.message) for w in found]
    return result, found


def parts(data, **options):
    return np.concatenate([np.zeros(0, EVENT), *(part.records() for part in stream(data, **options))])


def check(data, name, format=None):
    """Read a file in all ways that there are, and say whether all of it was right."""
    began = time.process_time()
    strict, quiet = told(load, data, name=name, format=format)
    lenient, loud = told(load, data, name=name, format=format, strict=False)
    streamed, _ = told(parts, data, name=name, format=format, strict=False)
    at_once, _ = told(parts, data, name=name, format=format)
    assert time.process_time() - began < SECONDS
    assert not quiet
    assert (lenient is not None, streamed is None) == (opens(data, name, format), lenient is None)
    assert (at_once is None) == (strict is None)
    if lenient is not None:
        Events(lenient.t, lenient.x, lenient.y, lenient.p, lenient.sensor_size)
        assert np.array_equal(streamed, lenient.records())
        assert bool(loud) == (strict is None)
    if strict is not None:
        assert strict == lenient
        assert np.array_equal(at_once, strict.records())
    return strict is not None


@pytest.fixture(params=[64, files.BLOCK], ids=["small blocks", "blocks"])
def block(request, monkeypatch):
    """How many bytes `stream` reads at once."""
    monkeypatch.setattr(files, "BLOCK", request.param)


@pytest.mark.parametrize("format", NAMES)
def test_whole_and_empty(format, sample):
    assert check(sample(format), f"a{KNOWN[format].suffixes[0]}")
    check(b"", f"a{KNOWN[format].suffixes[0]}")
    check(b"", "a", format)


@pytest.mark.parametrize("format", NAMES)
@pytest.mark.usefixtures("block")
def test_damaged(format, sample):
    whole = sample(format)

    @given(st.data())
    @settings(max_examples=12, suppress_health_check=list(HealthCheck))
    def run(data):
        check(data.draw(damaged(whole)), f"a{KNOWN[format].suffixes[0]}")

    run()


@pytest.mark.parametrize("format", NAMES)
def test_any_bytes(format, sample):
    head = sample(format)[:200]

    @given(st.integers(0, len(head)), st.binary(max_size=200))
    @settings(max_examples=12)
    def run(kept, rest):
        check(head[:kept] + rest, f"a{KNOWN[format].suffixes[0]}")
        check(head[:kept] + rest, "a", format)

    run()


@pytest.mark.parametrize("format", NAMES)
def test_mislabelled(format, sample):
    """A file under another name or read as another format."""
    data = sample(format)
    signed = KNOWN[format].knows(data[:HEAD])
    for other in NAMES:
        assert check(data, f"a{KNOWN[other].suffixes[-1]}") or not signed
        check(data[:20_000], "a", other)
