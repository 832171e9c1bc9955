"""SpiNNaker's plastic synapses as C, updated only when their source spikes, see `network/deferred.c`.

All plastic projections onto a population share the rule, with the history of events and the tables.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from neuro.chips import FixedProjection
from neuro.extend import Program, spinnaker_rule as sr
from neuro_exchange.c_code.arrays import Memory, comment, number
from neuro_exchange.c_code.cells import indented
from neuro_exchange.c_code.synapses import row_of
from neuro_exchange.templates import filled

_TABLES = {"plus": sr.PLUS, "minus": sr.MINUS, "x": sr.X, "y": sr.Y, "c": sr.C, "d": sr.D}
_NUMBERS = {"low": sr.LOW, "high": sr.HIGH, "up": sr.UP, "down": sr.DOWN, "gain": sr.GAIN, "alpha": sr.ALPHA}
_NUMBERS |= {"up_triplet": sr.UP_TRIPLET, "down_triplet": sr.DOWN_TRIPLET}
_NUMBERS |= {"taught_low": sr.TAUGHT_LOW, "taught_high": sr.TAUGHT_HIGH}
_PER_LEVEL = 8
"""Smallest number of integers that a signal has between two neighbouring levels of dopamine."""
_APART = 2.0**-24
"""Tolerance, in halves of s4.11, within which a value may count as half-way between two levels."""
_BITS, _HALVES = 62, 18
"""Bits of a product, and of the largest value in halves of s4.11."""


class History:
    """Builder of the C code of a rule, which all plastic projections onto a population share.

    Args:
        program: the program with the population.
        index: index of the first of these projections, the suffix of names in C.
        wires: the rule of the projection.
        memory: declarations, to which tables and states are added.
    """

    def __init__(self, program: Program, index: int, wires: FixedProjection, memory: Memory) -> None:
        assert isinstance(wires.rule, sr.SpinnakerRule)
        self.index, self.rule, self.n_scale, self._memory = index, wires.rule, wires.n_scale, memory
        self.part = part = program.projections[index]
        name, size = program.populations[part.target].name, program.populations[part.target].size
        c, timing = self.rule.constants, sr.TIMINGS[self.rule.constants[sr.TIMING]]
        self.taught, vogels, triplet = bool(c[sr.TAUGHT]), timing == "vogels", timing == "triplet"
        multiplies, traced = bool(c[sr.OF_WEIGHT]), timing != "nearest"
        # The lines of the templates that begin with a flag, such as "taught|", apply only to rules with this flag.
        flags = {"taught": self.taught, "traced": traced, "triplet": triplet, "nearest": not traced, "vogels": vogels}
        flags |= {"mult": multiplies, "add": not multiplies, "lowers": not vogels}
        flags |= {"lowmult": multiplies and not vogels, "lowadd": not multiplies and not vogels}
        flags |= {"sent": part.dopamine >= 0, "signal": part.signal >= 0}
        self._flags = {word for word, is_set in flags.items() if is_set}
        self._words: dict[str, object] = {"k": index, "onto": comment(name), "size": size}
        for word, k in _TABLES.items():
            begin, length, shift = self.rule.places[k].tolist()
            if length:
                table = memory.table(f"{word}_{index}", self.rule.table[begin : begin + length], f"{name}: {word}")
                self._words[word] = f"{table}, {length}u, {shift}u"
        self._words |= {word: number(int(c[column])) for word, column in _NUMBERS.items()}
        self._words |= {"moved": "c" if self.taught else "w", "pre_triplet": "fine(x, r2)" if triplet else "0"}
        self._words["post_triplet"] = f"fine(x, slow_{index}[j * 16u + k])" if triplet else "0"
        self.init = [f"memset({array}_{index}, 0, sizeof {array}_{index});" for array in self._arrays(size)]
        self.init.append(f"memset(count_{index}, 1, sizeof count_{index});")
        self._is_one_to_one = part.dopamine >= 0 and part.dopamine_one_to_one
        if part.dopamine >= 0:
            self._words |= {"due": "j" if self._is_one_to_one else "0", "concentration": self.rule.concentrations[0]}

    def _arrays(self, size: int) -> Iterable[str]:
        """Declare the states, and yield the names of those that start at 0."""
        dopamine = size if self.part.dopamine_one_to_one else 1
        arrays = [("", "count", "uint8_t", size), ("", "times", "uint32_t", 16 * size), ("", "heard", "uint8_t", size)]
        arrays += [("traced", "fast", "int16_t", 16 * size), ("triplet", "slow", "int16_t", 16 * size)]
        arrays += [("triplet", "spike", "uint32_t", size), ("taught", "level", "int16_t", 16 * size)]
        arrays += [("taught", "marks", "uint16_t", size), ("sent", "due", "uint16_t", dopamine)]
        for flag, word, kind, entries in arrays:
            if not flag or flag in self._flags:
                self._memory.state(f"{word}_{self.index}", kind, entries, f"{self._words['onto']}: {word}")
                if word != "count":
                    yield word

    def spike_statements(self, k: int) -> list[str]:
        """Return the statements that report a spike of neuron i of population k to the target neurons."""
        lines = [f"heard_{self.index}[i] = 1;"] if self.part.target == k else []
        if self.part.dopamine == k:
            lines.append(f"count(due_{self.index}{' + i' if self._is_one_to_one else ''}, TIMES);")
        return lines

    def dopamine_statement(self, one: int) -> str:
        """Return the statement that sets the dopamine of neuron i to values[i] / `one` in 1/ms."""
        ties, largest, halves = _ties(self.n_scale, one, self.rule.concentrations)
        bits, unit, places = len(self.rule.concentrations), self.rule.concentrations[0], _BITS - _HALVES
        constants = {"factor": f"INT64_C({round(halves * 2**places)})", "places": places, "most": number(largest)}
        self._words |= constants | {"unit": unit, "levels": 2**bits - 1, "bits": bits, "ties": len(ties)}
        entries = [f"{{{number(v)}, {h}, UINT64_C({mask})}}" for v, h, mask in ties]
        self._memory.flash += 16 * len(ties)
        if ties:
            self._flags.add("ties")
            self._memory.constants(f"ties_{self.index}", "tie", entries)
        return f"modulate_{self.index}(i, values[i]);"

    def lines(self, file: str, **values: object) -> list[str]:
        """Return the lines of a template that apply to the rule. Each line starts with a flag, "" for all rules."""
        flagged = [line.split("|", 1) for line in filled(file, **values, **self._words).split("\n") if line]
        return [text for flag, text in flagged if not flag.strip() or flag.strip() in self._flags]


def _ties(n_scale: float, one: int, units: Sequence[int]) -> tuple[list[tuple[int, int, int]], int, Fraction]:
    """Return the integers of a signal that may lie half-way between two levels of dopamine.

    The host of the emulator rounds such values in floating-point numbers. The C code looks the results up in a table.

    Args:
        n_scale: dopamine in 1/ms per unit of s4.11.
        one: integer of the signal that stands for 1/ms.
        units: levels of dopamine are multiples of the first unit.

    Returns:
        For each such integer: the integer, twice its value in s4.11, and a bit for each pair of neighbouring levels,
        set if the emulator chooses the upper level. Then an integer beyond all levels, and twice the value of 1.
    """
    halves, unit, levels = 2 / (Fraction(n_scale) * one), units[0], 2 ** len(units) - 1
    largest = int(2 * (32768 + (levels + 1) * unit) / halves) + 1
    numbers = np.arange(-largest, largest + 1)
    doubled = 2.0 * (numbers / one / n_scale)
    candidates = np.flatnonzero((abs(doubled - np.rint(doubled)) < _APART) & (np.rint(doubled) % 2 == unit % 2))
    lower = np.arange(-levels, levels)
    ties = []
    for value, nearest in zip(
        numbers[candidates].tolist(), np.rint(doubled[candidates]).astype(np.int64).tolist(), strict=True
    ):
        # The floating-point expression of the emulator, for the present dopamine that makes the value a tie.
        lower_ties = (nearest - (2 * lower + 1) * unit) // 2
        upper = np.rint((value / one / n_scale - lower_ties) / unit) > lower
        ties.append((value, nearest, sum(1 << k for k in np.flatnonzero(upper).tolist())))
    return ties, largest, halves


class Deferred:
    """Builder of the C code of a projection with a learning rule of SpiNNaker.

    Args:
        program: the program with the projection.
        index: index of the projection.
        wires: the rule and the words.
        memory: declarations, to which states are added.
        histories: the rules of projections so far, by target and scale; a missing one is added.

    Attributes:
        kind: C type of a weight.
        rule: the learning rule.
        history: the code of the rule.
        init: statements that initialise all states.
        states: arrays of weights and tags, with their sizes, by state.
    """

    kind = "uint16_t"

    def __init__(
        self,
        program: Program,
        index: int,
        wires: FixedProjection,
        memory: Memory,
        histories: dict[tuple[int, float], History],
    ) -> None:
        assert isinstance(wires.rule, sr.SpinnakerRule)
        self._program, self._q, self.rule = program, index, wires.rule
        self._part = part = program.projections[index]
        name, size = part.name, program.populations[part.source].size
        key = part.target, wires.n_scale
        self._is_first = key not in histories
        if self._is_first:
            histories[key] = History(program, index, wires, memory)
        self.history = histories[key]
        initial = abs(np.broadcast_to(wires.mantissas, part.size).astype(np.int64))
        begin = memory.entry(f"w_begin_{index}", initial, f"{name}: words at step 0")
        delays = memory.entry(f"delays_{index}", wires.delay % self.rule.slots, f"{name}: delays")
        self._delay = delays.replace("[i]", "[e]")
        memory.state(f"w_{index}", self.kind, part.size, f"{name}: words")
        self.init = [f"for (uint32_t i = 0; i < {part.size}u; i++) w_{index}[i] = {begin};"]
        rows = [("sent", "uint16_t"), ("last", "uint32_t"), ("r1", "int16_t"), ("r2", "int16_t")]
        arrays = [(word, kind, size) for word, kind in rows[: self._source_arrays]]
        arrays += [("t", self.kind, part.size)] if self.history.taught else []
        for word, kind, entries in arrays:
            memory.state(f"{word}_{index}", kind, entries, f"{name}: {word}")
            self.init.append(f"memset({word}_{index}, 0, sizeof {word}_{index});")
        self.init += self.history.init if self._is_first else []
        sign = "-(int32_t)" if self.rule.inhibits else ""
        self.states = {"weight": (f"{sign}w_{index}", part.size)}
        if self.history.taught:
            self.states["t"] = f"t_{index}", part.size

    @property
    def _source_arrays(self) -> int:
        """The number of arrays with an element per source."""
        return {"nearest": 2, "triplet": 4}.get(sr.TIMINGS[self.rule.constants[sr.TIMING]], 3)

    @property
    def word(self) -> str:
        """The expression for the word of synapse e.

        A delay of as many steps as there are slots is stored as 0. A synapse with this delay adds nothing.
        """
        word = f"{'-' if self.rule.inhibits else ''}(int32_t)w_{self._q}[e]"
        return "0" if self._delay == "0" else f"({self._delay} != 0 ? {word} : 0)" if "[" in self._delay else word

    def spike_statements(self, k: int) -> list[str]:
        """Return the statements that report a spike of neuron i of population k to the projection."""
        lines = [f"count(sent_{self._q} + i, TIMES);"] if self._part.source == k else []
        return lines + (self.history.spike_statements(k) if self._is_first else [])

    @staticmethod
    def signal_scale(parts: Sequence[Any]) -> tuple[int, int]:
        """Return the integer of a signal that stands for 1/ms, and an integer beyond the levels of all projections.

        Of several possible integers for 1/ms, the one with the fewest ties is chosen.
        """
        rules = [(part.history.n_scale, part.rule.concentrations) for part in parts]
        first = 2 * int(max(_PER_LEVEL / scale / units[0] for scale, units in rules) / 2) + 3
        integer = min(
            range(first, first + 16, 2),
            key=lambda integer: sum(len(_ties(rule[0], integer, rule[1])[0]) for rule in rules),
        )
        levels = max(2 ** len(units) * units[0] * scale for scale, units in rules)
        return integer, int(levels * integer) + 1

    def dopamine_statements(self, one: int) -> list[str]:
        """Return the statements that set the dopamine of neuron i to values[i] / `one` in 1/ms."""
        return [self.history.dopamine_statement(one)] if self._is_first else []

    @property
    def step_calls(self) -> list[str]:
        """The calls at the end of each step."""
        return [f"events_{self.history.index}();"] * self._is_first + [f"learn_{self._q}();"]

    def lines(self) -> list[str]:
        """Return the C functions of the projection."""
        q, history = self._q, self.history
        tag = f"t_{q} + e" if history.taught else "NULL"
        visit = f"visit_{history.index}(w_{q} + e, {tag}, j, {self._delay}, {self.rule.shift}u, t, p, r1, r2);"
        targets = self._program.populations[self._part.target].size
        rows = "\n        |".join(indented(row_of(self._part, q, targets, [visit])))
        sources = self._program.populations[self._part.source].size
        return [
            *(history.lines("c_code/network/deferred.c") if self._is_first else []),
            *history.lines("c_code/network/packets.c", q=q, of=comment(self._part.name), rows=rows, sources=sources),
        ]
