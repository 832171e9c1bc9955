"""Streams by the network: real sockets on the loopback, at ports that are free."""

import gc
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from neuro import ModelError
from neuro.events import Events, StreamCounts, filters, listen, representations, save, send
from neuro.events.streams import _kernels as ring_kernel
from neuro.events.streams._codings import CODINGS
from neuro.events.streams._sender import channel, paced
from refused import refused

SIZE = (346, 260)
HOST = "127.0.0.1"
WRAP = {"spif": 0, "spif-timed": 1 << 32, "faery13": 1 << 62, "faery8": 1 << 32, "raw-evt3": 1 << 24}
TIMED = [name for name in CODINGS if name != "spif"]


def some(n: int, seed: int = 0, start: int = 0, span: int = 10_000, size=SIZE) -> Events:
    draw = np.random.default_rng(seed)
    t = start + np.sort(draw.integers(0, span, n))
    return Events(t, draw.integers(0, size[0], n), draw.integers(0, size[1], n), draw.integers(0, 2, n), size)


def open_udp(format: str, **more):
    return listen(f"udp://{HOST}:0", format=format, sensor=SIZE, **more)


def faery8(t: int, x: int = 2, y: int = 3) -> bytes:
    return struct.pack("<IHH", t, x, y)


def put(stream, *datagrams: bytes) -> None:
    host, port = stream.url.removeprefix("udp://").split(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for data in datagrams:
            sock.sendto(data, (host, int(port)))


def taken(stream, datagrams: int) -> Events:
    """Everything, when so many datagrams have come."""
    parts = [stream.take()]
    while stream.counts.datagrams < datagrams and stream.wait(5.0):
        parts.append(stream.take())
    return sum(parts[1:], parts[0])


def through(stream, events: Events, format: str, **more) -> Events:
    done, sent = stream.counts.datagrams, send(stream.url, events, format=format, speed=float("inf"), **more)
    return taken(stream, done + sent.datagrams)


def columns(events: Events) -> list[list[int]]:
    return [getattr(events, name).tolist() for name in "xyp"]


@pytest.mark.parametrize("format", CODINGS)
def test_what_is_sent_arrives_event_for_event(format):
    events = some(3000)
    with open_udp(format) as stream:
        got = through(stream, events, format)
        assert columns(got) == columns(events)
        assert got == events or format == "spif"
        assert stream.counts == StreamCounts(events=3000, datagrams=stream.counts.datagrams)


def test_spif_without_times_has_those_of_receipt():
    with open_udp("spif") as stream:
        before = time.monotonic_ns()
        put(stream, struct.pack("<I", 1 << 31 | 7 << 16 | 1 << 15 | 9))
        assert stream.wait(5.0)
        events = stream.take()
        assert before < stream.received_ns < time.monotonic_ns()
        assert (events.x[0], events.y[0], events.p[0]) == (7, 9, 1)
        assert 0 <= events.t[0] < 10_000_000
        assert not len(stream.take())
        assert stream.received_ns is None


@st.composite
def recordings(draw):
    n = draw(st.integers(1, 60))
    gaps = draw(st.lists(st.integers(0, 1 << 22), min_size=n, max_size=n))
    start = draw(st.integers(0, 1 << 40))
    places = draw(
        st.lists(st.tuples(st.integers(0, 345), st.integers(0, 259), st.integers(0, 1)), min_size=n, max_size=n)
    )
    x, y, p = zip(*places, strict=True)
    return Events(start + np.cumsum(gaps), np.array(x), np.array(y), np.array(p), SIZE)


@pytest.fixture(scope="module", params=TIMED)
def timed(request):
    with open_udp(request.param) as stream:
        yield stream


@settings(max_examples=25, deadline=None)
@given(events=recordings(), datagram=st.sampled_from([16, 40, 200, 1400]))
@example(Events([(1 << 32) - 1, 1 << 32], *[[0, 0]] * 3, SIZE), 16)
def test_any_recording_comes_back(timed, events, datagram):
    """In time, too: but for what its clock cannot tell, and for a clock that falls back between two recordings."""
    from neuro.events.streams._kernels import ADDED, CLOCK

    timed._facts[[CLOCK, ADDED]] = 0  # as a stream that begins
    got = through(timed, events, timed.format, datagram=datagram)
    assert columns(got) == columns(events)
    assert np.array_equal(np.diff(got.t), np.diff(events.t))
    assert (got.t[0] - events.t[0]) % WRAP[timed.format] == 0


def test_events_of_before_a_wrap_are_late_after_it():
    early = faery8((1 << 32) - 10)
    with open_udp("faery8") as stream:
        put(stream, early, faery8(5), early)
        assert (taken(stream, 3).t.tolist(), stream.counts.out_of_order) == ([(1 << 32) - 10, (1 << 32) + 5], 1)


def test_silence_of_minutes_is_counted_by_evt3():
    events = Events(
        np.array([5, 200_000_000, 200_000_001]), np.array([1, 2, 3]), np.array([4, 4, 4]), np.ones(3, int), SIZE
    )
    with open_udp("raw-evt3") as stream:
        assert through(stream, events, "raw-evt3") == events


def test_datagrams_in_another_order_are_counted():
    with open_udp("faery13") as stream:
        one, two = (some(10, k, start=1000 * k, span=100).records().tobytes() for k in (1, 2))
        put(stream, two, one)
        assert (len(taken(stream, 2)), stream.counts.out_of_order) == (10, 10)


def test_clock_that_falls_back_goes_on():
    with open_udp("faery13") as stream:
        first = through(stream, some(10, start=10**9, span=100), "faery13")
        second = through(stream, some(10, span=100), "faery13")
        assert (second.t[0], stream.counts.restarts, stream.counts.out_of_order) == (first.t[-1], 1, 0)


def words(*events: tuple[int, int]) -> bytes:
    """A datagram of faery13: times and columns."""
    return b"".join(struct.pack("<qHHB", t, x, 0, 1) for t, x in events)


FAR = 1 << 50


@pytest.mark.parametrize("wrong", [FAR, 0])
@pytest.mark.parametrize("at", ["alone", "first", "amid", "last", "twice"])
def test_a_damaged_time_moves_no_clock(wrong, at):
    """An event far from those beside it, in the future or in the past, is left out and counted."""
    begin = 10**12
    right = [(begin + k, k) for k in range(9)]
    bad = (wrong, 99)
    middle = {
        "alone": [[bad]], "first": [[bad, *right[3:6]]], "amid": [[right[3], bad, *right[4:6]]],
        "last": [[*right[3:6], bad]], "twice": [[bad], [(wrong + FAR // 2, 99)]],
    }[at]  # fmt: skip
    datagrams = [right[:3], *middle, right[3 if at in ("alone", "twice") else 6 :]]
    with open_udp("faery13") as stream:
        put(stream, *(words(*each) for each in datagrams))
        events = taken(stream, len(datagrams))
        assert list(zip(events.t.tolist(), events.x.tolist(), strict=True)) == right
        assert stream.counts.lost == {"damaged": 1 + (at == "twice")}


HOUR = 3_600_000_000


@pytest.mark.parametrize(("format", "datagrams", "times", "damaged"), [
    ("faery8", [faery8(t) for t in (5000, 3_000_000_000, 5001, 1_000_000_000, 5002)], [5000, 5001, 5002], 2),
    ("faery13", [words((FAR, 9), (5, 1), (6, 2))], [5, 6], 1),
    ("faery13", [words((5, 1)), words((HOUR, 2), (HOUR + 1, 3)), words((2 * HOUR, 4)), words((2 * HOUR + 1, 5))],
     [5, HOUR, HOUR + 1, 2 * HOUR + 1], 1),
], ids=["of 32 bits", "in the first datagram", "that the next event agrees with"])  # fmt: skip
def test_a_time_that_jumps(format, datagrams, times, damaged):
    """A sender that falls silent, or sends an hour at once, loses an event at most, and that is counted."""
    with open_udp(format) as stream:
        put(stream, *datagrams)
        assert (taken(stream, len(datagrams)).t.tolist(), stream.counts.lost) == (times, {"damaged": damaged})


def test_a_sender_that_begins_anew_after_moments_is_recognised():
    """A recording of 50 ms in a loop: what is left out before it is recognised is counted."""
    from neuro.events.streams._kernels import RESTART_DATAGRAMS

    events = some(2000, span=50_000)
    with open_udp("faery13") as stream:
        parts, counts = [through(stream, events, "faery13") for _ in range(3)], stream.counts
        assert (parts[0], counts.restarts) == (events, 2)
        assert 0 < counts.out_of_order <= 2 * RESTART_DATAGRAMS * 1400 // 13
        assert counts.events + counts.out_of_order == 6000
        assert np.all(np.diff(sum(parts).t) >= 0)


def test_pixels_off_the_sensor_are_counted():
    with open_udp("faery8") as stream:
        got = through(stream, some(1000, size=(640, 480)), "faery8")
        inside = some(1000, size=(640, 480)).inside((0, SIZE[0]), (0, SIZE[1]))
        assert (columns(got), stream.counts.outside) == (columns(inside), 1000 - len(inside))


@pytest.mark.parametrize("format", CODINGS)
def test_bytes_that_are_no_events_do_no_harm(format):
    """Odd lengths, nothing, random bytes, the largest datagram; then all is as before."""
    draw = np.random.default_rng(3)
    with open_udp(format) as stream:
        bad = [draw.bytes(size) for size in (1, 3, 7, 1399, 65_507, *draw.integers(0, 3000, 50))]
        put(stream, b"", *bad)
        noise = taken(stream, 1 + len(bad))
        assert np.all(np.diff(noise.t) >= 0)
        assert noise.x.max(initial=0) < SIZE[0]
        assert noise.y.max(initial=0) < SIZE[1]
        counts = stream.counts
        assert counts.damaged > 0
        assert counts.datagrams == 1 + len(bad)
        after = some(100, start=10**9)
        assert columns(through(stream, after, format)) == columns(after)


def test_the_whole_part_of_a_damaged_datagram_counts():
    with open_udp("faery13") as stream:
        put(stream, some(3).records().tobytes()[:-1], b"\xff" * 13)
        assert (taken(stream, 2), stream.counts.damaged) == (some(3)[:2], 2)


def test_evt3_waits_for_time_and_row_after_a_loss():
    """What follows a loss has neither; the next time and row are right again."""
    high, low, row, event = 8 << 12 | 1, 6 << 12 | 5, 10, 2 << 12 | 20
    with open_udp("raw-evt3", buffer=1 << 18) as stream:
        words = struct.pack("<4H", high, low, row, event)
        put(stream, words)
        assert taken(stream, 1).t.tolist() == [4096 + 5]
        put(stream, *[words + struct.pack("<H", event) * 30_000] * 8)
        deadline = time.monotonic() + 5.0
        while not stream.counts.dropped_buffer and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.05)
        stream.take()
        put(stream, struct.pack("<5H", event, high + 1, event, 11, event + 1))
        assert stream.wait(5.0)
        after = stream.take()
        assert stream.counts.dropped_buffer > 0
        assert (after.t.tolist(), after.x.tolist(), after.y.tolist()) == ([2 * 4096], [21], [11])


@pytest.mark.parametrize("size", [2, 34, 1000])
def test_evt3_may_be_cut_anywhere(size, tmp_path):
    """The words of a file, in datagrams that begin in the middle of rows and vectors."""
    events = some(2000, size=(40, 20))
    save(events, tmp_path / "a.raw", format="evt3")
    data = (tmp_path / "a.raw").read_bytes()
    words = data[data.index(b"% end\n") + 6 :]
    with open_udp("raw-evt3") as stream:
        cuts = range(0, len(words), size)
        put(stream, *(words[k : k + size] for k in cuts))
        got = taken(stream, len(cuts))
        assert (got.t.tolist(), columns(got), stream.counts.lost) == (events.t.tolist(), columns(events), {})


def test_full_buffer_drops_and_counts():
    """Each datagram is taken, refused by the buffer, or refused by the system."""
    data = some(5000).records().tobytes()
    with open_udp("faery13", buffer=1 << 18) as stream:
        put(stream, *[data] * 100)
        time.sleep(0.1)
        stream.take()
        counts = stream.counts
        assert counts.dropped_buffer > 0
        assert counts.datagrams + counts.dropped_buffer + counts.dropped_kernel == 100
        assert counts.lost.keys() >= {"dropped_buffer"}


def stop(receiver):
    """Stop the thread of a receiver, which stays open."""
    receiver._state[ring_kernel.STOP] = 1
    receiver._thread.join()
    receiver._state[ring_kernel.STOP] = 0


@pytest.mark.skipif(sys.platform != "linux", reason="the queue is counted by Linux")
def test_what_the_system_drops_is_counted():
    """A listener whose thread stands still, so that the system's queue fills."""
    with open_udp("faery13") as stream:
        receiver = stream._receiver
        stop(receiver)
        receiver._sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        put(stream, *[some(100).records().tobytes()] * 50)
        receiver._thread = threading.Thread(target=receiver._run, daemon=True)
        receiver._thread.start()
        stream.wait(5.0)
        time.sleep(0.1)
        stream.take()
        counts = stream.counts
        assert counts.dropped_kernel > 0
        assert counts.datagrams + counts.dropped_kernel == 50


@settings(max_examples=40, deadline=None)
@given(sizes=st.lists(st.integers(0, ring_kernel.LARGEST), max_size=40), takes=st.integers(1, 7))
def test_no_entry_of_the_ring_lies_over_another(sizes, takes):
    """Where entries go is a function of numbers; those that wait never share a byte."""
    index = np.zeros((8, ring_kernel.FIELDS), np.int64)
    room, at, put_, taken_ = 4 * ring_kernel.LARGEST, 0, 0, 0
    for k, size in enumerate(sizes):
        at = ring_kernel.place.py_func(at, put_, taken_, index, room)
        if at < 0:
            taken_, at = put_, 0
            continue
        index[put_ % 8, :2] = at, size
        put_ += 1
        waiting = sorted(tuple(index[e % 8, :2]) for e in range(taken_, put_))
        assert all(a + n <= b for (a, n), (b, _) in pairwise(waiting))
        assert waiting[-1][0] + ring_kernel.LARGEST <= room
        at += (size // ring_kernel.ALIGNED + 1) * ring_kernel.ALIGNED
        taken_ += k % takes == 0


@contextmanager
def put_after(seconds: float, stream):
    timer = threading.Timer(seconds, put, (stream, faery8(1)))
    timer.start()
    yield
    timer.join()


def test_wait_returns_when_something_comes():
    with open_udp("faery8") as stream:
        assert not stream.wait(0.01)
        with put_after(0.05, stream):
            begin = time.monotonic()
            assert stream.wait(10.0)
            assert time.monotonic() - begin < 5.0
            assert stream.wait(0.0)
            assert len(stream.take()) == 1


def test_a_loop_gives_parts_until_silence():
    events = some(2000, span=50_000)
    with open_udp("faery13", until_silent=0.2, tick_ms=5.0) as stream:
        thread = threading.Thread(target=send, args=(stream.url, events), kwargs={"format": "faery13"})
        thread.start()
        parts = list(stream)
        thread.join()
        assert stream.ended
        assert sum(parts) == events
        assert 3 <= len(parts) <= 20


def test_silence_counts_from_the_first_datagram():
    with open_udp("faery8", until_silent=0.05) as stream:
        time.sleep(0.1)
        assert not stream.ended
        with put_after(0.1, stream):
            assert [len(part) for part in stream] == [1]
            assert stream.ended


def test_a_first_datagram_is_not_waited_for_for_ever():
    with open_udp("faery8", first_within=0.05) as stream:
        assert list(stream) == []
        assert stream.ended
        put(stream, faery8(1))
        assert stream.wait(5.0)
        assert not stream.ended
        stream.take()
        time.sleep(0.06)
        assert not stream.ended


def test_a_listener_that_is_dropped_frees_its_thread_and_its_port(frozen_heap):
    stream = open_udp("faery8")
    url, thread = stream.url, stream._receiver._thread
    before = len(os.listdir("/proc/self/fd")) if sys.platform == "linux" else 0
    del stream
    gc.collect()
    thread.join(5.0)
    assert not thread.is_alive()
    assert not before or len(os.listdir("/proc/self/fd")) == before - 3
    with listen(url, format="faery8", sensor=SIZE):
        pass


def test_filters_and_representations_take_a_stream():
    events, clean = some(2000, span=50_000), filters.Refractory(SIZE, period_us=3000)
    with open_udp("faery13", until_silent=0.2) as stream:
        send(stream.url, events, format="faery13", speed=float("inf"))
        got = sum(clean.stream(stream))
        assert got == clean.fresh().apply(events)
        assert np.array_equal(representations.event_frame(got), representations.event_frame(clean.apply(events)))


def test_speed_of_sending():
    events = some(1000, span=200_000)
    with open_udp("faery13") as stream:
        begin, sent = time.monotonic(), send(stream.url, events, format="faery13", speed=2.0)
        assert 0.09 <= time.monotonic() - begin < 2.0
        assert (sent.events, taken(stream, sent.datagrams)) == (1000, events)


def test_parts_and_files_are_sent(tmp_path):
    events = some(300, span=10**6)
    save(events, tmp_path / "a.npz")
    with open_udp("faery13") as stream:
        for given_ in (str(tmp_path / "a.npz"), [events[:100], events[100:]], iter([events]), events.records()):
            sent = send(stream.url, given_, format="faery13", speed=float("inf"))
            assert len(taken(stream, stream.counts.datagrams + sent.datagrams)) == 300


def served(events: Events, server) -> threading.Thread:
    def run():
        server.wait()
        paced([events], server, float("inf"))

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_aedat4_by_tcp():
    events, server = some(20_000, start=10**15), channel(f"tcp://{HOST}:0", None, None)
    thread = served(events, server)
    with listen(server.url, until_silent=0.3) as stream:
        assert stream.sensor_size == SIZE
        got = sum(stream)
        thread.join()
        server.close()
    assert (got, stream.counts.lost) == (events, {})


@contextmanager
def answering(data: bytes):
    """The URL of a server that says this to the first who connects."""
    with socket.create_server((HOST, 0)) as server:

        def answer():
            with server.accept()[0] as client:
                client.sendall(data)

        thread = threading.Thread(target=answer)
        thread.start()
        yield f"tcp://{HOST}:{server.getsockname()[1]}"
        thread.join()


def test_packets_of_a_file_by_tcp(tmp_path):
    """What a file has behind its first line is what comes by TCP; its packets are compressed."""
    from neuro.events.formats import aedat4

    events = some(20_000)
    save(events, tmp_path / "a.aedat4")
    data = (tmp_path / "a.aedat4").read_bytes()
    end = int.from_bytes(data[aedat4._HEAD_OF_TABLE :][:8], "little")
    with answering(data[len(aedat4.MAGIC) : end]) as url, listen(url) as stream:
        assert wait_for(stream, 20_000) == events


@pytest.mark.parametrize(("start", "lost"), [(20_000, {"connections": 1}), (0, {"restarts": 1, "connections": 1})])
def test_a_sender_that_dies_and_comes_back(start, lost):
    """The connection is made anew; what came before and after is there.

    By TCP nothing comes in another order, so a clock that falls back is a new one, by however little.
    """
    first = channel(f"tcp://{HOST}:0", None, None)
    thread = served(some(100), first)
    with listen(first.url) as stream:
        thread.join()
        assert len(wait_for(stream, 100)) == 100
        first.close()
        second = channel(first.url, None, None)
        second.wait()
        paced([some(50, start=start)], second, float("inf"))
        assert len(wait_for(stream, 50)) == 50
        second.close()
        assert stream.counts.lost == lost


def wait_for(stream, count: int) -> Events:
    parts, deadline = [stream.take()], time.monotonic() + 10.0
    while sum(map(len, parts)) < count and time.monotonic() < deadline:
        stream.wait(0.1)
        parts.append(stream.take())
    return sum(parts)


def test_packets_that_are_none_break_the_connection():
    server = channel(f"tcp://{HOST}:0", None, None)
    thread = served(some(10), server)
    with listen(server.url) as stream:
        thread.join()
        assert len(wait_for(stream, 10)) == 10
        (reader,) = server._readers
        reader.sendall(struct.pack("<ii", 0, 40) + b"\x01" * 40)
        stream.wait(5.0)
        stream.take()
        server.wait()  # it has connected anew
        server.put(some(5, start=20_000))
        assert (len(wait_for(stream, 5)), stream.counts.damaged, stream.counts.connections) == (5, 1, 1)
        server.close()


def test_killed_sender_ends_in_silence():
    code = """if True:
        import sys; import numpy as np; from neuro.events import Events, send
        t = np.arange(10**6) * 10
        send(sys.argv[1], Events(t, t * 0, t * 0, t * 0, (346, 260)), format='faery8')"""
    with open_udp("faery8", until_silent=3.0) as stream:
        sender, parts = subprocess.Popen([sys.executable, "-c", code, stream.url]), iter(stream)
        count = len(next(parts))
        sender.kill()
        sender.wait()
        stream._until_silent = 0.2
        assert count + sum(map(len, parts)) == stream.counts.events > 0


UDP, FREE, THERE = {"format": "spif", "sensor": SIZE}, f"udp://{HOST}:0", f"udp://{HOST}:9"
SILENT = Events(np.array([0, 1 << 33]), *[np.zeros(2, int)] * 3, SIZE)


def test_mistakes_are_told_in_one_sentence(messages):
    with open_udp("spif") as stream:
        messages.calls(globals() | locals())
        assert "another program listens at this port" in refused(listen, stream.url, **UDP)
        assert "unknown host 'no-such-host.invalid'" in refused(listen, "udp://no-such-host.invalid:1", **UDP)


def test_a_port_that_may_not_be_used(messages, monkeypatch):
    def refuse(self, place):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    messages.calls(globals())


def test_a_server_of_something_else():
    with answering(b"HTTP/1.1 400 Bad Request\r\n\r\n") as url:
        assert "does not send AEDAT 4" in refused(listen, url)


def test_addresses_of_six_parts():
    try:
        stream = listen("udp://[::1]:0", format="faery13", sensor=SIZE)
    except ModelError as error:
        pytest.skip(str(error))
    with stream:
        assert through(stream, some(10), "faery13") == some(10)


def test_closing_twice_and_taking_after():
    """What had arrived at the call is received, here by a thread that begins only then."""
    stream = open_udp("faery13")
    receiver = stream._receiver
    stop(receiver)
    send(stream.url, some(10), format="faery13")
    receiver._thread = threading.Timer(0.05, receiver._run)
    receiver._thread.start()
    stream.close()
    stream.close()
    assert not stream.ended
    assert stream.take() == some(10)
    assert stream.ended
    assert (list(stream), stream.counts.dropped_kernel) == ([], 0)
