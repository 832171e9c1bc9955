"""Delays that learn: whole steps in the delay register, the rest in the tag, both written by the host.

A delay is kept as a whole number of 1/256 steps. The register holds the nearest whole step, which is what a spike takes
that is sent now, and the tag the signed rest.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arrival_rule import acts_late, register
from neuro.chips.loihi.arithmetic import REGISTER_OF_ONE
from neuro.chips.loihi.learning import FRACTIONS
from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.kernels.jit import compiled, kernel
from neuro.model.synapses.base import DELAY
from neuro.program.program import Floats, Ints, Projection
from neuro_chip import tables as t
from neuro_chip.tables import Arrays

_NEVER = -1


class Delays:
    """The delays of all projections whose rules change them.

    Args:
        fixed: the quantised program.
        arrays: of the loop; its lags are written.

    Attributes:
        units: the delays of each such projection in 1/256 steps, int32.
    """

    def __init__(self, fixed: FixedProgram, arrays: Arrays) -> None:
        self._program, self._a = fixed.program, arrays
        self.units: dict[int, NDArray[np.int32]] = {}
        self._pairs: dict[int, _Pairs] = {}
        for index, part in enumerate(self._program.projections):
            if part.synapse.delays:
                self.units[index] = self._described(part)
                if part.synapse.learns == "pairs":
                    self._pairs[index] = _Pairs(fixed, index)

    def __contains__(self, index: object) -> bool:
        return index in self.units

    def __bool__(self) -> bool:
        """Whether any changes after each step."""
        return bool(self._pairs)

    def _described(self, part: Projection) -> NDArray[np.int32]:
        return np.broadcast_to(part.delay * FRACTIONS, part.size).astype(np.int32)

    def steps(self, index: int) -> Ints:
        """How many steps the next spikes take, one for each synapse."""
        return (self.units[index].astype(np.int64) + FRACTIONS // 2) // FRACTIONS

    def read(self, index: int) -> Floats:
        """The delays in ms."""
        return self.units[index].astype(np.float64) * (self._program.resolution / FRACTIONS)

    def raw(self, index: int, name: str) -> Ints | None:
        """The delay registers or the tags; None for another name."""
        if name == "delay":
            return register(self._lags(index).astype(np.int32), REGISTER_OF_ONE).astype(np.int64)
        # The tag is signed, from -128 to 127: the register has the nearest step, not the one below.
        return self.units[index] - FRACTIONS * self.steps(index) if name in ("t", "tag") else None

    def bounds(self, index: int) -> tuple[int, int]:
        """The smallest and the largest delay, in 1/256 steps."""
        fewest, most = self._program.projections[index].delay_range(self._program.resolution)
        return FRACTIONS * fewest, FRACTIONS * most

    def _lags(self, index: int) -> Ints:
        model = self._program.populations[self._program.projections[index].target].model
        return self.steps(index) + acts_late(model)

    def write(self, index: int) -> None:
        """Let the loop send over the delays that there are now."""
        first = self._a["projections"][index, t.LAG]
        self._a["lags"][first : first + self.units[index].size] = self._lags(index)

    def after(self, step: int) -> None:
        """What the spikes of a step change; those emitted in it are sent with what they have changed."""
        # The loop stops after each step where pairs change delays: the host writes them, as it would on the chip, which
        # cannot write its own delay registers.
        emitted, pops = self._a["emitted"][: self._a["clock"][t.EMITTED]], self._a["pops"]
        for index, pairs in self._pairs.items():
            part = self._program.projections[index]
            ends = [np.searchsorted(emitted, pops[k, [t.BEGIN, t.END]]) for k in (part.source, part.target)]
            pre, post = (
                emitted[lo:hi] - pops[k, t.BEGIN] for (lo, hi), k in zip(ends, (part.source, part.target), strict=True)
            )
            if pre.size or post.size:
                pairs.learn(self.units[index], *self.bounds(index), pre, post, step)
                self.write(index)

    def start_anew(self, described: bool) -> None:
        """No spike is known; the delays as described if asked."""
        for pairs in self._pairs.values():
            pairs.start_anew()
        for index in self.units if described else ():
            self.units[index] = self._described(self._program.projections[index])
            self.write(index)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that changes."""
        arrays: dict[str, NDArray[Any]] = {f"delays.{index}": units.copy() for index, units in self.units.items()}
        for index, pairs in self._pairs.items():
            arrays |= {f"delays.{index}.pre": pairs.last_pre.copy(), f"delays.{index}.post": pairs.last_post.copy()}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for index in self.units:
            self.units[index] = arrays[f"delays.{index}"].astype(np.int32)
            self.write(index)
        for index, pairs in self._pairs.items():
            pairs.last_pre[:], pairs.last_post[:] = arrays[f"delays.{index}.pre"], arrays[f"delays.{index}.post"]


class _Pairs:
    """A rule that spike pairs drive, and when the neurons of its two sides fired last."""

    def __init__(self, fixed: FixedProgram, index: int) -> None:
        program = fixed.program
        part = program.projections[index]
        n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
        pre, post = program.connections(index)
        by_source, by_target = np.argsort(pre, kind="stable"), np.argsort(post, kind="stable")
        self._rows = by_source, np.searchsorted(pre[by_source], np.arange(n_source + 1))
        self._columns = by_target, np.searchsorted(post[by_target], np.arange(n_target + 1))
        self._ends = pre.astype(np.int64), post.astype(np.int64)
        self._h, self._c, self._y = program.resolution, np.zeros(part.synapse.width), np.zeros((2, 1))
        arithmetic = part.synapse.arithmetic
        arithmetic.constants(part.synapse.vector(), self._h, self._c)
        self._pass = _pass(arithmetic.on_pre, arithmetic.on_post)
        self.last_pre, self.last_post = np.full(n_source, _NEVER), np.full(n_target, _NEVER)

    def start_anew(self) -> None:
        """None has fired."""
        self.last_pre[:] = _NEVER
        self.last_post[:] = _NEVER

    def learn(self, units: NDArray[np.int32], low: int, high: int, pre: Ints, post: Ints, step: int) -> None:
        """Post spikes of a step act, then pre spikes; neither side sees those of this step."""
        self._pass(
            *(self._y, units, self._h / FRACTIONS, low, high, self._c, *self._rows, *self._columns, *self._ends),
            *(pre, post, self.last_pre, self.last_post, step, self._h),
        )


@cache
def _pass(on_pre: Any, on_post: Any) -> Any:
    """The pass over the synapses of the neurons that fired, compiled for a rule."""
    by_pre, by_post = compiled(on_pre), compiled(on_post)

    @kernel
    def learn(y, units, unit, low, high, c, by_source, row_ends, by_target, column_ends, source, target,
              pre, post, last_pre, last_post, step, h):  # fmt: skip
        # Post before pre, as in the float backends; neither side sees the other's spikes of this step, which are
        # entered below.
        for j in post:
            for n in range(column_ends[j], column_ends[j + 1]):
                e = by_target[n]
                last = last_pre[source[e]]
                # The rule's own function in ms; between spikes only whole units of 1/256 step are kept, as the two
                # registers hold them.
                y[DELAY, 0] = units[e] * unit
                by_post(y, 0, c, (np.inf if last < 0 else (step - last) * h,), (0.0,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            for n in range(row_ends[i], row_ends[i + 1]):
                e = by_source[n]
                last = last_post[target[e]]
                y[DELAY, 0] = units[e] * unit
                by_pre(y, 0, c, (0.0,), (np.inf if last < 0 else (step - last) * h,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            last_pre[i] = step
        for j in post:
            last_post[j] = step

    return learn
