"""How good decisions are, and what it takes to decide on a recording: its bill, or why a target refuses the network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import neuro
from neuro_recognise.method import Run
from neuro_recognise.shown import Ints

if TYPE_CHECKING:
    from neuro.chips import Energy


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


@dataclass(frozen=True, slots=True, eq=False)
class Priced:
    """What it takes to decide on a recording.

    Attributes:
        run: of the network, on any backend.
        recordings: that were shown.
        bills: by target, of one recording.
        refused: by target why it cannot run the network.
    """

    run: Run
    recordings: int
    bills: Mapping[str, Energy]
    refused: Mapping[str, str]


def price(run: Run, recordings: int, targets: Iterable[str], neurons_per_core: int | None = None) -> Priced:
    """The bill of a recording on each target.

    Args:
        run: of a network on some recordings, on any backend.
        recordings: how many were shown.
        targets: chips, processors or table files, see `neuro.Simulation.energy`.
        neurons_per_core: of a chip, see `Answer`.

    Raises:
        ModelError: there is no such target, or it has no published costs.
    """
    sim = run[0]
    reasons = {name: refusal(sim, name) for name in targets}
    bills = {
        name: _bill(run, name, neurons_per_core).per(recordings, "recording")
        for name, why in reasons.items()
        if not why
    }
    return Priced(run, recordings, bills, {name: why for name, why in reasons.items() if why})


def _bill(run: Run, target: str, neurons_per_core: int | None) -> Energy:
    """What a run takes; on a chip with so many neurons on a core."""
    from neuro.chips import chip, place, price as of_counts

    (sim, taken), asked = run, chip(target)
    if neurons_per_core is None or asked.mesh is None or not asked.costs:
        return sim.energy(target, of=taken)
    return of_counts(sim.program, taken.raw_counts, place(sim.program, asked, neurons_per_core=neurons_per_core), asked)


def refusal(sim: neuro.Simulation, target: str) -> str:
    """Why a chip cannot run a network, the first reason; "" if it can, or if its arithmetic is not known here."""
    from neuro.chips import chip, quantise

    asked = chip(target)
    problems = quantise(sim.program, asked).problems if asked.arithmetic else ()
    return next((f"{one.what}: {one.why}" for one in problems if one.refused), "")
