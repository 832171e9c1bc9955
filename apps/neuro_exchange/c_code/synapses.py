"""Projections as C: a function that sends a spike of neuron i, and the products of Loihi's learning engine.

At the end of an epoch, the code visits each plastic synapse that may change: by a spike of the epoch, or by a product
of the rule that needs no spike (u_k). Random rounding draws by the same keys as the emulated chip, see
`backends/neuro_chip/learning.py`.
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
"""Largest number of integers of a signal per unit of a trace. If several projections learn from the signal, the
smallest of their units counts."""


class Delivery:
    """Builder of the C code that delivers the spikes of a projection. A word is the integer that a synapse adds.

    Args:
        index: index of the projection, the suffix of its names in C.
        part: the projection.
        wires: words and lags of the synapses.
        target: the target population.
        memory: declarations, to which tables are added.
        by_sign: whether negative words go to a second receptor.
        sums: offset of the projection's sums in the array `sums`, if its sum over a step is shifted or wrapped as a
            whole; else None.
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
        self._index, self._part, self._wires, self._target, self._memory = index, part, wires, target, memory
        self._lags = f"{wires.lag.flat[0] if wires.lag.size else 1}u"
        if np.any(wires.lag != wires.lag.flat[:1]):
            about = f"{part.name}: steps until a spike arrives"
            self._lags = f"{memory.table(f'lags_{index}', wires.lag, about)}[e]"

    def lines(self, word: str = "") -> list[str]:
        """Return the C functions of the projection.

        Args:
            word: expression for the word of synapse e of a plastic projection. Static projections have constants.
        """
        self._word = word or self._static_word()
        body = {"dense": self._dense, "csr": self._csr, "one_to_one": self._one_to_one, "grid": self._grid}
        head = f"static void send_{self._index}(uint32_t i, uint32_t times)"
        return [*function(head, body[self._part.layout]()), *self._pour()]

    def _static_word(self) -> str:
        """Return the text of the word of synapse e: a number if all are equal, else an entry of a table."""
        mantissas = scaled(np.atleast_1d(self._wires.words).astype(np.int64))
        if np.all(mantissas.stored == mantissas.stored.flat[:1]):
            return number(int(mantissas.stored.flat[0]) * mantissas.factor if mantissas.stored.size else 0)
        table = self._memory.table(f"words_{self._index}", mantissas.stored, f"{self._part.name}: words")
        return f"{table}[e]" if mantissas.factor == 1 else f"{table}[e] * {number(mantissas.factor)}"

    @property
    def _has_lags_per_synapse(self) -> bool:
        return "[" in self._lags

    def _slot(self) -> str:
        """Return the address, for the first target neuron, to which synapse e adds its word."""
        if self._sums is None:
            return self._ring(self._lags)
        first, last = lags_of(self._wires)
        lag = f" + ({self._lags} - {first}u) * {self._target.size}u" if last > first else ""
        return f"sums + {self._sums}u{lag}"

    def _ring(self, lag: str) -> str:
        """Return the address of the slot of the ring that is read `lag` steps from now."""
        target = self._target
        second = f" + {target.slots * target.size}u" if self._wires.receptor else ""
        return f"ring_{target.number}{second} + later(at_{target.number}, {lag}, {target.slots}u) * {target.size}u"

    def _pour(self) -> list[str]:
        """Return the function that adds the sums of a step to the ring, if the projection has sums."""
        if self._sums is None:
            return []
        q, n, (first, last) = self._index, self._target.size, lags_of(self._wires)
        arguments = f"{n}u, {int(self._wires.wraps)}, {self._wires.shift}u"
        body = [f"if (full_{q} == 0) return;", f"full_{q} = 0;"]
        body += [f"for (uint32_t lag = {first}u; lag <= {last}u; lag++) {{"]
        body += [f"    pour({self._ring('lag')}, sums + {self._sums}u + (lag - {first}u) * {n}u, {arguments});", "}"]
        return function(f"static void pour_{q}(void)", body)

    def _add(self, place: str) -> str:
        if self._target.fixed.kind == "relay":
            return f"count({place}, times);"
        offset = f"{self._target.slots * self._target.size}u, " if self._by_sign else ""
        return f"add({place}, {offset}{self._word}, times);"

    def _into(self, lines: Sequence[str], place: str) -> list[str]:
        """Append the statement that adds the word to a target. Synapses with one lag share a pointer to the slot."""
        if self._has_lags_per_synapse:
            return [*lines, self._add(f"{self._slot()} + {place}")]
        return [*lines, self._add(f"into + {place}")]

    def _begin(self) -> list[str]:
        flag = [] if self._sums is None else [f"full_{self._index} = 1;"]
        return flag if self._has_lags_per_synapse else [*flag, f"{self._target.slot_type} *into = {self._slot()};"]

    def _dense(self) -> list[str]:
        n = self._target.size
        body = [f"uint32_t e = i * {n}u + j;"] if "[e]" in self._word or self._has_lags_per_synapse else []
        return [*self._begin(), *_loop("j", "0", f"{n}u", self._into(body, "j"), (not body))]

    def _csr(self) -> list[str]:
        index, name = self._index, self._part.name
        ends = self._memory.table(f"ends_{index}", self._part.row_ends, f"{name}: ends of the sources' rows", True)
        targets = self._memory.table(f"targets_{index}", self._part.targets.astype(np.int64), f"{name}: targets", True)
        loop = _loop("e", f"{ends}[i]", f"{ends}[i + 1]", self._into([], f"{targets}[e]"))
        return [*self._begin(), *loop]

    def _one_to_one(self) -> list[str]:
        uses_e = "[e]" in self._word or self._has_lags_per_synapse
        return [*(["uint32_t e = i;"] if uses_e else []), *self._begin(), *self._into([], "i")]

    def _grid(self) -> list[str]:
        """Visit each target (map m, row r, column c) whose kernel covers the source. Kernels are stored once per map.

        The source (y, x), counted with the border, is covered by the rows from ceil((y - height + 1) / stride) to
        y / stride, and the same for columns.
        """
        grid = self._part.grid
        assert grid is not None
        depth, stride = grid.kernels[1], grid.stride
        plane = grid.height * grid.width
        lines = [f"uint32_t channel = i / {plane}u, rest = i % {plane}u;"]
        lines += [f"uint32_t y = rest / {grid.width}u + {grid.top}u, x = rest % {grid.width}u + {grid.left}u;"]
        axes = (("r", "y", grid.kernel_height, grid.rows), ("c", "x", grid.kernel_width, grid.columns))
        for axis, position, width, limit in axes:
            begin = f"({position} - {width - 1}u + {stride - 1}u) / {stride}u"
            lines += [f"uint32_t {axis}_begin = {position} < {width}u ? 0 : {begin};"]
            lines += [f"uint32_t {axis}_last = {position} / {stride}u;"]
            lines += [f"uint32_t {axis}_end = {axis}_last < {limit}u ? {axis}_last + 1u : {limit}u;"]
        lines += self._begin()
        first = f"channel / {depth}u * {grid.reach}u"
        word = [f"uint32_t e = line + x - c * {stride}u;"] if "[e]" in self._word else []
        kernel_row = f"(m * {depth}u + channel % {depth}u) * {grid.kernel_height}u + y - r * {stride}u"
        line = [f"uint32_t line = ({kernel_row}) * {grid.kernel_width}u;"] if word else []
        inner = _loop("c", "c_begin", "c_end", self._into(word, f"(m * {grid.rows}u + r) * {grid.columns}u + c"))
        rows = _loop("r", "r_begin", "r_end", [*line, *inner])
        return [*lines, *_loop("m", first, f"{first} + {grid.reach}u", rows)]


def lags_of(wires: FixedProjection) -> tuple[int, int]:
    """Return the shortest and the longest lag of a projection in steps."""
    return (int(wires.lag.min()), int(wires.lag.max())) if wires.lag.size else (1, 1)


def _loop(name: str, begin: str, end: str, body: Sequence[str], without_i: bool = False) -> list[str]:
    head = f"for (uint32_t {name} = {begin}; {name} < {end}; {name}++) {{"
    return [*(["(void)i;"] if without_i else []), head, *(f"    {line}" for line in body), "}"]


def row_of(part: Projection, q: int, targets: int, body: Sequence[str]) -> list[str]:
    """Return a loop over the synapses e of source i, with target neurons j."""
    if part.layout == "one_to_one":
        return ["uint32_t j = i, e = i;", *body]
    if part.layout == "dense":
        return _loop("j", "0", f"{targets}u", [f"uint32_t e = i * {targets}u + j;", *body])
    return _loop("e", f"ends_{q}[i]", f"ends_{q}[i + 1]", [f"uint32_t j = targets_{q}[e];", *body])


class Learning:
    """Builder of the C code of a projection with a learning rule of Loihi.

    Args:
        program: the program with the projection.
        index: index of the projection.
        wires: the rule and the mantissas.
        memory: declarations, to which states are added.

    Attributes:
        kind: C type of a weight.
        rule: the learning rule.
        states: arrays of weights and tags, with their sizes, by state.
        init: statements that initialise all states.
    """

    kind = "int16_t"

    def __init__(self, program: Program, index: int, wires: FixedProjection, memory: Memory) -> None:
        assert isinstance(wires.rule, loihi_rule.LearningRule)
        self._program, self._q, self._wires, self._memory = program, index, wires, memory
        self._part, self.rule = program.projections[index], wires.rule
        self._sources, self._targets = (program.populations[k].size for k in (self._part.source, self._part.target))
        self._grain = bounds(wires.sign_mode, wires.bits)[2].bit_length() - 1  # log2 of the step between mantissas
        self.init = list[str]()
        self.states: dict[str, tuple[str, int]] = {}
        # States: weights, tags, traces at each step of an epoch, and which neurons fired in this step and this epoch.
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
            # Dopamine spikes that have not arrived yet: a slot for each step of the delay and for the present step.
            self._due_size = self._targets if self._part.dopamine_one_to_one else 1
            kind = TYPES[narrowest(0, program.populations[self._part.dopamine].size)]
            self._state("due", kind, (self._part.dopamine_delay + 1) * self._due_size, "0")

    def _state(self, word: str, kind: str, size: int, begins: str) -> None:
        name = self._memory.state(f"{word}_{self._q}", kind, size, f"{self._part.name}: {word}")
        self.init.append(f"for (uint32_t i = 0; i < {size}u; i++) {name}[i] = {begins};")

    def _count(self, trace: str) -> int:
        return self._sources if trace in loihi_rule.PRE else self._targets

    @property
    def word(self) -> str:
        """The expression for the word of synapse e."""
        return f"word_of(w_{self._q}[e], {self._grain}, {self._wires.exponent})"

    def spike_statements(self, k: int) -> list[str]:
        """Return the statements that report a spike of neuron i of population k to the projection."""
        part, q = self._part, self._q
        sides = (("x", part.source), ("y", part.target))
        lines = [f"{side}_fired_{q}[i] = 1;" for side, population in sides if population == k]
        if part.dopamine == k:
            lines.append(f"due_{q}[{self._due_slot(part.dopamine_delay)}{' + i' if self._due_size > 1 else ''}]++;")
        return lines

    def _due_slot(self, steps: int) -> str:
        """Return the index of the dopamine spikes that act some steps from now."""
        lag = f"(now + {steps}u)" if steps else "now"
        return f"(uint32_t)({lag} % {self._part.dopamine_delay + 1}u) * {self._due_size}u"

    @staticmethod
    def signal_scale(parts: Sequence[Any]) -> tuple[int, int]:
        """Return the integer of a signal that stands for 1/ms, and an integer that saturates all traces."""
        finest = min(part._wires.n_scale for part in parts)
        return 1 << max(0, math.floor(math.log2(_LEVELS / finest))), 128 * _LEVELS

    @property
    def step_calls(self) -> list[str]:
        """The calls at the end of each step."""
        return [f"learn_{self._q}();"]

    def dopamine_statements(self, one: int) -> list[str]:
        """Return the statements that set the dopamine of neuron i to values[i] / `one` in 1/ms.

        The emulator divides and rounds. Here a table has, for each value 1 to 127 of a trace, the smallest integer that
        is rounded to it, so no division is needed.
        """
        scale, q, n, trace_max = self._wires.n_scale, self._q, self._targets, loihi_rule.TRACE_MAX
        units = np.rint(np.arange(math.ceil(trace_max * scale * one) + 1) / one / scale)
        smallest = np.searchsorted(units, np.arange(1, trace_max + 1))
        about = f"{self._part.name}: the least dopamine of each value of a trace"
        name = self._memory.table(f"levels_{q}", smallest, about, True)
        index = f"[(uint32_t)((now + {self.rule.epoch - 1}u) % {self.rule.epoch}u) * {n}u + i]"
        return [
            "uint32_t size = values[i] < 0 ? 0u - (uint32_t)values[i] : (uint32_t)values[i], level = 0;",
            f"for (uint32_t bit = 64u; bit != 0; bit /= 2u) level += size >= {name}[level + bit - 1u] ? bit : 0;",
            f"r1_{q}{index} = (uint8_t)(values[i] > 0 ? level : 0);",
            f"r2_{q}{index} = (uint8_t)(values[i] < 0 ? level : 0);",
        ]

    def lines(self) -> list[str]:
        """Return the functions. `learn_Q` is called at the end of each step."""
        # `apply_Q` is the rule at synapse e from neuron i to j. Both changes are computed before either is made.
        q, (low, high, _) = self._q, bounds(self._wires.sign_mode)
        tag = f"t_{q}[e]" if self.rule.dt else "0"
        body = [f"int32_t w = w_{q}[e], t = {tag};", "(void)t;"]
        variables = {"w": self.rule.dw, "t": self.rule.dt}
        body += [f"int32_t d{word} = d{word}_{q}(i, j, number, w, t);" for word, terms in variables.items() if terms]
        for word, grain, (lowest, highest) in (("w", self._grain, (low, high)), ("t", 0, (-256, 255))):
            if variables[word]:
                base = f"step_word(UINT64_C({keyed_random.key(self._program.seed, word, self._part.name)}), now)"
                change = f"rounded(d{word}, {grain}, {base}, e)"
                if word == "w" and self.rule.rounding == "away":
                    change = f"rounded_away(d{word}, {grain})"
                result = f"(int16_t)clipped({word} + {change}, {lowest}, {highest})"
                body.append(f"if (d{word} != 0) {word}_{q}[e] = {result};")
        return [
            *self._changes("w", self.rule.dw),
            *self._changes("t", self.rule.dt),
            *function(f"static void apply_{q}(uint32_t i, uint32_t j, uint32_t e, uint32_t number)", body),
            *self._learn(),
        ]

    def _changes(self, word: str, terms: Sequence[loihi_rule.Term]) -> list[str]:
        """Return the function that sums the due products for a variable, in units of 2^-7."""
        if not terms:
            return []
        unused = [f"(void){name};" for name in ("i", "j", "number", "w", "t")]
        body = [f"int32_t sum = {word} * 128;", *unused]
        for term in terms:
            conditions = [f"(number & {(1 << term.every) - 1}u) == 0"] if term.every else []
            conditions += {"x0": [f"x_last_{self._q}[i] != 0"], "y0": [f"y_last_{self._q}[j] != 0"], "u": []}[term.gate]
            factors = " * ".join(["(int64_t)" + number(term.mantissa), *(self._factor(f, term) for f in term.factors)])
            line = f"sum = summed(sum, {factors}, {term.exponent + loihi_rule.FRACTION_BITS});"
            body.append(f"if ({' && '.join(conditions)}) {line}" if conditions else line)
        head = f"static int32_t d{word}_{self._q}(uint32_t i, uint32_t j, uint32_t number, int32_t w, int32_t t)"
        return function(head, [*body, f"return sum - {word} * 128;"])

    def _factor(self, factor: loihi_rule.Factor, term: loihi_rule.Term) -> str:
        """Return the text of a factor. Traces are read at the step of the gating spike, or at the end of the epoch."""
        name, add, q, end = factor.name, factor.add, self._q, f"{self.rule.epoch - 1}u"
        if name in ("w", "t"):
            text = name
        elif name in ("x0", "y0"):
            side, neuron = name[0], "i" if name == "x0" else "j"
            text = f"({side}_last_{q}[{neuron}] != 0)"
        else:
            step = {"x0": f"(x_last_{q}[i] - 1u)", "y0": f"(y_last_{q}[j] - 1u)", "u": end}[term.gate]
            step = end if name in loihi_rule.MODULATORY else step
            text = f"{name}_{q}[{step} * {self._count(name)}u + {'i' if name in loihi_rule.PRE else 'j'}]"
        return f"({text} {'-' if add < 0 else '+'} {abs(add)})" if add else text

    def _learn(self) -> list[str]:
        """Return the function of a step: traces decay, spikes add impulses, and the rule acts at an epoch's end."""
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
                    element = f"{name}_{q}[slot * {size}u + i]"
                    body += [f"        {element} = raised({element}, {self.rule.traces[name].impulse}u);"]
            body += [f"        {side}_last_{q}[i] = (uint8_t)(slot + 1u);", f"        {side}_fired_{q}[i] = 0;"]
            body += ["    }", "}"]
        body += [f"if (slot == {epoch - 1}u) {{", *indented(self._visit()), "}"]
        if self._part.dopamine >= 0:
            n, due_size, impulse = self._targets, self._due_size, self.rule.traces["r1"].impulse
            body += [f"uint32_t due = {self._due_slot(0)};", f"for (uint32_t i = 0; i < {n}u; i++) {{"]
            body += [f"    uint8_t *r1 = r1_{q} + slot * {n}u + i;"]
            body += [f"    *r1 = raised(*r1, due_{q}[due{' + i' if due_size > 1 else ''}] * UINT32_C({impulse}));", "}"]
            body += [f"memset(due_{q} + due, 0, sizeof *due_{q} * {due_size}u);"]
        return function(f"static void learn_{q}(void)", body)

    def _visit(self) -> list[str]:
        """Return the loop over all synapses that a product may change, and the reset of the epoch's spikes."""
        q, epoch = self._q, self.rule.epoch
        ungated_terms = [term for term in (*self.rule.dw, *self.rule.dt) if term.gate == "u"]
        condition = " || ".join(sorted({f"(number & {(1 << term.every) - 1}u) == 0" for term in ungated_terms}))
        # Synapses whose tag is 0 are skipped if all these products have the tag as a factor.
        if (
            ungated_terms
            and self.rule.dt
            and all(any(factor.name == "t" and not factor.add for factor in term.factors) for term in ungated_terms)
        ):
            condition = f"(t_{q}[e] != 0 && ({condition}))"
        lines = [f"uint32_t number = (uint32_t)(now / {epoch}u);"]
        lines += [f"for (uint32_t i = 0; i < {self._sources}u; i++) {{"]
        condition += " || " if condition else ""
        test = f"if ({condition}x_last_{q}[i] != 0 || y_last_{q}[j] != 0) apply_{q}(i, j, e, number);"
        lines += [*indented(row_of(self._part, q, self._targets, [test])), "}"]
        for side, size in (("x", self._sources), ("y", self._targets)):
            lines.append(f"for (uint32_t i = 0; i < {size}u; i++) {side}_last_{q}[i] = 0;")
        return lines
