"""One projection as C: its words, and a function that sends a spike of neuron i along it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedProjection
from neuro.exchange.c_code.arrays import Memory, number, scaled
from neuro.exchange.c_code.cells import Cells, function
from neuro.program.program import Projection


class Delivery:
    """A projection onto a population.

    Args:
        index: with which its names in C end.
        part: the projection.
        wires: its words and lags.
        target: what it sends to.
        memory: takes its tables.
        by_sign: whether words below 0 go to a receptor of their own.
        sums: where the sums of a step begin, if they are shifted or wrapped before they are added to those of others.
    """

    def __init__(
        self,
        index: int,
        part: Projection,
        wires: FixedProjection,
        target: Cells,
        memory: Memory,
        by_sign: bool,
        sums: int | None,
    ) -> None:
        self._by_sign, self._sums = by_sign, sums
        self._index, self._part, self._wires, self._to, self._memory = index, part, wires, target, memory
        self._lags = self._shared("lag", wires.lag, "lags", "steps to the update that sees a spike")

    def lines(self, word: str = "") -> list[str]:
        """The function.

        Args:
            word: of synapse e, of a projection that learns; what its registers say elsewhere.
        """
        self._word = word or self._words()
        body = {"dense": self._dense, "csr": self._csr, "one_to_one": self._one_to_one, "grid": self._grid}
        head = f"static void send_{self._index}(uint32_t i, uint32_t times)"
        return [*function(head, body[self._part.layout]()), *self._pour()]

    def _words(self) -> str:
        """The word of synapse e: a number that all share, or an entry of a table."""
        found = scaled(np.atleast_1d(self._wires.words).astype(np.int64))
        if np.all(found.stored == found.stored.flat[:1]):
            return number(int(found.stored.flat[0]) * found.factor if found.stored.size else 0)
        table = self._memory.table(f"words_{self._index}", found.stored, f"{self._part.name}: words")
        return f"{table}[e]" if found.factor == 1 else f"{table}[e] * {number(found.factor)}"

    def _shared(self, one: str, values: NDArray[np.integer], name: str, about: str) -> str:
        if values.size == 0 or np.all(values == values.flat[0]):
            return f"{values.flat[0] if values.size else 1}u"
        return f"{self._memory.table(f'{name}_{self._index}', values, f'{self._part.name}: {about}')}[e]"

    @property
    def _own_lags(self) -> bool:
        return "[" in self._lags

    def _slot(self) -> str:
        """Where a spike that synapse e sends now is added, of the first target."""
        if self._sums is None:
            return self._ring(self._lags)
        first, last = lags_of(self._wires)
        lag = f" + ({self._lags} - {first}u) * {self._to.size}u" if last > first else ""
        return f"sums + {self._sums}u{lag}"

    def _ring(self, lag: str) -> str:
        """The slot of the ring that is read some steps from now."""
        to = self._to
        second = f" + {to.slots * to.size}u" if self._wires.receptor else ""
        return f"ring_{to.number}{second} + later(at_{to.number}, {lag}, {to.slots}u) * {to.size}u"

    def _pour(self) -> list[str]:
        """The function that adds the sums of a step to the ring, if there are such."""
        if self._sums is None:
            return []
        q, n, (first, last) = self._index, self._to.size, lags_of(self._wires)
        words = f"{n}u, {int(self._wires.wraps)}, {self._wires.shift}u"
        body = [f"if (full_{q} == 0) return;", f"full_{q} = 0;"]
        body += [f"for (uint32_t lag = {first}u; lag <= {last}u; lag++) {{"]
        body += [f"    pour({self._ring('lag')}, sums + {self._sums}u + (lag - {first}u) * {n}u, {words});", "}"]
        return function(f"static void pour_{q}(void)", body)

    def _add(self, place: str) -> str:
        if self._to.fixed.kind == "relay":
            return f"count({place}, times);"
        below = f"{self._to.slots * self._to.size}u, " if self._by_sign else ""
        return f"add({place}, {below}{self._word}, times);"

    def _into(self, lines: Sequence[str], place: str) -> list[str]:
        """Add to a place of the target; the slot is found once where all synapses have one lag."""
        if self._own_lags:
            return [*lines, self._add(f"{self._slot()} + {place}")]
        return [*lines, self._add(f"into + {place}")]

    def _begin(self) -> list[str]:
        full = [] if self._sums is None else [f"full_{self._index} = 1;"]
        return full if self._own_lags else [*full, f"{self._to.slot} *into = {self._slot()};"]

    def _dense(self) -> list[str]:
        n = self._to.size
        body = [f"uint32_t e = i * {n}u + j;"] if "[e]" in self._word or self._own_lags else []
        return [*self._begin(), *_loop("j", "0", f"{n}u", self._into(body, "j"), self._unused_i(body))]

    def _csr(self) -> list[str]:
        index, name = self._index, self._part.name
        ends = self._memory.table(f"ends_{index}", self._part.row_ends, f"{name}: ends of rows of its sources", True)
        targets = self._memory.table(f"targets_{index}", self._part.targets.astype(np.int64), f"{name}: targets", True)
        loop = _loop("e", f"{ends}[i]", f"{ends}[i + 1]", self._into([], f"{targets}[e]"))
        return [*self._begin(), *loop]

    def _one_to_one(self) -> list[str]:
        uses = "[e]" in self._word or self._own_lags
        return [*(["uint32_t e = i;"] if uses else []), *self._begin(), *self._into([], "i")]

    def _grid(self) -> list[str]:
        """Every place of every map whose kernel covers the source; kernels are stored once, without places."""
        g = self._part.grid
        assert g is not None
        depth = g.kernels[1]
        lines = [f"uint32_t channel = i / {g.height * g.width}u, rest = i % {g.height * g.width}u;"]
        lines += [f"uint32_t y = rest / {g.width}u + {g.top}u, x = rest % {g.width}u + {g.left}u;"]
        for axis, at, side, places in (("r", "y", g.kernel_height, g.rows), ("c", "x", g.kernel_width, g.columns)):
            # from ceil((at - side + 1) / stride) to at / stride
            begin = f"({at} - {side - 1}u + {g.stride - 1}u) / {g.stride}u"
            lines += [f"uint32_t {axis}_begin = {at} < {side}u ? 0 : {begin};"]
            lines += [f"uint32_t {axis}_last = {at} / {g.stride}u;"]
            lines += [f"uint32_t {axis}_end = {axis}_last < {places}u ? {axis}_last + 1u : {places}u;"]
        lines += self._begin()
        first = f"channel / {depth}u * {g.reach}u"
        word = [f"uint32_t e = line + x - c * {g.stride}u;"] if "[e]" in self._word else []
        kernel = f"((m * {depth}u + channel % {depth}u) * {g.kernel_height}u + y - r * {g.stride}u) * {g.kernel_width}u"
        line = [f"uint32_t line = {kernel};"] if word else []
        inner = _loop("c", "c_begin", "c_end", self._into(word, f"(m * {g.rows}u + r) * {g.columns}u + c"))
        rows = _loop("r", "r_begin", "r_end", [*line, *inner])
        return [*lines, *_loop("m", first, f"{first} + {g.reach}u", rows)]

    def _unused_i(self, body: Sequence[str]) -> bool:
        return not body


def lags_of(wires: FixedProjection) -> tuple[int, int]:
    """The shortest and the longest lag of a projection."""
    return (int(wires.lag.min()), int(wires.lag.max())) if wires.lag.size else (1, 1)


def _loop(name: str, begin: str, end: str, body: Sequence[str], without_i: bool = False) -> list[str]:
    head = f"for (uint32_t {name} = {begin}; {name} < {end}; {name}++) {{"
    return [*(["(void)i;"] if without_i else []), head, *(f"    {line}" for line in body), "}"]
