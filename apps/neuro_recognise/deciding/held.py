"""What was decided of recordings that were held out from training, and how often a decision of some margin is wrong.

With what was learnt of beginnings that is all that decisions while events arrive need.

In the file of a recogniser:

```
/early/times_us   moments since the first event, us
/early/margins    (recordings, moments) of held-out recordings
/early/right      (recordings, moments) whether the decision was right
/early/labels     (recordings,) index of the class of each; older files have none
/early/learnt/0   arrays and texts by name, of the first moment; and so on; none where all moments ask what was learnt
                  of whole recordings
```
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_recognise.method import Learnt
from neuro_recognise.shown import Floats, Ints

PARTS = 10
"""Of held-out recordings, when each is judged by the others: tenths leave 90 % to learn from."""


def margins(scores: Floats) -> Floats:
    """How far the largest score of each row is above the second; NaN where all of a row are, 0 with one class."""
    if scores.shape[-1] < 2:
        return np.where(np.isnan(scores[..., 0]), np.nan, 0.0)
    silent = np.isnan(scores).all(axis=-1)
    ordered = np.sort(np.where(np.isnan(scores), -np.inf, scores), axis=-1)
    above: Floats = np.full(silent.shape, np.nan)
    np.subtract(ordered[..., -1], ordered[..., -2], out=above, where=~silent)
    return above


@dataclass(frozen=True, eq=False)
class Held:
    """What was decided of recordings that were held out from training.

    Attributes:
        times_us: (moments,) since the first event, ascending.
        margins: (recordings, moments), NaN where nothing was decided.
        right: (recordings, moments) whether the decision was right.
        labels: (recordings,) index of the class of each; None if not known, as in older files.
    """

    times_us: Ints
    margins: Floats
    right: npt.NDArray[np.bool_]
    labels: Ints | None = None

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.right)

    def take(self, chosen: Ints | npt.NDArray[np.bool_]) -> Held:
        """Some of the recordings."""
        labels = None if self.labels is None else self.labels[chosen]
        return Held(self.times_us, self.margins[chosen], self.right[chosen], labels)

    def error(self, after_us: int, margin: float) -> float:
        """How likely a decision of this margin is wrong, at the moment before a time.

        Of n decisions with this margin or a larger one, w of them wrong, it is (w + 1) / (n + 2), Laplace's rule of
        succession: one right decision does not make certain. A larger margin never has the larger error: the least of
        those of all smaller margins is taken.

        Returns:
            NaN before the first moment, and where nothing was held out.
        """
        moment = int(np.searchsorted(self.times_us, after_us, "right")) - 1
        if moment < 0 or np.isnan(margin):
            return float("nan")
        from_margin, error = self._curves[moment]
        place = max(0, int(np.searchsorted(from_margin, margin, "right")) - 1)
        return float(error[place]) if error.size else float("nan")

    def errors(self, margins: Floats) -> Floats:
        """`error` of many decisions.

        Args:
            margins: (recordings, moments) of these or of other recordings, NaN where nothing was decided.

        Returns:
            (recordings, moments), NaN where nothing was decided.
        """
        found = np.full(margins.shape, np.nan)
        for moment, (from_margin, error) in enumerate(self._curves):
            there = np.flatnonzero(~np.isnan(margins[:, moment]))
            place = np.searchsorted(from_margin, margins[there, moment], "right") - 1
            if error.size:
                found[there, moment] = error[np.maximum(0, place)]
        return found

    @cached_property
    def parts(self) -> list[tuple[Ints, Held]]:
        """Tenths of the recordings, each spread over all, and what was decided of the other nine."""
        part = np.arange(len(self)) % PARTS
        return [(np.flatnonzero(part == k), self.take(part != k)) for k in range(min(PARTS, len(self)))]

    @cached_property
    def crossed(self) -> Floats:
        """(recordings, moments) `error` of each decision, by the other parts alone."""
        found = np.full(self.margins.shape, np.nan)
        for own, others in self.parts:
            found[own] = others.errors(self.margins[own])
        return found

    @cached_property
    def _curves(self) -> list[tuple[Floats, Floats]]:
        """Of each moment margins, ascending, and the error from each on."""
        return [self._curve(moment) for moment in range(len(self.times_us))]

    def _curve(self, moment: int) -> tuple[Floats, Floats]:
        there = ~np.isnan(self.margins[:, moment])
        from_margin, which = np.unique(self.margins[there, moment], return_inverse=True)
        wrong = np.bincount(which, ~self.right[there, moment], len(from_margin))
        number = np.bincount(which, minlength=len(from_margin))
        error = (np.cumsum(wrong[::-1])[::-1] + 1) / (np.cumsum(number[::-1])[::-1] + 2)
        return from_margin, np.minimum.accumulate(error)


@dataclass(frozen=True, eq=False)
class Early:
    """What decisions while events arrive need.

    Attributes:
        held: what was decided of held-out recordings, moment by moment.
        learnt: at each of these moments, of beginnings so long; empty where they are not learnt apart.
    """

    held: Held
    learnt: tuple[Learnt, ...] = ()

    def at(self, after_us: int) -> Learnt | None:
        """What was learnt of beginnings so long: of the last moment before, or the first; None if not apart."""
        if not self.learnt:
            return None
        moment = int(np.searchsorted(self.held.times_us, after_us, "right")) - 1
        return self.learnt[max(0, moment)]

    def write(self, group: Any) -> None:
        """Put it into an open group of a file."""
        group["times_us"], group["margins"], group["right"] = self.held.times_us, self.held.margins, self.held.right
        if self.held.labels is not None:
            group["labels"] = self.held.labels
        for moment, learnt in enumerate(self.learnt):
            for name, part in learnt.items():
                group[f"learnt/{moment}/{name}"] = part

    @classmethod
    def read(cls, group: Any) -> Early:
        """What `write` put there."""
        labels = group["labels"][()] if "labels" in group else None
        held = Held(group["times_us"][()], group["margins"][()], group["right"][()], labels)
        several = group.get("learnt", {})
        learnt = tuple({name: part_of(data) for name, data in several[str(k)].items()} for k in range(len(several)))
        return cls(held, learnt)


def part_of(data: Any) -> Any:
    """An array or a text of a file."""
    return data.asstr()[()] if data.dtype.kind == "O" else data[()]
