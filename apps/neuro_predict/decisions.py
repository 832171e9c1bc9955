"""Decisions of an output: a score for each neuron, the deciding neuron, and the accuracy of many decisions.

| decides by | score | tie | no decision |
| --- | --- | --- | --- |
| counts | spikes; for a graded output the sum of payloads | first to fire, then lowest | no neuron fires |
| first | ms of the first spike, NaN without one | most spikes, then lowest | no neuron fires |
| potential | mean V_m over all steps, mV | lowest | all are equal |

`neuro train` decides by `counts`. Its loss `potential` compares the scores of `potential`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.coding import Works, first_to_fire, highest_rate, on_numbers

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SILENT = -1
"""Decision of an output without spikes, or whose potentials are all equal."""


def by_counts(times: Floats, ids: Ints, neurons: int, payloads: Ints | None = None) -> tuple[int, Floats]:
    """Return the neuron with most spikes, and the number of spikes of each neuron.

    For a graded output, sums of payloads replace the numbers of spikes.

    Args:
        times: times of the spikes, ms.
        ids: neuron of each spike.
        neurons: number of neurons of the output.
        payloads: payloads of the spikes of a graded output.
    """
    counts, first_times = _counts_and_first(times, ids, neurons)
    if payloads is not None:
        sums = np.bincount(ids, payloads, minlength=neurons).astype(np.float64)
        return int(np.lexsort((first_times, -sums))[0]) if ids.size else SILENT, sums
    highest = highest_rate(counts)
    return _first_of(highest[first_to_fire(first_times[highest])]), counts


def by_first(times: Floats, ids: Ints, neurons: int) -> tuple[int, Floats]:
    """Return the neuron that fires first, and the first spike of each neuron, ms; see `by_counts` for the arguments."""
    counts, first_times = _counts_and_first(times, ids, neurons)
    soonest = first_to_fire(first_times)
    return _first_of(soonest[highest_rate(counts[soonest])]), first_times


def by_potential(V_m: Floats) -> tuple[int, Floats]:
    """Return the neuron with the highest mean potential, and the mean of each neuron.

    Args:
        V_m: (steps, neurons), potentials, mV.
    """
    mean = V_m.mean(axis=0)
    return (SILENT if (mean == mean[0]).all() else int(mean.argmax())), mean


def decision_work(by: str, neurons: int) -> Works:
    """Return the operations of a decision, by the unit of a use: a spike of the output, a step, or a recording.

    A spike is counted and its time compared; then the counts and the first times are compared with the best and with
    each other. Potentials are added up in each step, then divided, and compared with the best and with the first.

    Args:
        by: "counts", "first" or "potential"; "" for an output without a decision.
        neurons: number of neurons of the output.
    """
    if not by:
        return {}
    if by == "potential":
        return {"step": on_numbers(neurons, 2 * neurons), "recording": on_numbers(3 * neurons, 2 * neurons)}
    return {"spike": on_numbers(2, 4), "recording": on_numbers(4 * neurons, 2 * neurons)}


def _counts_and_first(times: Floats, ids: Ints, neurons: int) -> tuple[Floats, Floats]:
    first_times = np.full(neurons, np.inf)
    np.minimum.at(first_times, ids, times)
    return np.bincount(ids, minlength=neurons).astype(np.float64), np.where(np.isinf(first_times), np.nan, first_times)


def _first_of(neurons: Ints) -> int:
    return int(neurons[0]) if neurons.size else SILENT


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Comparison of decisions with the true classes.

    Attributes:
        classes: names of the classes.
        confusion: (classes, classes + 1) recordings by true class and by decision; the last column is no decision.
    """

    classes: tuple[str, ...]
    confusion: Ints

    @property
    def n(self) -> int:
        """Number of recordings."""
        return int(self.confusion.sum())

    @property
    def correct(self) -> int:
        """Number of right decisions."""
        return int(np.trace(self.confusion))

    @property
    def accuracy(self) -> float:
        """Share of right decisions; a missing decision counts as wrong."""
        return self.correct / self.n if self.n else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the accuracy."""
        return wilson(self.correct, self.n)

    def as_words(self) -> dict[str, Any]:
        """Return the figures as plain data, for JSON."""
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
        decided: class of each recording, or -1 for no decision.
        labels: true class of each recording.
        classes: names of the classes.

    Returns:
        The evaluation.
    """
    confusion = np.zeros((len(classes), len(classes) + 1), np.int64)
    np.add.at(confusion, (labels, decided), 1)  # -1 is the last column
    return Evaluation(classes, confusion)


def wilson(correct: int, n: int, z: float = 1.959963984540054) -> tuple[float, float]:
    """Return the confidence interval of a share.

    Args:
        correct: number of successes.
        n: number of trials; without trials the interval is 0 to 1.
        z: quantile of the normal distribution; the default gives 95 %.

    Returns:
        The lower and the upper end.

    Source: Wilson, J. Am. Stat. Assoc. 22:209, 1927.
    """
    if n == 0:
        return 0.0, 1.0
    p, spread = correct / n, z * z / n
    middle = p + spread / 2
    reach = z * float(np.sqrt(p * (1 - p) / n + spread / (4 * n)))
    low, high = ((middle + sign * reach) / (1 + spread) for sign in (-1, 1))
    return max(0.0, low), min(1.0, high)
