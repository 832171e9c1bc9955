"""How far a long run is, on stderr and only where that is a terminal."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from neuro.run.simulation import Simulation

STRETCH_S = 0.2


def _is_terminal() -> bool:
    """Whether stderr is one; it is None where it was closed before the start."""
    return sys.stderr is not None and sys.stderr.isatty()


class Bar:
    """A bar of biological time with the rate of the run; nothing of it stays."""

    def __enter__(self) -> Bar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True), transient=True, disable=not _is_terminal())
        self._task = self._bar.add_task("", total=None)
        self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self.stop()

    def stop(self) -> None:
        """Take the bar away."""
        self._bar.stop()

    def say(self, text: str) -> None:
        """Say what is going on, how long it takes being unknown."""
        self._bar.update(self._task, description=text, total=None)

    def show(self, done_ms: float, total_ms: float, rate: float) -> None:
        """Show the biological time reached, and the rate in ms per second."""
        text = f"{done_ms:,.0f} of {total_ms:,.0f} ms, {rate:,.0f} ms/s"
        self._bar.update(self._task, description=text, completed=done_ms, total=total_ms)


def advance(sim: Simulation, steps: int, bar: Bar) -> None:
    """Run in stretches of about a fifth of a second, between which the bar moves and Ctrl-C is heard.

    Processes that share a network must keep step, so they run at once.
    """
    from neuro.core.clock import Clock
    from neuro.core.launch import shared

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
        bar.show(clock.ms(done), clock.ms(steps), clock.ms(stretch) / taken)
        stretch = max(1, int(stretch * min(10.0, STRETCH_S / taken)))
