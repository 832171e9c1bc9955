"""The arrays of one projection that learns on Loihi, and the calls of its kernels in order."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi.arithmetic import bounds, grain_of
from neuro.core.keyed_random import key
from neuro.model.synapses.loihi_rule import FACTORS, FRACTION_BITS, MODULATORY, POST, PRE, LearningRule, Term
from neuro_chip import learning as kernels

Ints = NDArray[np.int64]
GATES = {"x0": kernels.X0, "y0": kernels.Y0, "u": kernels.U}


def table(rule: LearningRule) -> Ints:
    """The rule's products as the kernels read them, int64 (products, `COLUMNS`)."""
    terms = (*rule.dw, *rule.dt)
    rows = np.zeros((len(terms), kernels.COLUMNS), dtype=np.int64)
    for row, term in zip(rows, terms, strict=True):
        row[: kernels.FIRST] = (
            *(GATES[term.gate], (1 << term.every) - 1),
            *(term.mantissa, term.exponent + FRACTION_BITS, len(term.factors)),
        )
        for n, factor in enumerate(term.factors):
            row[kernels.FIRST + 2 * n : kernels.FIRST + 2 * n + 2] = FACTORS.index(factor.name), factor.add
    return rows


def _is_zero_without_tag(term: Term) -> bool:
    return any(factor.name == "t" and factor.add == 0 for factor in term.factors)


class Plastic:
    """States of the synapses of one projection that learns.

    Args:
        name, seed: of the projection and of the program: they key the draws.
        rule: the rule.
        row_ends, targets: the connections, as a program's of layout csr.
        n_targets: neurons of the target.
        weights: mantissas of the synapses.
        bits, sign_mode: of the weights.

    Attributes:
        weights, tags: int16, one for each synapse.
        counts: int64, see `neuro_chip.learning`; `trace_saturations` of both sides.
    """

    kept: ClassVar[tuple[str, ...]] = ("weights", "tags", "xs", "ys", "x0", "y0", "tx", "ty", "counts", "saturated")

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
        self.rule, self.epoch, self.terms = rule, rule.epoch, table(rule)
        n_sources = row_ends.size - 1
        low, high, _ = bounds(sign_mode)
        due = [term for term in (*rule.dw, *rule.dt) if term.gate == "u"]
        self.settings: Ints = np.array(
            [
                *(rule.epoch, grain_of(bits, sign_mode == "mixed"), low, high, rule.rounding == "away"),
                *(all(_is_zero_without_tag(term) for term in due), len(rule.dw)),
            ],
            dtype=np.int64,
        )
        self.row_ends, self.targets = row_ends.astype(np.int64), targets.astype(np.int32)
        self.incoming = np.argsort(self.targets, kind="stable").astype(np.int32)
        self.column_ends: Ints = np.concatenate([[0], np.cumsum(np.bincount(self.targets, minlength=n_targets))])
        self.sources = np.repeat(np.arange(n_sources, dtype=np.int32), np.diff(self.row_ends))[self.incoming]
        self.weights = weights.astype(np.int16)
        self.tags = np.zeros(self.weights.size, dtype=np.int16)
        self.xs, self.x_keep, self.x_impulse, self.x_keys = _traces(name, seed, rule, PRE, n_sources)
        self.ys, self.y_keep, self.y_impulse, self.y_keys = _traces(name, seed, rule, (*POST, *MODULATORY), n_targets)
        self.r_impulse = self.y_impulse.copy()
        self.r_impulse[: len(POST)] = 0
        self.y_impulse[len(POST) :] = 0  # dopamine comes by `release`: post spikes must not add to its traces
        self.x0, self.tx = np.zeros((2, n_sources), dtype=np.uint8)
        self.y0, self.ty = np.zeros((2, n_targets), dtype=np.uint8)
        self.keys = np.array([key(seed, purpose, name) for purpose in ("w", "t")], dtype=np.uint64)
        self.counts: Ints = np.zeros(6, dtype=np.int64)
        self.saturated: Ints = np.zeros(1, dtype=np.int64)

    def step(self, step: int, pre: Ints, post: Ints, payloads: Ints | None = None) -> None:
        """One step of learning.

        Args:
            step: its number, from 1; an epoch ends where it is a multiple of `epoch`.
            pre: ids of the sources that fired, each once.
            post: ids of the targets that fired, each once.
            payloads: not looked at.
        """
        slot = (step - 1) % self.epoch  # decay, then impulses, then the rule: it reads the impulses of its own step
        kernels.decay(self.xs, slot, self.x_keep, self.x_keys, step)
        kernels.decay(self.ys, slot, self.y_keep, self.y_keys, step)
        self.saturated += kernels.spike(self.xs, slot, self.x_impulse, pre, self.x0, self.tx)
        self.saturated += kernels.spike(self.ys, slot, self.y_impulse, post, self.y0, self.ty)
        if slot == self.epoch - 1:
            kernels.learn(
                *(self.terms, self.settings, self.xs, self.ys, self.x0, self.y0, self.tx, self.ty),
                *(self.weights, self.tags, self.row_ends, self.targets, self.column_ends, self.incoming, self.sources),
                *(self.keys, step, self.counts),
            )

    def release(self, step: int, ids: Ints) -> None:
        """Dopamine spikes reach the targets `ids` after a step: r1 grows by its impulse, once for each."""
        slot = (step - 1) % self.epoch
        r1 = self.ys[slot, len(POST)]
        grown: Ints = r1 + np.bincount(ids, minlength=r1.size) * self.r_impulse[len(POST)]
        self.saturated += np.count_nonzero(grown > 127)
        r1[:] = np.minimum(grown, 127)

    def modulate(self, step: int, values: NDArray[np.float64], scale: float) -> None:
        """Set the modulatory traces of all targets after a step.

        Args:
            step: the last finished step (0 before the first).
            values: dopamine of every target in 1/ms; negative values go to r2.
            scale: dopamine of one unit of the traces.
        """
        units: Ints = np.rint(np.asarray(values) / scale).astype(np.int64)
        self.saturated += np.count_nonzero(abs(units) > 127)
        slot, first = (step - 1) % self.epoch, len(POST)
        self.ys[slot, first] = np.clip(units, 0, 127)
        self.ys[slot, first + 1] = np.clip(-units, 0, 127)


def _traces(
    name: str, seed: int, rule: LearningRule, names: tuple[str, ...], neurons: int
) -> tuple[NDArray[np.uint8], Ints, Ints, NDArray[np.uint64]]:
    """History, decays, impulses and keys of the traces of one side; a trace that is not read stays 0."""
    used = [rule.traces.get(trace) for trace in names]
    keep = np.array([(tr.numerator, tr.denominator) if tr else (0, 1) for tr in used], dtype=np.int64)
    impulses = np.array([tr.impulse if tr else 0 for tr in used], dtype=np.int64)
    keys = np.array([key(seed, trace, name) for trace in names], dtype=np.uint64)
    return np.zeros((rule.epoch, len(names), neurons), dtype=np.uint8), keep, impulses, keys
