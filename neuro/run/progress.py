"""A run in stretches, so that it can be seen how far it is."""

from __future__ import annotations

import time
from typing import Protocol

from neuro.core.clock import Clock
from neuro.core.launch import shared
from neuro.core.progress import Bar
from neuro.program.program import Program

STRETCH_S = 0.2


class Runs(Protocol):
    """A simulation."""

    program: Program

    def run(self, ms: float) -> None:
        """Advance."""

    def check_room(self, steps: int) -> None:
        """Refuse a run that records too much."""


def advance(sim: Runs, steps: int, bar: Bar) -> float:
    """Run in stretches of about a fifth of a second, between which the bar moves and Ctrl-C is heard.

    Running in parts gives the same bits. Processes that share a network must keep step, so they run at once.

    Returns:
        how long the first step took in s where others follow: in it kernels are compiled, once on a machine, which
        reports nothing of the others; else 0.
    """
    clock = Clock(sim.program.resolution)
    sim.check_room(steps)
    if shared():
        sim.run(clock.ms(steps))
        return 0.0
    done, stretch, first_s = 0, 1, 0.0
    while done < steps:
        stretch = min(stretch, steps - done)
        began = time.perf_counter()
        sim.run(clock.ms(stretch))
        taken = time.perf_counter() - began
        done += stretch
        if done == 1 < steps:
            first_s = taken
            bar.begin(done)
        else:
            rate = clock.ms(stretch) / taken
            bar.show(done, steps, f"{clock.ms(done):,.0f} of {clock.ms(steps):,.0f} ms, {rate:,.0f} ms/s")
        stretch = max(1, int(stretch * min(10.0, STRETCH_S / taken)))
    return first_s
