"""Loihi 2's learning with two factors, as lava computes it: "bit approximate", in its words.

What a step does, in this order: pre spikes, post spikes, and at the end of an epoch the rule.

* Of several spikes of a neuron in an epoch all but the last raise its traces at once, as if at the epoch's beginning;
  the last one at its own step, when the epoch is worked out. Payloads raise x1 at once.
* An epoch is worked out at its end: from the traces at its beginning each step keeps exp(-1/tau), rounded up where the
  random number of the population is below the fraction.
* Products read traces at the step of the last pre spike (x0), of the last post spike (y0), or at the end (u). Each
  factor is clipped to its bits and signed; their product, of 32 bits, is multiplied by the scale's mantissa, shifted
  down by what it may have above 15 bits, shifted up by the exponent + 7 and clipped.
* Weight and tag lie 7 bits up in the sum of the products; one random number rounds all of them.

Random numbers are lava's where the rule has a seed: draws of numpy's default generator, two a step for traces and one
an epoch for weights. Source: lava 0.10, `src/lava/magma/core`, `model/py/connection.py` and `learning`.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi2 import SIGN_MODES
from neuro.core.keyed_random import key
from neuro.kernels.jit import inlined, kernel
from neuro.model.synapses import loihi2_learning
from neuro.model.synapses.loihi_rule import (
    FACTORS,
    FRACTION_BITS,
    MANTISSA_BITS,
    POST,
    PRE,
    PRODUCT_BITS,
    TRACE_MAX,
    WIDTHS,
    LearningRule,
)
from neuro.program.program import Floats, Ints
from neuro_chip import learning as kernels
from neuro_chip.plastic import GATES

_WEIGHT_SEED = 2
"""Of lava's number for weights, whatever the seed of a rule."""
_SHIFTED = kernels.COLUMNS
"""One more column of a product: by how many bits it is shifted down."""
_WIDTHS = WIDTHS | {"x0": 1, "y0": 1}


class TwoFactors:
    """States of the synapses of one projection that learns on Loihi 2; the same calls as `neuro_chip.plastic.Plastic`.

    Args:
        name, seed: of the projection and of the program, for the random numbers.
        rule, synapse: the products, and the numbers of the model.
        row_ends, targets: the connections, as a program's of layout csr.
        n_targets: neurons of the target.
        weights: mantissas of the synapses.
    """

    kept: ClassVar[tuple[str, ...]] = ("weights", "tags", "xs", "ys", "tx", "ty", "counts", "saturated")

    def __init__(
        self,
        name: str,
        seed: int,
        rule: LearningRule,
        synapse: loihi2_learning,
        row_ends: Ints,
        targets: NDArray[np.int32],
        n_targets: int,
        weights: Ints,
    ) -> None:
        self.rule, self.epoch, self.graded, self.terms = rule, rule.epoch, synapse.graded, _table(rule)
        self.of_weight = len(rule.dw)
        n_sources = row_ends.size - 1
        self.targets, self.incoming = targets, np.zeros(0, dtype=np.int32)
        self.sources = np.repeat(np.arange(n_sources, dtype=np.int32), np.diff(row_ends))
        self.bounds: Ints = np.array([SIGN_MODES[synapse.sign_mode], (-257, 255)], dtype=np.int64)
        self.weights, self.tags = weights.astype(np.int16), np.zeros(weights.size, dtype=np.int16)
        said = synapse.parameters()
        self._impulses = [np.array([[said[f"{each}_impulse"]] for each in side]) for side in (PRE, POST)]
        self._keeps = [_keep([said[f"{each}_tau"] for each in side]) for side in (PRE, POST)]
        self.xs, self.ys = (np.zeros((k, n), dtype=np.int64) for k, n in ((2, n_sources), (3, n_targets)))
        self.tx, self.ty = np.zeros(n_sources, dtype=np.int64), np.zeros(n_targets, dtype=np.int64)
        self.counts: Ints = np.zeros(6, dtype=np.int64)
        self.saturated: Ints = np.zeros(1, dtype=np.int64)
        own = synapse.rng_seed
        keyed = [key(seed, purpose, name) for purpose in ("x", "y", "w")]
        self._seeds = keyed if own < 0 else [own, own + 2, _WEIGHT_SEED]

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints) -> None:
        """One step of learning.

        Args:
            step: its number, from 1; an epoch ends where it is a multiple of `epoch`.
            pre: ids of the sources that fired, each once.
            post: ids of the targets that fired, each once.
            payloads: of the sources that fired.
        """
        now = (step - 1) % self.epoch + 1
        again = self.tx[pre] > 0
        counted = self._raise_x1(pre, payloads, again)
        self._add(self.xs[1:], self._impulses[0][1:], pre[again & counted])
        self.tx[pre[counted]] = now
        self._add(self.ys, self._impulses[1], post[self.ty[post] > 0])
        self.ty[post] = now
        if now == self.epoch:
            self._learn(step)

    def _raise_x1(self, pre: Ints, payloads: Ints, again: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """What spikes do to x1 at once; which of them count as such."""
        every = np.ones(pre.size, dtype=np.bool_)
        if self.graded == "impulse":
            self._add(self.xs[:1], self._impulses[0][:1], pre[again])
            return every
        halves = np.rint(payloads / 2).astype(np.int64) & 255
        if self.graded == "overwrite":
            self.xs[0, pre] = halves
            return every
        added = np.zeros_like(self.xs[0])
        added[pre] = halves
        sums = self.xs[0] + added & 255
        over = sums > TRACE_MAX
        if self.graded == "add_with_saturation":
            self.xs[0] = np.minimum(sums, TRACE_MAX)
            return every
        self.xs[0] = np.where(over, sums - TRACE_MAX, sums)
        counted: NDArray[np.bool_] = over[pre]
        return counted

    def _add(self, traces: Ints, impulses: Ints, ids: Ints) -> None:
        """Add impulses to the traces of some neurons, up to 127."""
        raised = traces[:, ids] + impulses
        self.saturated += np.count_nonzero(raised > TRACE_MAX)
        traces[:, ids] = np.minimum(raised, TRACE_MAX)

    def _learn(self, step: int) -> None:
        """Work out an epoch that ends, and apply the rule."""
        number = step // self.epoch
        draws = [_draw(seed, at) for seed, at in zip(self._seeds, (2 * step, 2 * step, number), strict=True)]
        xs = self._history(self.xs, self._keeps[0], self._impulses[0], self.tx, draws[0])
        ys = self._history(self.ys, self._keeps[1], self._impulses[1], self.ty, draws[1])
        apply(
            *(self.terms, self.of_weight, number, xs, ys, self.tx, self.ty, self.sources, self.targets),
            *(self.weights, self.tags, self.bounds, draws[2], self.counts),
        )
        self.xs[:], self.ys[:] = xs[-1], ys[-1]
        self.tx[:], self.ty[:] = 0, 0

    def _history(self, traces: Ints, keep: Floats, impulses: Ints, times: Ints, draw: float) -> Ints:
        """Traces before each step of the epoch and at its end, shape (epoch + 1, traces, neurons)."""
        found: Ints = np.empty((self.epoch + 1, *traces.shape), dtype=np.int64)
        found[0] = traces
        for step in range(1, self.epoch + 1):
            left = keep * found[step - 1]
            found[step] = np.floor(left) + (draw < left % 1)
            self._add(found[step], impulses, np.flatnonzero(times == step))
        return found

    def present(self, name: str) -> Ints:
        """A trace of the source or of the target of every synapse."""
        traces = self.xs[PRE.index(name)] if name in PRE else self.ys[POST.index(name)]
        of_each: Ints = traces[self.sources if name in PRE else self.targets]
        return of_each


def _table(rule: LearningRule) -> Ints:
    """The rule's products as `apply` reads them."""
    terms = (*rule.dw, *rule.dt)
    rows = np.zeros((len(terms), _SHIFTED + 1), dtype=np.int64)
    for row, term in zip(rows, terms, strict=True):
        row[: kernels.FIRST] = (
            *(GATES[term.gate], (1 << term.every) - 1),
            *(term.mantissa, term.exponent + FRACTION_BITS, len(term.factors)),
        )
        for n, factor in enumerate(term.factors):
            row[kernels.FIRST + 2 * n : kernels.FIRST + 2 * n + 2] = FACTORS.index(factor.name), factor.add
        bits = sum(_WIDTHS[factor.name] for factor in term.factors) + MANTISSA_BITS
        row[_SHIFTED] = max(0, bits - PRODUCT_BITS)
    return rows


_BITS = np.array([_WIDTHS[name] for name in FACTORS])
"""Of each factor."""


def _keep(taus: list[float]) -> Floats:
    """What a step leaves of traces, shape (traces, 1)."""
    return np.array([[np.exp(-1.0 / tau) if tau else 0.0] for tau in taus])


def _draw(seed: int, index: int) -> float:
    """A random number of numpy's default generator, by its index."""
    return float(np.random.Generator(np.random.PCG64(seed).advance(index)).random())


# mypy: disable-error-code="no-untyped-def,no-untyped-call"

_i32 = np.int32
_TOP = 32767


@inlined
def _factor(code, i, j, at, xs, ys, tx, ty, w, t):
    """The value of a factor; codes as in `neuro.model.synapses.loihi_rule.FACTORS`."""
    if code == 0:
        return np.int64(tx[i] > 0)
    if code < 3:
        return xs[at, code - 1, i]
    if code == 3:
        return np.int64(ty[j] > 0)
    if code < 7:
        return ys[at, code - 4, j]
    return w if code == 9 else t


@inlined
def _sum(terms, first, end, number, i, j, xs, ys, tx, ty, w, t, value, counts):
    """The sum of the products for a variable, which lies 7 bits up."""
    total = value << 7
    for n in range(first, end):
        gate = terms[n, kernels.GATE]
        if gate == kernels.X0:
            acts, at = tx[i] > 0, tx[i]
        elif gate == kernels.Y0:
            acts, at = ty[j] > 0, ty[j]
        else:
            acts, at = (number & terms[n, kernels.MASK]) == 0, xs.shape[0] - 1
        if not acts:
            continue
        v = _i32(1)
        for f in range(terms[n, kernels.SIZE]):
            code, add = terms[n, kernels.FIRST + 2 * f], terms[n, kernels.FIRST + 2 * f + 1]
            most = np.int64(1) << _BITS[code]
            value_of = _factor(code, i, j, at, xs, ys, tx, ty, w, t) + add
            v = _i32(v * _i32(min(max(value_of, -most), most - 1)))
        v = _i32(_i32(v * _i32(terms[n, kernels.MANTISSA])) >> _i32(terms[n, _SHIFTED]))
        shifted = np.int64(_i32(v << _i32(terms[n, kernels.SHIFT])))
        total += _limited(shifted, counts)
        total = _limited(total, counts)
    return total


@inlined
def _limited(v, counts):
    """A value within the accumulator, whose lowest value is one below that of 16 bits."""
    if v > _TOP or v < -_TOP - 2:
        counts[kernels.OVERFLOWS] += 1
    return min(max(v, -_TOP - 2), _TOP)


@inlined
def _rounded(total, draw):
    """A sum as a whole number."""
    whole = total >> 7
    return whole + np.int64(draw < (total - (whole << 7)) / 128.0)


@kernel
def apply(terms, of_weight, number, xs, ys, tx, ty, sources, targets, weights, tags, bounds, draw, counts):
    """Apply the rule to every synapse at the end of an epoch, which is the `number`th.

    The first `of_weight` products of `terms` are of dw. `xs` and `ys` are traces, int64 (epoch + 1, traces, neurons);
    `tx` and `ty` are the step of the last spike in the epoch, 0 if there was none. `sources` and `targets` are those of
    every synapse; `weights` and `tags`, int16, are written. `bounds` are (2, 2) the lowest and the highest weight and
    tag, `draw` rounds, and `counts`, columns of `neuro_chip.learning`, are added to.
    """
    for e in range(weights.size):
        i, j = sources[e], targets[e]
        w, t = np.int64(weights[e]), np.int64(tags[e])
        counts[kernels.EVALUATED] += tx[i] > 0 or ty[j] > 0
        if of_weight > 0:
            total = _sum(terms, 0, of_weight, number, i, j, xs, ys, tx, ty, w, t, w, counts)
            # what has the wrong sign is cut before it is rounded
            total = max(total, np.int64(0)) if bounds[0, 0] == 0 else total
            total = min(total, np.int64(0)) if bounds[0, 1] == 0 else total
            new = _rounded(total, draw)
            counts[kernels.WEIGHT_SATURATED] += new > bounds[0, 1] or new < bounds[0, 0]
            new = min(max(new, bounds[0, 0]), bounds[0, 1])
            counts[kernels.CHANGED] += new != w
            weights[e] = new
        if of_weight < terms.shape[0]:
            new = _rounded(_sum(terms, of_weight, terms.shape[0], number, i, j, xs, ys, tx, ty, w, t, t, counts), draw)
            counts[kernels.TAG_SATURATED] += new > bounds[1, 1] or new < bounds[1, 0]
            new = min(max(new, bounds[1, 0]), bounds[1, 1])
            counts[kernels.TAG_CHANGED] += new != t
            tags[e] = new
