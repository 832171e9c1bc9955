"""The neurons of a population as C: state arrays, and a function that steps all neurons.

A register that all neurons share is a constant in the function; any other register is a table. Values that are replaced
in every step need no array: a current without memory is a local variable.

Groups of competing neurons are decided after the step of their neurons. No chip has such groups. The C code decides
them as the host of the emulated chip does: by the voltages of the step, and ties by keyed random draws.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from neuro import lateral_reset, winner_take_all
from neuro.apps import keyed_random
from neuro.chips import FixedPopulation
from neuro.extend import Ints, Program
from neuro_exchange.c_code.arrays import TYPES, Memory, narrowest, number
from neuro_exchange.templates import filled

_NOTHING = np.zeros(1, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A population of a network.

    Attributes:
        number: index of the population, the suffix of its names in C.
        fixed: the registers.
        size: number of neurons.
        first: index of the first neuron among all neurons of the network.
        slots: slots of the input ring, one more than the longest lag of the projections to the population.
        receptors: number of input rings: 2 if a weight may go to the second receptor, else 1.
        slot_type: C type of a neuron's input in a step.
        is_output: the spikes are output of the program.
        competes: the neurons belong to a group.
        projections: indices of the outgoing projections that deliver a spike at once.
        learning_statements: statements that report TIMES spikes of neuron i to learning projections.
    """

    number: int
    fixed: FixedPopulation
    size: int
    first: int
    slots: int
    receptors: int
    slot_type: str
    is_output: bool
    competes: bool
    projections: tuple[int, ...]
    learning_statements: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StepCode:
    """The C code of a population.

    Attributes:
        states: names of the state arrays by register.
        lines: the functions.
        init: statements that initialise the states, by register.
        threshold: expression for the threshold of neuron i.
    """

    states: dict[str, str]
    lines: list[str]
    init: dict[str, str]
    threshold: str = ""


class PopulationCode:
    """Builder of the C code of a population. Texts of registers are expressions for neuron i.

    Args:
        cells: the population.
        memory: declarations, to which tables and states are added.
    """

    def __init__(self, cells: Cells, memory: Memory) -> None:
        self._cells, self._memory = cells, memory
        self._states = dict[str, str]()
        self._init = dict[str, str]()
        self._reset = list[str]()

    def text(self, name: str, values: Ints) -> str:
        """Return the text of a constant register: a number if all neurons share it, else an entry of a table."""
        return self._memory.entry(f"{name}_{self._cells.number}", values, f"{self._cells.fixed.name}: {name}")

    def state(self, register: str) -> str:
        """Return the text of a state register of 32 bits. A new register is declared."""
        element = f"{register}_{self._cells.number}[i]"
        if register in self._states:
            return element
        self._array(register, "int32_t")
        initial = self.text(f"{register}_begin", self._cells.fixed.initial.get(register, _NOTHING))
        self._init[register] = _loop_in_a_line(self._cells.size, f"{element} = {initial};")
        return element

    def hold(self, steps: Ints) -> str:
        """Declare the counter of refractory steps left, and return its text; "" if no neuron is ever refractory."""
        if steps.max() <= 0:
            return ""
        counter = self._array("hold", TYPES[narrowest(0, int(steps.max()))])
        self._init["hold"] = _loop_in_a_line(self._cells.size, f"{counter} = 0;")
        self._reset.append(f"{counter} = {self.text('refractory', np.maximum(steps, 0))};")
        return counter

    def reset_voltage(self, v: str, to: str) -> None:
        """Let a spike set the voltage `v` to the value `to`, or lower it by the register `fall` if that is not 0."""
        fall = self._cells.fixed.registers.get("fall", _NOTHING)
        statement, decrease = f"{v} = {to};", self.text("fall", fall)
        if fall.all():
            statement = f"{v} -= {decrease};"
        elif fall.any():
            statement = f"{v} = {decrease} == 0 ? {to} : {v} - {decrease};"
        self._reset.insert(0, statement)

    def step_at_threshold(self, before: Sequence[str], threshold: str, body: Sequence[str]) -> StepCode:
        """Return the code of neurons that fire at a threshold. All registers must have been declared before.

        Args:
            before: statements before the loop over neurons.
            threshold: expression for the threshold of neuron i.
            body: statements for neuron i; they call `fire(i)` at threshold.
        """
        k, size = self._cells.number, self._cells.size
        lines = function(f"static void reset_{k}(uint32_t i)", self._reset) if self._cells.competes else []
        reset = [f"reset_{k}(i);"] if self._cells.competes else self._reset
        lines += function(f"static void fire_{k}(uint32_t i)", [*reset, *emit_statements(self._cells, "1u")])
        first_statements, on_spike = [], f"fire_{k}(i);"
        if self._cells.competes:
            fired = self._memory.state(f"fired_{k}", "uint8_t", size, f"{self._cells.fixed.name}: above threshold")
            first_statements, on_spike = [f"{fired}[i] = 0;"], f"{fired}[i] = 1;"
        text = [line.replace("fire(i);", on_spike) for line in _loop(size, [*first_statements, *body])]
        lines += function(f"static void step_{k}(void)", [*before, *text])
        return StepCode(self._states, lines, self._init, threshold)

    def step_that_sends(self, before: Sequence[str], body: Sequence[str], payload: str) -> StepCode:
        """Return the code of neurons that send numbers. The body resets the neuron.

        Args:
            before: statements before the loop over neurons.
            body: statements for neuron i.
            payload: expression for the unsigned number that the neuron then sends; 0 sends nothing.
        """
        k = self._cells.number
        lines = function(f"static void fire_{k}(uint32_t i, uint32_t times)", emit_statements(self._cells, "times"))
        body = [*body, f"uint32_t payload = {payload};", f"if (payload != 0) fire_{k}(i, payload);"]
        lines += function(f"static void step_{k}(void)", [*before, *_loop(self._cells.size, body)])
        return StepCode(self._states, lines, self._init)

    def _array(self, register: str, kind: str) -> str:
        name = f"{register}_{self._cells.number}"
        self._states[register] = self._memory.state(
            name, kind, self._cells.size, f"{self._cells.fixed.name}: {register}"
        )
        return f"{name}[i]"


def loihi_lif(cells: Cells, memory: Memory) -> StepCode:
    """Compartments of Loihi 1, see `neuro.model.neurons.loihi_lif`."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    v, kept_share = code.state("v"), 4095 - registers["du"]
    u = code.state("u") if kept_share.any() else ""
    hold = code.hold(registers["refractory"] - 1)
    code.reset_voltage(v, "0")
    lowest = number(shared(registers, "v_min") if "v_min" in registers else -(2**23) + 1)
    bias = code.text("bias", registers["bias_mant"] << registers["bias_exp"])
    leak = code.text("keep_v", 4096 - registers["dv"])
    body = [f"int32_t u = next_u({u or '0'}, {code.text('keep_u', kept_share)}, in[i]);", *([f"{u} = u;"] if u else [])]
    body += ["in[i] = 0;"]
    updates = [f"{v} = next_v({v}, {leak}, u, {bias}, {lowest});"]
    threshold = code.text("threshold", registers["vth"] * 64)
    updates += [f"if ({v} > {threshold}) {{", "    fire(i);", "}"]
    return code.step_at_threshold(
        [input_declaration(cells)], threshold, body + _if_refractory(hold, updates, [f"{v} = 0;"])
    )


def spinnaker_lif(cells: Cells, memory: Memory) -> StepCode:
    """SpiNNaker's exponential neurons, see `neuro.model.neurons.spinnaker_lif`."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    v, exc, inh = code.state("v"), code.state("g_exc"), code.state("g_inh")
    hold = code.hold(registers["t_refract"])
    code.reset_voltage(v, code.text("v_reset", registers["v_reset"]))
    body, slots = [], ("in[i]", "below[i]" if cells.receptors == 2 else "0")
    for g, word, slot in ((exc, "exc", slots[0]), (inh, "inh", slots[1])):
        decay, init = (code.text(f"{word}_{suffix}", registers[f"{word}_{suffix}"]) for suffix in ("decay", "init"))
        body += [f"{g} = next_g({g}, {decay}, {slot}, {registers[f'{word}_shift'][0]}, {init});"]
    body += [f"{slot} = 0;" for slot in slots[: cells.receptors]]
    drive = f"(int64_t){exc} - {inh} + {code.text('bias', registers['i_offset'])}"
    arguments = (
        code.text(word, registers[name]) for word, name in (("r_m", "r_m"), ("v_rest", "v_rest"), ("keep_v", "exp_tc"))
    )
    body += _if_refractory(hold, [f"{v} = next_v({v}, {drive}, {', '.join(arguments)});"], [])
    # A refractory neuron is compared as well, as in the machine's code.
    threshold = code.text("threshold", registers["v_thresh"])
    body += [f"if ({v} >= {threshold}) {{", "    fire(i);", "}"]
    return code.step_at_threshold([input_declaration(cells)], threshold, body)


def spinnaker_delta(cells: Cells, memory: Memory) -> StepCode:
    """Neurons with delta input in SpiNNaker's arithmetic."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    v, hold = code.state("v"), code.hold(registers["t_refract"])
    code.reset_voltage(v, code.text("v_reset", registers["v_reset"]))
    slots = ("in[i]", "below[i]")[: cells.receptors]
    inputs = [
        f"((int64_t){slot} << {registers[f'{word}_shift'][0]})"
        for slot, word in zip(slots, ("exc", "inh"), strict=False)
    ]
    lowest = number(shared(registers, "v_min") if "v_min" in registers else -(2**31) + 1)
    arguments = (
        code.text(word, registers[name])
        for word, name in (("bias", "i_offset"), ("v_rest", "v_rest"), ("keep_v", "exp_tc"))
    )
    body = [f"int64_t input = {' - '.join(inputs)};", *(f"{slot} = 0;" for slot in slots)]
    updates = [f"{v} = next_v_delta({v}, input, {', '.join(arguments)}, {lowest});"]
    threshold = code.text("threshold", registers["v_thresh"])
    updates += [f"if ({v} >= {threshold}) {{", "    fire(i);", "}"]
    return code.step_at_threshold([input_declaration(cells)], threshold, body + _if_refractory(hold, updates, []))


def relay(cells: Cells, memory: Memory) -> StepCode:
    """Parrot neurons, which repeat the spikes of a step; as a single spike on a chip whose spikes have one bit."""
    body = ["uint16_t times = in[i];", "in[i] = 0;"]
    return PopulationCode(cells, memory).step_that_sends([input_declaration(cells)], body, "spikes(times)")


def input_declaration(cells: Cells) -> str:
    """Return the declaration of the inputs of this step: `in`, and `below` for the second receptor."""
    k, ring_size = cells.number, cells.slots * cells.size
    declaration = f"{cells.slot_type} *in = ring_{k} + at_{k} * {cells.size}u"
    return f"{declaration}, *below = in + {ring_size};" if cells.receptors == 2 else f"{declaration};"


def emit_statements(cells: Cells, times: str) -> list[str]:
    """Return the statements that emit a spike of neuron i."""
    lines = [f"emit({cells.first}u + i, {times}, {int(cells.is_output)});"]
    learning = (line.replace("TIMES", times) for line in cells.learning_statements)
    return [*lines, *(f"send_{q}(i, {times});" for q in cells.projections), *learning]


def _if_refractory(hold: str, active: Sequence[str], refractory: Iterable[str]) -> list[str]:
    """Return a branch for active and refractory neurons; only the active one if no neuron is ever refractory."""
    if not hold:
        return list(active)
    return [f"if ({hold} != 0) {{", *indented([f"{hold}--;", *refractory]), "} else {", *indented(active), "}"]


def shared(registers: Mapping[str, Ints], name: str) -> int:
    """Return the value of a register that all neurons share, or 0 if there is no such register."""
    return int(registers[name][0]) if name in registers else 0


def _loop(size: int, body: Iterable[str]) -> list[str]:
    return [f"for (uint32_t i = 0; i < {size}u; i++) {{", *indented(body), "}"]


def _loop_in_a_line(size: int, statement: str) -> str:
    return f"for (uint32_t i = 0; i < {size}u; i++) {statement}"


def indented(lines: Iterable[str]) -> list[str]:
    """Indent the lines of a block."""
    return [f"    {line}" for line in lines]


def function(head: str, body: Iterable[str]) -> list[str]:
    """Return the lines of a function with a head and a body."""
    return [head, "{", *indented(body), "}", ""]


def loihi2_lif(cells: Cells, memory: Memory) -> StepCode:
    """Neurons with a threshold, see `neuro.model.neurons.loihi2_lif`."""
    code = PopulationCode(cells, memory)
    body, begins = _integrated(cells, code)
    v, threshold = code.state("v"), code.text("threshold", cells.fixed.registers["vth"] * 64)
    code.reset_voltage(v, "0")
    return code.step_at_threshold(begins, threshold, [*body, f"if ({v} > {threshold}) {{", "    fire(i);", "}"])


def loihi2_ternary_lif(cells: Cells, memory: Memory) -> StepCode:
    """Neurons with an upper and a lower threshold, which send +1 and -1."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    body, begins = _integrated(cells, code)
    v = code.state("v")
    high, low = (code.text(word, registers[word] * 64) for word in ("vth_hi", "vth_lo"))
    body += [f"int32_t sign = ({v} > {high}) - ({v} < {low});", f"if (sign != 0) {v} = 0;"]
    return code.step_that_sends(begins, body, "(uint32_t)sign")


def _integrated(cells: Cells, code: PopulationCode) -> tuple[list[str], list[str]]:
    """Return the statements that update current and voltage of neuron i, and those before the loop over neurons."""
    registers = cells.fixed.registers
    v, kept_share = code.state("v"), 4095 - registers["du"]
    u = code.state("u") if kept_share.any() else ""
    begins, interval = [input_declaration(cells)], shared(registers, "reset_interval")
    if interval:
        arrays = [array.removesuffix("[i]") for array in (v, u) if array]
        test = f"if (now % {interval}u == {shared(registers, 'reset_offset') % interval}u) {{"
        begins += [test, *(f"    memset({array}, 0, sizeof {array});" for array in arrays), "}"]
    bias = code.text("bias", registers["bias_mant"] << registers["bias_exp"])
    leak = code.text("keep_v", 4096 - registers["dv"])
    body = [f"int32_t u = next_u({u or '0'}, {code.text('keep_u', kept_share)}, in[i]);", *([f"{u} = u;"] if u else [])]
    return [*body, "in[i] = 0;", f"{v} = next_v({v}, {leak}, u, {bias});"], begins


def sigma_delta(cells: Cells, memory: Memory) -> StepCode:
    """Neurons that sum messages, apply an activation function, and send its changes."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    sigma = code.state("sigma")
    bias = code.text("bias", registers["bias"])
    body = [f"int32_t y = plus({sigma} = plus({sigma}, wrap32(in[i])), {bias});"]
    return _encoding(cells, code, [*body, *(["if (y < 0) y = 0;"] if shared(registers, "relu") else [])])


def delta_encoder(cells: Cells, memory: Memory) -> StepCode:
    """Neurons that send the changes of their input."""
    exponent = sum(shared(cells.fixed.registers, word) for word in ("spike_exp", "state_exp"))
    return _encoding(cells, PopulationCode(cells, memory), [f"int32_t y = scaled(in[i], {exponent}u);"])


def _encoding(cells: Cells, code: PopulationCode, body: Sequence[str]) -> StepCode:
    registers = cells.fixed.registers
    states = ("act", "residue", *(["error"] if shared(registers, "cum_error") else []))
    places = [f"&{code.state(word)}" for word in states] + ["NULL"]
    arguments = f"{', '.join(places[:3])}, y, {code.text('vth', registers['vth'])}, {shared(registers, 'state_exp')}u"
    return code.step_that_sends([input_declaration(cells)], [*body, "in[i] = 0;"], f"encoded({arguments})")


def sigma_decoder(cells: Cells, memory: Memory) -> StepCode:
    """Neurons that send the sum of all messages so far in every step."""
    code = PopulationCode(cells, memory)
    sigma = code.state("sigma")
    body = [f"{sigma} = plus({sigma}, wrap32(in[i]));", "in[i] = 0;"]
    return code.step_that_sends([input_declaration(cells)], body, f"(uint32_t){sigma}")


def graded_vector(cells: Cells, memory: Memory) -> StepCode:
    """Neurons that send every input above a threshold."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    body = ["int32_t input = wrap32(in[i]);", "in[i] = 0;"]
    arguments = f"input, {code.text('vth', registers['vth'])}, {int(not shared(registers, 'relu'))}"
    return code.step_that_sends([input_declaration(cells)], body, f"passed({arguments})")


def graded_product(cells: Cells, memory: Memory) -> StepCode:
    """Neurons that send the product of the inputs of both receptors if it exceeds a threshold."""
    registers, code = cells.fixed.registers, PopulationCode(cells, memory)
    slots = ("in[i]", "below[i]")[: cells.receptors]
    body = [
        f"int32_t product = wrap32((int64_t)({' * '.join([*slots, '0u'][:2])}));",
        *(f"{slot} = 0;" for slot in slots),
    ]
    arguments = f"(int32_t)floor_shift(product, {shared(registers, 'exp')}u), {code.text('vth', registers['vth'])}, 1"
    return code.step_that_sends([input_declaration(cells)], body, f"passed({arguments})")


def resonator(fires: Callable[[str, str, str], tuple[str, str]]) -> Callable[[Cells, Memory], StepCode]:
    """Return the function that writes resonate-and-fire neurons, whose complex state rotates.

    Args:
        fires: function that returns the test for a spike and the reset, from the texts of the real part, the imaginary
            part and the threshold. `before` is the imaginary part of the previous step.
    """

    def write(cells: Cells, memory: Memory) -> StepCode:
        registers, code = cells.fixed.registers, PopulationCode(cells, memory)
        real, imag = code.state("real"), code.state("imag")
        exponent = shared(registers, "state_exp")
        test, reset = fires(real, imag, code.text("threshold", registers["vth"]))
        slots = ("in[i]", "below[i]")[: cells.receptors]
        inputs = [f"scaled({slot}, {exponent}u)" for slot in slots] + ["0"]
        factors = ", ".join(code.text(word, registers[word]) for word in ("cos_decay", "sin_decay"))
        body = [f"int32_t before = {imag};", f"turn(&{real}, &{imag}, {factors}, {inputs[0]}, {inputs[1]});"]
        body += [*(f"{slot} = 0;" for slot in slots), f"uint32_t fires = {test};", "(void)before;"]
        return code.step_that_sends(
            [input_declaration(cells)], [*body, *([f"if (fires) {reset}"] if reset else [])], "fires"
        )

    return write


loihi2_rf = resonator(lambda real, imag, vth: (f"{real} >= {vth} && {imag} >= 0 && before < 0", ""))
loihi2_rf_iz = resonator(lambda real, imag, vth: (f"{imag} >= {vth}", f"{real} = 0, {imag} = {vth} - 1;"))


SUPPORTED = (winner_take_all, lateral_reset)
"""Kinds of groups that are written as C."""


def decide(program: Program, index: int, cells: Cells, threshold: str, memory: Memory) -> tuple[list[str], list[str]]:
    """Return the functions that decide a group, and the statements that open the group at the start of a trial.

    Args:
        program: the program with the group.
        index: index of the group.
        cells: the population of the group.
        threshold: C expression for the threshold of neuron i.
        memory: declarations, to which the group's state is added.
    """
    group, k = program.groups[index], cells.number
    choice, opened, shape = group.choice, list[str](), program.populations[group.population].shape
    is_single = isinstance(choice, lateral_reset) and shape[choice.axis] == 1
    tie = keyed_random.key(program.seed, "tie", group.name)
    # The neuron with the largest distance from threshold wins. A random draw breaks ties.
    search = filled("c_code/network/best.c", k=k, none=f"{cells.size}u", tie=tie, threshold=threshold)
    lines = [] if is_single else search.splitlines()
    lines += [f"static void decide_{k}(void)", "{"]
    if isinstance(choice, lateral_reset):
        # A loop over the rivals of a single neuron makes compilers warn of an index out of range.
        lines += [] if is_single else _lateral_reset(cells, shape[choice.axis], math.prod(shape[choice.axis + 1 :]))
    else:
        stops_after_spike = isinstance(choice, winner_take_all) and choice.first_to_fire
        if stops_after_spike:
            closed = memory.variable(f"closed_{k}", "uint8_t", f"{group.name}: whether it has decided")
            opened = [f"{closed} = 0;"]
        lines += _winner_take_all(cells, stops_after_spike)
    fires = [f"    for (uint32_t i = 0; i < {cells.size}u; i++) {{", f"        if (fired_{k}[i]) fire_{k}(i);", "    }"]
    return [*lines, *fires, "}", ""], opened


def supports(choice: object) -> bool:
    """Return whether groups of a kind are written as C."""
    return isinstance(choice, SUPPORTED)


def _winner_take_all(cells: Cells, stops_after_spike: bool) -> list[str]:
    """Return the statements of winner take all. With `stops_after_spike` losers are not reset; the group closes."""
    k, size = cells.number, cells.size
    lines = [f"    uint32_t best = best_{k}(0, {size}u, 1);"]
    lose = f"fired_{k}[i] = 0;" if stops_after_spike else f"fired_{k}[i] = 0, reset_{k}(i);"
    closed = f" || closed_{k}" if stops_after_spike else ""
    lines += [f"    for (uint32_t i = 0; i < {size}u; i++) {{", f"        if (fired_{k}[i] && (i != best{closed})) {{"]
    lines += [f"            {lose}", "        }", "    }"]
    return [*lines, *([f"    if (best < {size}u) closed_{k} = 1;"] if stops_after_spike else [])]


def _lateral_reset(cells: Cells, rivals: int, stride: int) -> list[str]:
    """Return the statements of lateral reset: the best of each set of rivals fires, and all others are reset.

    Neurons of a set are `stride` apart: 0, 2 and 4 for three rivals and a stride of 2.
    """
    k, size = cells.number, cells.size
    return [
        f"    for (uint32_t first = 0; first < {size}u; first++) {{",
        f"        if (first / {stride}u % {rivals}u != 0) continue;",
        f"        uint32_t last = first + {rivals * stride}u, best = best_{k}(first, last, {stride}u);",
        f"        for (uint32_t i = first; best < {size}u && i < last; i += {stride}u) {{",
        f"            if (i != best) fired_{k}[i] = 0, reset_{k}(i);",
        "        }",
        "    }",
    ]
