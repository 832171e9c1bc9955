"""The trial loop of all backends: presentation, decision, labels, dropout and reward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.core import keyed_random
from neuro.core.checks import numbers
from neuro.core.errors import ModelError
from neuro.model.synapses import Lesson, TrialEnd
from neuro.program.backend import EngineCounts, Outcome, Trial, Wins
from neuro.program.counts import Counts, Tally, difference, total
from neuro.program.program import Floats, Ints
from neuro.run.handles import Run
from neuro.run.settable import neuron_ids

Bools = NDArray[np.bool_]
_CHUNK = 1 << 24
_NOBODY: Ints = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class AllWins:
    """All neurons that won in the trials of a batch, by trial, then in the order of the wins.

    Attributes:
        neurons: the winners, shape (wins,).
        steps: tick of each win, from 0.
        offsets: trial i has the wins `offsets[i] : offsets[i + 1]`, shape (trials + 1,).
    """

    neurons: Ints
    steps: Ints
    offsets: Ints


@dataclass(frozen=True, eq=False)
class TrialCounts:
    """Counts of trials or plain runs, without the outcomes. ``+`` adds counts of several batches of one simulation.

    Attributes:
        trials: number of trials, 0 for plain runs.
        raw_counts: counts per neuron.
    """

    trials: int
    raw_counts: EngineCounts
    _tally: Tally

    @cached_property
    def counts(self) -> Counts:
        """Counts by population and projection."""
        return self._tally.between(None, self.raw_counts)

    def __len__(self) -> int:
        return self.trials

    def __add__(self, other: TrialCounts) -> TrialCounts:
        return TrialCounts(self.trials + other.trials, total(self.raw_counts, other.raw_counts), self._tally)


@dataclass(frozen=True, eq=False)
class TrialResults:
    """The outcomes of the trials of a batch, one entry per trial.

    Attributes:
        winner: the neuron that decided, the first one of several, or -1.
        label: label of the winner's map (the map itself if the network has no labels), or -1.
        step: tick of the decision, from 0, or -1.
        potential: largest V_m of each map at the decision, shape (trials, maps). With `local_winners` it is the value
            at the first win of the map. Without a decision it is the value at the end.
        ticks: number of ticks that ran.
    """

    winner: Ints
    label: Ints
    step: Ints
    potential: Floats
    ticks: Ints
    _wins: tuple[Wins, ...] | None
    _tally: Tally
    _before: EngineCounts
    _after: EngineCounts

    @cached_property
    def wins(self) -> AllWins:
        """All winners if a trial may have several; otherwise the neurons that decided."""
        if self._wins is None:
            decided = self.winner >= 0
            return AllWins(self.winner[decided], self.step[decided], np.append(0, np.cumsum(decided)))
        neurons, ticks = ([getattr(trial_wins, name) for trial_wins in self._wins] for name in ("neurons", "ticks"))
        no_wins = [_NOBODY]
        return AllWins(
            np.concatenate(neurons or no_wins), np.concatenate(ticks or no_wins), np.cumsum([0, *map(len, neurons)])
        )

    @cached_property
    def counts(self) -> Counts:
        """Counts of the batch by population and projection."""
        return self._tally.between(self._before, self._after)

    @property
    def raw_counts(self) -> EngineCounts:
        """Counts of the batch per neuron."""
        return difference(self._after, self._before)

    @property
    def taken(self) -> TrialCounts:
        """Counts of the batch without the outcomes. Counts of several batches can be added."""
        return TrialCounts(len(self), self.raw_counts, self._tally)

    def __len__(self) -> int:
        return len(self.winner)


class TrialLoop:
    """Presents trials to an engine and lets rules learn.

    Args:
        run: a network in execution that has trials.
        tally: converts the counts of a batch.
    """

    def __init__(self, run: Run, tally: Tally) -> None:
        program, section = run.program, run.program.trials
        assert section is not None
        self.section, self.tally = section, tally
        self.engine, self.clock, self.rules = run.engine, run.clock, run.rules
        self.inputs = program.populations[section.input].size
        output = program.populations[section.output]
        self.outputs = output.size
        self.per_label = max(section.maps_per_label, 1)
        self.per_label_neurons = output.size // section.maps * self.per_label
        self.maps_of = np.arange(section.maps // self.per_label * self.per_label).reshape(-1, self.per_label)
        learners = [(q, p.synapse) for q, p in enumerate(program.projections) if p.synapse.learns == "trials"]
        self.learners = [q for q, _ in learners]
        pairs = [(q, p) for q, p in enumerate(program.projections) if p.synapse.learns == "pairs"]
        self.by_dopamine = [q for q, _ in pairs]
        self.signals = {p.signal: program.populations[p.target].size for _, p in pairs if p.signal >= 0}
        intervals = [int(p.synapse.parameters().get("deliver_interval", 1)) for _, p in pairs]
        self.grid = math.lcm(*(program.min_delay * interval for interval in intervals))
        self.growing = {q for q, rule in learners if hasattr(rule.arithmetic, "encourage")}
        self.supervised = not (learners or pairs) or bool(self.signals) or any(rule.supervised for _, rule in learners)
        self.peaks = any(rule.peaks for _, rule in learners)
        self.several = program.groups[section.group].choice.several
        self.key = keyed_random.key(program.seed, "dropout", output.name)
        self.forget_samples()

    def forget_samples(self) -> None:
        """Forget all samples, for dropout."""
        self.samples_drawn, self.last_sample = 0, (-1, -1)

    def state(self) -> Ints:
        """Return the state of dropout: number of samples so far, and epoch and number of the last sample."""
        return np.array([self.samples_drawn, *self.last_sample], dtype=np.int64)

    def put(self, state: Ints) -> None:
        """Restore a `state`."""
        self.samples_drawn, self.last_sample = int(state[0]), (int(state[1]), int(state[2]))

    def run(
        self,
        times: ArrayLike,
        ids: ArrayLike,
        offsets: ArrayLike,
        labels: ArrayLike | None,
        learn: bool,
        samples: ArrayLike | None,
        epoch: int,
    ) -> TrialResults:
        """Present a batch; `Simulation.trials` describes the arguments."""
        ends = self._offsets(offsets, np.size(times))
        n = len(ends) - 1
        is_once = learn and self.section.spikes == "once" and bool(self.learners or not self.section.anew)
        ticks, neurons = self._input(times, ids, ends, is_once)
        correct = self._labels(labels, n, learn)
        silenced = self._dropout(samples, n, int(epoch)) if learn else np.zeros((1, self.section.maps), dtype=bool)
        peaks = learn and self.peaks
        winner, step, ran = (np.full(n, -1, dtype=np.int64) for _ in range(3))
        potential = np.empty((n, self.section.maps))
        wins: list[Wins] = []
        before = self.engine.counts()
        weights = {} if learn else self._dopamine_weights()
        present_trial, silent_maps, bounds = self.engine.present, silenced[0] if len(silenced) else None, ends.tolist()
        for i in range(n):
            a, b = bounds[i], bounds[i + 1]
            mute = silenced[i] if learn else silent_maps
            if self.by_dopamine:
                self._start_on_grid(weights)
            outcome = present_trial(Trial(ticks[a:b], neurons[a:b], mute, peaks))  # type: ignore[arg-type]
            winner[i], step[i], ran[i], potential[i] = outcome.winner, outcome.tick, outcome.ticks, outcome.potential
            if outcome.wins is not None:
                wins.append(outcome.wins)
            if learn:
                # Each of several winners teaches like a single winner, in the order of the wins.
                outcomes = [outcome]
                if outcome.wins is not None and len(outcome.wins.neurons) > 1:
                    neurons_and_ticks = zip(outcome.wins.neurons.tolist(), outcome.wins.ticks.tolist(), strict=True)
                    outcomes = [replace(outcome, winner=neuron, tick=tick) for neuron, tick in neurons_and_ticks]
                for single in outcomes:
                    self._teach(single, -1 if correct is None else int(correct[i]), mute)  # type: ignore[arg-type]
                if self.by_dopamine:
                    reward = self._reward(outcome, -1 if correct is None else int(correct[i]))
                    for signal, size in self.signals.items():
                        self.engine.signal(signal, np.full(size, reward))
                    self.engine.run(self.section.after)
        self._restore_weights(weights)
        all_wins = tuple(wins) if self.several else None
        label = np.where(winner >= 0, winner // self.per_label_neurons, -1)
        return TrialResults(winner, label, step, potential, ran, all_wins, self.tally, before, self.engine.counts())

    def _teach(self, outcome: Outcome, correct: int, silenced: Bools) -> None:
        """Let each rule teach the neurons that it chooses from the outcome of a trial."""
        decided = outcome.winner >= 0
        is_correct = decided and outcome.winner // self.per_label_neurons == correct
        reward = self._reward(outcome, correct)
        maps = self.maps_of[correct] if correct >= 0 else _NOBODY
        end = TrialEnd(
            outcome.winner, outcome.tick, outcome.ticks, correct, is_correct, reward, maps, silenced,
            outcome.potential, outcome.best, outcome.peak, outcome.peak_tick,
        )  # fmt: skip

        for projection in self.learners:
            rule = self.rules[projection]
            for taught in rule.lessons(end):
                if isinstance(taught, Lesson):
                    # Engines do not check neurons, and a third-party rule may name a neuron that does not exist.
                    if not 0 <= (neuron := taught.neuron) < self.outputs:
                        expected = f"expected one of the output, 0 to {self.outputs - 1}"
                        message = f"{rule.name}: a lesson for neuron {neuron}: {expected}"
                        raise ModelError(message, hint="no neuron decided where end.winner is -1")
                    self.engine.learn(projection, int(taught.neuron), int(taught.tick), float(taught.lesson))
                else:
                    if projection not in self.growing:
                        expected = "expected a function 'encourage(w, c)' in its file"
                        raise ModelError(f"{rule.name}: its lessons let maps grow: {expected}")
                    if taught.maps is not end.maps and not all(
                        0 <= m < self.section.maps for m in taught.maps.tolist()
                    ):
                        expected = f"expected maps from 0 to {self.section.maps - 1}"
                        raise ModelError(f"{rule.name}: growth of maps {taught.maps.tolist()}: {expected}")
                    self.engine.encourage(projection, taught.maps)

    def _dopamine_weights(self) -> dict[int, Floats]:
        """Return the weights that learn by dopamine."""
        return {q: self.engine.get_synapses(q, "weight") for q in self.by_dopamine}

    def _start_on_grid(self, weights: Mapping[int, Floats]) -> None:
        """Advance without learning to the next step of dopamine's grid (`deliver_interval`), where a trial may begin.

        Args:
            weights: weights to restore in any case, by projection.
        """
        if n_steps := -self.engine.step % self.grid:
            weights = weights or self._dopamine_weights()
            self.engine.run(n_steps)
        self._restore_weights(weights)

    def _restore_weights(self, weights: Mapping[int, Floats]) -> None:
        """Restore weights that dopamine changed outside of trials that teach."""
        for projection, values in weights.items():
            self.engine.set_weights(projection, values)

    def _reward(self, outcome: Outcome, correct: int) -> float:
        """Return the reward of a trial; 0 without a decision or a label."""
        if outcome.winner < 0 or correct < 0:
            return 0.0
        return self.section.reward[0 if outcome.winner // self.per_label_neurons == correct else 1]

    def _offsets(self, offsets: ArrayLike, total: int) -> Ints:
        array = np.asarray(offsets)
        if array.ndim != 1 or array.size < 1 or array.dtype.kind not in "iu":
            raise ModelError("trials: offsets: expected whole numbers, one for each trial and the end")
        if array[0] != 0 or array[-1] != total or np.any(np.diff(array.astype(np.int64)) < 0):
            raise ModelError(
                f"trials: offsets from {array[0]} to {array[-1]}: expected ascending numbers from 0 to {total}, "
                "the number of times"
            )
        return array.astype(np.int64)

    def _input(self, times: ArrayLike, ids: ArrayLike, ends: Ints, once: bool) -> tuple[Ints, Ints]:
        """Return ticks and neurons of the input spikes, sorted within each trial."""
        try:
            ticks = self.clock.steps(np.ravel(numbers(times, "times")), "times")
            neurons = neuron_ids(np.ravel(np.asarray(ids)), self.inputs)
        except ModelError as error:
            raise error.at(None, "trials") from None
        if ticks.shape != neurons.shape:
            raise ModelError(f"trials: {ticks.size} times and {neurons.size} ids: expected as many of each")
        bad = np.flatnonzero((ticks < 0) | (ticks >= self.section.duration))
        if bad.size:
            raise ModelError(
                f"trials: times[{bad[0]}] = {self.clock.ms(int(ticks[bad[0]])):g} ms: expected 0 <= t < "
                f"{self.clock.ms(self.section.duration):g} ms, the duration"
            )
        trial = np.repeat(np.arange(len(ends) - 1), np.diff(ends))
        keys = (trial * self.section.duration + ticks) * self.inputs + neurons
        if np.any(keys[1:] < keys[:-1]):
            order = np.argsort(keys, kind="stable")
            ticks, neurons = ticks[order], neurons[order]
        if once:
            self._refuse_repeats(trial, neurons)
        return ticks, neurons

    def _refuse_repeats(self, trial: Ints, neurons: Ints) -> None:
        """Refuse a second spike of an input in a trial, which `spikes: once` excludes."""
        n = int(trial[-1]) + 1 if trial.size else 0
        chunk = min(n, max(1, _CHUNK // self.inputs))
        for first_trial in range(0, n, max(chunk, 1)):
            a, b = np.searchsorted(trial, (first_trial, first_trial + chunk))
            rows = (trial[a:b] - first_trial) * self.inputs + neurons[a:b]
            has_spiked = np.zeros(chunk * self.inputs, dtype=np.uint8)
            has_spiked[rows] = 1
            if np.count_nonzero(has_spiked) < len(rows):
                number, neuron = divmod(int(np.argmax(np.bincount(rows) > 1)), self.inputs)
                raise ModelError(
                    f"trials: input {neuron} spikes twice in trial {number + first_trial}: "
                    "expected at most once while learning",
                    hint="trials.spikes: first uses the first spike of each input, trials.spikes: each uses all",
                )

    def _labels(self, labels: ArrayLike | None, n: int, learn: bool) -> Ints | None:
        if labels is None:
            if learn and self.supervised:
                raise ModelError("trials: learn=True without labels: expected one label for each trial")
            return None
        array = _one_per_trial(labels, n, "labels")
        n_labels = self.section.maps // self.per_label
        bad = np.flatnonzero((array < 0) | (array >= n_labels))
        if bad.size:
            raise ModelError(f"trials: labels[{bad[0]}] = {array[bad[0]]}: expected a label from 0 to {n_labels - 1}")
        return array

    def _dropout(self, samples: ArrayLike | None, n: int, epoch: int) -> Bools:
        """Draw the maps that are silenced in each trial. Each sample has a draw.

        The draws are numbered by the samples presented with learning.

        A new sample begins where its number or the epoch changes.
        """
        if epoch < 0:
            raise ModelError(f"trials: epoch = {epoch}: expected a whole number >= 0")
        share = self.section.dropout * self.section.dropout_decay**epoch
        if samples is None or self.section.dropout_per_trial:
            is_new = np.ones(n, dtype=bool)
        else:
            array = _one_per_trial(samples, n, "samples")
            previous = self.last_sample[1] if self.last_sample[0] == epoch else -1
            is_new = np.diff(array, prepend=previous) != 0
            if n:
                self.last_sample = (epoch, int(array[-1]))
        indices = self.samples_drawn + np.cumsum(is_new) - 1
        self.samples_drawn += int(is_new.sum())
        return keyed_random.uniform_table(self.key, indices, self.section.maps) < share


def _one_per_trial(values: ArrayLike, n: int, what: str) -> Ints:
    """Check whole numbers, one for each of n trials."""
    array = np.asarray(values)
    if array.shape != (n,) or array.dtype.kind not in "iu":
        raise ModelError(f"trials: {what} of shape {list(array.shape)}: expected {n} whole numbers, one per trial")
    return array.astype(np.int64)
