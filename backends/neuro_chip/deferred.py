"""The state of a projection that learns on SpiNNaker, and the effect of events on this state."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.spinnaker_rule import ONE, PLUS, SIGNAL_SPIKES, TIMING, TIMINGS, D, SpinnakerRule
from neuro.program.program import Floats, Ints
from neuro_chip import spinnaker_learning as kernels

_SPIKES: Ints = np.zeros(0, dtype=np.int64)
"""In place of concentrations: the events are post spikes."""


class Deferred:
    """A projection that learns on SpiNNaker; projections onto one population have equal histories.

    Args:
        rule: the rule.
        row_ends, targets: the connections, as a program's of layout csr.
        n_targets: neurons of the target.
        words: of the weights, magnitudes.
        delays: ticks by which events of the post neurons act late, one for each synapse.
        delivered: of each synapse whether its slots are written.
        shifts: of the receptor of each synapse.
        stages: how often a core for delays holds the packets of each synapse back, for as many ticks as there are
            slots; None: never.

    Attributes:
        weights, tags: words, and words of the eligibility or accumulators, int64, one for each synapse.
        rows: what is kept of each source and stage, see `neuro_chip.spinnaker_learning`.
        held: packets of each source in the last ticks, (ticks, sources).
        history: of the post neurons.
        counts: int64, see `neuro_chip.spinnaker_learning`.
    """

    kept: ClassVar[tuple[str, ...]] = (
        *("weights", "tags", "rows", "held", "counts", "draws"),
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
        kernels.SENT: SIGNAL_SPIKES,
        kernels.CUT: "signals at a bound",
    }

    def __init__(
        self,
        rule: SpinnakerRule,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        words: Ints,
        delays: Ints,
        delivered: NDArray[np.bool_],
        shifts: Ints,
        stages: Ints | None = None,
    ) -> None:
        self.rule = rule
        self.draws = kernels.SEED.copy()
        self._rule = kernels.Rule(rule.constants, rule.table, rule.places, self.draws)
        self.weights, self.tags = words.astype(np.int64), np.zeros(words.size, dtype=np.int64)
        stages, n_sources = np.zeros(words.size, dtype=np.int64) if stages is None else stages, row_ends.size - 1
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
        """Return what synapses add to slots with the spike: nothing where they are not delivered, or later."""
        sends = self.synapses.delivered[synapses] & (self.synapses.stages[synapses] == 0)
        words: NDArray[np.int32] = (self.weights[synapses] * sends).astype(np.int32)
        return -words if self.rule.inhibits else words

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> tuple[Ints, Ints]:
        """Take the post spikes of a step, then the packets of the sources.

        Args:
            step: its number, from 1; the first tick is 0.
            pre: ids of the sources that fired, each once.
            post: ids of the targets that fired, each once.
            payloads: how often each source fired.

        Returns:
            The synapses whose words may have changed, and what each has sent beside its last word for every spike of
            this step: the earlier packets of a step were sent with other words, and those held back are sent now.
        """
        self.spike(post, step - 1)
        if self.n_rows == 1:
            return self._take(0, pre, payloads, step - 1)
        self.held[(step - 1) % len(self.held)] = np.bincount(pre, payloads, self.held.shape[1])
        found = []
        for stage in range(self.n_rows):
            held = self.held[(step - 1 - stage * self.rule.slots) % len(self.held)]
            found.append(self._take(stage, np.flatnonzero(held), held[held > 0], step - 1))
        synapses, sent = zip(*found, strict=True)
        return np.concatenate(synapses), np.concatenate(sent)

    def _take(self, stage: int, pre: Ints, payloads: Ints, tick: int) -> tuple[Ints, Ints]:
        """Take the packets of a stage, which arrive at a tick; arguments and results as of `step`."""
        synapses = self._of(pre)
        times = np.repeat(payloads, self.synapses.row_ends[pre + 1] - self.synapses.row_ends[pre])
        if self.n_rows > 1:
            mine = self.synapses.stages[synapses] == stage
            synapses, times = synapses[mine], times[mine]
        more: Ints = np.zeros(synapses.size, dtype=np.int64)
        for packet in range(int(payloads.max(initial=0))):
            self.packets(pre[payloads > packet] * self.n_rows + stage, tick)
            more += np.where(times > packet, self.weights[synapses], 0)
        if stage == 0:
            more -= times * self.weights[synapses]
        return synapses, more * self.synapses.delivered[synapses]

    def _of(self, pre: Ints) -> Ints:
        """Return the synapses of some sources."""
        begin, end = self.synapses.row_ends[pre], self.synapses.row_ends[pre + 1]
        firsts = np.repeat(begin - np.concatenate(([0], np.cumsum(end - begin)[:-1])), end - begin)
        synapses: Ints = firsts + np.arange(firsts.size)
        return synapses

    def release(self, step: int, ids: Ints) -> None:
        """Append the dopamine of spikes in a step that reach the targets `ids`, before its post spikes."""
        self.dopamine(ids, np.full(ids.size, self.rule.concentrations[0]), step - 1)

    def modulate(self, step: int, values: Floats, scale: float) -> None:
        """Bring dopamine of all targets to some values by spikes of sources of reward and punishment.

        Args:
            step: the last finished step (0 before the first).
            values: dopamine of every target in 1/ms.
            scale: dopamine of one unit in s4.11.
        """
        # The host follows the traces that its own spikes have left.
        unit, levels = self.rule.concentrations[0], (1 << len(self.rule.concentrations)) - 1
        missing: Ints = np.rint((values / scale - self._level(step)) / unit).astype(np.int64)
        self.counts[kernels.CUT] += np.count_nonzero(abs(missing) > levels)
        missing = np.clip(missing, -levels, levels)
        for bit, amount in enumerate(self.rule.concentrations):
            ids = np.flatnonzero(abs(missing) >> bit & 1)
            self.dopamine(ids, np.sign(missing[ids]) * amount, step)
            self.counts[kernels.SENT] += ids.size

    def _level(self, tick: int) -> Floats:
        """Return dopamine of each target at a tick, in s4.11."""
        every, newest = np.arange(self.history.counts.size), self.history.counts - 1
        level = self.history.traces[every, newest, kernels.DOPAMINE]
        return np.asarray(np.floor(level * self._decay(D, tick - self.history.times[every, newest])))

    def read(self, name: str, step: int, pre: Ints, post: Ints, n_scale: float) -> Floats:
        """Return a state of every synapse after a step, in the units of the language; K_plus is its trace of pairs."""
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
        """Return what a table leaves after some ticks."""
        first, length, shift = self.rule.places[table]
        at = np.clip(ticks >> shift, 0, length - 1)
        return np.asarray(np.where(ticks >> shift < length, self.rule.table[first + at] / ONE, 0.0))

    def native(self) -> dict[str, int]:
        """Counts of the machine alone, by name."""
        return {what: int(self.counts[k]) for k, what in self.counted.items() if self.counts[k]}

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        arrays = (self.rows, self.held, *self.history, *self.synapses[:-1], self.rule.table)
        return sum(array.nbytes for array in arrays)

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
        """Bring rows up to date whose packets were emitted at tick t, one after another."""
        kernels.packets(self._rule, self.rows, self.history, self.synapses, ids, t, self.counts)
