"""The state of a projection that learns on Loihi 1 or Loihi 2, and its update in a step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi2 import SIGN_MODES
from neuro.chips.loihi_registers import bounds, grain_of
from neuro.core.keyed_random import key, uniform
from neuro.model.synapses.loihi_rule import (
    FACTORS,
    FRACTION_BITS,
    LEVEL,
    MANTISSA_BITS,
    MODULATORY,
    POST,
    PRE,
    PRODUCT_BITS,
    TRACE_MAX,
    LearningRule,
    Trace,
)
from neuro.program.program import Floats, Ints
from neuro_chip import learning as kernels

_COUNTED = {
    kernels.EVALUATED: "rules applied",
    kernels.CHANGED: "weight writes",
    kernels.WEIGHT_SATURATED: "weights at a bound",
    kernels.TAG_SATURATED: "tags at a bound",
    kernels.OVERFLOWS: "accumulator overflows",
}
GATES = {"x0": kernels.X0, "y0": kernels.Y0, "u": kernels.U}


class Learner:
    """The synapses of a projection that learns, and their rule; subclasses define the step of a family.

    Args:
        rule: the rule.
        row_ends, targets: the connections, in the csr layout of a program.
        n_targets: number of target neurons.
        weights: mantissas of the synapses.
        ends: the smallest and the largest weight, then the smallest and the largest tag.
        precision: the step between two weights.

    Attributes:
        weights, tags: int16, one per synapse.
        xs, ys, tx, ty: see `neuro_chip.learning.Traces`.
        counts: int64, see `neuro_chip.learning`; `saturated` counts saturations of the traces of both sides.
    """

    saved: ClassVar[tuple[str, ...]] = ("weights", "tags", "xs", "ys", "tx", "ty", "counts", "saturated")
    """Names of the arrays in a snapshot."""
    weights: NDArray[np.int16]
    tags: NDArray[np.int16]
    xs: NDArray[Any]
    ys: NDArray[Any]
    tx: NDArray[Any]
    ty: NDArray[Any]

    def __init__(
        self,
        rule: LearningRule,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        weights: Ints,
        ends: tuple[int, int, int, int],
        precision: int = 1,
    ) -> None:
        self.rule, self.epoch = rule, rule.epoch
        products = (*rule.dw, *rule.dt)
        self.terms: Ints = np.zeros((len(products), kernels.COLUMNS), dtype=np.int64)
        for row, term in zip(self.terms, products, strict=True):
            bits = sum(int(kernels.BITS[FACTORS.index(factor.name)]) for factor in term.factors) + MANTISSA_BITS
            row[: kernels.FIRST] = (
                *(GATES[term.gate], (1 << term.every) - 1, term.mantissa, term.exponent + FRACTION_BITS),
                *(len(term.factors), max(0, bits - PRODUCT_BITS)),
            )
            for n, factor in enumerate(term.factors):
                row[kernels.FIRST + 2 * n : kernels.FIRST + 2 * n + 2] = FACTORS.index(factor.name), factor.add
        # A product with u_k is 0 for a tag of 0, if the bare tag is a factor.
        needs_tag = all(
            any(factor.name == "t" and factor.add == 0 for factor in term.factors)
            for term in products
            if term.gate == "u"
        )
        self.settings: Ints = np.array(
            [rule.epoch, precision, *ends, rule.rounding == "away", needs_tag, len(rule.dw)], dtype=np.int64
        )
        n_sources = row_ends.size - 1
        incoming = np.argsort(targets, kind="stable").astype(np.int32)
        self.synapses = kernels.Synapses(
            weights=weights.astype(np.int16),
            tags=np.zeros(weights.size, dtype=np.int16),
            row_ends=row_ends.astype(np.int64),
            targets=targets.astype(np.int32),
            column_ends=np.concatenate([[0], np.cumsum(np.bincount(targets, minlength=n_targets))]),
            incoming=incoming,
            sources=np.repeat(np.arange(n_sources, dtype=np.int32), np.diff(row_ends))[incoming],
        )
        self.weights, self.tags = self.synapses.weights, self.synapses.tags
        self.counts: Ints = np.zeros(6, dtype=np.int64)
        self.saturated: Ints = np.zeros(1, dtype=np.int64)

    @property
    def mantissas(self) -> NDArray[np.int32]:
        """The present weights."""
        return self.weights.astype(np.int32)

    def native(self) -> dict[str, int]:
        """Return the counts that exist only on the chip, by name."""
        counts = {label: int(self.counts[column]) for column, label in _COUNTED.items() if self.counts[column]}
        return counts | ({"trace saturations": int(self.saturated[0])} if self.saturated[0] else {})

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in (self.xs, self.ys, *self.synapses))

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> None:
        """Learn from the spikes of a step.

        Args:
            step: the number of the step, from 1; an epoch ends at multiples of `epoch`.
            pre: ids of the sources that fired, each once.
            post: ids of the targets that fired, each once.
            payloads: payloads of the sources that fired.
        """
        raise NotImplementedError

    def trace(self, name: str, step: int) -> Floats:
        """Return a trace of all neurons of its side (sources or targets) after a step."""
        raise NotImplementedError

    def modulatory(self, step: int) -> NDArray[np.uint8]:
        """Return the positive and the negative part of n of all targets after a step, as an array to write to."""
        raise NotImplementedError

    def modulate(self, step: int, values: Floats, scale: float) -> None:
        """Set the dopamine n of all targets after a step.

        Args:
            step: the last finished step (0 before the first).
            values: n of every target in 1/ms.
            scale: n of one unit of the traces, in 1/ms.
        """
        units: Ints = np.rint(np.asarray(values) / scale).astype(np.int64)
        self.saturated += np.count_nonzero(abs(units) > TRACE_MAX)
        self.modulatory(step)[:] = np.clip((units, -units), 0, TRACE_MAX)


class Plastic(Learner):
    """A projection that learns on Loihi 1.

    Args:
        name, seed: name of the projection and seed of the program, which determine the draws.
        rule, row_ends, targets, n_targets, weights: see `Learner`.
        bits, sign_mode: number of bits and sign mode of the weights.
    """

    def __init__(
        self,
        name: str,
        seed: int,
        rule: LearningRule,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        weights: Ints,
        bits: int = 8,
        sign_mode: str = "mixed",
    ) -> None:
        low, high, _ = bounds(sign_mode)
        ends = low, high, -256, 255
        super().__init__(rule, row_ends, targets, n_targets, weights, ends, grain_of(bits, sign_mode == "mixed"))
        sides = (PRE, row_ends.size - 1), ((*POST, *MODULATORY), n_targets)
        self.xs, self.ys = (np.zeros((rule.epoch, len(names), n), dtype=np.uint8) for names, n in sides)
        self.tx, self.ty = (np.zeros(n, dtype=np.uint8) for _, n in sides)
        self._traces = kernels.Traces(self.xs, self.ys, self.tx, self.ty)
        self._keep: list[Ints] = []
        self._impulses: list[Ints] = []
        self._keys: list[NDArray[np.uint64]] = []
        for names, _ in sides:
            used = [rule.traces.get(trace) for trace in names]  # a trace that the rule does not read stays 0
            self._keep.append(np.array([(tr.numerator, tr.denominator) if tr else (0, 1) for tr in used]))
            # Post spikes do not add to the traces of dopamine; `release` does.
            self._impulses.append(np.array([0 if tr is None else tr.impulse for tr in used]))
            self._keys.append(np.array([key(seed, trace, name) for trace in names], dtype=np.uint64))
        self._released = int(self._impulses[1][len(POST)])
        self._impulses[1][len(POST) :] = 0
        self._draws = np.array([key(seed, purpose, name) for purpose in ("w", "t")], dtype=np.uint64)

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints | None = None) -> None:
        """Learn from the spikes of a step; payloads are ignored."""
        slot = (step - 1) % self.epoch  # decay, then impulses, then the rule, which reads the impulses of this step
        for k, (history, ids, times) in enumerate(((self.xs, pre, self.tx), (self.ys, post, self.ty))):
            kernels.decay(history, slot, self._keep[k], self._keys[k], step)
            self.saturated += kernels.spike(history, slot, self._impulses[k], ids, times)
        if slot == self.epoch - 1:
            kernels.learn_loihi(self.terms, self.settings, self._traces, self.synapses, self._draws, step, self.counts)

    def trace(self, name: str, step: int) -> Floats:
        """Return a trace of all neurons of its side (sources or targets) after a step."""
        history, names = (self.xs, PRE) if name in PRE else (self.ys, (*POST, *MODULATORY))
        trace: Floats = history[(step - 1) % self.epoch, names.index(name)].astype(np.float64)
        return trace

    def release(self, step: int, ids: Ints) -> None:
        """Add the impulse to r1 of the targets `ids`, once for each dopamine spike that reaches them after a step."""
        slot = (step - 1) % self.epoch
        r1 = self.ys[slot, len(POST)]
        raised: Ints = r1 + np.bincount(ids, minlength=r1.size) * self._released
        self.saturated += np.count_nonzero(raised > 127)
        r1[:] = np.minimum(raised, 127)

    def modulatory(self, step: int) -> NDArray[np.uint8]:
        """Return r1 and r2 of all targets after a step."""
        traces: NDArray[np.uint8] = self.ys[(step - 1) % self.epoch, len(POST) :]
        return traces


class TwoFactors(Learner):
    """A projection that learns on Loihi 2 by a rule of two factors, as in lava.

    The order in a step is: pre spikes, post spikes, and at the end of an epoch the rule.

    * Of several spikes of a neuron in an epoch, all except the last raise the traces at once, as if they came at the
      beginning of the epoch. The last spike acts at its own step when the epoch is evaluated. Payloads raise x1 at
      once.
    * An epoch is evaluated at its end: starting from the traces at its beginning, each step multiplies by exp(-1/tau)
      and rounds up if the random number of the population is below the fraction.

    Random numbers are those of lava if the rule has a seed: draws of numpy's default generator, two per step for traces
    and one per epoch for weights. Source: lava 0.10, `src/lava/magma/core`, `model/py/connection.py` and `learning`.

    Args:
        name, seed: name of the projection and seed of the program, for the random numbers.
        numbers: parameters of `loihi2_learning`: impulses and time constants of the traces, `sign_mode`, `graded`,
            `rng_seed`.
        rule, row_ends, targets, n_targets, weights: see `Learner`.
    """

    def __init__(
        self,
        name: str,
        seed: int,
        rule: LearningRule,
        numbers: Mapping[str, Any],
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        weights: Ints,
    ) -> None:
        super().__init__(rule, row_ends, targets, n_targets, weights, (*SIGN_MODES[numbers["sign_mode"]], -257, 255))
        self.graded = numbers["graded"]
        self._impulses = [np.array([[numbers[f"{trace}_impulse"]] for trace in side]) for side in (PRE, POST)]
        taus = [[numbers[f"{trace}_tau"] for trace in side] for side in (PRE, POST)]
        self._keeps = [np.array([[np.exp(-1.0 / tau) if tau else 0.0] for tau in side]) for side in taus]
        n_sources = row_ends.size - 1
        self.xs, self.ys = (np.zeros((k, n), dtype=np.int64) for k, n in ((2, n_sources), (3, n_targets)))
        self.tx, self.ty = np.zeros(n_sources, dtype=np.int64), np.zeros(n_targets, dtype=np.int64)
        first = numbers["rng_seed"]
        # lava's seed for weights is 2, whatever the seed of a rule.
        self._seeds = [key(seed, purpose, name) for purpose in ("x", "y", "w")] if first < 0 else [first, first + 2, 2]

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> None:
        """Learn from the spikes of a step."""
        epoch_step = (step - 1) % self.epoch + 1
        fired_before = self.tx[pre] > 0
        is_spike = self._raise_x1(pre, payloads, fired_before)
        self._add(self.xs[1:], self._impulses[0][1:], pre[fired_before & is_spike])
        self.tx[pre[is_spike]] = epoch_step
        self._add(self.ys, self._impulses[1], post[self.ty[post] > 0])
        self.ty[post] = epoch_step
        if epoch_step == self.epoch:
            number = step // self.epoch
            draws = [
                float(np.random.Generator(np.random.PCG64(seed).advance(counter)).random())
                for seed, counter in zip(self._seeds, (2 * step, 2 * step, number), strict=True)
            ]
            xs = self._history(self.xs, self._keeps[0], self._impulses[0], self.tx, draws[0])
            ys = self._history(self.ys, self._keeps[1], self._impulses[1], self.ty, draws[1])
            self.xs[:], self.ys[:] = xs[-1], ys[-1]
            traces = kernels.Traces(xs, ys, self.tx, self.ty)
            kernels.learn_loihi2(
                self.terms, self.settings, traces, self.synapses, np.full(2, draws[2]), step, self.counts
            )

    def _raise_x1(self, pre: Ints, payloads: Ints, fired_before: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Raise x1 by payloads, or by earlier spikes of the epoch; return which pre events count as spikes."""
        all_events = np.ones(pre.size, dtype=np.bool_)
        if self.graded == "impulse":
            self._add(self.xs[:1], self._impulses[0][:1], pre[fired_before])
            return all_events
        halves = np.rint(payloads / 2).astype(np.int64) & 255
        if self.graded == "overwrite":
            self.xs[0, pre] = halves
            return all_events
        added = np.zeros_like(self.xs[0])
        added[pre] = halves
        sums = self.xs[0] + added & 255
        is_over = sums > TRACE_MAX
        if self.graded == "add_with_saturation":
            self.xs[0] = np.minimum(sums, TRACE_MAX)
            return all_events
        self.xs[0] = np.where(is_over, sums - TRACE_MAX, sums)
        wrapped: NDArray[np.bool_] = is_over[pre]
        return wrapped

    def _add(self, traces: Ints, impulses: Ints, ids: Ints) -> None:
        """Add impulses to the traces of some neurons, up to 127."""
        if ids.size:
            raised = traces[:, ids] + impulses
            self.saturated += np.count_nonzero(raised > TRACE_MAX)
            traces[:, ids] = np.minimum(raised, TRACE_MAX)

    def _history(self, traces: Ints, decay: Floats, impulses: Ints, times: Ints, draw: float) -> Ints:
        """Return the traces after each step of the epoch, shape (epoch, traces, neurons)."""
        history: Ints = np.empty((self.epoch, *traces.shape), dtype=np.int64)
        previous = traces
        for step, step_traces in enumerate(history, 1):
            decayed = decay * previous
            step_traces[:] = np.floor(decayed) + (draw < decayed % 1)
            self._add(step_traces, impulses, np.flatnonzero(times == step))
            previous = step_traces
        return history

    def trace(self, name: str, step: int) -> Floats:
        """Return a trace of all neurons of its side (sources or targets) after a step."""
        trace: Floats = (self.xs[PRE.index(name)] if name in PRE else self.ys[POST.index(name)]).astype(np.float64)
        return trace


class ThreeFactors(TwoFactors):
    """A projection that learns on Loihi 2 by a rule of three factors: each target sends y1, y2 and y3 in each step.

    The engine is that of lava (Loihi3FLearningRule), which reads the values sent in the last step of an epoch. In lava
    the program of a neuron determines the values. Here y1 is a trace of the neuron's spikes before this step, and y2
    and y3 follow from n, which a signal sets by a graded spike, see `Outgoing`. A neuron stores y1 and both parts of n
    in 7 bits. All three decay and are rounded by a draw for each neuron.

    Args:
        name, seed, rule, numbers: see `TwoFactors`.
        synapses: the last four arguments of `TwoFactors`.

    Attributes:
        ys: uint8 (3, targets), y1 and the positive and the negative part of n of each target.
    """

    def __init__(self, name: str, seed: int, rule: LearningRule, numbers: Mapping[str, Any], *synapses: Any) -> None:
        # In lava the engine adds no impulse to the sent values, which decay with a tau of 2^16 - 1 steps.
        engine = {f"{trace}_{word}": value for trace in POST for word, value in (("impulse", 0), ("tau", 65535))}
        super().__init__(name, seed, rule, {**numbers, **engine}, *synapses)
        self.ys = np.zeros((len(POST), self.ty.size), dtype=np.uint8)
        used = [rule.traces.get(trace, Trace(0, 0, 1)) for trace in POST]
        self._keep: Ints = np.array([(trace.numerator, trace.denominator) for trace in used])
        self._rise: Ints = np.array([[trace.impulse] for trace in used])
        self._rounding = key(seed, "n", name)
        self._neurons = np.array([key(seed, trace, name) for trace in POST], dtype=np.uint64)

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> None:
        """Learn from the spikes of a step."""
        kernels.decay(self.ys[np.newaxis], 0, self._keep, self._neurons, step)
        ys_before = self.ys.copy()
        self.ys[1:] = self.outgoing(step)
        super().step(step, pre, post, payloads)
        self.ys[:] = ys_before
        self._add(self.ys, self._rise, post)

    def outgoing(self, step: int) -> Ints:
        """Return y2 and y3 of all targets in a step, shape (2, targets)."""
        assert self.rule.outgoing is not None
        amount = (self.ys[1].astype(np.int64) - self.ys[2] << FRACTION_BITS) - self.rule.outgoing.baseline
        draws = uniform(self._rounding, step, np.arange(amount.size))
        levels = np.floor(abs(amount) / 2.0 ** (self.rule.outgoing.shift + FRACTION_BITS) + draws).astype(np.int64)
        largest = TRACE_MAX // LEVEL
        self.saturated += np.count_nonzero(levels > largest)
        messages: Ints = np.minimum(levels, largest) * LEVEL * np.array([amount > 0, amount < 0])
        return messages

    def modulatory(self, step: int) -> NDArray[np.uint8]:
        """Return both parts of n of all targets."""
        traces: NDArray[np.uint8] = self.ys[1:]
        return traces


def numbers_of(rule: LearningRule, sign_mode: str) -> dict[str, Any]:
    """Return the parameters of lava's engine for a rule of three factors, in which spikes raise x1 and x2."""
    traces = {name: rule.traces.get(name, Trace(0, 0, 1)) for name in PRE}
    numbers: dict[str, Any] = {f"{name}_impulse": trace.impulse for name, trace in traces.items()}
    numbers |= {f"{name}_tau": trace.tau for name, trace in traces.items()}
    return numbers | {"graded": "impulse", "sign_mode": sign_mode, "rng_seed": -1}
