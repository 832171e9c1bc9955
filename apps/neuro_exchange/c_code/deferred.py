"""SpiNNaker's plastic synapses as C, which wait for the next spike of their source, see `network/deferred.c`.

Projections onto one population share a rule, and so its history of events and its tables.
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
"""Numbers of a signal from one level of dopamine to the next, at least."""
_APART = 2.0**-24
"""Distance below which the value of a number may be taken for one between two levels, in halves of s4.11."""
_BITS, _HALVES = 62, 18
"""Bits of a product, and of the largest value in halves of s4.11."""


class History:
    """The rule of all that learns onto a population: its tables, its events, and the functions that use them.

    Args:
        program: has the population.
        index: of the first projection, with which names in C end.
        wires: of the projection.
        memory: takes tables and states.
    """

    def __init__(self, program: Program, index: int, wires: FixedProjection, memory: Memory) -> None:
        assert isinstance(wires.rule, sr.SpinnakerRule)
        self.index, self.rule, self.n_scale, self._memory = index, wires.rule, wires.n_scale, memory
        self.part = part = program.projections[index]
        name, size = program.populations[part.target].name, program.populations[part.target].size
        c, timing = self.rule.constants, sr.TIMINGS[self.rule.constants[sr.TIMING]]
        self.taught, vogels, triplet = bool(c[sr.TAUGHT]), timing == "vogels", timing == "triplet"
        multiplies, traced = bool(c[sr.OF_WEIGHT]), timing != "nearest"
        flags = {"taught": self.taught, "traced": traced, "triplet": triplet, "nearest": not traced, "vogels": vogels}
        flags |= {"mult": multiplies, "add": not multiplies, "lowers": not vogels}
        flags |= {"lowmult": multiplies and not vogels, "lowadd": not multiplies and not vogels}
        flags |= {"sent": part.dopamine >= 0, "signal": part.signal >= 0}
        self._flags = {word for word, holds in flags.items() if holds}
        self._words: dict[str, object] = {"k": index, "onto": comment(name), "size": size}
        for word, k in _TABLES.items():
            first, length, shift = self.rule.places[k].tolist()
            if length:
                table = memory.table(f"{word}_{index}", self.rule.table[first : first + length], f"{name}: {word}")
                self._words[word] = f"{table}, {length}u, {shift}u"
        self._words |= {word: number(int(c[column])) for word, column in _NUMBERS.items()}
        at, moved = f"{index}[j * 16u + k]", "c" if self.taught else "w"
        self._words |= {"moved": moved, "pre_triplet": "fine(x, r2)" if triplet else "0"}
        self._words["post_triplet"] = f"fine(x, slow_{at})" if triplet else "0"
        self.init = [f"memset({array}_{index}, 0, sizeof {array}_{index});" for array in self._arrays(size)]
        self.init.append(f"memset(count_{index}, 1, sizeof count_{index});")
        self._each = part.dopamine >= 0 and part.dopamine_one_to_one
        if part.dopamine >= 0:
            self._words |= {"due": "j" if self._each else "0", "concentration": self.rule.concentrations[0]}

    def _arrays(self, size: int) -> Iterable[str]:
        """Declare the states; yield the names of those that begin at 0."""
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

    def heard_from(self, k: int) -> list[str]:
        """Statements with which the post neurons hear of a spike of neuron i of a population."""
        lines = [f"heard_{self.index}[i] = 1;"] if self.part.target == k else []
        if self.part.dopamine == k:
            lines.append(f"count(due_{self.index}{' + i' if self._each else ''}, TIMES);")
        return lines

    def level_by(self, one: int) -> str:
        """The statement that brings the dopamine of neuron i to values[i] / `one` in 1/ms."""
        ties, largest, halves = _ties(self.n_scale, one, self.rule.concentrations)
        bits, unit, places = len(self.rule.concentrations), self.rule.concentrations[0], _BITS - _HALVES
        words = {"factor": f"INT64_C({round(halves * 2**places)})", "places": places, "most": number(largest)}
        self._words |= words | {"unit": unit, "levels": 2**bits - 1, "bits": bits, "ties": len(ties)}
        entries = [f"{{{number(v)}, {h}, UINT64_C({mask})}}" for v, h, mask in ties]
        self._memory.flash += 16 * len(ties)
        if ties:
            self._flags.add("ties")
            self._memory.constants(f"ties_{self.index}", "tie", entries)
        return f"modulate_{self.index}(i, values[i]);"

    def lines(self, file: str, **words: object) -> list[str]:
        """A file of functions, of which each line begins with what a rule must have for it."""
        parts = [line.split("|", 1) for line in filled(file, **words, **self._words).split("\n") if line]
        return [text for flag, text in parts if not flag.strip() or flag.strip() in self._flags]


def _ties(n_scale: float, one: int, units: Sequence[int]) -> tuple[list[tuple[int, int, int]], int, Fraction]:
    """The numbers of a signal that may be as near to two levels, and what the host of the emulator makes of them.

    Returns:
        Of each such number twice its value in s4.11, and a bit for each pair of neighbouring levels: set where it takes
        the upper one. Then the number that is beyond all levels, and twice the value of 1.
    """
    halves, unit, levels = 2 / (Fraction(n_scale) * one), units[0], 2 ** len(units) - 1
    largest = int(2 * (32768 + (levels + 1) * unit) / halves) + 1
    numbers = np.arange(-largest, largest + 1)
    twice = 2.0 * (numbers / one / n_scale)
    near = np.flatnonzero((abs(twice - np.rint(twice)) < _APART) & (np.rint(twice) % 2 == unit % 2))
    below = np.arange(-levels, levels)
    found = []
    for value, at in zip(numbers[near].tolist(), np.rint(twice[near]).astype(np.int64).tolist(), strict=True):
        # The float expression of the emulator, with the dopamine at which the value is as near to both levels.
        before = (at - (2 * below + 1) * unit) // 2
        upper = np.rint((value / one / n_scale - before) / unit) > below
        found.append((value, at, sum(1 << k for k in np.flatnonzero(upper).tolist())))
    return found, largest, halves


class Deferred:
    """A projection that learns by a rule of SpiNNaker.

    Args:
        program: has it.
        index: of the projection.
        wires: its rule and its words.
        memory: takes its states.
        histories: of the projections before, by target and scale; one more where there is none yet.
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
        self._first = key not in histories
        if self._first:
            histories[key] = History(program, index, wires, memory)
        self.history = histories[key]
        first = abs(np.broadcast_to(wires.mantissas, part.size).astype(np.int64))
        begin = memory.entry(f"w_begin_{index}", first, f"{name}: words at step 0")
        delays = memory.entry(f"delays_{index}", wires.delay % self.rule.slots, f"{name}: delays")
        self._delay = delays.replace("[i]", "[e]")
        memory.state(f"w_{index}", self.kind, part.size, f"{name}: words")
        self.init = [f"for (uint32_t i = 0; i < {part.size}u; i++) w_{index}[i] = {begin};"]
        rows = [("sent", "uint16_t"), ("last", "uint32_t"), ("r1", "int16_t"), ("r2", "int16_t")]
        arrays = [(word, kind, size) for word, kind in rows[: self._kept]]
        arrays += [("t", self.kind, part.size)] if self.history.taught else []
        for word, kind, entries in arrays:
            memory.state(f"{word}_{index}", kind, entries, f"{name}: {word}")
            self.init.append(f"memset({word}_{index}, 0, sizeof {word}_{index});")
        self.init += self.history.init if self._first else []
        sign = "-(int32_t)" if self.rule.inhibits else ""
        self.states = {"weight": (f"{sign}w_{index}", part.size)}
        if self.history.taught:
            self.states["t"] = f"t_{index}", part.size

    @property
    def _kept(self) -> int:
        """Arrays that are kept of each source."""
        return {"nearest": 2, "triplet": 4}.get(sr.TIMINGS[self.rule.constants[sr.TIMING]], 3)

    @property
    def word(self) -> str:
        """What a spike adds by synapse e: nothing where the delay is the number of slots, which is stored as 0."""
        word = f"{'-' if self.rule.inhibits else ''}(int32_t)w_{self._q}[e]"
        return "0" if self._delay == "0" else f"({self._delay} != 0 ? {word} : 0)" if "[" in self._delay else word

    def heard_from(self, k: int) -> list[str]:
        """Statements with which the projection hears of a spike of neuron i of a population."""
        lines = [f"count(sent_{self._q} + i, TIMES);"] if self._part.source == k else []
        return lines + (self.history.heard_from(k) if self._first else [])

    @staticmethod
    def numbers(parts: Sequence[Any]) -> tuple[int, int]:
        """The number of a signal that stands for 1/ms, and one beyond all levels, of the projections that listen."""
        rules = [(part.history.n_scale, part.rule.concentrations) for part in parts]
        first = 2 * int(max(_PER_LEVEL / scale / units[0] for scale, units in rules) / 2) + 3
        one = min(
            range(first, first + 16, 2), key=lambda one: sum(len(_ties(rule[0], one, rule[1])[0]) for rule in rules)
        )
        levels = max(2 ** len(units) * units[0] * scale for scale, units in rules)
        return one, int(levels * one) + 1

    def set_by(self, one: int) -> list[str]:
        """Statements that set the dopamine of neuron i to values[i] / `one` in 1/ms."""
        return [self.history.level_by(one)] if self._first else []

    @property
    def calls(self) -> list[str]:
        """What a step does in its end."""
        return [f"events_{self.history.index}();"] * self._first + [f"learn_{self._q}();"]

    def lines(self) -> list[str]:
        """The functions."""
        q, history = self._q, self.history
        tag = f"t_{q} + e" if history.taught else "NULL"
        visit = f"visit_{history.index}(w_{q} + e, {tag}, j, {self._delay}, {self.rule.shift}u, t, p, r1, r2);"
        targets = self._program.populations[self._part.target].size
        rows = "\n        |".join(indented(row_of(self._part, q, targets, [visit])))
        sources = self._program.populations[self._part.source].size
        return [
            *(history.lines("c_code/network/deferred.c") if self._first else []),
            *history.lines("c_code/network/packets.c", q=q, of=comment(self._part.name), rows=rows, sources=sources),
        ]
