"""A bar on stderr while something is learnt."""

from __future__ import annotations

from typing import Any

from neuro.apps import Bar as Line
from neuro_recognise.method import Progress

__all__ = ["LearningBar"]


class LearningBar:
    """What is being done and how far it is, and a line that stays for each thing that is done and was decided on."""

    def __enter__(self) -> LearningBar:
        self._line = Line().__enter__()
        self._line.say("preparing")
        return self

    def __exit__(self, *error: Any) -> None:
        self._line.stop()

    def show(self, progress: Progress) -> None:
        """Show how far a training is."""
        text = progress.what
        if progress.right is not None:
            text += f": {progress.right:.1%} right"
        if progress.among is None:
            self._line.show(progress.done, progress.total, text)
        else:
            done, total = progress.among
            self._line.show(done, total, f"{done} of {total} done; {text}")
        if progress.done == progress.total and progress.right is not None:
            self._line.keep(text)
