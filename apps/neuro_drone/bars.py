"""How far a command is, on stderr: bars on a terminal, some lines elsewhere."""

from __future__ import annotations

import sys
from collections import defaultdict, deque
from collections.abc import Callable
from typing import Any

import typer

from neuro_drone.evaluate import Lap
from neuro_drone.train import TrainingProgress

__all__ = ["Bars"]

LAST = 20
"""Episodes of which the mean error is shown."""

LINES = 10
"""Lines of each training where there is no terminal."""


class Bars:
    """One bar for each thing that is under way.

    Args:
        lines: that are printed of each where there is no terminal.
    """

    def __init__(self, lines: int = LINES) -> None:
        self._lines = lines

    def __enter__(self) -> Bars:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._screen = sys.stderr.isatty()
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        where = Console(stderr=True, highlight=False)
        self._bar = Progress(*columns, console=where, transient=True, disable=not self._screen)
        self._tasks: dict[str, Any] = {}
        self._said: dict[str, int] = {}
        self._errors: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=LAST))
        self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.stop()

    def training(self, progress: TrainingProgress) -> None:
        """Show how far a training is, and its error of late."""
        what = f"seed {progress.seed}"
        errors = self._errors[what]
        errors.append(progress.error_px)
        message = f"{progress.step:,} of {progress.steps:,} steps, {sum(errors) / len(errors):.1f} px"
        self.at(what, progress.step, progress.steps, message)

    def laps(self, total: int) -> Callable[[Lap], None]:
        """What shows how many laps of so many are flown; only on a terminal."""
        flown: list[float] = []

        def show(lap: Lap) -> None:
            flown.append(lap.error_px)
            if self._screen:
                self.at("laps", len(flown), total, f"{len(flown)} of {total}, {sum(flown) / len(flown):.1f} px")

        return show

    def at(self, what: str, done: int, total: int, told: str) -> None:
        """Show how far something is; elsewhere than on a terminal some lines are printed."""
        text, part = f"{what}: {told}", done * self._lines // total
        if what not in self._tasks:
            self._tasks[what] = self._bar.add_task("", total=total)
            self._said[what] = 0
        self._bar.update(self._tasks[what], description=text, completed=done, total=total)
        if not self._screen and part > self._said[what]:
            typer.echo(text, err=True)
        self._said[what] = part
        if done >= total:
            self._bar.update(self._tasks[what], visible=len(self._tasks) == 1)
