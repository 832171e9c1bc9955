"""Learning of one projection: by spike pairs (for synapses and for kernels of grids) and by moves.

Pair learning is eager here: every synapse processes every event. A spike of the target reaches a synapse after the
delay of the synapse, or at once if the delay learns. So each synapse has its own K-, the trace of the post spikes that
have reached this synapse, see `Traces`. A kernel of a grid learns from all its places together, see `SharedLearning`.
Learning by moves gathers an eligibility step by step, and a signal applies the eligibility to the weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.synapses import Trace, modulated, pairs
from neuro.model.synapses.base import DELAY, common
from neuro.model.synapses.moves import MoveRule
from neuro.program.program import Floats, Ints, Program
from neuro_reference.projections import ReferenceProjection

PAIRS: Any = pairs
"""Functions of pair rules, which have no types."""


class PairLearning:
    """States of the plastic synapses of one projection.

    Attributes:
        rule: numbers of the synapse model, one row for all synapses or one row per synapse.
        c: constants computed from the rule, a row for each synapse.
        y: weight and states of every synapse.
        back: delay after which a spike of the target reaches a synapse, in steps.
        sent: weight after the last pre spike, which `stdp` shows.
        reached: step up to which a modulated synapse is integrated.
        pre: traces of each source.
        post: traces of each synapse, of the post spikes that have reached it.
        n, n_step: dopamine of each target, and the step at which it had this value.
        posts: post spikes under way, (steps, synapse).
        doses: dopamine spikes under way, (steps, target).
    """

    saved: ClassVar[tuple[str, ...]] = ("rule", "y", "sent", "reached", "n", "n_step", "posts", "doses")

    def __init__(self, program: Program, synapses: ReferenceProjection, tau_minus: Floats) -> None:
        part = synapses.part
        self.synapses, self.part, self.h = synapses, part, program.resolution
        self.arithmetic, self.modulated = part.synapse.arithmetic, part.synapse.modulated
        self.n_source = program.populations[part.source].size
        self.tau_minus: Floats = np.broadcast_to(tau_minus, synapses.n_target)[synapses.target]
        self.grid = program.min_delay * int(part.synapse.parameters().get("deliver_interval", 1))
        self.y: Floats = np.zeros((1 + len(part.synapse.states), len(synapses.target)))
        self.sent = synapses.weights.copy()
        self.y[0], self.y[1:] = self.sent, part.synapse.first_states()
        self.delays = part.synapse.delays
        if self.delays:
            self.y[DELAY] = synapses.delay * self.h
        self.back = np.zeros_like(synapses.delay) if self.delays else synapses.delay
        self.send = part.synapse.sends()
        self.key = keyed_random.key(program.seed, "synapse", part.name)
        self.rule = part.synapse.vector()
        n, n_target = len(synapses.target), synapses.n_target
        self.pre = Traces(part.synapse.pre, self._taus(part.synapse.pre), self.n_source, self.h)
        self.pre.after[:] = part.synapse.first_traces()[:, None]
        self.post = Traces(part.synapse.post, self._taus(part.synapse.post), n, self.h)
        self.refresh()
        self.reached: Ints = np.zeros(n, dtype=np.int64)
        self.n: Floats = np.zeros(n_target)
        self.n_step: Ints = np.zeros(n_target, dtype=np.int64)
        self.posts: Ints = np.zeros((self.synapses.slots, n), dtype=np.int64)
        self.doses: Ints = np.zeros((self.part.dopamine_delay + 1, n_target), dtype=np.int64)

    def reset(self, step: int) -> None:
        """Reset traces, eligibilities and dopamine to step 0. The weights of the present step stay."""
        self._integrate_all(step)
        self.y[1:], self.sent = 0.0, self.y[0].copy()
        for traces in (self.pre, self.post):
            traces.after[:], traces.since[:], traces.last[:] = 0.0, step, NEVER
        self.n[:], self.n_step[:], self.posts[:], self.doses[:] = 0.0, step, 0, 0

    def emit_post(self, ids: Ints, multiplicity: Ints, step: int) -> None:
        """Send spikes of the target to the synapses."""
        emitted: Ints = np.zeros(self.synapses.n_target, dtype=np.int64)
        emitted[ids] = multiplicity
        synapses = np.flatnonzero(emitted[self.synapses.target])
        self.posts[(step + self.back[synapses]) % len(self.posts), synapses] = emitted[self.synapses.target[synapses]]

    def arrive(self, step: int) -> None:
        """Process the arrivals of a step: dopamine first, then post spikes."""
        place = step % len(self.doses)
        for target in np.flatnonzero(self.doses[place]).tolist():
            for e in np.flatnonzero(self.synapses.target == target).tolist():
                self._integrate(e, step)
            dose = self.doses[place, target] / self.tau_n
            self.n[target], self.n_step[target] = self._dopamine(target, step) + dose, step
        self.doses[place] = 0
        for e in np.flatnonzero(self.posts[step % len(self.posts)]).tolist():
            self._integrate(e, step)
            multiplicity = int(self.posts[step % len(self.posts), e])
            pre = self.pre.at(self.synapses.source[e], step)
            for _ in range(multiplicity):
                self.arithmetic.on_post(self.y, e, self.c[e], pre, self.post.at(e, step))
                self.post.spike(e, step)
        self.posts[step % len(self.posts)] = 0

    def spike(self, source: int, step: int, nth: int) -> Floats:
        """Process a pre spike: the rule acts, then its traces grow; return the weights that are sent.

        Args:
            source: the neuron.
            step: step of the spike.
            nth: number of spikes that the neuron has emitted before in this step.
        """
        row, pre = self.synapses.row(source), self.pre.at(source, step)
        for e in range(row.start, row.stop):
            self._integrate(e, step)
            draws: tuple[float, ...] = ()
            if self.part.synapse.draws:
                draws = tuple(keyed_random.uniform(self.key, keyed_random.nth(step, nth), np.array([e])).tolist())
            self.arithmetic.on_pre(self.y, e, self.c[e], pre, self.post.earlier(e, step), *draws)
        self.pre.spike(source, step)
        self.sent[row] = self.y[0, row]
        if self.delays:
            self.synapses.set_out(row, self.y[DELAY, row])
        return np.array([self.send(self.y, e, self.c[e]) for e in range(row.start, row.stop)])

    def signal(self, values: Floats, step: int) -> None:
        """Set the dopamine of every target at the end of a step."""
        self._integrate_all(step)
        self.n[:], self.n_step[:] = values, step

    def set_rule(self, rule: Floats, step: int) -> None:
        """Set the rule's numbers at the end of a step. Earlier steps keep the old numbers."""
        self._integrate_all(step)
        self.pre.decay_to(step)
        self.post.decay_to(step)
        self.n = np.array([self._dopamine(j, step) for j in range(self.synapses.n_target)])
        self.n_step[:] = step
        self.rule = rule.copy()
        self.refresh()

    def set_weights(self, weights: Floats, step: int, where: slice | NDArray[np.bool_]) -> None:
        """Replace the weights of some synapses at the end of a step."""
        self._integrate_all(step)
        self.y[0, where] = weights[where]
        self.sent[where] = weights[where]

    def read(self, name: str, step: int) -> Floats:
        """Return a state of every synapse at the end of a step, without changing it."""
        if name == "K_plus":
            return np.array([self.pre.at(i, step)[0] for i in self.synapses.source])
        if name == "n":
            return np.array([self._dopamine(j, step) for j in self.synapses.target])
        if not self.modulated and name == "weight":
            return self.sent.copy()
        y, reached = self.y.copy(), self.reached.copy()
        self._integrate_all(step)
        values = self.state(name).copy()
        self.y, self.reached = y, reached
        return values

    def state(self, name: str) -> Floats:
        """Return the stored weight or state of every synapse."""
        row = 0 if name == "weight" else 1 + [s.name for s in self.part.synapse.states].index(name)
        values: Floats = self.y[row]
        return values

    def refresh(self) -> None:
        """Compute the constants after a change of the rule."""
        constants = self.part.synapse.constants_of(self.rule, self.h)
        self.c: Floats = np.broadcast_to(constants, (len(self.synapses.target), self.part.synapse.width))
        self.tau_n = float(self._numbers().get("tau_n", math.inf))  # without tau_n, n is constant
        self.pre.taus = [np.broadcast_to(tau, self.n_source) for tau in self._taus(self.part.synapse.pre)]
        self.post.taus = [np.broadcast_to(tau, len(self.synapses.target)) for tau in self._taus(self.part.synapse.post)]

    def _taus(self, traces: Sequence[Trace]) -> list[Floats]:
        """Return the time constants of some traces, ms."""
        numbers = {name: np.full(1, value) for name, value in self._numbers().items()}
        return [numbers.get(trace.tau, self.tau_minus) if trace.tau else np.zeros(1) for trace in traces]

    def _numbers(self) -> dict[str, float]:
        """Return the numbers of the rule that all synapses share, by name."""
        return dict(zip(self.part.synapse.numbers(), common(self.rule).tolist(), strict=True))

    def _integrate_all(self, step: int) -> None:
        for e in range(len(self.synapses.target)):
            self._integrate(e, step)

    def _integrate(self, e: int, step: int) -> None:
        """Integrate dopamine in a synapse from its last integration to a step."""
        if not self.modulated or self.reached[e] == step:
            return
        begin = int(self.reached[e])
        n = self._dopamine(self.synapses.target[e], begin)
        self.arithmetic.advance(self.y, e, self.c[e], begin, step, n, self.grid)
        self.reached[e] = step

    def _dopamine(self, target: int, step: int) -> float:
        if not self.modulated:
            return 0.0
        elapsed = (step - self.n_step[target]) * self.h
        return float(self.n[target] * math.exp(-elapsed / self.tau_n))


class SharedLearning:
    """Learning of the kernels of a grid: in each step the changes of all synapses of a weight are summed.

    Attributes:
        rule: numbers of the synapse model.
        k_plus: trace of each source.
        k_minus: trace of each target, of the spikes that arrived before the present step.
        heard: number of spikes that have arrived at each target in the present step.
        n: dopamine of each target.
        eligibility: eligibility of each synapse.
        change: change of each weight in the present step.
        changed: mask of the synapses that have changed their weight in the present step.
        posts, doses: post and dopamine spikes under way, (steps, targets).
    """

    saved: ClassVar[tuple[str, ...]] = (
        "rule", "k_plus", "k_minus", "heard", "n", "eligibility", "change", "changed", "posts", "doses",
    )  # fmt: skip

    def __init__(self, program: Program, synapses: ReferenceProjection, tau_minus: Floats) -> None:
        self.synapses, self.part, self.h = synapses, synapses.part, program.resolution
        grid = self.part.grid
        assert grid is not None
        self.mean, n_target = grid.mean, synapses.n_target
        # Changes are summed in the order of places, with the maps of a place together.
        self.inner: Ints = np.arange(n_target).reshape(grid.maps, -1).T.ravel()
        place = np.empty_like(self.inner)
        place[self.inner] = np.arange(n_target)
        weight = np.arange(self.part.size).reshape(grid.maps, -1)
        order = np.empty(self.part.size, dtype=np.int64)
        order[weight.T.ravel()] = np.arange(self.part.size)
        maps, sender = grid.maps, program.populations[self.part.source]
        sheets = [p.grid.maps for p in program.projections if p.target == self.part.source and p.grid is not None]
        self.outer: Ints = np.arange(sender.size).reshape(sheets[0] if sheets else 1, -1).T.ravel()
        self.by_place = np.lexsort((order[synapses.slot], place[synapses.target] // maps))
        self.synapses_onto = [np.flatnonzero(synapses.target == target) for target in range(n_target)]
        self.synapses_onto = [row[np.argsort(order[synapses.slot[row]])] for row in self.synapses_onto]
        rows = [np.arange(synapses.row_ends[i], synapses.row_ends[i + 1]) for i in range(len(synapses.row_ends) - 1)]
        self.synapses_of = [row[np.argsort(place[synapses.target[row]])] for row in rows]
        self.decay_minus: Floats = np.broadcast_to(np.exp(-self.h / tau_minus), n_target)
        self.k_plus: Floats = np.zeros(sender.size)
        self.k_minus, self.heard, self.n = (np.zeros(n_target) for _ in range(3))
        self.eligibility: Floats = np.zeros(len(synapses.target))
        self.change: Floats = np.zeros(self.part.size)
        self.changed: NDArray[np.bool_] = np.zeros(len(synapses.target), dtype=bool)
        self.posts: Ints = np.zeros((self.synapses.slots, n_target), dtype=np.int64)
        self.doses: Ints = np.zeros((self.part.dopamine_delay + 1, n_target), dtype=np.int64)
        self.rule = self.part.synapse.vector()
        self.refresh()

    def refresh(self) -> None:
        """Compute the constants after a change of the rule."""
        self.c: Floats = self.part.synapse.constants_of(self.rule, self.h)
        numbers = dict(zip(self.part.synapse.numbers(), self.rule.tolist(), strict=True))
        self.decay_plus = math.exp(-self.h / numbers["tau_plus"])

    def arrive(self, ids: Ints, multiplicity: Ints, step: int) -> None:
        """Integrate dopamine over a step, then process the post spikes that arrive in it.

        Args:
            ids: target neurons that spike in this step. Their spikes arrive after the delay.
            multiplicity: number of spikes of each.
            step: number of the step.
        """
        self.posts[(step + int(self.part.delay.max())) % len(self.posts), ids] = multiplicity
        self.k_plus *= self.decay_plus
        self.k_minus = (self.k_minus + self.heard) * self.decay_minus
        self.heard[:] = 0.0
        if self.part.synapse.modulated:
            self._integrate()
            doses = self.doses[step % len(self.doses)]
            self.n += doses / self.c[modulated.TAU_N]
            doses[:] = 0
        posts = self.posts[step % len(self.posts)]
        for target in self.inner[posts[self.inner] > 0].tolist():
            for e in self.synapses_onto[target].tolist():
                k_plus, m = float(self.k_plus[self.synapses.source[e]]), float(posts[target])
                if k_plus == 0.0:
                    continue
                if self.part.synapse.modulated:
                    self._add_eligibility(e, m * (self.c[modulated.A_PLUS] * k_plus))
                else:
                    self._add_change(
                        e, m * PAIRS.potentiation(self.synapses.weights[self.synapses.slot[e]], k_plus, self.c)
                    )
            self.heard[target] += posts[target]
        posts[:] = 0

    def spike(self, ids: Ints, multiplicity: Ints) -> None:
        """Process the source spikes of a step after sending them, and apply all changes of the step to the weights."""
        spikes: Ints = np.zeros(len(self.k_plus), dtype=np.int64)
        spikes[ids] = multiplicity
        for source in self.outer[spikes[self.outer] > 0].tolist():
            m = float(spikes[source])
            for e in self.synapses_of[source].tolist():
                k_minus = float(self.k_minus[self.synapses.target[e]])
                if k_minus == 0.0:
                    continue
                if self.part.synapse.modulated:
                    self._add_eligibility(e, -m * (self.c[modulated.A_MINUS] * k_minus))
                else:
                    self._add_change(
                        e, m * PAIRS.depression(self.synapses.weights[self.synapses.slot[e]], k_minus, self.c)
                    )
            self.k_plus[source] += m
        places = np.bincount(self.synapses.slot[self.changed], minlength=self.part.size)
        for k in np.flatnonzero(self.change).tolist():
            w = float(self.synapses.weights[k] + self.change[k] / (places[k] if self.mean else 1))
            if self.part.synapse.modulated:
                w = min(self.c[modulated.W_MAX], max(self.c[modulated.W_MIN], w))
            else:
                w = PAIRS.within(w, self.c[pairs.W_MAX])
            self.synapses.weights[k] = w + 0.0
        self.change[:], self.changed[:] = 0.0, False

    def signal(self, values: Floats) -> None:
        """Set the dopamine of every target at the end of a step."""
        self.n[:] = values

    def _integrate(self) -> None:
        c, left_c = self.c, modulated.DECAYS + 4
        for e in self.by_place[self.eligibility[self.by_place] != 0.0].tolist():
            n = self.n[self.synapses.target[e]]
            gain = n * c[modulated.TAU] * c[left_c + 3] - c[modulated.B] * c[modulated.TAU_C] * c[left_c + 2]
            self._add_change(e, self.eligibility[e] * gain)
            self.eligibility[e] *= c[left_c]
        self.n *= c[left_c + 1]

    def _add_eligibility(self, e: int, amount: float) -> None:
        """Add to the eligibility of a synapse, which has the lower bound c_min."""
        self.eligibility[e] = max(self.eligibility[e] + amount, self.c[modulated.C_MIN])

    def _add_change(self, e: int, amount: float) -> None:
        """Add to the change of a synapse's weight."""
        self.change[self.synapses.slot[e]] += amount
        self.changed[e] |= amount != 0.0


def emit_dopamine(learning: PairLearning | SharedLearning, ids: Ints, multiplicity: Ints, step: int) -> None:
    """Send spikes of the dopamine population, emitted in a step, to the targets of a projection."""
    place = (step + learning.part.dopamine_delay) % len(learning.doses)
    if learning.part.dopamine_one_to_one:
        learning.doses[place, ids] += multiplicity
    else:
        learning.doses[place] += multiplicity.sum()


NEVER = -1
"""Step of the last spike of a neuron that has not spiked."""


class Traces:
    """The traces of all sources or of all synapses.

    Args:
        kinds: the traces that the rule reads.
        taus: time constant of each trace in ms, one value or one per place.
        n: number of sources or synapses.
        h: length of a step in ms.

    Attributes:
        after: values at step `since`, shape (traces, n).
        before: values just before the spikes of step `last`, the last step with spikes.
    """

    saved: ClassVar[tuple[str, ...]] = ("after", "before", "since", "last")

    def __init__(self, kinds: Sequence[Trace], taus: Sequence[Floats], n: int, h: float) -> None:
        self.kinds, self.h = kinds, h
        self.after: Floats = np.zeros((len(kinds), n))
        self.before: Floats = np.zeros((len(kinds), n))
        self.since: Ints = np.zeros(n, dtype=np.int64)
        self.last: Ints = np.full(n, NEVER, dtype=np.int64)
        self.taus = [np.broadcast_to(tau, n) for tau in taus]

    def at(self, place: int, step: int) -> tuple[float, ...]:
        """Return the values at a step, including all spikes so far."""
        values = []
        for kind, impulse, taus in zip(self.kinds, self.after, self.taus, strict=True):
            if not kind.tau:
                values.append(float(step - self.last[place]) * self.h if self.last[place] != NEVER else math.inf)
            else:
                elapsed, tau = (step - self.since[place]) * self.h, taus[place]
                values.append(float(impulse[place] * math.exp(-elapsed / tau)) if tau > 0.0 else 0.0)
        return tuple(values)

    def earlier(self, place: int, step: int) -> tuple[float, ...]:
        """Return the values at a step, including only spikes before this step."""
        if self.last[place] == step:
            return tuple(float(self.before[k, place]) for k in range(len(self.kinds)))
        return self.at(place, step)

    def spike(self, place: int, step: int) -> None:
        """Add a spike at a step."""
        values = self.at(place, step)
        if self.last[place] != step:
            self.before[:, place] = values
        for k, (kind, value) in enumerate(zip(self.kinds, values, strict=True)):
            self.after[k, place] = kind.adds if kind.nearest else kind.adds + value
        self.since[place] = self.last[place] = step

    def decay_to(self, step: int) -> None:
        """Let all traces decay to a step, before their time constants change."""
        for place in range(len(self.since)):
            self.after[:, place], self.since[place] = self.at(place, step), step


class MoveLearning:
    """States of the synapses of one projection that learn by moves.

    Attributes:
        rule: numbers of the synapse model.
        y: weight and states of every synapse.
        x: pre traces of each source, (traces, sources).
        came: spikes of each source that arrive in the present step.
        gate: gate of each target.
    """

    saved: ClassVar[tuple[str, ...]] = ("rule", "y", "x", "came", "gate")

    def __init__(self, program: Program, synapses: ReferenceProjection) -> None:
        part = synapses.part
        assert isinstance(part.synapse, MoveRule)
        self.synapses, self.part, self.h, self.model = synapses, part, program.resolution, part.synapse
        states = [state.name for state in program.populations[part.target].model.states]
        self.seen_row = states.index(self.model.sees) if self.model.sees else -1
        self.y: Floats = np.zeros((1 + len(part.synapse.states), len(synapses.target)))
        self.y[0], self.y[1:] = synapses.weights, part.synapse.first_states()
        n_source = program.populations[part.source].size
        self.x: Floats = np.zeros((len(part.synapse.pre), n_source))
        self.came: Ints = np.zeros(n_source, dtype=np.int64)
        self.gate: Floats = np.ones(synapses.n_target)
        self.rule = part.synapse.vector()
        self.refresh()

    def refresh(self) -> None:
        """Compute the constants after a change of the rule."""
        self.c: Floats = self.part.synapse.constants_of(self.rule, self.h)
        numbers = dict(zip(self.part.synapse.numbers(), common(self.rule).tolist(), strict=True))
        self.left: Floats = np.exp([[-self.h / numbers[trace.tau]] for trace in self.part.synapse.pre])
        self.adds: Floats = np.array([[trace.adds] for trace in self.part.synapse.pre])
        self.x_min = numbers["x_min"]

    def gather(self, ids: Ints, multiplicity: Ints, states: Floats) -> None:
        """Gather the eligibility of a step of the target population.

        Args:
            ids: the neurons that spiked.
            multiplicity: number of spikes of each.
            states: states of all neurons after the step.
        """
        self.x *= self.left
        self.x[:, np.all(np.abs(self.x) < self.x_min, axis=0)] = 0.0
        self.x += self.adds * self.came
        self.came[:] = 0
        spikes: Ints = np.zeros(self.synapses.n_target, dtype=np.int64)
        spikes[ids] = multiplicity
        state_read = states[self.seen_row] if self.model.sees else np.zeros(self.synapses.n_target)
        sources, targets = np.flatnonzero(self.x.any(axis=0)), np.flatnonzero((spikes != 0) | (state_read != 0.0))
        concerned = np.isin(self.synapses.source, sources) & np.isin(self.synapses.target, targets)
        for e in np.flatnonzero(concerned).tolist():
            i, pre = self.synapses.target[e], tuple(self.x[:, self.synapses.source[e]].tolist())
            self.model.arithmetic.gather(
                self.y, e, self.c, pre, float(spikes[i]), float(state_read[i]), float(self.gate[i])
            )

    def teach(self, values: Floats) -> None:
        """Apply a signal that is set at the end of a step."""
        for e in np.flatnonzero(self.y[1:].any(axis=0)).tolist():
            self.model.arithmetic.teach(self.y, e, self.c, float(values[self.synapses.target[e]]))
        self.synapses.weights[:] = self.y[0]

    def state(self, name: str) -> Floats:
        """Return the weight or a state of every synapse, as a view."""
        row = 0 if name == "weight" else 1 + [s.name for s in self.part.synapse.states].index(name)
        values: Floats = self.y[row]
        return values
