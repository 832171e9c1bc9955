"""Projections as C: a function that sends a spike of neuron i, and Loihi's learning engine, product by product.

All synapses that learn are visited at the end of an epoch in which a spike or a product with u_k may change them. What
is rounded is drawn by the same keys as on the emulated chip, see `backends/neuro_chip/learning.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from neuro.apps import keyed_random
from neuro.chips import FixedProjection, bounds
from neuro.extend import Program, Projection, loihi_rule
from neuro_exchange.c_code.arrays import TYPES, Memory, narrowest, number, scaled
from neuro_exchange.c_code.cells import Cells, function, indented

_LEVELS = 256
"""Numbers of a signal that stand for one unit of a trace, at most, of the finest projection that listens."""


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
        self._lags = f"{wires.lag.flat[0] if wires.lag.size else 1}u"
        if np.any(wires.lag != wires.lag.flat[:1]):
            about = f"{part.name}: steps to the update that sees a spike"
            self._lags = f"{memory.table(f'lags_{index}', wires.lag, about)}[e]"

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
        return [*self._begin(), *_loop("j", "0", f"{n}u", self._into(body, "j"), (not body))]

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


def lags_of(wires: FixedProjection) -> tuple[int, int]:
    """The shortest and the longest lag of a projection."""
    return (int(wires.lag.min()), int(wires.lag.max())) if wires.lag.size else (1, 1)


def _loop(name: str, begin: str, end: str, body: Sequence[str], without_i: bool = False) -> list[str]:
    head = f"for (uint32_t {name} = {begin}; {name} < {end}; {name}++) {{"
    return [*(["(void)i;"] if without_i else []), head, *(f"    {line}" for line in body), "}"]


def row_of(part: Projection, q: int, targets: int, body: Sequence[str]) -> list[str]:
    """What is done to the synapses e of source i onto neurons j."""
    if part.layout == "one_to_one":
        return ["uint32_t j = i, e = i;", *body]
    if part.layout == "dense":
        return _loop("j", "0", f"{targets}u", [f"uint32_t e = i * {targets}u + j;", *body])
    return _loop("e", f"ends_{q}[i]", f"ends_{q}[i + 1]", [f"uint32_t j = targets_{q}[e];", *body])


class Learning:
    """A projection that learns by a rule of Loihi.

    Args:
        program: has it.
        index: of the projection.
        wires: its rule and its mantissas.
        memory: takes its states.
    """

    kind = "int16_t"

    def __init__(self, program: Program, index: int, wires: FixedProjection, memory: Memory) -> None:
        assert isinstance(wires.rule, loihi_rule.LearningRule)
        self._program, self._q, self._wires, self._memory = program, index, wires, memory
        self._part, self.rule = program.projections[index], wires.rule
        self._sources, self._targets = (program.populations[k].size for k in (self._part.source, self._part.target))
        self._grain = bounds(wires.sign_mode, wires.bits)[2].bit_length() - 1
        self._init, self._read = list[str](), set[str]()
        self.states: dict[str, tuple[str, int]] = {}
        # The states: weights and tags, traces of each step of an epoch, and who fired in this step and this epoch.
        q, name, slots = self._q, self._part.name, self.rule.epoch
        first = np.broadcast_to(self._wires.mantissas, self._part.size).astype(np.int64)
        begin = memory.entry(f"w_begin_{q}", first, f"{name}: mantissas at step 0")
        self._state("w", "int16_t", self._part.size, begin)
        self.states["weight"] = f"w_{q}", self._part.size
        if self.rule.dt:
            self._state("t", "int16_t", self._part.size, "0")
            self.states["t"] = f"t_{q}", self._part.size
        for trace in self.rule.traces:
            self._state(trace, "uint8_t", slots * self._count(trace), "0")
        for side, size in (("x", self._sources), ("y", self._targets)):
            self._state(f"{side}_fired", "uint8_t", size, "0")
            self._state(f"{side}_last", "uint8_t", size, "0")
        if self._part.dopamine >= 0:
            # Dopamine spikes under way, one slot for each step of the delay and for the present step.
            self._sent = self._targets if self._part.dopamine_one_to_one else 1
            kind = TYPES[narrowest(0, program.populations[self._part.dopamine].size)]
            self._state("due", kind, (self._part.dopamine_delay + 1) * self._sent, "0")

    def _state(self, word: str, kind: str, size: int, begins: str) -> None:
        name = self._memory.state(f"{word}_{self._q}", kind, size, f"{self._part.name}: {word}")
        self._init.append(f"for (uint32_t i = 0; i < {size}u; i++) {name}[i] = {begins};")

    def _count(self, trace: str) -> int:
        return self._sources if trace in loihi_rule.PRE else self._targets

    @property
    def word(self) -> str:
        """What a spike adds by synapse e."""
        return f"word_of(w_{self._q}[e], {self._grain}, {self._wires.exponent})"

    def heard_from(self, k: int) -> list[str]:
        """Statements with which the projection hears of a spike of neuron i of a population."""
        part, q = self._part, self._q
        sides = (("x", part.source), ("y", part.target))
        lines = [f"{side}_fired_{q}[i] = 1;" for side, population in sides if population == k]
        if part.dopamine == k:
            lines.append(f"due_{q}[{self._due_slot(part.dopamine_delay)}{' + i' if self._sent > 1 else ''}]++;")
        return lines

    def _due_slot(self, steps: int) -> str:
        """The place of the dopamine spikes that act some steps from now."""
        lag = f"(now + {steps}u)" if steps else "now"
        return f"(uint32_t)({lag} % {self._part.dopamine_delay + 1}u) * {self._sent}u"

    @staticmethod
    def numbers(parts: Sequence[Any]) -> tuple[int, int]:
        """The number of a signal that stands for 1/ms, and one that saturates the traces of what listens."""
        finest = min(part._wires.n_scale for part in parts)
        return 1 << max(0, math.floor(math.log2(_LEVELS / finest))), 128 * _LEVELS

    @property
    def calls(self) -> list[str]:
        """What a step does in its end."""
        return [f"learn_{self._q}();"]

    def set_by(self, one: int) -> list[str]:
        """Statements that set the dopamine of neuron i to values[i] / `one` in 1/ms, rounded as on the emulator."""
        # Of each of the 127 values of a trace the smallest number that is rounded to it.
        scale, q, n, most = self._wires.n_scale, self._q, self._targets, loihi_rule.TRACE_MAX
        units = np.rint(np.arange(math.ceil(most * scale * one) + 1) / one / scale)
        ends = np.searchsorted(units, np.arange(1, most + 1))
        about = f"{self._part.name}: the least dopamine of each value of a trace"
        name = self._memory.table(f"levels_{q}", ends, about, True)
        at = f"[(uint32_t)((now + {self.rule.epoch - 1}u) % {self.rule.epoch}u) * {n}u + i]"
        return [
            "uint32_t size = values[i] < 0 ? 0u - (uint32_t)values[i] : (uint32_t)values[i], level = 0;",
            f"for (uint32_t bit = 64u; bit != 0; bit /= 2u) level += size >= {name}[level + bit - 1u] ? bit : 0;",
            f"r1_{q}{at} = (uint8_t)(values[i] > 0 ? level : 0);",
            f"r2_{q}{at} = (uint8_t)(values[i] < 0 ? level : 0);",
        ]

    @property
    def init(self) -> list[str]:
        """Statements that put all states where they are at step 0."""
        return self._init

    def lines(self) -> list[str]:
        """The functions; `learn_Q` is called at the end of each step."""
        # The rule at synapse e from neuron i to j; both changes are made from the values before.
        q, (low, high, _) = self._q, bounds(self._wires.sign_mode)
        tag = f"t_{q}[e]" if self.rule.dt else "0"
        body = [f"int32_t w = w_{q}[e], t = {tag};", "(void)t;"]
        words = {"w": self.rule.dw, "t": self.rule.dt}
        body += [f"int32_t d{word} = d{word}_{q}(i, j, number, w, t);" for word, terms in words.items() if terms]
        for word, grain, (least, most) in (("w", self._grain, (low, high)), ("t", 0, (-256, 255))):
            if words[word]:
                base = f"step_word(UINT64_C({keyed_random.key(self._program.seed, word, self._part.name)}), now)"
                by = f"rounded(d{word}, {grain}, {base}, e)"
                if word == "w" and self.rule.rounding == "away":
                    by = f"rounded_away(d{word}, {grain})"
                new = f"(int16_t)clipped({word} + {by}, {least}, {most})"
                body.append(f"if (d{word} != 0) {word}_{q}[e] = {new};")
        return [
            *self._changes("w", self.rule.dw),
            *self._changes("t", self.rule.dt),
            *function(f"static void apply_{q}(uint32_t i, uint32_t j, uint32_t e, uint32_t number)", body),
            *self._learn(),
        ]

    def _changes(self, word: str, terms: Sequence[loihi_rule.Term]) -> list[str]:
        """What the due products change a variable by, in units of 2^-7."""
        if not terms:
            return []
        unused = [f"(void){name};" for name in ("i", "j", "number", "w", "t")]
        body = [f"int32_t sum = {word} * 128;", *unused]
        for term in terms:
            due = [f"(number & {(1 << term.every) - 1}u) == 0"] if term.every else []
            due += {"x0": [f"x_last_{self._q}[i] != 0"], "y0": [f"y_last_{self._q}[j] != 0"], "u": []}[term.gate]
            factors = " * ".join(["(int64_t)" + number(term.mantissa), *(self._factor(f, term) for f in term.factors)])
            line = f"sum = summed(sum, {factors}, {term.exponent + loihi_rule.FRACTION_BITS});"
            body.append(f"if ({' && '.join(due)}) {line}" if due else line)
        head = f"static int32_t d{word}_{self._q}(uint32_t i, uint32_t j, uint32_t number, int32_t w, int32_t t)"
        return function(head, [*body, f"return sum - {word} * 128;"])

    def _factor(self, factor: loihi_rule.Factor, term: loihi_rule.Term) -> str:
        """A factor as the product reads it: traces at the step of the spike that gates it, or at the epoch's end."""
        name, add, q, end = factor.name, factor.add, self._q, f"{self.rule.epoch - 1}u"
        if name in ("w", "t"):
            text = name
        elif name in ("x0", "y0"):
            side, who = name[0], "i" if name == "x0" else "j"
            text = f"({side}_last_{q}[{who}] != 0)"
        else:
            at = {"x0": f"(x_last_{q}[i] - 1u)", "y0": f"(y_last_{q}[j] - 1u)", "u": end}[term.gate]
            at = end if name in loihi_rule.MODULATORY else at
            text = f"{name}_{q}[{at} * {self._count(name)}u + {'i' if name in loihi_rule.PRE else 'j'}]"
        return f"({text} {'-' if add < 0 else '+'} {abs(add)})" if add else text

    def _learn(self) -> list[str]:
        """Traces decay, then spikes add their impulses; at the end of an epoch the rule is applied."""
        q, epoch = self._q, self.rule.epoch
        body = [f"uint32_t slot = (uint32_t)((now - 1u) % {epoch}u), before = (slot + {epoch - 1}u) % {epoch}u;"]
        body += ["(void)before;"]
        for name, trace in self.rule.traces.items():
            n, word = self._count(name), f"{name}_{q}"
            base = f"step_word(UINT64_C({keyed_random.key(self._program.seed, name, self._part.name)}), now)"
            faded = f"faded({word}[before * {n}u + i], {trace.numerator}u, {trace.denominator}u, base, i)"
            loop = f"for (uint32_t i = 0; i < {n}u; i++) {word}[slot * {n}u + i] = {faded};"
            body += ["{", *indented([f"uint64_t base = {base};", loop]), "}"]
        for side, names, size in (("x", loihi_rule.PRE, self._sources), ("y", loihi_rule.POST, self._targets)):
            body += [f"for (uint32_t i = 0; i < {size}u; i++) {{", f"    if ({side}_fired_{q}[i] != 0) {{"]
            for name in names:
                if name in self.rule.traces:
                    at = f"{name}_{q}[slot * {size}u + i]"
                    body += [f"        {at} = raised({at}, {self.rule.traces[name].impulse}u);"]
            body += [f"        {side}_last_{q}[i] = (uint8_t)(slot + 1u);", f"        {side}_fired_{q}[i] = 0;"]
            body += ["    }", "}"]
        body += [f"if (slot == {epoch - 1}u) {{", *indented(self._visit()), "}"]
        if self._part.dopamine >= 0:
            n, many, impulse = self._targets, self._sent, self.rule.traces["r1"].impulse
            body += [f"uint32_t due = {self._due_slot(0)};", f"for (uint32_t i = 0; i < {n}u; i++) {{"]
            body += [f"    uint8_t *r1 = r1_{q} + slot * {n}u + i;"]
            body += [f"    *r1 = raised(*r1, due_{q}[due{' + i' if many > 1 else ''}] * UINT32_C({impulse}));", "}"]
            body += [f"memset(due_{q} + due, 0, sizeof *due_{q} * {many}u);"]
        return function(f"static void learn_{q}(void)", body)

    def _visit(self) -> list[str]:
        """All synapses that a product may change; then the spikes of the epoch are forgotten."""
        q, epoch = self._q, self.rule.epoch
        swept = [term for term in (*self.rule.dw, *self.rule.dt) if term.gate == "u"]
        acts = " || ".join(sorted({f"(number & {(1 << term.every) - 1}u) == 0" for term in swept}))
        # A product of a tag of 0 is 0.
        if (
            swept
            and self.rule.dt
            and all(any(each.name == "t" and not each.add for each in term.factors) for term in swept)
        ):
            acts = f"(t_{q}[e] != 0 && ({acts}))"
        lines = [f"uint32_t number = (uint32_t)(now / {epoch}u);"]
        lines += [f"for (uint32_t i = 0; i < {self._sources}u; i++) {{"]
        acts += " || " if acts else ""
        test = f"if ({acts}x_last_{q}[i] != 0 || y_last_{q}[j] != 0) apply_{q}(i, j, e, number);"
        lines += [*indented(row_of(self._part, q, self._targets, [test])), "}"]
        for side, size in (("x", self._sources), ("y", self._targets)):
            lines.append(f"for (uint32_t i = 0; i < {size}u; i++) {side}_last_{q}[i] = 0;")
        return lines
