"""Learning of one projection by spike pairs, eagerly: every synapse follows every event; and by moves.

A shared kernel learns from all its places at once, see `SharedLearning`.

A synapse hears the spikes of its target after its delay, at once where the delay learns. So it keeps a K- of its own:
the trace of the post spikes that have reached it, see `Traces`. By moves, eligibility is gathered step by step, and a
signal teaches it at once.
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
"""Functions of rules, which have no types."""


class PairLearning:
    """States of the plastic synapses of one projection.

    Attributes:
        rule: the numbers of the synapse model, of all synapses or a row for each.
        c: the constants that follow, a row for each synapse.
        y: weight and states of every synapse.
        back: steps after which a synapse hears a spike of its target.
        sent: weight after the last pre spike, which `stdp` shows.
        reached: step up to which a modulated synapse is integrated.
        pre: traces of each source; post: of each synapse, of the post spikes that have reached it.
        n, n_step: dopamine of each target at a step.
        posts: post spikes on their way, (steps, synapse); doses: dopamine spikes on their way, (steps, target).
    """

    kept: ClassVar[tuple[str, ...]] = ("rule", "y", "sent", "reached", "n", "n_step", "posts", "doses")

    def __init__(self, program: Program, wires: ReferenceProjection, tau_minus: Floats) -> None:
        part = wires.part
        self.wires, self.part, self.h = wires, part, program.resolution
        self.arithmetic, self.modulated = part.synapse.arithmetic, part.synapse.modulated
        self.n_source = program.populations[part.source].size
        self.tau_minus: Floats = np.broadcast_to(tau_minus, wires.n_target)[wires.target]
        self.grid = program.min_delay * int(part.synapse.parameters().get("deliver_interval", 1))
        self.y: Floats = np.zeros((1 + len(part.synapse.states), len(wires.target)))
        self.sent = wires.weights.copy()
        self.y[0], self.y[1:] = self.sent, part.synapse.first_states()
        self.delays = part.synapse.delays
        if self.delays:
            self.y[DELAY] = wires.delay * self.h
        self.back = np.zeros_like(wires.delay) if self.delays else wires.delay
        self.send = part.synapse.sends()
        self.key = keyed_random.key(program.seed, "synapse", part.name)
        self.rule = part.synapse.vector()
        n, n_target = len(wires.target), wires.n_target
        self.pre = Traces(part.synapse.pre, self._taus(part.synapse.pre), self.n_source, self.h)
        self.pre.after[:] = part.synapse.first_traces()[:, None]
        self.post = Traces(part.synapse.post, self._taus(part.synapse.post), n, self.h)
        self.refresh()
        self.reached: Ints = np.zeros(n, dtype=np.int64)
        self.n: Floats = np.zeros(n_target)
        self.n_step: Ints = np.zeros(n_target, dtype=np.int64)
        self.posts: Ints = np.zeros((self.wires.slots, n), dtype=np.int64)
        self.doses: Ints = np.zeros((self.part.dopamine_delay + 1, n_target), dtype=np.int64)

    def start_anew(self, step: int) -> None:
        """Let traces, eligibilities and dopamine be as at step 0; the weights of a step stay."""
        self._bring(step)
        self.y[1:], self.sent = 0.0, self.y[0].copy()
        for traces in (self.pre, self.post):
            traces.after[:], traces.since[:], traces.last[:] = 0.0, step, NEVER
        self.n[:], self.n_step[:], self.posts[:], self.doses[:] = 0.0, step, 0, 0

    def emit_post(self, ids: Ints, multiplicity: Ints, step: int) -> None:
        """Send spikes of the target to the synapses."""
        emitted: Ints = np.zeros(self.wires.n_target, dtype=np.int64)
        emitted[ids] = multiplicity
        to = np.flatnonzero(emitted[self.wires.target])
        self.posts[(step + self.back[to]) % len(self.posts), to] = emitted[self.wires.target[to]]

    def arrive(self, step: int) -> None:
        """What arrives in a step: dopamine first, then post spikes."""
        place = step % len(self.doses)
        for target in np.flatnonzero(self.doses[place]).tolist():
            for e in np.flatnonzero(self.wires.target == target).tolist():
                self._integrate(e, step)
            dose = self.doses[place, target] / self.tau_n
            self.n[target], self.n_step[target] = self._dopamine(target, step) + dose, step
        self.doses[place] = 0
        for e in np.flatnonzero(self.posts[step % len(self.posts)]).tolist():
            self._integrate(e, step)
            multiplicity = int(self.posts[step % len(self.posts), e])
            pre = self.pre.at(self.wires.source[e], step)
            for _ in range(multiplicity):
                self.arithmetic.on_post(self.y, e, self.c[e], pre, self.post.at(e, step))
                self.post.spike(e, step)
        self.posts[step % len(self.posts)] = 0

    def spike(self, source: int, step: int, nth: int) -> Floats:
        """A pre spike emitted in `step`: the rule acts, then its traces grow; return the weights that are sent.

        Args:
            source: the neuron.
            step: of its spike.
            nth: how many it has emitted in this step before.
        """
        row, pre = self.wires.row(source), self.pre.at(source, step)
        for e in range(row.start, row.stop):
            self._integrate(e, step)
            drawn: tuple[float, ...] = ()
            if self.part.synapse.draws:
                drawn = tuple(keyed_random.uniform(self.key, keyed_random.nth(step, nth), np.array([e])).tolist())
            self.arithmetic.on_pre(self.y, e, self.c[e], pre, self.post.earlier(e, step), *drawn)
        self.pre.spike(source, step)
        self.sent[row] = self.y[0, row]
        if self.delays:
            self.wires.set_out(row, self.y[DELAY, row])
        return np.array([self.send(self.y, e, self.c[e]) for e in range(row.start, row.stop)])

    def signal(self, values: Floats, step: int) -> None:
        """Set the dopamine of every target at the end of a step."""
        self._bring(step)
        self.n[:], self.n_step[:] = values, step

    def set_rule(self, rule: Floats, step: int) -> None:
        """Change the rule's numbers at the end of a step; what came before keeps the old ones."""
        self._bring(step)
        self.pre.bring(step)
        self.post.bring(step)
        self.n = np.array([self._dopamine(j, step) for j in range(self.wires.n_target)])
        self.n_step[:] = step
        self.rule = rule.copy()
        self.refresh()

    def set_weights(self, weights: Floats, step: int, where: slice | NDArray[np.bool_]) -> None:
        """Replace the weights of some synapses at the end of a step."""
        self._bring(step)
        self.y[0, where] = weights[where]
        self.sent[where] = weights[where]

    def read(self, name: str, step: int) -> Floats:
        """A state of every synapse at the end of a step; nothing is changed by it."""
        if name == "K_plus":
            return np.array([self.pre.at(i, step)[0] for i in self.wires.source])
        if name == "n":
            return np.array([self._dopamine(j, step) for j in self.wires.target])
        if not self.modulated and name == "weight":
            return self.sent.copy()
        y, reached = self.y.copy(), self.reached.copy()
        self._bring(step)
        values = self.state(name).copy()
        self.y, self.reached = y, reached
        return values

    def state(self, name: str) -> Floats:
        """The weight or a state of every synapse as it was left."""
        row = 0 if name == "weight" else 1 + [s.name for s in self.part.synapse.states].index(name)
        values: Floats = self.y[row]
        return values

    def refresh(self) -> None:
        """Work out the constants after a change of the rule."""
        constants = self.part.synapse.constants_of(self.rule, self.h)
        self.c: Floats = np.broadcast_to(constants, (len(self.wires.target), self.part.synapse.width))
        self.tau_n = float(self._numbers().get("tau_n", math.inf))  # without one n is held
        self.pre.taus = [np.broadcast_to(tau, self.n_source) for tau in self._taus(self.part.synapse.pre)]
        self.post.taus = [np.broadcast_to(tau, len(self.wires.target)) for tau in self._taus(self.part.synapse.post)]

    def _taus(self, traces: Sequence[Trace]) -> list[Floats]:
        """The time constants of some traces, ms."""
        own = {name: np.full(1, value) for name, value in self._numbers().items()}
        return [own.get(trace.tau, self.tau_minus) if trace.tau else np.zeros(1) for trace in traces]

    def _numbers(self) -> dict[str, float]:
        """The rule's numbers by name, of those that all synapses share."""
        return dict(zip(self.part.synapse.numbers(), common(self.rule).tolist(), strict=True))

    def _bring(self, step: int) -> None:
        for e in range(len(self.wires.target)):
            self._integrate(e, step)

    def _integrate(self, e: int, step: int) -> None:
        """Let dopamine act on a synapse from where it was left up to a step."""
        if not self.modulated or self.reached[e] == step:
            return
        begin = int(self.reached[e])
        n = self._dopamine(self.wires.target[e], begin)
        self.arithmetic.advance(self.y, e, self.c[e], begin, step, n, self.grid)
        self.reached[e] = step

    def _dopamine(self, target: int, step: int) -> float:
        if not self.modulated:
            return 0.0
        passed = (step - self.n_step[target]) * self.h
        return float(self.n[target] * math.exp(-passed / self.tau_n))


class SharedLearning:
    """Learning of a shared kernel: the changes of all synapses of a weight, formed together in each step.

    Attributes:
        rule: the numbers of the synapse model.
        k_plus: trace of each source; k_minus: of each target, of the spikes that arrived before the present step.
        heard: spikes that have arrived at each target in the present step.
        n: dopamine of each target.
        eligibility: of each synapse.
        change: of each weight in the present step; changed: which synapses have changed theirs.
        posts, doses: spikes on their way, (steps, targets).
    """

    kept: ClassVar[tuple[str, ...]] = (
        "rule", "k_plus", "k_minus", "heard", "n", "eligibility", "change", "changed", "posts", "doses",
    )  # fmt: skip

    def __init__(self, program: Program, wires: ReferenceProjection, tau_minus: Floats) -> None:
        self.wires, self.part, self.h = wires, wires.part, program.resolution
        grid = self.part.grid
        assert grid is not None
        self.mean, n_target = grid.mean, wires.n_target
        # Places one after the other, the maps of a place together: so sums of changes have one order.
        self.inner: Ints = np.arange(n_target).reshape(grid.maps, -1).T.ravel()
        place = np.empty_like(self.inner)
        place[self.inner] = np.arange(n_target)
        weight = np.arange(self.part.size).reshape(grid.maps, -1)
        order = np.empty(self.part.size, dtype=np.int64)
        order[weight.T.ravel()] = np.arange(self.part.size)
        maps, sender = grid.maps, program.populations[self.part.source]
        sheets = [p.grid.maps for p in program.projections if p.target == self.part.source and p.grid is not None]
        self.outer: Ints = np.arange(sender.size).reshape(sheets[0] if sheets else 1, -1).T.ravel()
        self.by_place = np.lexsort((order[wires.slot], place[wires.target] // maps))
        self.onto = [np.flatnonzero(wires.target == target) for target in range(n_target)]
        self.onto = [each[np.argsort(order[wires.slot[each]])] for each in self.onto]
        rows = [np.arange(wires.row_ends[i], wires.row_ends[i + 1]) for i in range(len(wires.row_ends) - 1)]
        self.of = [each[np.argsort(place[wires.target[each]])] for each in rows]
        self.left_minus: Floats = np.broadcast_to(np.exp(-self.h / tau_minus), n_target)
        self.k_plus: Floats = np.zeros(sender.size)
        self.k_minus, self.heard, self.n = (np.zeros(n_target) for _ in range(3))
        self.eligibility: Floats = np.zeros(len(wires.target))
        self.change: Floats = np.zeros(self.part.size)
        self.changed: NDArray[np.bool_] = np.zeros(len(wires.target), dtype=bool)
        self.posts: Ints = np.zeros((self.wires.slots, n_target), dtype=np.int64)
        self.doses: Ints = np.zeros((self.part.dopamine_delay + 1, n_target), dtype=np.int64)
        self.rule = self.part.synapse.vector()
        self.refresh()

    def refresh(self) -> None:
        """Work out the constants after a change of the rule."""
        self.c: Floats = self.part.synapse.constants_of(self.rule, self.h)
        numbers = dict(zip(self.part.synapse.numbers(), self.rule.tolist(), strict=True))
        self.left_plus = math.exp(-self.h / numbers["tau_plus"])

    def arrive(self, ids: Ints, multiplicity: Ints, step: int) -> None:
        """Let dopamine act for a step, then the post spikes that arrive in it.

        Args:
            ids: neurons of the target that spike in this step; their spikes arrive after the delay.
            multiplicity: how often each.
            step: which it is.
        """
        self.posts[(step + int(self.part.delay.max())) % len(self.posts), ids] = multiplicity
        self.k_plus *= self.left_plus
        self.k_minus = (self.k_minus + self.heard) * self.left_minus
        self.heard[:] = 0.0
        if self.part.synapse.modulated:
            self._integrate()
            doses = self.doses[step % len(self.doses)]
            self.n += doses / self.c[modulated.TAU_N]
            doses[:] = 0
        posts = self.posts[step % len(self.posts)]
        for target in self.inner[posts[self.inner] > 0].tolist():
            for e in self.onto[target].tolist():
                k_plus, m = float(self.k_plus[self.wires.source[e]]), float(posts[target])
                if k_plus == 0.0:
                    continue
                if self.part.synapse.modulated:
                    self._earn(e, m * (self.c[modulated.A_PLUS] * k_plus))
                else:
                    self._add(e, m * PAIRS.potentiation(self.wires.weights[self.wires.slot[e]], k_plus, self.c))
            self.heard[target] += posts[target]
        posts[:] = 0

    def spike(self, ids: Ints, multiplicity: Ints) -> None:
        """Let the spikes of the source in a step act, which have been sent; then the changes act on the weights."""
        spikes: Ints = np.zeros(len(self.k_plus), dtype=np.int64)
        spikes[ids] = multiplicity
        for source in self.outer[spikes[self.outer] > 0].tolist():
            m = float(spikes[source])
            for e in self.of[source].tolist():
                k_minus = float(self.k_minus[self.wires.target[e]])
                if k_minus == 0.0:
                    continue
                if self.part.synapse.modulated:
                    self._earn(e, -m * (self.c[modulated.A_MINUS] * k_minus))
                else:
                    self._add(e, m * PAIRS.depression(self.wires.weights[self.wires.slot[e]], k_minus, self.c))
            self.k_plus[source] += m
        places = np.bincount(self.wires.slot[self.changed], minlength=self.part.size)
        for k in np.flatnonzero(self.change).tolist():
            w = float(self.wires.weights[k] + self.change[k] / (places[k] if self.mean else 1))
            if self.part.synapse.modulated:
                w = min(self.c[modulated.W_MAX], max(self.c[modulated.W_MIN], w))
            else:
                w = PAIRS.within(w, self.c[pairs.W_MAX])
            self.wires.weights[k] = w + 0.0
        self.change[:], self.changed[:] = 0.0, False

    def signal(self, values: Floats) -> None:
        """Set the dopamine of every target at the end of a step."""
        self.n[:] = values

    def _integrate(self) -> None:
        c, left_c = self.c, modulated.DECAYS + 4
        for e in self.by_place[self.eligibility[self.by_place] != 0.0].tolist():
            n = self.n[self.wires.target[e]]
            gain = n * c[modulated.TAU] * c[left_c + 3] - c[modulated.B] * c[modulated.TAU_C] * c[left_c + 2]
            self._add(e, self.eligibility[e] * gain)
            self.eligibility[e] *= c[left_c]
        self.n *= c[left_c + 1]

    def _earn(self, e: int, by: float) -> None:
        """Add to the eligibility of a synapse, down to c_min."""
        self.eligibility[e] = max(self.eligibility[e] + by, self.c[modulated.C_MIN])

    def _add(self, e: int, by: float) -> None:
        """Add to the change of the weight of a synapse."""
        self.change[self.wires.slot[e]] += by
        self.changed[e] |= by != 0.0


def emit_dopamine(learning: PairLearning | SharedLearning, ids: Ints, multiplicity: Ints, step: int) -> None:
    """Send spikes of the dopamine population, emitted in a step, to the targets of a projection."""
    place = (step + learning.part.dopamine_delay) % len(learning.doses)
    if learning.part.dopamine_one_to_one:
        learning.doses[place, ids] += multiplicity
    else:
        learning.doses[place] += multiplicity.sum()


NEVER = -1
"""The step of the last spike where there was none."""


class Traces:
    """The traces of one side.

    Args:
        kinds: what the rule reads.
        taus: the time constant of each in ms, one or one per place.
        n: sources, or synapses.
        h: length of a step in ms.

    Attributes:
        after: the values at step `since`, shape (traces, n).
        before: the values just before the spikes of step `last`, the last that had any.
    """

    kept: ClassVar[tuple[str, ...]] = ("after", "before", "since", "last")

    def __init__(self, kinds: Sequence[Trace], taus: Sequence[Floats], n: int, h: float) -> None:
        self.kinds, self.h = kinds, h
        self.after: Floats = np.zeros((len(kinds), n))
        self.before: Floats = np.zeros((len(kinds), n))
        self.since: Ints = np.zeros(n, dtype=np.int64)
        self.last: Ints = np.full(n, NEVER, dtype=np.int64)
        self.taus = [np.broadcast_to(tau, n) for tau in taus]

    def at(self, place: int, step: int) -> tuple[float, ...]:
        """The values at a step, of all spikes so far."""
        values = []
        for kind, after, taus in zip(self.kinds, self.after, self.taus, strict=True):
            if not kind.tau:
                values.append(float(step - self.last[place]) * self.h if self.last[place] != NEVER else math.inf)
            else:
                passed, tau = (step - self.since[place]) * self.h, taus[place]
                values.append(float(after[place] * math.exp(-passed / tau)) if tau > 0.0 else 0.0)
        return tuple(values)

    def earlier(self, place: int, step: int) -> tuple[float, ...]:
        """The values at a step, of the spikes strictly before it."""
        if self.last[place] == step:
            return tuple(float(self.before[k, place]) for k in range(len(self.kinds)))
        return self.at(place, step)

    def spike(self, place: int, step: int) -> None:
        """A spike at a step, after all that came before."""
        values = self.at(place, step)
        if self.last[place] != step:
            self.before[:, place] = values
        for k, (kind, value) in enumerate(zip(self.kinds, values, strict=True)):
            self.after[k, place] = kind.adds if kind.nearest else kind.adds + value
        self.since[place] = self.last[place] = step

    def bring(self, step: int) -> None:
        """Let all decay to a step, as before their time constants change."""
        for place in range(len(self.since)):
            self.after[:, place], self.since[place] = self.at(place, step), step


class MoveLearning:
    """States of the synapses of one projection that learn by moves.

    Attributes:
        rule: the numbers of the synapse model.
        y: weight and states of every synapse.
        x: the pre traces of each source, (traces, sources).
        came: spikes of each source that arrive in the present step.
        gate: of each target.
    """

    kept: ClassVar[tuple[str, ...]] = ("rule", "y", "x", "came", "gate")

    def __init__(self, program: Program, wires: ReferenceProjection) -> None:
        part = wires.part
        assert isinstance(part.synapse, MoveRule)
        self.wires, self.part, self.h, self.model = wires, part, program.resolution, part.synapse
        states = [state.name for state in program.populations[part.target].model.states]
        self.seen_row = states.index(self.model.sees) if self.model.sees else -1
        self.y: Floats = np.zeros((1 + len(part.synapse.states), len(wires.target)))
        self.y[0], self.y[1:] = wires.weights, part.synapse.first_states()
        n_source = program.populations[part.source].size
        self.x: Floats = np.zeros((len(part.synapse.pre), n_source))
        self.came: Ints = np.zeros(n_source, dtype=np.int64)
        self.gate: Floats = np.ones(wires.n_target)
        self.rule = part.synapse.vector()
        self.refresh()

    def refresh(self) -> None:
        """Work out the constants after a change of the rule."""
        self.c: Floats = self.part.synapse.constants_of(self.rule, self.h)
        numbers = dict(zip(self.part.synapse.numbers(), common(self.rule).tolist(), strict=True))
        self.left: Floats = np.exp([[-self.h / numbers[trace.tau]] for trace in self.part.synapse.pre])
        self.adds: Floats = np.array([[trace.adds] for trace in self.part.synapse.pre])
        self.x_min = numbers["x_min"]

    def gather(self, ids: Ints, multiplicity: Ints, states: Floats) -> None:
        """Let a step of the target, in which some of its neurons spiked, add to the eligibility.

        Args:
            ids: the neurons that spiked.
            multiplicity: how often each.
            states: of all neurons, as the step has left them.
        """
        self.x *= self.left
        self.x[:, np.all(np.abs(self.x) < self.x_min, axis=0)] = 0.0
        self.x += self.adds * self.came
        self.came[:] = 0
        spikes: Ints = np.zeros(self.wires.n_target, dtype=np.int64)
        spikes[ids] = multiplicity
        seen = states[self.seen_row] if self.model.sees else np.zeros(self.wires.n_target)
        sources, targets = np.flatnonzero(self.x.any(axis=0)), np.flatnonzero((spikes != 0) | (seen != 0.0))
        concerned = np.isin(self.wires.source, sources) & np.isin(self.wires.target, targets)
        for e in np.flatnonzero(concerned).tolist():
            i, pre = self.wires.target[e], tuple(self.x[:, self.wires.source[e]].tolist())
            self.model.arithmetic.gather(self.y, e, self.c, pre, float(spikes[i]), float(seen[i]), float(self.gate[i]))

    def teach(self, values: Floats) -> None:
        """Let a signal act that is set at the end of a step."""
        for e in np.flatnonzero(self.y[1:].any(axis=0)).tolist():
            self.model.arithmetic.teach(self.y, e, self.c, float(values[self.wires.target[e]]))
        self.wires.weights[:] = self.y[0]

    def state(self, name: str) -> Floats:
        """The row of the weight or of a state of every synapse."""
        row = 0 if name == "weight" else 1 + [s.name for s in self.part.synapse.states].index(name)
        values: Floats = self.y[row]
        return values
