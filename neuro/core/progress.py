"""Progress of long work on stderr: a bar on a terminal, else a line every ten seconds."""

from __future__ import annotations

import sys
import time
from typing import Any

from neuro.core.system import shared

EVERY_S = 10.0
"""Seconds between two printed lines."""
STRETCH_S = 0.2
"""Seconds of a stretch of `advance`."""


def _is_terminal() -> bool:
    """Return True if stderr is a terminal; stderr is None if it was closed before the start."""
    return sys.stderr is not None and sys.stderr.isatty()


class Bar:
    """A progress bar with a description and the remaining time. The bar disappears at the end.

    If stderr is no terminal, e.g. a log, a line is printed every ten seconds instead.
    """

    def __enter__(self) -> Bar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._moves = _is_terminal()
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._moves)
        self._task = self._bar.add_task("", total=None)
        self._bar.start()
        self._began = self._told = time.monotonic()
        self._done = self._from = 0.0
        return self

    def __exit__(self, *error: Any) -> None:
        self.stop()

    def stop(self) -> None:
        """Remove the bar."""
        self._bar.stop()

    def say(self, text: str) -> None:
        """Show a description of work whose duration is unknown."""
        self._bar.update(self._task, description=text, total=None)
        self._line(text)

    def begin(self, done: float) -> None:
        """Start the clock at an amount of completed work. The estimate of the remaining time ignores this work."""
        self._bar.reset(self._task)
        self._began, self._done, self._from = time.monotonic(), done, done

    def show(self, done: float, total: float, text: str, line: bool = True) -> None:
        """Show the progress. An amount below the previous one restarts the clock.

        Args:
            done: completed amount.
            total: total amount.
            text: description.
            line: whether to print a line if stderr is no terminal; False if the work is logged otherwise.
        """
        if done < self._done:
            self._bar.reset(self._task)
            self._began, self._from = time.monotonic(), 0.0
        self._done = done
        self._bar.update(self._task, description=text, completed=done, total=total)
        work_done = done - self._from
        remaining_s = (time.monotonic() - self._began) * (total - done) / work_done if work_done else 0.0
        if line:
            self._line(f"{text}, {remaining_s:,.0f} s left" if remaining_s >= 1 else text)

    def keep(self, text: str) -> None:
        """Print a line that stays."""
        self._console.print(text, markup=False)

    def _line(self, text: str) -> None:
        time_s = time.monotonic()
        if not self._moves and sys.stderr is not None and time_s - self._told >= EVERY_S:
            self._told = time_s
            self.keep(text)


def advance(sim: Any, steps: int, bar: Bar) -> float:
    """Run a simulation in stretches of about 0.2 s. Between stretches the bar moves and Ctrl-C is handled.

    The results have the same bits as a single run. Processes that share a network must keep step: they run all steps in
    one stretch.

    Args:
        sim: a simulation of `neuro.compile`, or an object that runs like it.
        steps: number of steps.
        bar: bar that shows the progress.

    Returns:
        Seconds of the first step, if there are several steps; else 0. The first step may compile kernels, so its
        duration says nothing about the others.
    """
    from neuro.core.clock import Clock  # imports numpy, which would slow down the start of each command

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
        elapsed_s = time.perf_counter() - began
        done += stretch
        if done == 1 < steps:
            first_s = elapsed_s
            bar.begin(done)
        else:
            rate = clock.ms(stretch) / elapsed_s
            bar.show(done, steps, f"{clock.ms(done):,.0f} of {clock.ms(steps):,.0f} ms, {rate:,.0f} ms/s")
        stretch = max(1, int(stretch * min(10.0, STRETCH_S / elapsed_s)))
    return first_s
