"""A bar on stderr while something is learnt."""

from __future__ import annotations

import sys
from typing import Any

from neuro_recognise.method import Progress

__all__ = ["Bar"]


class Bar:
    """A bar with what is being done, and a line that stays for each thing that is done and was decided on."""

    def __enter__(self) -> Bar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._console = Console(stderr=True, highlight=False)
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=self._console, transient=True)
        self._task, self._what = self._bar.add_task("preparing", total=None), "preparing"
        if sys.stderr.isatty():
            self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        if sys.stderr.isatty():
            self._bar.stop()

    def show(self, progress: Progress) -> None:
        """Show how far a training is."""
        text = progress.what
        if progress.right is not None:
            text += f": {progress.right:.1%} right"
        if progress.what != self._what:
            self._bar.reset(self._task)
        self._what = progress.what
        self._bar.update(self._task, description=text, completed=progress.done, total=progress.total)
        if progress.done == progress.total and progress.right is not None:
            self._console.print(text)
