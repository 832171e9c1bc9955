"""How good decisions are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Decisions against the truth.

    Attributes:
        classes: names.
        confusion: (classes, classes + 1) recordings by class and by decision; the last column is silence.
    """

    classes: tuple[str, ...]
    confusion: Ints

    @property
    def n(self) -> int:
        """The number of recordings."""
        return int(self.confusion.sum())

    @property
    def correct(self) -> int:
        """How many were decided rightly."""
        return int(np.trace(self.confusion))

    @property
    def accuracy(self) -> float:
        """Share of right decisions; silence is wrong."""
        return self.correct / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the accuracy."""
        return wilson(self.correct, self.n)

    def as_words(self) -> dict[str, Any]:
        """The figures as plain data, for JSON."""
        return {
            "accuracy": self.accuracy,
            "correct": self.correct,
            "n": self.n,
            "interval": list(self.interval),
            "silent": int(self.confusion[:, -1].sum()),
            "confusion": self.confusion.tolist(),
        }


def evaluate(decided: Ints, labels: Ints, classes: tuple[str, ...]) -> Evaluation:
    """Compare decisions with labels.

    Args:
        decided: class of each recording, or -1 for silence.
        labels: the right ones.
        classes: names of the classes.

    Returns:
        The evaluation.
    """
    confusion = np.zeros((len(classes), len(classes) + 1), np.int64)
    np.add.at(confusion, (labels, decided), 1)  # -1 is the last column
    return Evaluation(classes, confusion)


def wilson(correct: int, n: int, z: float = 1.959963984540054) -> tuple[float, float]:
    """Interval of a share.

    Args:
        correct: successes.
        n: trials; of none the interval is everything.
        z: quantile of the normal distribution; the default gives 95 %.

    Returns:
        Lower and upper end.

    Source: Wilson, J. Am. Stat. Assoc. 22:209, 1927.
    """
    if n == 0:
        return 0.0, 1.0
    p, spread = correct / n, z * z / n
    middle = p + spread / 2
    reach = z * float(np.sqrt(p * (1 - p) / n + spread / (4 * n)))
    low, high = ((middle + sign * reach) / (1 + spread) for sign in (-1, 1))
    return max(0.0, low), min(1.0, high)
