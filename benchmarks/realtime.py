"""The loop in real time: duration of feeding and delay of actions, beside an empty loop in the same run.

    python benchmarks/realtime.py [--seconds 10] [--rows 346x260] [--udp] [--out FILE.h5]
    sudo chrt --fifo 1 python benchmarks/realtime.py

Each row has a camera with noise at a rate, a length of a tick, and a network on grids. Events are played from memory in
the same process by a `Player`. With `--udp` another process on the other core sends them over the loopback. *tick to
action* is the part of the network: take and feed events, run, and read counts with a port. *event to action* includes
the wait for the next tick; with UDP it is counted from the oldest datagram of a tick. If other programs use the cores,
the figures of the empty loop show their share. With `chrt` the loop has priority over them.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np

import neuro
from neuro.events import Events
from neuro.realtime import Loop, Player, Source, empty_loop

ROWS = {
    # width, height, events a second, ms of a tick, stride of the first grid
    "64x48": (64, 48, 1e5, 1.0, 4),
    "346x260": (346, 260, 1e6, 1.0, 4),
    "640x480": (640, 480, 5e6, 5.0, 7),
}
ROUNDS = 500


def network(width: int, height: int, stride: int) -> neuro.Network:
    """Return a network with maps of edges, and with maps on top of these.

    With 346 x 260 px it has 43,000 neurons besides the pixels.
    """
    net = neuro.Network("live", resolution=1.0)
    net.population("camera", (2, height, width), neuro.event_camera())
    cells = neuro.iaf_psc_delta(tau_m=10.0, V_th=-66.0)
    weight = neuro.uniform(low=0.0, high=0.5)
    net.population("edges", (4, "auto", "auto"), cells)
    net.population("shapes", (4, "auto", "auto"), cells)
    net.population("places", (1, "auto", "auto"), cells)
    net.connect("camera", "edges", neuro.grid(kernel=[5, 5], stride=stride), weight=weight)
    net.connect("edges", "shapes", neuro.grid(kernel=[5, 5]), weight=weight)
    net.connect("shapes", "places", neuro.grid(kernel=[5, 5], stride=2), weight=weight)
    return net


def noise(width: int, height: int, n: int, us: int, begin: int = 0) -> Events:
    """Return n events at random places, and at random times within `us`."""
    rng = np.random.default_rng(begin)
    t = begin + np.sort(rng.integers(0, us, n))
    return Events(t, rng.integers(0, width, n), rng.integers(0, height, n), rng.integers(0, 2, n), (width, height))


def feeding(width: int, height: int, n: int, tick: float) -> float:
    """Return the median duration of `sim.feed` with n events, ms."""
    net = neuro.Network("fed", resolution=1.0)
    net.population("camera", (2, height, width), neuro.event_camera())
    sim, us, taken = neuro.compile(net), round(1000 * tick), []
    for k in range(ROUNDS):
        events = noise(width, height, n, us, k * us)
        began = time.perf_counter()
        sim.feed("camera", events)
        taken.append(time.perf_counter() - began)
        sim.run(tick)
    return 1000.0 * float(np.median(taken[20:]))


@contextmanager
def sender(url: str, width: int, height: int, rate: float, seconds: float) -> Iterator[None]:
    """Run another process that sends noise over the loopback, at normal priority."""
    words = (url, width, height, rate, seconds)
    with subprocess.Popen(["chrt", "--other", "0", sys.executable, __file__, "--send", *map(str, words)]) as process:
        yield
        process.terminate()


def send(url: str, width: str, height: str, rate: str, seconds: str) -> None:
    """Send noise in parts of 100 ms, each at its time, in the process of `sender`."""
    n = round(float(rate) / 10)
    parts = (noise(int(width), int(height), n, 100_000, 100_000 * k) for k in range(round(10 * float(seconds))))
    neuro.events.send(url, parts, format="faery8")


def main() -> None:
    """Print a row for each camera."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rows", nargs="+", default=list(ROWS), choices=ROWS, help="cameras, all if not given")
    parser.add_argument("--out", help="also record to this file")
    parser.add_argument("--udp", action="store_true")
    parser.add_argument("--send", nargs=5, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.send:
        send(*asked.send)
        return
    for width, height, rate, tick, stride in map(ROWS.__getitem__, asked.rows):
        n = round(rate * tick / 1000.0)
        nothing, fed = (feeding(width, height, m, tick) for m in (0, n))
        sim = neuro.compile(network(width, height, stride), seed=1)
        neurons = sum(part.size for part in sim.program.populations[1:])
        counts, room = sim.port("places", "counts"), np.zeros(sim.program.populations[-1].size, dtype=np.int64)
        before = empty_loop(tick, 1000.0)
        with ExitStack() as stack:
            source: Source
            if asked.udp:
                listener = neuro.events.listen("udp://127.0.0.1:0", format="faery8", sensor=(width, height))
                source = stack.enter_context(listener)
                stack.enter_context(sender(listener.url, width, height, rate, asked.seconds + 30.0))
                listener.wait(30.0)
            else:
                source = Player(noise(width, height, round(rate * asked.seconds), round(1e6 * asked.seconds)))
            loop = Loop(sim, tick=tick, inputs={"camera": source}, act=lambda ms, c=counts, r=room: c.get(r))
            run = loop.run(1000.0 * asked.seconds, out=asked.out)
        print(f"{width}x{height}, {rate:,.0f} events/s, ticks of {tick:g} ms, {neurons:,} neurons")
        print(f"  feed: {nothing:.3f} ms + {1e6 * (fed - nothing) / n:.1f} ns an event ({n:,} events: {fed:.3f} ms)")
        for name, h in (
            ("tick to action", run.response),
            ("event to action", run.latency),
            ("empty loop, in the same ticks", run.empty),
            ("empty loop, a second before", before),
        ):
            print(f"  {name:<30} {h}")
        print(f"  {run.inputs['camera']}")
        print("  " + ", ".join(f"{word} {h.ms(0.5):.3f} / {h.ms(0.99):.3f}" for word, h in run.phases.items()))
        late = f"{run.misses:,} of {run.ticks:,} ticks missed, preempted {run.cost.preempted:,} times"
        number, phases = run.largest_tick
        slowest = ", ".join(f"{word} {ms:.3f}" for word, ms in phases.items())
        print(f"  slowest tick {number:,}: {slowest}; {run.cost.minor_faults:,} page faults")
        print(f"  {late}, {run.drops:,} drops")


if __name__ == "__main__":
    main()
