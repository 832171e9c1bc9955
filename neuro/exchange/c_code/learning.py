"""Loihi's learning engine as C: the rule of one projection, written out product by product.

All synapses are visited at the end of an epoch in which a spike or a product with u_k may change them. What is rounded
is drawn by the same keys as on the emulated chip, see `backends/neuro_chip/learning.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.chips.fixed import FixedProjection
from neuro.chips.loihi import bounds, grain_of
from neuro.core.keyed_random import key
from neuro.exchange.c_code.arrays import Memory, number
from neuro.exchange.c_code.cells import function, indented
from neuro.model.synapses.loihi_rule import FRACTION_BITS, MODULATORY, POST, PRE, Factor, LearningRule, Term
from neuro.program.program import Program


class Learning:
    """A projection that learns.

    Args:
        program: has it.
        index: of the projection.
        wires: its rule and its mantissas.
        memory: takes its states.
    """

    def __init__(self, program: Program, index: int, wires: FixedProjection, memory: Memory) -> None:
        assert isinstance(wires.rule, LearningRule)
        self._program, self._q, self._wires, self._memory = program, index, wires, memory
        self._part, self.rule = program.projections[index], wires.rule
        self._sources, self._targets = (program.populations[k].size for k in (self._part.source, self._part.target))
        self._grain = grain_of(wires.bits, wires.sign_mode == "mixed").bit_length() - 1
        self._init, self._read = list[str](), set[str]()
        self.states: dict[str, tuple[str, int]] = {}
        self._declare()

    def _declare(self) -> None:
        """The states: weights and tags, traces of each step of an epoch, and who fired in this step and this epoch."""
        q, name, slots = self._q, self._part.name, self.rule.epoch
        first = np.broadcast_to(self._wires.mantissas, self._part.size).astype(np.int64)
        begin = self._memory.table(f"w_begin_{q}", first, f"{name}: mantissas at step 0")
        self._state("w", "int16_t", self._part.size, f"{begin}[i]")
        self.states["weight"] = f"w_{q}", self._part.size
        if self.rule.dt:
            self._state("t", "int16_t", self._part.size, "0")
            self.states["t"] = f"t_{q}", self._part.size
        for trace in self.rule.traces:
            self._state(trace, "uint8_t", slots * self._count(trace), "0")
        for side, size in (("x", self._sources), ("y", self._targets)):
            self._state(f"{side}_fired", "uint8_t", size, "0")
            self._state(f"{side}_last", "uint8_t", size, "0")

    def _state(self, word: str, kind: str, size: int, begins: str) -> None:
        name = self._memory.state(f"{word}_{self._q}", kind, size, f"{self._part.name}: {word}")
        self._init.append(f"for (uint32_t i = 0; i < {size}u; i++) {name}[i] = {begins};")

    def _count(self, trace: str) -> int:
        return self._sources if trace in PRE else self._targets

    @property
    def word(self) -> str:
        """What a spike adds by synapse e."""
        return f"word_of(w_{self._q}[e], {self._grain}, {self._wires.exponent})"

    @property
    def init(self) -> list[str]:
        """Statements that put all states where they are at step 0."""
        return self._init

    def lines(self) -> list[str]:
        """The functions; `learn_Q` is called at the end of each step."""
        return [*self._changes("w", self.rule.dw), *self._changes("t", self.rule.dt), *self._apply(), *self._learn()]

    def _changes(self, word: str, terms: Sequence[Term]) -> list[str]:
        """What the due products change a variable by, in units of 2^-7."""
        if not terms:
            return []
        unused = [f"(void){name};" for name in ("i", "j", "number", "w", "t")]
        body = [f"int32_t sum = {word} * 128;", *unused]
        for term in terms:
            due = [f"(number & {(1 << term.every) - 1}u) == 0"] if term.every else []
            due += {"x0": [f"x_last_{self._q}[i] != 0"], "y0": [f"y_last_{self._q}[j] != 0"], "u": []}[term.gate]
            factors = " * ".join(["(int64_t)" + number(term.mantissa), *(self._factor(f, term) for f in term.factors)])
            line = f"sum = summed(sum, {factors}, {term.exponent + FRACTION_BITS});"
            body.append(f"if ({' && '.join(due)}) {line}" if due else line)
        head = f"static int32_t d{word}_{self._q}(uint32_t i, uint32_t j, uint32_t number, int32_t w, int32_t t)"
        return function(head, [*body, f"return sum - {word} * 128;"])

    def _factor(self, factor: Factor, term: Term) -> str:
        """A factor as the product reads it: traces at the step of the spike that gates it, or at the epoch's end."""
        name, add, q, end = factor.name, factor.add, self._q, f"{self.rule.epoch - 1}u"
        if name in ("w", "t"):
            text = name
        elif name in ("x0", "y0"):
            side, who = name[0], "i" if name == "x0" else "j"
            text = f"({side}_last_{q}[{who}] != 0)"
        else:
            at = {"x0": f"(x_last_{q}[i] - 1u)", "y0": f"(y_last_{q}[j] - 1u)", "u": end}[term.gate]
            at = end if name in MODULATORY else at
            text = f"{name}_{q}[{at} * {self._count(name)}u + {'i' if name in PRE else 'j'}]"
        return f"({text} {'-' if add < 0 else '+'} {abs(add)})" if add else text

    def _apply(self) -> list[str]:
        """The rule at synapse e from neuron i to j; both changes are made from the values before."""
        q, (low, high, _) = self._q, bounds(self._wires.sign_mode)
        tag = f"t_{q}[e]" if self.rule.dt else "0"
        body = [f"int32_t w = w_{q}[e], t = {tag};", "(void)t;"]
        words = {"w": self.rule.dw, "t": self.rule.dt}
        body += [f"int32_t d{word} = d{word}_{q}(i, j, number, w, t);" for word, terms in words.items() if terms]
        for word, grain, (least, most) in (("w", self._grain, (low, high)), ("t", 0, (-256, 255))):
            if words[word]:
                base = f"step_word(UINT64_C({key(self._program.seed, word, self._part.name)}), now)"
                by = f"rounded(d{word}, {grain}, {base}, e)"
                if word == "w" and self.rule.rounding == "away":
                    by = f"rounded_away(d{word}, {grain})"
                new = f"(int16_t)clipped({word} + {by}, {least}, {most})"
                body.append(f"if (d{word} != 0) {word}_{q}[e] = {new};")
        return function(f"static void apply_{q}(uint32_t i, uint32_t j, uint32_t e, uint32_t number)", body)

    def _learn(self) -> list[str]:
        """Traces decay, then spikes add their impulses; at the end of an epoch the rule is applied."""
        q, epoch = self._q, self.rule.epoch
        body = [f"uint32_t slot = (uint32_t)((now - 1u) % {epoch}u), before = (slot + {epoch - 1}u) % {epoch}u;"]
        body += ["(void)before;"]
        for name, trace in self.rule.traces.items():
            n, word = self._count(name), f"{name}_{q}"
            base = f"step_word(UINT64_C({key(self._program.seed, name, self._part.name)}), now)"
            faded = f"faded({word}[before * {n}u + i], {trace.numerator}u, {trace.denominator}u, base, i)"
            loop = f"for (uint32_t i = 0; i < {n}u; i++) {word}[slot * {n}u + i] = {faded};"
            body += ["{", *indented([f"uint64_t base = {base};", loop]), "}"]
        for side, names, size in (("x", PRE, self._sources), ("y", POST, self._targets)):
            body += [f"for (uint32_t i = 0; i < {size}u; i++) {{", f"    if ({side}_fired_{q}[i] != 0) {{"]
            for name in names:
                if name in self.rule.traces:
                    at = f"{name}_{q}[slot * {size}u + i]"
                    body += [f"        {at} = raised({at}, {self.rule.traces[name].impulse}u);"]
            body += [f"        {side}_last_{q}[i] = (uint8_t)(slot + 1u);", f"        {side}_fired_{q}[i] = 0;"]
            body += ["    }", "}"]
        body += [f"if (slot == {epoch - 1}u) {{", *indented(self._visit()), "}"]
        return function(f"static void learn_{q}(void)", body)

    def _visit(self) -> list[str]:
        """All synapses that a product may change; then the spikes of the epoch are forgotten."""
        q, epoch = self._q, self.rule.epoch
        swept = [term for term in (*self.rule.dw, *self.rule.dt) if term.gate == "u"]
        due = " || ".join(f"(number & {(1 << term.every) - 1}u) == 0" for term in swept)
        lines = [f"uint32_t number = (uint32_t)(now / {epoch}u);"]
        lines += [f"for (uint32_t i = 0; i < {self._sources}u; i++) {{"]
        test = f"if ({due + ' || ' if due else ''}x_last_{q}[i] != 0 || y_last_{q}[j] != 0) apply_{q}(i, j, e, number);"
        if self._part.layout == "one_to_one":
            lines += indented(["uint32_t j = i, e = i;", test])
        elif self._part.layout == "dense":
            lines += [f"    for (uint32_t j = 0; j < {self._targets}u; j++) {{"]
            lines += [f"        uint32_t e = i * {self._targets}u + j;", f"        {test}", "    }"]
        else:
            lines += [f"    for (uint32_t e = ends_{q}[i]; e < ends_{q}[i + 1]; e++) {{"]
            lines += [f"        uint32_t j = targets_{q}[e];", f"        {test}", "    }"]
        lines.append("}")
        for side, size in (("x", self._sources), ("y", self._targets)):
            lines.append(f"for (uint32_t i = 0; i < {size}u; i++) {side}_last_{q}[i] = 0;")
        return lines
