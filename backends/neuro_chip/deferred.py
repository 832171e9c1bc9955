"""The state of a projection that learns on SpiNNaker, and the effect of events on it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker_rule import ONE, PLUS, SIGNAL_SPIKES, TIMING, TIMINGS, D, SpinnakerRule
from neuro.program.program import Floats, Ints
from neuro_chip import spinnaker_learning as kernels

_SPIKES: Ints = np.zeros(0, dtype=np.int64)
"""Placeholder for the concentrations of post spikes, which have none."""


class Deferred:
    """A projection that learns on SpiNNaker. All projections onto one population have equal histories.

    Args:
        rule: the rule.
        row_ends, targets: the connections, in the csr layout of a program.
        n_targets: number of target neurons.
        words: words of the weights, as magnitudes.
        delays: ticks by which events of the post neurons act later, one per synapse.
        delivered: whether the slots of each synapse are written.
        shifts: shift of the receptor of each synapse.
        stages: number of times that a delay core holds back the packets of each synapse, each time for as many ticks as
            there are slots; None: 0 for all synapses.

    Attributes:
        weights: words of the weights, int64, one per synapse.
        tags: words of the eligibility, or accumulators, int64, one per synapse.
        rows: state of each source and stage, see `neuro_chip.spinnaker_learning`.
        held: packets of each source in the last ticks, (ticks, sources).
        history: histories of the post neurons.
        counts: int64, see `neuro_chip.spinnaker_learning`.
    """

    saved: ClassVar[tuple[str, ...]] = (
        *("weights", "tags", "rows", "held", "counts", "draws"),
        *(f"history_{name}" for name in kernels.History._fields),
    )
    """Names of the arrays in a snapshot."""
    counted: ClassVar[dict[int, str]] = {
        kernels.EVALUATED: "rules applied",
        kernels.CHANGED: "weight writes",
        kernels.UNDELIVERED: "undelivered synapses",
        kernels.MISSED: "updates that lack dropped history entries",
        kernels.WRAPPED: "wrapped words",
        kernels.OVERFLOWN: "wrapped traces",
        kernels.SENT: SIGNAL_SPIKES,
        kernels.CUT: "signals at a bound",
    }

    def __init__(
        self,
        rule: SpinnakerRule,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        mantissas: Ints,
        delays: Ints,
        delivered: NDArray[np.bool_],
        shifts: Ints,
        stages: Ints | None = None,
    ) -> None:
        self.rule = rule
        self.draws = kernels.SEED.copy()
        self._rule = kernels.Rule(rule.constants, rule.table, rule.places, self.draws)
        self.weights, self.tags = mantissas.astype(np.int64), np.zeros(mantissas.size, dtype=np.int64)
        stages, n_sources = np.zeros(mantissas.size, dtype=np.int64) if stages is None else stages, row_ends.size - 1
        self.n_rows = int(stages.max(initial=0)) + 1
        self.synapses = kernels.Synapses(
            self.weights, self.tags, row_ends, targets, delays, delivered, shifts, stages, self.n_rows
        )
        self.rows: Ints = np.zeros((n_sources * self.n_rows, kernels.ROW_COLUMNS), dtype=np.int64)
        self.held: Ints = np.zeros(((self.n_rows - 1) * rule.slots + 1, n_sources), dtype=np.int64)
        self.history = kernels.history_of(n_targets)
        self.counts: Ints = np.zeros(kernels.COUNTS, dtype=np.int64)

    @property
    def mantissas(self) -> NDArray[np.int32]:
        """The words with the sign of their receptor."""
        return (-self.weights if self.rule.inhibits else self.weights).astype(np.int32)

    def words(self, synapses: Ints | slice = slice(None)) -> NDArray[np.int32]:
        """Return the words that synapses add in the step of a spike; 0 if its packet is held back or not delivered."""
        sends = self.synapses.delivered[synapses] & (self.synapses.stages[synapses] == 0)
        words: NDArray[np.int32] = (self.weights[synapses] * sends).astype(np.int32)
        return -words if self.rule.inhibits else words

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> tuple[Ints, Ints]:
        """Apply the post spikes of a step, then the packets of the sources.

        Args:
            step: the number of the step, from 1; the first tick is 0.
            pre: ids of the sources that fired, each once.
            post: ids of the targets that fired, each once.
            payloads: number of spikes of each source that fired.

        Returns:
            the synapses whose words may have changed, and for each the difference between the sum of the words that it
            has sent and (spikes of this step) x (its new word). Earlier packets of a step were sent with other words,
            and packets that were held back are sent now.
        """
        self.spike(post, step - 1)
        if self.n_rows == 1:
            return self._process(0, pre, payloads, step - 1)
        self.held[(step - 1) % len(self.held)] = np.bincount(pre, payloads, self.held.shape[1])
        results = []
        for stage in range(self.n_rows):
            packets = self.held[(step - 1 - stage * self.rule.slots) % len(self.held)]
            results.append(self._process(stage, np.flatnonzero(packets), packets[packets > 0], step - 1))
        synapses, differences = zip(*results, strict=True)
        return np.concatenate(synapses), np.concatenate(differences)

    def _process(self, stage: int, pre: Ints, payloads: Ints, tick: int) -> tuple[Ints, Ints]:
        """Process the packets of a stage, which arrive at a tick; arguments and results are those of `step`."""
        synapses = self._synapses_of(pre)
        times = np.repeat(payloads, self.synapses.row_ends[pre + 1] - self.synapses.row_ends[pre])
        if self.n_rows > 1:
            is_of_stage = self.synapses.stages[synapses] == stage
            synapses, times = synapses[is_of_stage], times[is_of_stage]
        differences: Ints = np.zeros(synapses.size, dtype=np.int64)
        for packet in range(int(payloads.max(initial=0))):
            self.packets(pre[payloads > packet] * self.n_rows + stage, tick)
            differences += np.where(times > packet, self.weights[synapses], 0)
        if stage == 0:
            differences -= times * self.weights[synapses]
        return synapses, differences * self.synapses.delivered[synapses]

    def _synapses_of(self, pre: Ints) -> Ints:
        """Return the synapses of some sources."""
        begin, end = self.synapses.row_ends[pre], self.synapses.row_ends[pre + 1]
        firsts = np.repeat(begin - np.concatenate(([0], np.cumsum(end - begin)[:-1])), end - begin)
        synapses: Ints = firsts + np.arange(firsts.size)
        return synapses

    def release(self, step: int, ids: Ints) -> None:
        """Append dopamine of the spikes of a step that reach the targets `ids`, before their post spikes."""
        self.dopamine(ids, np.full(ids.size, self.rule.concentrations[0]), step - 1)

    def modulate(self, step: int, values: Floats, scale: float) -> None:
        """Set the dopamine of all targets, by spikes of the sources of reward and punishment.

        Args:
            step: the last finished step (0 before the first).
            values: dopamine of every target in 1/ms.
            scale: dopamine of one unit in s4.11.
        """
        # The host tracks the traces of its own spikes.
        unit, levels = self.rule.concentrations[0], (1 << len(self.rule.concentrations)) - 1
        missing_units: Ints = np.rint((values / scale - self._level(step)) / unit).astype(np.int64)
        self.counts[kernels.CUT] += np.count_nonzero(abs(missing_units) > levels)
        missing_units = np.clip(missing_units, -levels, levels)
        for bit, amount in enumerate(self.rule.concentrations):
            ids = np.flatnonzero(abs(missing_units) >> bit & 1)
            self.dopamine(ids, np.sign(missing_units[ids]) * amount, step)
            self.counts[kernels.SENT] += ids.size

    def _level(self, tick: int) -> Floats:
        """Return the dopamine of each target at a tick, in s4.11."""
        neurons, newest = np.arange(self.history.counts.size), self.history.counts - 1
        level = self.history.traces[neurons, newest, kernels.DOPAMINE]
        return np.asarray(np.floor(level * self._decay(D, tick - self.history.times[neurons, newest])))

    def read(self, name: str, step: int, pre: Ints, post: Ints, n_scale: float) -> Floats:
        """Return a state of every synapse after a step, in units of the language; K_plus is the trace of pairs."""
        if name == "n":
            return np.asarray(self._level(step - 1)[post] * n_scale)
        if name == "c":
            return np.asarray(self.tags * self.rule.eligibility)
        if name == "K_plus" and self.rule.constants[TIMING] != TIMINGS.index("recurrent"):
            rows = self.rows[pre * self.n_rows + self.synapses.stages]
            passed = step - 1 - rows[:, kernels.LAST]
            return np.asarray(rows[:, kernels.R1] / ONE * self._decay(PLUS, passed))
        return self.tags.astype(np.float64)

    def _decay(self, table: int, ticks: Ints) -> Floats:
        """Return the factor, 0 to 1, by which the decay of a table scales a value after some ticks."""
        first, length, shift = self.rule.places[table]
        indices = np.clip(ticks >> shift, 0, length - 1)
        return np.asarray(np.where(ticks >> shift < length, self.rule.table[first + indices] / ONE, 0.0))

    def native(self) -> dict[str, int]:
        """Return the counts that exist only on the machine, by name."""
        return {label: int(self.counts[k]) for k, label in self.counted.items() if self.counts[k]}

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        arrays = (self.rows, self.held, *self.history, *self.synapses[:-1], self.rule.table)
        return sum(array.nbytes for array in arrays)

    def __getattr__(self, name: str) -> Any:
        """Return an array of the history by its name in `saved`."""
        if name.startswith("history_"):
            return getattr(self.history, name.removeprefix("history_"))
        raise AttributeError(name)

    def spike(self, ids: Ints, t: int) -> None:
        """Append spikes of post neurons at tick t."""
        kernels.events(self._rule, self.history, ids, _SPIKES, t, self.counts)

    def dopamine(self, ids: Ints, concentrations: Ints, t: int) -> None:
        """Append dopamine at tick t: a signed concentration in s4.11 for each of some neurons."""
        kernels.events(self._rule, self.history, ids, concentrations, t, self.counts)

    def packets(self, ids: Ints, t: int) -> None:
        """Update the rows of packets that were emitted at tick t, one after another."""
        kernels.packets(self._rule, self.rows, self.history, self.synapses, ids, t, self.counts)
