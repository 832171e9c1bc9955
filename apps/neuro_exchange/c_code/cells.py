"""The neurons of one population as C: their registers, their states, and one function that steps them all.

Registers that all neurons share are written into the function; others are tables. What every step replaces is no state:
of a current that keeps nothing no array is left.

Neurons that compete are decided after their step. No chip has such groups: where a chip runs, its host decides them, by
the voltages of the step and keyed draws for ties.
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
        number: with which its names in C end.
        fixed: its registers.
        size: neurons.
        first: the first of them among all of the network.
        slots: of its ring: one more than the longest lag of what it receives.
        receptors: rings that it has; 2 where a word may go to the second receptor.
        slot: type of what a neuron receives in a step.
        out: whether its spikes are output.
        group: whether its neurons compete.
        onto: numbers of the projections that it sends along.
        noted: statements with which learning hears of TIMES spikes of neuron i.
    """

    number: int
    fixed: FixedPopulation
    size: int
    first: int
    slots: int
    receptors: int
    slot: str
    out: bool
    group: bool
    onto: tuple[int, ...]
    noted: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Stepped:
    """What the neurons of a population are in C.

    Attributes:
        states: registers that a step leaves to the next, with the names of their arrays.
        lines: the functions.
        init: statements that put the states where they are at step 0, by register.
        threshold: of neuron i.
    """

    states: dict[str, str]
    lines: list[str]
    init: dict[str, str]
    threshold: str = ""


class Registers:
    """The registers of a population as text of C, of neuron i.

    Args:
        cells: the population.
        memory: takes tables and states.
    """

    def __init__(self, cells: Cells, memory: Memory) -> None:
        self._cells, self._memory = cells, memory
        self._states = dict[str, str]()
        self._init = dict[str, str]()
        self._reset = list[str]()

    def text(self, name: str, values: Ints) -> str:
        """A register: a number that all neurons share, or an entry of a table."""
        return self._memory.entry(f"{name}_{self._cells.number}", values, f"{self._cells.fixed.name}: {name}")

    def state(self, register: str) -> str:
        """A state register of 32 bits."""
        at = f"{register}_{self._cells.number}[i]"
        if register in self._states:
            return at
        self._array(register, "int32_t")
        begins = self.text(f"{register}_begin", self._cells.fixed.initial.get(register, _NOTHING))
        self._init[register] = _all(self._cells.size, f"{at} = {begins};")
        return at

    def hold(self, steps: Ints) -> str:
        """The count of refractory steps that are left; "" where no neuron is ever refractory."""
        if steps.max() <= 0:
            return ""
        at = self._array("hold", TYPES[narrowest(0, int(steps.max()))])
        self._init["hold"] = _all(self._cells.size, f"{at} = 0;")
        self._reset.append(f"{at} = {self.text('refractory', np.maximum(steps, 0))};")
        return at

    def falls(self, v: str, to: str) -> None:
        """Say what a spike does to the voltage: it goes to a value, or falls by one where a register says so."""
        fall = self._cells.fixed.registers.get("fall", _NOTHING)
        here, by = f"{v} = {to};", self.text("fall", fall)
        if fall.all():
            here = f"{v} -= {by};"
        elif fall.any():
            here = f"{v} = {by} == 0 ? {to} : {v} - {by};"
        self._reset.insert(0, here)

    def stepped(self, before: Sequence[str], threshold: str, body: Sequence[str]) -> Stepped:
        """The population, when all of its registers have a text.

        Args:
            before: statements before the loop over neurons.
            threshold: of neuron i.
            body: what a neuron does; it calls `fire(i)` at threshold.
        """
        k, size = self._cells.number, self._cells.size
        lines = function(f"static void reset_{k}(uint32_t i)", self._reset) if self._cells.group else []
        reset = [f"reset_{k}(i);"] if self._cells.group else self._reset
        lines += function(f"static void fire_{k}(uint32_t i)", [*reset, *sent(self._cells, "1u")])
        begins, reached = [], f"fire_{k}(i);"
        if self._cells.group:
            fired = self._memory.state(f"fired_{k}", "uint8_t", size, f"{self._cells.fixed.name}: above threshold")
            begins, reached = [f"{fired}[i] = 0;"], f"{fired}[i] = 1;"
        text = [line.replace("fire(i);", reached) for line in _loop(size, [*begins, *body])]
        lines += function(f"static void step_{k}(void)", [*before, *text])
        return Stepped(self._states, lines, self._init, threshold)

    def sending(self, before: Sequence[str], body: Sequence[str], payload: str) -> Stepped:
        """A population whose neurons send numbers, and reset themselves in their step.

        Args:
            before: statements before the loop over neurons.
            body: what a neuron does.
            payload: what it then sends, as an unsigned number; nothing where that is 0.
        """
        k = self._cells.number
        lines = function(f"static void fire_{k}(uint32_t i, uint32_t times)", sent(self._cells, "times"))
        body = [*body, f"uint32_t payload = {payload};", f"if (payload != 0) fire_{k}(i, payload);"]
        lines += function(f"static void step_{k}(void)", [*before, *_loop(self._cells.size, body)])
        return Stepped(self._states, lines, self._init)

    def _array(self, register: str, kind: str) -> str:
        name = f"{register}_{self._cells.number}"
        self._states[register] = self._memory.state(
            name, kind, self._cells.size, f"{self._cells.fixed.name}: {register}"
        )
        return f"{name}[i]"


def loihi_lif(cells: Cells, memory: Memory) -> Stepped:
    """Compartments of Loihi 1, see `neuro.model.neurons.loihi_lif`."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    v, keep = own.state("v"), 4095 - r["du"]
    u = own.state("u") if keep.any() else ""
    hold = own.hold(r["refractory"] - 1)
    own.falls(v, "0")
    lowest = number(shared(r, "v_min") if "v_min" in r else -(2**23) + 1)
    bias, leak = own.text("bias", r["bias_mant"] << r["bias_exp"]), own.text("keep_v", 4096 - r["dv"])
    body = [f"int32_t u = next_u({u or '0'}, {own.text('keep_u', keep)}, in[i]);", *([f"{u} = u;"] if u else [])]
    body += ["in[i] = 0;"]
    free = [f"{v} = next_v({v}, {leak}, u, {bias}, {lowest});"]
    threshold = own.text("threshold", r["vth"] * 64)
    free += [f"if ({v} > {threshold}) {{", "    fire(i);", "}"]
    return own.stepped([arriving(cells)], threshold, body + _unless(hold, free, [f"{v} = 0;"]))


def spinnaker_lif(cells: Cells, memory: Memory) -> Stepped:
    """SpiNNaker's exponential neurons, see `neuro.model.neurons.spinnaker_lif`."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    v, exc, inh = own.state("v"), own.state("g_exc"), own.state("g_inh")
    hold = own.hold(r["t_refract"])
    own.falls(v, own.text("v_reset", r["v_reset"]))
    body, slots = [], ("in[i]", "below[i]" if cells.receptors == 2 else "0")
    for g, word, slot in ((exc, "exc", slots[0]), (inh, "inh", slots[1])):
        decay, init = (own.text(f"{word}_{what}", r[f"{word}_{what}"]) for what in ("decay", "init"))
        body += [f"{g} = next_g({g}, {decay}, {slot}, {r[f'{word}_shift'][0]}, {init});"]
    body += [f"{slot} = 0;" for slot in slots[: cells.receptors]]
    drive = f"(int64_t){exc} - {inh} + {own.text('bias', r['i_offset'])}"
    words = (own.text(word, r[name]) for word, name in (("r_m", "r_m"), ("v_rest", "v_rest"), ("keep_v", "exp_tc")))
    body += _unless(hold, [f"{v} = next_v({v}, {drive}, {', '.join(words)});"], [])
    # A refractory neuron is compared as well, as in the machine's code.
    threshold = own.text("threshold", r["v_thresh"])
    body += [f"if ({v} >= {threshold}) {{", "    fire(i);", "}"]
    return own.stepped([arriving(cells)], threshold, body)


def spinnaker_delta(cells: Cells, memory: Memory) -> Stepped:
    """Neurons with delta input in SpiNNaker's arithmetic."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    v, hold = own.state("v"), own.hold(r["t_refract"])
    own.falls(v, own.text("v_reset", r["v_reset"]))
    slots = ("in[i]", "below[i]")[: cells.receptors]
    inputs = [
        f"((int64_t){slot} << {r[f'{word}_shift'][0]})" for slot, word in zip(slots, ("exc", "inh"), strict=False)
    ]
    lowest = number(shared(r, "v_min") if "v_min" in r else -(2**31) + 1)
    words = (
        own.text(word, r[name]) for word, name in (("bias", "i_offset"), ("v_rest", "v_rest"), ("keep_v", "exp_tc"))
    )
    body = [f"int64_t input = {' - '.join(inputs)};", *(f"{slot} = 0;" for slot in slots)]
    free = [f"{v} = next_v_delta({v}, input, {', '.join(words)}, {lowest});"]
    threshold = own.text("threshold", r["v_thresh"])
    free += [f"if ({v} >= {threshold}) {{", "    fire(i);", "}"]
    return own.stepped([arriving(cells)], threshold, body + _unless(hold, free, []))


def relay(cells: Cells, memory: Memory) -> Stepped:
    """Parrots: as many spikes as arrived; on a chip whose spikes are one bit one of them."""
    body = ["uint16_t times = in[i];", "in[i] = 0;"]
    return Registers(cells, memory).sending([arriving(cells)], body, "spikes(times)")


def arriving(cells: Cells) -> str:
    """The declaration of what arrives in this step."""
    k, plane = cells.number, cells.slots * cells.size
    here = f"{cells.slot} *in = ring_{k} + at_{k} * {cells.size}u"
    return f"{here}, *below = in + {plane};" if cells.receptors == 2 else f"{here};"


def sent(cells: Cells, times: str) -> list[str]:
    """Statements with which neuron i emits."""
    lines = [f"emit({cells.first}u + i, {times}, {int(cells.out)});"]
    noted = (line.replace("TIMES", times) for line in cells.noted)
    return [*lines, *(f"send_{q}(i, {times});" for q in cells.onto), *noted]


def _unless(hold: str, free: Sequence[str], held: Iterable[str]) -> list[str]:
    """What a neuron does that is not refractory, and one that is."""
    if not hold:
        return list(free)
    return [f"if ({hold} != 0) {{", *indented([f"{hold}--;", *held]), "} else {", *indented(free), "}"]


def shared(registers: Mapping[str, Ints], name: str) -> int:
    """A register that all neurons share; 0 where there is none."""
    return int(registers[name][0]) if name in registers else 0


def _loop(size: int, body: Iterable[str]) -> list[str]:
    return [f"for (uint32_t i = 0; i < {size}u; i++) {{", *indented(body), "}"]


def _all(size: int, statement: str) -> str:
    return f"for (uint32_t i = 0; i < {size}u; i++) {statement}"


def indented(lines: Iterable[str]) -> list[str]:
    """Lines inside a block."""
    return [f"    {line}" for line in lines]


def function(head: str, body: Iterable[str]) -> list[str]:
    """A function by its head and its statements."""
    return [head, "{", *indented(body), "}", ""]


def loihi2_lif(cells: Cells, memory: Memory) -> Stepped:
    """Neurons with a threshold, see `neuro.model.neurons.loihi2_lif`."""
    own = Registers(cells, memory)
    body, begins = _integrated(cells, own)
    v, threshold = own.state("v"), own.text("threshold", cells.fixed.registers["vth"] * 64)
    own.falls(v, "0")
    return own.stepped(begins, threshold, [*body, f"if ({v} > {threshold}) {{", "    fire(i);", "}"])


def loihi2_ternary_lif(cells: Cells, memory: Memory) -> Stepped:
    """Neurons with two thresholds, which send signs."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    body, begins = _integrated(cells, own)
    v = own.state("v")
    high, low = (own.text(word, r[word] * 64) for word in ("vth_hi", "vth_lo"))
    body += [f"int32_t sign = ({v} > {high}) - ({v} < {low});", f"if (sign != 0) {v} = 0;"]
    return own.sending(begins, body, "(uint32_t)sign")


def _integrated(cells: Cells, own: Registers) -> tuple[list[str], list[str]]:
    """The current and the voltage of neuron i; and what is done before the loop over all."""
    r = cells.fixed.registers
    v, keep = own.state("v"), 4095 - r["du"]
    u = own.state("u") if keep.any() else ""
    begins, interval = [arriving(cells)], shared(r, "reset_interval")
    if interval:
        arrays = [each.removesuffix("[i]") for each in (v, u) if each]
        test = f"if (now % {interval}u == {shared(r, 'reset_offset') % interval}u) {{"
        begins += [test, *(f"    memset({each}, 0, sizeof {each});" for each in arrays), "}"]
    bias, leak = own.text("bias", r["bias_mant"] << r["bias_exp"]), own.text("keep_v", 4096 - r["dv"])
    body = [f"int32_t u = next_u({u or '0'}, {own.text('keep_u', keep)}, in[i]);", *([f"{u} = u;"] if u else [])]
    return [*body, "in[i] = 0;", f"{v} = next_v({v}, {leak}, u, {bias});"], begins


def sigma_delta(cells: Cells, memory: Memory) -> Stepped:
    """Sums of messages, their activations, and the changes of these."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    sigma = own.state("sigma")
    bias = own.text("bias", r["bias"])
    body = [f"int32_t y = plus({sigma} = plus({sigma}, wrap32(in[i])), {bias});"]
    return _encoding(cells, own, [*body, *(["if (y < 0) y = 0;"] if shared(r, "relu") else [])])


def delta_encoder(cells: Cells, memory: Memory) -> Stepped:
    """Changes of what arrives."""
    exponent = sum(shared(cells.fixed.registers, word) for word in ("spike_exp", "state_exp"))
    return _encoding(cells, Registers(cells, memory), [f"int32_t y = scaled(in[i], {exponent}u);"])


def _encoding(cells: Cells, own: Registers, body: Sequence[str]) -> Stepped:
    r = cells.fixed.registers
    states = ("act", "residue", *(["error"] if shared(r, "cum_error") else []))
    places = [f"&{own.state(word)}" for word in states] + ["NULL"]
    words = f"{', '.join(places[:3])}, y, {own.text('vth', r['vth'])}, {shared(r, 'state_exp')}u"
    return own.sending([arriving(cells)], [*body, "in[i] = 0;"], f"encoded({words})")


def sigma_decoder(cells: Cells, memory: Memory) -> Stepped:
    """Sums of messages, sent as they are."""
    own = Registers(cells, memory)
    sigma = own.state("sigma")
    body = [f"{sigma} = plus({sigma}, wrap32(in[i]));", "in[i] = 0;"]
    return own.sending([arriving(cells)], body, f"(uint32_t){sigma}")


def graded_vector(cells: Cells, memory: Memory) -> Stepped:
    """What arrives, where it is large enough."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    body = ["int32_t input = wrap32(in[i]);", "in[i] = 0;"]
    words = f"input, {own.text('vth', r['vth'])}, {int(not shared(r, 'relu'))}"
    return own.sending([arriving(cells)], body, f"passed({words})")


def graded_product(cells: Cells, memory: Memory) -> Stepped:
    """The product of what arrives at both receptors, where it is large enough."""
    r, own = cells.fixed.registers, Registers(cells, memory)
    slots = ("in[i]", "below[i]")[: cells.receptors]
    body = [
        f"int32_t product = wrap32((int64_t)({' * '.join([*slots, '0u'][:2])}));",
        *(f"{slot} = 0;" for slot in slots),
    ]
    words = f"(int32_t)floor_shift(product, {shared(r, 'exp')}u), {own.text('vth', r['vth'])}, 1"
    return own.sending([arriving(cells)], body, f"passed({words})")


def resonator(fires: Callable[[str, str, str], tuple[str, str]]) -> Callable[[Cells, Memory], Stepped]:
    """Neurons whose state turns.

    Args:
        fires: gives the test whether one fires, and what follows, from the texts of its real and its imaginary part,
            and of its threshold; `before` is the old imaginary part.
    """

    def stepped(cells: Cells, memory: Memory) -> Stepped:
        r, own = cells.fixed.registers, Registers(cells, memory)
        real, imag = own.state("real"), own.state("imag")
        exponent = shared(r, "state_exp")
        test, reset = fires(real, imag, own.text("threshold", r["vth"]))
        slots = ("in[i]", "below[i]")[: cells.receptors]
        inputs = [f"scaled({slot}, {exponent}u)" for slot in slots] + ["0"]
        factors = ", ".join(own.text(word, r[word]) for word in ("cos_decay", "sin_decay"))
        body = [f"int32_t before = {imag};", f"turn(&{real}, &{imag}, {factors}, {inputs[0]}, {inputs[1]});"]
        body += [*(f"{slot} = 0;" for slot in slots), f"uint32_t fires = {test};", "(void)before;"]
        return own.sending([arriving(cells)], [*body, *([f"if (fires) {reset}"] if reset else [])], "fires")

    return stepped


loihi2_rf = resonator(lambda real, imag, vth: (f"{real} >= {vth} && {imag} >= 0 && before < 0", ""))
loihi2_rf_iz = resonator(lambda real, imag, vth: (f"{imag} >= {vth}", f"{real} = 0, {imag} = {vth} - 1;"))


SUPPORTED = (winner_take_all, lateral_reset)


def decide(program: Program, index: int, cells: Cells, threshold: str, memory: Memory) -> tuple[list[str], list[str]]:
    """The functions of a group, and the statements that open it.

    Args:
        program: has the group.
        index: of the group.
        cells: the population.
        threshold: of neuron i, as text of C.
        memory: takes its state.
    """
    group, k = program.groups[index], cells.number
    choice, opened, shape = group.choice, list[str](), program.populations[group.population].shape
    alone = isinstance(choice, lateral_reset) and shape[choice.axis] == 1
    tie = keyed_random.key(program.seed, "tie", group.name)
    # The neuron of the largest margin; of equal ones that of the larger draw.
    best = filled("c_code/network/best.c", k=k, none=f"{cells.size}u", tie=tie, threshold=threshold)
    lines = [] if alone else best.splitlines()
    lines += [f"static void decide_{k}(void)", "{"]
    if isinstance(choice, lateral_reset):
        # Compilers take the loop over rivals of one neuron for one that leaves its array.
        lines += [] if alone else _rivals(cells, shape[choice.axis], math.prod(shape[choice.axis + 1 :]))
    else:
        once = isinstance(choice, winner_take_all) and choice.first_to_fire
        if once:
            closed = memory.variable(f"closed_{k}", "uint8_t", f"{group.name}: whether it has decided")
            opened = [f"{closed} = 0;"]
        lines += _one(cells, once)
    fires = [f"    for (uint32_t i = 0; i < {cells.size}u; i++) {{", f"        if (fired_{k}[i]) fire_{k}(i);", "    }"]
    return [*lines, *fires, "}", ""], opened


def supports(choice: object) -> bool:
    """Whether groups of a kind are written as C."""
    return isinstance(choice, SUPPORTED)


def _one(cells: Cells, once: bool) -> list[str]:
    """Winner take all: with `first_to_fire` the others stay at threshold, and the group is closed."""
    k, size = cells.number, cells.size
    lines = [f"    uint32_t best = best_{k}(0, {size}u, 1);"]
    lose = f"fired_{k}[i] = 0;" if once else f"fired_{k}[i] = 0, reset_{k}(i);"
    closed = f" || closed_{k}" if once else ""
    lines += [f"    for (uint32_t i = 0; i < {size}u; i++) {{", f"        if (fired_{k}[i] && (i != best{closed})) {{"]
    lines += [f"            {lose}", "        }", "    }"]
    return [*lines, *([f"    if (best < {size}u) closed_{k} = 1;"] if once else [])]


def _rivals(cells: Cells, rivals: int, apart: int) -> list[str]:
    """Lateral reset: of each set of rivals the best fires, and all others are reset."""
    k, size = cells.number, cells.size
    return [
        f"    for (uint32_t first = 0; first < {size}u; first++) {{",
        f"        if (first / {apart}u % {rivals}u != 0) continue;",
        f"        uint32_t last = first + {rivals * apart}u, best = best_{k}(first, last, {apart}u);",
        f"        for (uint32_t i = first; best < {size}u && i < last; i += {apart}u) {{",
        f"            if (i != best) fired_{k}[i] = 0, reset_{k}(i);",
        "        }",
        "    }",
    ]
