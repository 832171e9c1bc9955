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


def advance(sim: Runs, steps: int, bar: Bar) -> None:
    """Run in stretches of about a fifth of a second, between which the bar moves and Ctrl-C is heard.

    Running in parts gives the same bits. Processes that share a network must keep step, so they run at once.
    """
    clock = Clock(sim.program.resolution)
    if shared():
        sim.run(clock.ms(steps))
        return
    done, stretch = 0, 1
    while done < steps:
        stretch = min(stretch, steps - done)
        began = time.perf_counter()
        sim.run(clock.ms(stretch))
        taken = time.perf_counter() - began
        done += stretch
        rate = clock.ms(stretch) / taken
        bar.show(done, steps, f"{clock.ms(done):,.0f} of {clock.ms(steps):,.0f} ms, {rate:,.0f} ms/s")
        stretch = max(1, int(stretch * min(10.0, STRETCH_S / taken)))
