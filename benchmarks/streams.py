"""Network streams over the loopback: rate, losses, and the time until a waiting program wakes up.

    python benchmarks/streams.py rate [--format faery8] [--rate 5e6]    events a second, and what is lost
    python benchmarks/streams.py busy [--format faery8] [--rate 5e6]    the same, by an interpreter that computes
    python benchmarks/streams.py wake                                   from a datagram's sending to `wait`'s return

The sender is another process, on the last core if there are several. This process is bound to the first core. The delay
of a wake-up is printed beside that of an empty loop in the same run, in which `time.sleep` of half a millisecond
returns late.
"""

from __future__ import annotations

import argparse
import os
import resource
import socket
import subprocess
import sys
import time

import numpy as np

from neuro.events import EVENT, Events, Listener, listen
from neuro.events.streams._sender import channel

SIZE = (640, 480)


def recording(n: int, rate: float) -> Events:
    """Return n events at a constant rate, at random places."""
    draw = np.random.default_rng(0)
    x, y, p = draw.integers(0, SIZE[0], n), draw.integers(0, SIZE[1], n), draw.integers(0, 2, n)
    return Events(np.arange(n) * 1_000_000 // int(rate), x, y, p, SIZE)


def sender(url: str, format: str, rate: float, seconds: float, datagram: int) -> None:
    """Send encoded datagrams, each at its time. Print the numbers of events and datagrams."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    part = recording(int(min(rate, 2e6)), rate)
    to = channel(url, format, datagram)
    made = [bytes(data) for data in to._encode(part, to._size)]  # type: ignore[attr-defined]
    period = len(part) / rate / len(made)
    host, port = url.removeprefix("udp://").split(":")
    place = (host, int(port))
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    total = round(seconds / period)
    begin = time.perf_counter()
    sent = 0
    while sent < total:
        due = min(total, int((time.perf_counter() - begin) / period) + 1)
        while sent < due:
            sock.sendto(made[sent % len(made)], place)
            sent += 1
        time.sleep(0.0002)
    lap = time.perf_counter() - begin
    whole, rest = divmod(sent, len(made))
    sizes = np.cumsum([0, *map(len, made)]) // {"faery8": 8, "faery13": 13, "spif": 4, "spif-timed": 8}[format]
    print(f"{whole * len(part) + int(sizes[rest])} {sent} {lap}", flush=True)


def ticks(url: str, seconds: float) -> None:
    """Send an event each millisecond, whose time is the present in us."""
    host, port = url.removeprefix("udp://").split(":")
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    event = np.zeros(1, EVENT)
    for _ in range(round(1000 * seconds)):
        event["t"] = time.monotonic_ns() // 1000
        sock.sendto(event.tobytes(), (host, int(port)))
        time.sleep(0.001)


def started(stream: Listener, format: str, rate: float, seconds: float, datagram: int) -> subprocess.Popen[str]:
    words = ["send", "--url", stream.url, "--format", format, "--rate", str(rate), "--seconds", str(seconds)]
    words += ["--datagram", str(datagram)]
    return subprocess.Popen([sys.executable, __file__, *words], stdout=subprocess.PIPE, text=True)


def rate(args: argparse.Namespace, busy: bool) -> None:
    """Take events each millisecond. If `busy`, compute in plain Python for 4 ms between takes."""
    with listen("udp://127.0.0.1:0", format=args.format, sensor=SIZE) as stream:
        process = started(stream, args.format, args.rate, args.seconds, args.datagram)
        stream.wait(30.0)
        before, taking = resource.getrusage(resource.RUSAGE_SELF), 0.0
        takes = 0
        while process.poll() is None or stream.wait(0.2):
            if busy:
                end = time.perf_counter() + 0.004
                while time.perf_counter() < end:
                    pass
            else:
                stream.wait(0.1)
                time.sleep(0.001)
            begin = time.perf_counter()
            stream.take()
            taking += time.perf_counter() - begin
            takes += 1
        used = resource.getrusage(resource.RUSAGE_SELF)
        events, datagrams, lap = map(float, process.stdout.read().split())  # type: ignore[union-attr]
        counts = stream.counts
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    lost = datagrams - counts.datagrams
    print(f"sent      {events:,.0f} events in {datagrams:,.0f} datagrams, {events / lap:,.0f} events a second")
    print(f"received  {counts.events:,} events in {counts.datagrams:,} datagrams")
    known = counts.dropped_buffer + (counts.dropped_kernel or 0)
    print(f"lost      {lost:,.0f} datagrams; kernel {counts.dropped_kernel}, buffer {counts.dropped_buffer}: "
          f"{lost - known:,.0f} not explained")  # fmt: skip
    print(f"take      {1e6 * taking / takes:.0f} us each, {1e9 * taking / max(1, counts.events):.2f} ns an event; "
          f"the process used {cpu / lap:.0%} of a core")  # fmt: skip
    print(f"other     {counts.lost}; largest resident size {used.ru_maxrss / 1024:.0f} MB, "
          f"{before.ru_maxrss / 1024:.0f} MB at the first event")  # fmt: skip


def wake(args: argparse.Namespace) -> None:
    """Receive a datagram each millisecond, with an event whose time is the time of sending."""
    sent, late, empty = [], [], []
    with listen("udp://127.0.0.1:0", format="faery13", sensor=SIZE) as stream:
        process = started(stream, "ticks", 1000.0, args.seconds, 13)
        while process.poll() is None or stream.wait(0.2):
            if stream.wait(0.1):
                now = time.monotonic_ns()
                events = stream.take()
                assert stream.received_ns is not None
                late.append((now - stream.received_ns) / 1e3)
                sent.append(now / 1e3 - events.t[0])
                begin = time.monotonic_ns()
                time.sleep(0.0005)
                empty.append((time.monotonic_ns() - begin) / 1e3 - 500)
        print(f"{stream.counts.datagrams:,} datagrams, lost: {stream.counts.lost}")
    for name, values in (("sending", sent), ("receipt", late), ("empty loop", empty)):
        p50, p99, p999 = np.percentile(values, (50, 99, 99.9))
        print(f"{name:<10}  p50 {p50:6.0f} us  p99 {p99:6.0f} us  p99.9 {p999:6.0f} us  largest {max(values):6.0f} us")


def main() -> None:
    """Run the chosen command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("rate", "busy", "wake", "send"))
    parser.add_argument("--format", default="faery8", choices=("spif", "spif-timed", "faery13", "faery8", "ticks"))
    parser.add_argument("--rate", type=float, default=5e6)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--datagram", type=int, default=1400)
    parser.add_argument("--url")
    args = parser.parse_args()
    if args.what == "send":
        if args.format == "ticks":
            ticks(args.url, args.seconds)
            return
        sender(args.url, args.format, args.rate, args.seconds, args.datagram)
        return
    cores = os.sched_getaffinity(0)
    if len(cores) > 1:
        os.sched_setaffinity(0, cores - {max(cores)})
    wake(args) if args.what == "wake" else rate(args, args.what == "busy")


if __name__ == "__main__":
    main()
