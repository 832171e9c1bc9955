"""The text of `NAME.c` and `NAME.h` for a quantised program, and the sizes of its arrays.

A step has the order of the emulated chips. A spike is sent when it is emitted, into the slot of a later step. Input
rings have one slot more than the longest lag, so no spike is written to the slot that a population reads.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from zlib import crc32

import numpy as np

from neuro.chips import FixedProgram, FixedProjection, arithmetic_of, longest_lag, names_of
from neuro.extend import spinnaker_rule
from neuro_exchange.c_code.arrays import TYPES, Memory, comment, narrowest, number
from neuro_exchange.c_code.cells import (
    Cells,
    StepCode,
    decide,
    delta_encoder,
    function,
    graded_product,
    graded_vector,
    indented,
    loihi2_lif,
    loihi2_rf,
    loihi2_rf_iz,
    loihi2_ternary_lif,
    loihi_lif,
    relay,
    shared,
    sigma_decoder,
    sigma_delta,
    spinnaker_delta,
    spinnaker_lif,
)
from neuro_exchange.c_code.deferred import Deferred, History
from neuro_exchange.c_code.synapses import Delivery, Learning, lags_of
from neuro_exchange.templates import filled

STEPS: dict[str, Callable[[Cells, Memory], StepCode]] = {
    "relay": relay,
    "loihi_lif": loihi_lif,
    "spinnaker_lif": spinnaker_lif,
    "spinnaker_delta": spinnaker_delta,
    "loihi2_lif": loihi2_lif,
    "loihi2_ternary_lif": loihi2_ternary_lif,
    "loihi2_rf": loihi2_rf,
    "loihi2_rf_iz": loihi2_rf_iz,
    "sigma_delta": sigma_delta,
    "delta_encoder": delta_encoder,
    "sigma_decoder": sigma_decoder,
    "graded_vector": graded_vector,
    "graded_product": graded_product,
}
"""Functions that write the code of a population, by `FixedPopulation.kind`."""


class Family(NamedTuple):
    """A family of chips.

    Attributes:
        slot_type: C type of a neuron's input in a step.
        field: second field of an event, after the neuron.
        kind: C type of the field.
        about: description of an event.
        by_sign: whether negative words go to a second receptor.
        learning: header with the functions for learning.
    """

    slot_type: str = "uint16_t"
    field: str = "times"
    kind: str = "uint16_t"
    about: str = "A neuron, and the number of its spikes in a step"
    by_sign: bool = False
    learning: str = "learning.h"


_GRADED = "A neuron, and the payload of its spike; without payloads, the number of its spikes in a step"
FAMILIES = {
    "loihi": Family(),
    "loihi2": Family("uint32_t", "payload", "int32_t", _GRADED),
    "spinnaker": Family(by_sign=True, learning="deferred.h"),
}
"""Families of chips that are written as C, by the name of their header."""

INPUTS = ("listed", "poisson")
"""Kinds of populations whose spikes are input of the program."""

REGISTERS = {"V_m": ("v", "hold"), "I_syn_ex": ("u", "g_exc"), "I_syn_in": ("u", "g_inh")}
"""Registers that a trial resets with a state. Resetting the potential ends refractoriness."""

MARK = "Written by neuro for a microcontroller"
"""Mark of the files that neuro wrote."""

_POINTER = 4
_INPUTS = -1
"""Key of the sums of all inputs, which are added to the rings together. Other keys are indices of populations."""
_STEP = "uint32_t NAME_step(const NAME_event *events, uint32_t n, NAME_event *out)"

_TRIAL = "/* Begin a trial: drop spikes that have not arrived, and reset the states of the output. */"


class Dopamine(NamedTuple):
    """A signal of dopamine.

    Attributes:
        call: C function that sets the signal.
        one: integer that stands for 1/ms.
        size: number of neurons that receive the signal.
        largest: integer beyond the largest level of dopamine of all projections.
    """

    call: str
    one: int
    size: int
    largest: int


@dataclass(frozen=True, slots=True)
class Source:
    """The C source of a network.

    Attributes:
        header: text of `NAME.h`.
        code: text of `NAME.c`.
        id: checksum in both files, by which the compiler detects a header and a source file of different networks.
        flash: bytes of the constant tables.
        ram: bytes of the states.
        firsts: index of the first neuron of each population among all neurons, then the number of all neurons.
        states: names of the registers that the digest of all states reads, by population or plastic projection. The
            digest has this order.
        signals: signals that a program sets, by name.
    """

    header: str
    code: str
    id: str
    flash: int
    ram: int
    firsts: list[int]
    states: dict[str, tuple[str, ...]]
    signals: dict[str, Dopamine]


def source_of(fixed: FixedProgram, name: str, outputs: tuple[str, ...]) -> Source:
    """Return the C source of a quantised program.

    Args:
        fixed: the program. All its parts must be supported, see `export.refuse`.
        name: prefix of all public names.
        outputs: populations whose spikes are output.
    """
    return _Writer(fixed, name, outputs).source()


class _Writer:
    """Builder of the arrays and functions of a network."""

    def __init__(self, fixed: FixedProgram, name: str, outputs: tuple[str, ...]) -> None:
        self._fixed, self._program, self._name, self._outputs = fixed, fixed.program, name, outputs
        self._memory, self._family = Memory(), FAMILIES[fixed.chip.arithmetic]
        sizes = [part.size for part in self._program.populations]
        self._firsts = np.concatenate(([0], np.cumsum(sizes))).astype(int).tolist()
        self._spiking = [
            q for q, wires in enumerate(fixed.projections) if wires is not None and self._program.projections[q].size
        ]
        self._histories: dict[tuple[int, float], History] = {}
        self._learning = {q: self._learner(q) for q in self._spiking if self._program.projections[q].synapse.learns}
        self._cells = {k: self._cells_of(k) for k, part in enumerate(fixed.populations) if part.kind in STEPS}
        self._inputs = [k for k, part in enumerate(self._program.populations) if part.kind in INPUTS]

    def _learner(self, q: int) -> Learning | Deferred:
        arguments = self._program, q, self._wires(q), self._memory
        is_deferred = isinstance(self._wires(q).rule, spinnaker_rule.SpinnakerRule)
        return Deferred(*arguments, self._histories) if is_deferred else Learning(*arguments)

    def _cells_of(self, k: int) -> Cells:
        part, cells, wires = self._program.populations[k], self._fixed.populations[k], self._fixed.projections
        incoming = [q for q in self._spiking if self._program.projections[q].target == k]
        lag = max((int(longest_lag(self._program, q).max(initial=1)) for q in incoming), default=0)
        has_second_receptor = any(
            wire.receptor or (self._family.by_sign and bool(np.any(wire.words < 0) or self._inhibits(q)))
            for q in incoming
            if (wire := wires[q]) is not None
        )
        is_relay = cells.kind == "relay"
        return Cells(
            number=k,
            fixed=cells,
            size=part.size,
            first=self._firsts[k],
            slots=lag + 1,
            receptors=1 + (has_second_receptor and not is_relay),
            slot_type=Family().slot_type if is_relay else self._family.slot_type,
            is_output=part.name in self._outputs,
            competes=any(group.population == k for group in self._program.groups),
            projections=self._sent_at_once(k),
            learning_statements=self._learning_statements(k),
        )

    def _inhibits(self, q: int) -> bool:
        """Return whether learnt weights are subtracted, even if all words are 0 at the start."""
        return isinstance(part := self._learning.get(q), Deferred) and part.rule.inhibits

    def _sent_at_once(self, k: int) -> tuple[int, ...]:
        """Return the outgoing projections, except deferred projections, which learn before sending."""
        immediate = (q for q in self._spiking if not isinstance(self._learning.get(q), Deferred))
        return tuple(q for q in immediate if self._program.projections[q].source == k)

    def _learning_statements(self, k: int) -> tuple[str, ...]:
        """Return the statements that report a spike of neuron i of a population to all plastic projections."""
        return tuple(line for part in self._learning.values() for line in part.spike_statements(k))

    def source(self) -> Source:
        """Write both files."""
        memory = self._memory
        if self._needs_step_number:
            memory.variable("now", "uint64_t", "the step")
        for k, cells in self._cells.items():
            size, name = cells.slots * cells.size * cells.receptors, cells.fixed.name
            memory.state(f"ring_{k}", cells.slot_type, size, f"{name}: input of {cells.slots} steps")
            memory.variable(f"at_{k}", TYPES[narrowest(0, cells.slots)], f"{name}: the slot of this step")
        self._sums = self._sum_offsets()
        sending = [line for q in self._spiking for line in self._delivery(q)]
        signals, calls, declarations = self._calls()
        learning = [line for part in self._learning.values() for line in part.lines()]
        step_codes = {k: STEPS[cells.fixed.kind](cells, memory) for k, cells in self._cells.items()}
        decision_lines, opening_lines = list[str](), list[str]()
        for index, group in enumerate(self._program.groups):
            k = group.population
            lines, begin = decide(self._program, index, self._cells[k], step_codes[k].threshold, memory)
            decision_lines, opening_lines = decision_lines + lines, opening_lines + begin
        functions = [line for part in step_codes.values() for line in part.lines]
        inputs, step = self._input(), self._step()
        parts = [sending, functions, decision_lines, learning, inputs, self._init(step_codes, opening_lines), step]
        parts += [self._voltage(step_codes), calls, self._digest(step_codes)]
        family, upper = self._family, self._name.upper()
        values = {
            "name": self._name,
            "NAME": upper,
            "about": f"network '{comment(self._program.name)}' in the integers of {self._fixed.chip.title}",
            "mark": MARK,
            "kind": family.kind,
            "field": family.field,
        }
        code = filled(
            "c_code/network/network.c",
            **values,
            chip=self._fixed.chip.arithmetic,
            learning=f'#include "{self._family.learning}"\n' if self._learning else "",
            memory="\n".join(memory.lines),
            value="wrap32(times)" if family.kind == "int32_t" else f"({family.kind})times",
            functions="\n".join(line for part in parts for line in [*part, ""]),
        )
        code = re.sub(r"\n{3,}", "\n\n", code).replace("NAME_", f"{self._name}_").rstrip() + "\n"
        populations = self._program.populations
        neurons, macros = [], _macros(part.name for part in populations)
        for word, part, first in zip(macros, populations, self._firsts, strict=False):
            role = "input" if part.kind in INPUTS else "output" if part.name in self._outputs else "hidden"
            neurons += [
                f"#define {upper}_FIRST_{word} {first}u /* {role} */",
                f"#define {upper}_SIZE_{word} {part.size}u",
            ]
        header = filled(
            "c_code/network/network.h",
            **values,
            neurons="\n".join(neurons),
            most=sum(part.size for part in populations if part.name in self._outputs),
            ns=round(self._program.resolution * 1e6),
            neuron="uint16_t" if self._firsts[-1] <= 65536 else "uint32_t",
            event=family.about,
            trial=f"{_TRIAL}\nvoid {self._name}_trial(void);\n\n" if self._program.trials is not None else "",
            learning=declarations.replace("NAME_", f"{upper}_").replace("name_", f"{self._name}_"),
        )
        states = {self._cells[k].fixed.name: _digested(part) for k, part in step_codes.items()}
        states |= {self._program.projections[q].name: list(part.states) for q, part in self._learning.items()}
        checksum = f"0x{crc32((header + code).encode()):08X}u"
        return Source(
            header.replace("@id@", checksum),
            code.replace("@id@", checksum),
            checksum,
            memory.flash,
            memory.ram + _POINTER,
            self._firsts,
            {name: tuple(registers) for name, registers in states.items()},
            signals,
        )

    def _wires(self, q: int) -> FixedProjection:
        wires = self._fixed.projections[q]
        assert wires is not None
        return wires

    def _delivery(self, q: int) -> list[str]:
        part = self._program.projections[q]
        target, by_sign, sums = self._cells[part.target], self._family.by_sign, self._sums.get(q)
        delivery = Delivery(q, part, self._wires(q), target, self._memory, by_sign, sums)
        return delivery.lines(self._learning[q].word if q in self._learning else "")

    def _sum_offsets(self) -> dict[int, int]:
        """Return the offsets in the C array `sums`, for projections whose sum over a step is shifted or wrapped as one.

        Sources are stepped one after the other, so all use the same part of the array.
        """
        offsets, sizes = dict[int, int](), dict[int, int]()
        for q in self._spiking:
            part, wires = self._program.projections[q], self._wires(q)
            if wires.shift or wires.wraps:
                source = _INPUTS if part.source in self._inputs else part.source
                first, last = lags_of(wires)
                offsets[q] = sizes.get(source, 0)
                sizes[source] = offsets[q] + (last - first + 1) * self._cells[part.target].size
                self._memory.variable(f"full_{q}", "uint8_t", f"{part.name}: 1 if sums are not 0")
        if sizes:
            self._memory.state("sums", "uint32_t", max(sizes.values()), "sums of the present source in a step")
        return offsets

    def _pour_calls(self, *sources: int) -> list[str]:
        """Return the calls that add the sums of sources to the rings."""
        return [f"pour_{q}();" for k in sources for q in self._sent_at_once(k) if q in self._sums]

    @property
    def _needs_step_number(self) -> bool:
        """True if random draws or periodic resets need the number of the step."""
        resets = any(shared(cells.fixed.registers, "reset_interval") for cells in self._cells.values())
        return bool(self._program.groups or self._learning or resets)

    def _input(self) -> list[str]:
        """Return the function that sends a spike of an input. Neurons that are not inputs are ignored."""
        lines = ["static void input(uint32_t neuron, uint32_t times)", "{", "    (void)times;"]
        for k in self._inputs:
            first, last = self._firsts[k], self._firsts[k + 1]
            sends = [f"        send_{q}(i, times);" for q in self._sent_at_once(k)]
            sends = [f"        uint32_t i = neuron - {first}u;", "        (void)i;", *sends]
            sends += [f"        {statement.replace('TIMES', 'times')}" for statement in self._learning_statements(k)]
            name = comment(self._program.populations[k].name)
            lines += [f"    if ({_inside(first, last)}) {{ /* {name} */", *sends, "    }"]
        if not self._inputs:
            lines.append("    (void)neuron;")
        return [*lines, "}"]

    def _init(self, step_codes: dict[int, StepCode], opening_lines: list[str]) -> list[str]:
        """Return the functions that begin a run and a trial."""
        clear = [f"memset(ring_{k}, 0, sizeof ring_{k});" for k in self._cells]
        lines = [*(["now = 0;"] if self._needs_step_number else []), *(f"at_{k} = 0;" for k in self._cells), *clear]
        lines += [line for part in step_codes.values() for line in part.init.values()]
        lines += [line for part in self._learning.values() for line in part.init]
        functions = function("void NAME_init(void)", [*lines, *opening_lines])
        if (trials := self._program.trials) is not None:
            names = names_of(self._program.populations[trials.output])
            states = {register for state in trials.reset for name in names[state] for register in REGISTERS[name]}
            resets = [line for register, line in step_codes[trials.output].init.items() if register in states]
            functions += function("void NAME_trial(void)", [*clear, *resets, *opening_lines])
        return functions

    def _step(self) -> list[str]:
        merge = arithmetic_of(self._fixed.chip).one_bit and bool(self._inputs)
        body = ["uint32_t neuron = events[e].neuron;"]
        times = f"events[e].{self._family.field}"
        line = f"if ({times} != 0) input(neuron, spikes((uint32_t){times}));"
        lines = [*(["now++;"] if self._needs_step_number else []), "out_at = out;"]
        if merge:
            size = max(self._firsts[k + 1] for k in self._inputs)
            bits = self._memory.state("seen", "uint32_t", -(-size // 32), "bit set of inputs that spiked in this step")
            body += [f"if (neuron >= {size}u || ({bits}[neuron / 32u] >> neuron % 32u & 1u) != 0) continue;"]
            line = f"if ({times} != 0) {bits}[neuron / 32u] |= UINT32_C(1) << neuron % 32u, input(neuron, 1u);"
        lines += ["for (uint32_t e = 0; e < n; e++) {", *indented([*body, line]), "}", *self._pour_calls(*self._inputs)]
        if merge:
            clear = f"if (events[e].neuron < {size}u) {bits}[events[e].neuron / 32u] = 0;"
            lines += [f"for (uint32_t e = 0; e < n; e++) {{ {clear} }}"]
        for k, cells in self._cells.items():
            lines += [f"step_{k}();", *([f"decide_{k}();"] if cells.competes else []), *self._pour_calls(k)]
        lines += [call for part in self._learning.values() for call in part.step_calls]
        for k, cells in self._cells.items():
            kind = TYPES[narrowest(0, cells.slots)]
            lines += [f"at_{k} = ({kind})later(at_{k}, 1u, {cells.slots}u);"] if cells.slots > 1 else []
        return function(_STEP, [*lines, "return (uint32_t)(out_at - out);"])

    def _voltage(self, step_codes: dict[int, StepCode]) -> list[str]:
        lines = []
        for k, part in step_codes.items():
            first, size = self._firsts[k], self._cells[k].size
            for state in list(part.states.values())[:1]:
                lines += [f"if ({_inside(first, first + size)}) return {state}[neuron - {first}u];"]
        return function("int32_t NAME_voltage(uint32_t neuron)", [*lines, "(void)neuron;", "return 0;"])

    def _calls(self) -> tuple[dict[str, Dopamine], list[str], str]:
        """Return the signals, the functions that set signals and return learnt weights, and their declarations."""
        parts, populations = self._program.projections, self._program.populations
        signals, code, declarations = dict[str, Dopamine](), list[str](), ""
        indices = sorted({parts[q].signal for q in self._learning} - {-1})
        for call, index in _call_names("reward", [self._program.signals[index].name for index in indices], indices):
            signal = self._program.signals[index]
            learners = [learner for q, learner in self._learning.items() if parts[q].signal == index]
            target = populations[signal.target]
            one, largest = type(learners[0]).signal_scale(learners)
            signals[signal.name] = Dopamine(f"{self._name}_{call}", one, target.size, largest)
            body = [line for part in learners for line in ("{", *indented(part.dopamine_statements(one)), "}")]
            loop = [f"for (uint32_t i = 0; i < {target.size}u; i++) {{", *indented(body), "}"]
            code += function(f"void NAME_{call}(const int32_t *values)", loop)
            values = {
                "signal": comment(signal.name),
                "to": comment(target.name),
                "size": target.size,
                "one": number(one),
            }
            declarations += filled("c_code/network/reward.h", call=call, CALL=call.upper(), **values)
        for call, q in _call_names("weights", [parts[q].name for q in self._learning], self._learning):
            kind = self._learning[q].kind
            code += function(f"{kind} *NAME_{call}(void)", [f"return w_{q};"])
            values = {"of": comment(parts[q].name), "size": parts[q].size, "kind": kind}
            declarations += filled("c_code/network/weights.h", call=call, CALL=call.upper(), **values)
        return signals, code, declarations

    def _digest(self, step_codes: dict[int, StepCode]) -> list[str]:
        """Return the C function for tests of the export, which returns digests of states and spikes after a step."""
        lines = ["uint64_t sum = 0;", "uint32_t place = 0;"]
        for k, part in step_codes.items():
            size = self._cells[k].size
            for register in _digested(part):
                statement = f"digest(&sum, &place, {part.states[register]}[i]);"
                lines += [f"for (uint32_t i = 0; i < {size}u; i++) {statement}"]
        for learner in self._learning.values():
            for name, size in learner.states.values():
                lines.append(f"for (uint32_t i = 0; i < {size}u; i++) digest(&sum, &place, {name}[i]);")
        lines += ["*spikes = sent;", "sent = 0;", "(void)place;", "return sum;"]
        head = "uint64_t NAME_digest(uint64_t *spikes)"
        return ["#ifdef NEURO_DIGEST", f"{head};", *function(head, lines)[:-1], "#endif"]


def _inside(first: int, last: int) -> str:
    """Return the C test for first <= neuron < last."""
    return f"neuron < {last}u" if first == 0 else f"neuron >= {first}u && neuron < {last}u"


def _digested(part: StepCode) -> list[str]:
    """Return the state registers that the emulator shows."""
    return [register for register in part.states if register != "hold"]


def _call_names(word: str, names: Sequence[str], numbers: Iterable[int]) -> Iterator[tuple[str, int]]:
    """Yield a name of a C function for each part: "weights", or "weights_a" and "weights_b" for two parts."""
    for name, index in zip(_macros(names), numbers, strict=True):
        yield f"{word}_{name.lower()}" if len(names) > 1 else word, index


def _macros(names: Iterable[str]) -> Iterator[str]:
    """Yield a unique C identifier in capitals for each name, e.g. "ON_CELLS" for "on-cells"."""
    used_words = set[str]()
    for k, name in enumerate(names):
        word = re.sub(r"[^A-Z0-9]", "_", name.upper())
        while word in used_words:
            word += f"_{k}"
        used_words.add(word)
        yield word
