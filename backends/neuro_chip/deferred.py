"""The state of one projection that learns on SpiNNaker, and what events of a tick do to it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker_rule import SpinnakerRule
from neuro.program.program import Ints
from neuro_chip import spinnaker_learning as kernels

_SPIKES: Ints = np.zeros(0, dtype=np.int64)
"""In place of concentrations: the events are post spikes."""


class Deferred:
    """A projection that learns on SpiNNaker; all that is onto one population shares what its histories hold.

    Args:
        rule: the rule.
        row_ends, targets: the connections, as a program's of layout csr.
        n_targets: neurons of the target.
        words: of the weights, magnitudes.
        delays: ticks by which events of the post neurons act late, one for each synapse.
        sent: of each synapse whether it is delivered.
        shifts: of the receptor of each synapse.

    Attributes:
        weights, tags: words, and words of the eligibility or accumulators, int64, one for each synapse.
        rows: what is kept of each source, see `neuro_chip.spinnaker_learning`.
        history: of the post neurons.
        counts: int64, see `neuro_chip.spinnaker_learning`.
    """

    kept: ClassVar[tuple[str, ...]] = (
        *("weights", "tags", "rows", "counts", "draws"),
        *(f"history_{name}" for name in kernels.History._fields),
    )
    """Arrays that change."""
    counted: ClassVar[dict[int, str]] = {
        kernels.EVALUATED: "rules applied",
        kernels.CHANGED: "weight writes",
        kernels.UNDELIVERED: "undelivered synapses",
        kernels.MISSED: "updates that lack dropped history entries",
        kernels.WRAPPED: "wrapped words",
        kernels.OVERFLOWN: "wrapped traces",
    }

    def __init__(
        self,
        rule: SpinnakerRule,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        words: Ints,
        delays: Ints,
        sent: NDArray[np.bool_],
        shifts: Ints,
    ) -> None:
        self.rule = rule
        self.draws = kernels.SEED.copy()
        self._rule = kernels.Rule(rule.constants, rule.table, rule.places, self.draws)
        self.weights, self.tags = words.astype(np.int64), np.zeros(words.size, dtype=np.int64)
        self.synapses = kernels.Synapses(self.weights, self.tags, row_ends, targets, delays, sent, shifts)
        self.rows: Ints = np.zeros((row_ends.size - 1, kernels.ROW_COLUMNS), dtype=np.int64)
        self.history = kernels.history_of(n_targets)
        self.counts: Ints = np.zeros(kernels.COUNTS, dtype=np.int64)

    def __getattr__(self, name: str) -> Any:
        """Return an array of the history by its name in `kept`."""
        if name.startswith("history_"):
            return getattr(self.history, name.removeprefix("history_"))
        raise AttributeError(name)

    def spike(self, ids: Ints, t: int) -> None:
        """Append spikes of post neurons at tick t."""
        kernels.events(self._rule, self.history, ids, _SPIKES, t, self.counts)

    def dopamine(self, ids: Ints, concentrations: Ints, t: int) -> None:
        """Append dopamine at tick t, of signed concentrations in s4.11, one for each of some neurons."""
        kernels.events(self._rule, self.history, ids, concentrations, t, self.counts)

    def packets(self, ids: Ints, t: int) -> None:
        """Bring the rows of sources up to date that emitted packets at tick t, one after another."""
        kernels.packets(self._rule, self.rows, self.history, self.synapses, ids, t, self.counts)
