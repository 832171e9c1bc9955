"""What the commands tell: progress, tables, JSON and pictures."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro import ModelError
from neuro.apps import console, sealed, table, write_picture
from neuro_remus.model import Model
from neuro_remus.settings import SETTINGS, Settings
from neuro_remus.train import Progress
from neuro_remus.tried import Tried

FORMAT = "neuro remus figures 1"
FIGURES = sealed("the figures of 'neuro remus demo'", f'"format": "{FORMAT}"', ', "digest": "{}"')

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Bar:
    """A bar on stderr with the accuracy so far, and a line that stays for each epoch."""

    def __enter__(self) -> Bar:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._console = Console(stderr=True, highlight=False)
        columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=self._console, transient=True)
        self._task = self._bar.add_task("preparing", total=None)
        if sys.stderr.isatty():
            self._bar.start()
        return self

    def __exit__(self, *error: Any) -> None:
        if sys.stderr.isatty():
            self._bar.stop()

    def show(self, progress: Progress) -> None:
        """Show how far a training is."""
        share = progress.correct / progress.done
        text = f"epoch {progress.epoch + 1} of {progress.epochs}: {share:.1%} of the frames right"
        done = progress.epoch * progress.total + progress.done
        self._bar.update(self._task, description=text, completed=done, total=progress.epochs * progress.total)
        if progress.done == progress.total:
            self._console.print(text)


def named(name: str) -> Settings:
    """The settings of a name.

    Raises:
        ModelError: there are none.
    """
    if name not in SETTINGS:
        raise ModelError(f"unknown settings '{name}': expected {' or '.join(SETTINGS)}")
    return SETTINGS[name]


def learnt(model: Model) -> str:
    """One line about a training."""
    grids, recordings = len(model.kernels), model.training["recordings"]
    return (
        f"{grids} grids for {len(model.classes)} classes, learnt from {recordings} recordings "
        f"in {len(model.history)} epochs; {model.history[-1]:.1%} of the last frames right"
    )


def figures(model: Model, tried: Tried) -> str:
    """All figures as JSON; those at the top are of the model's own vote."""
    own = model.settings.vote
    words = {"format": FORMAT, "vote": own, **tried.votes[own].as_words(), "classes": list(model.classes)}
    return json.dumps(words | {"votes": {vote: found.as_words() for vote, found in tried.votes.items()}}, indent=1)


def show(model: Model, tried: Tried) -> None:
    """Print the votes, and the confusion of the model's own."""
    rows = []
    for vote, found in tried.votes.items():
        low, high = found.interval
        name = f"{vote} *" if vote == model.settings.vote else vote
        rows.append((name, f"{found.accuracy:.1%}", f"{low:.1%} - {high:.1%}", found.correct, found.n))
    own = tried.votes[model.settings.vote]
    out = console()
    out.print(table(("vote", ">accuracy", ">95 % interval", ">right", ">of"), rows))
    columns = ("shown", *(f">{name}" for name in (*own.classes, "silent")))
    cells = ((name, *(n or "." for n in row)) for name, row in zip(own.classes, own.confusion.tolist(), strict=True))
    out.print(table(columns, cells, title=f"decided by {model.settings.vote}"))


def describe(model: Model) -> None:
    """Print what a model was trained with."""
    settings = model.settings.as_words()
    rows = [("classes", ", ".join(model.classes)), *model.training.items()]
    rows += [(name, settings[name]) for name in ("epochs", "order", "rate_decay", "vote")]
    rows += [(f"network: {name}", value) for name, value in settings["network"].items()]
    rows += [(f"front end: {name}", value) for name, value in settings["front"].items()]
    out = console()
    out.print(learnt(model))
    out.print(table(("what", "value"), rows))


def write_pictures(model: Model, folder: Path) -> None:
    """Draw the learnt grids and how the learning went."""
    from neuro_remus.pictures import history, prototypes

    _save(prototypes(model), folder / "prototypes.png")
    _save(history(model), folder / "learning.png")


def write_confusion(model: Model, tried: Tried, folder: Path) -> None:
    """Draw the confusion by the model's own vote."""
    from neuro_remus.pictures import confusion

    _save(confusion(tried.votes[model.settings.vote], model.settings.vote), folder / "confusion.png")


def _save(figure: Figure, file: Path) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_picture(file, figure)
    print(file)
