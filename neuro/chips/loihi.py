"""Loihi 1: conversion of leaky integrate-and-fire neurons and their weights to registers.

Any table with `arithmetic: loihi` uses it.

Let S be the units of the voltage register per mV, P32 the potential in mV that 1 pA of synaptic current adds in a step,
and P30 the potential that 1 pA of constant current adds (exact integration, `neuro.model.neurons.propagators`):

| described | on the chip |
| --- | --- |
| V_m - E_L | v = S (V_m - E_L) |
| I_syn, without the input of this step | u = S P32 I_syn / P11, with P11 = exp(-h / tau_syn) |
| weight of `iaf_psc_exp` | 64 m 2^e = S P32 w |
| weight of `iaf_psc_delta` | 64 m 2^e = S w, and du = 4095, so that u decays completely |
| tau_syn | (4096 - (du + 1)) / 4096 = exp(-h / tau_syn) |
| tau_m | (4096 - dv) / 4096 = exp(-h / tau_m) |
| V_m >= V_th | v > 64 vth, where vth is the largest integer with 64 vth < S (V_th - E_L) |
| t_ref of R steps | refractory = R + 1 |
| delay of D steps | `iaf_psc_exp`: D, `iaf_psc_delta`: D - 1, see `neuro.chips.inputs` |

Source: Davies et al., IEEE Micro 38(1):82, 2018; traces of lava 0.10, nengo-loihi 1.1 and Brian2Loihi 0.5.2. Where the
references differ, two rules follow Brian2Loihi, which reports a match with the chip: each weight is shifted, not the
sum of a step, and mantissas lose their lowest bits towards 0. Three rules follow nengo-loihi, whose tests compare sums
with the chip: the sum of a step wraps as a two's complement of 22 bits, u and u + bias wrap at 24 bits, and v is
clipped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetic import SIGNALS, Arithmetic, Option, Projections, is_positive, is_whole
from neuro.chips.description import Chip
from neuro.chips.fixed import (
    FixedPopulation,
    FixedProjection,
    WeightRounding,
    Words,
    farthest_weight,
    judge_weights,
    round_weights,
)
from neuro.chips.inputs import (
    Inputs,
    Options,
    acts_late,
    approximated,
    has_lowest_potential,
    lowest_potential_problems,
    one_kernel,
    refused,
    register,
    resets_by_subtraction,
    soft_reset_problems,
    too_long,
    too_short,
    value_at,
)
from neuro.chips.loihi_registers import (
    BIAS_LARGEST,
    BIAS_MANTISSA,
    DECAY_STEPS,
    INPUT_LIMIT,
    KIND,
    LOSSLESS,
    REFRACTORY_LIMIT,
    REGISTER_OF_ONE,
    TOLERANCE,
    U_LIMIT,
    V_LIMIT,
    VTH_LIMIT,
    WEIGHT_BITS,
    WEIGHT_EXPONENTS,
    InMillivolts,
    bounds,
    choose_scale,
    exponent_of,
    grain_of,
    in_millivolts,
    potential_changes,
    receives,
    registers_of,
    word,
)
from neuro.core.errors import ModelError
from neuro.model.neurons import Neuron, iaf_psc_delta, iaf_psc_exp
from neuro.model.synapses import static
from neuro.program.backend import Problem
from neuro.program.program import Floats, Population, Program

_ONE = np.ones(1)

SOFT_RESET = (
    "needs two compartments per neuron, the second of which inhibits the first (Rueckauer et al., ACM J. Emerg. "
    "Technol. Comput. Syst. 18:48, 2022); only one is placed and priced"
)


def missing_features(inputs: Inputs) -> list[Problem]:
    """Return problems with features of a population that a compartment lacks, independent of the scale."""
    return [*_times(inputs), *_potentials(inputs), *_input(inputs), *soft_reset_problems(inputs.part, SOFT_RESET)]


def _times(inputs: Inputs) -> Iterator[Problem]:
    """Yield problems with time constants beyond 12-bit decays, and with refractory periods beyond their register."""
    part, h = inputs.part, inputs.program.resolution
    limit = -h / np.log1p(-1.0 / DECAY_STEPS)
    is_used = dict(zip(("tau_syn_ex", "tau_syn_in"), receives(inputs), strict=True))
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in part.parameters and is_used.get(name, True):
            yield from too_short(part, name, h)
            yield from too_long(part, name, h, limit, "a 12-bit decay", name == "tau_m")
    neuron = int(np.argmax(part.parameters["t_ref"]))
    steps = round(value_at(part, "t_ref", neuron) / h)
    if steps + 1 > REFRACTORY_LIMIT:
        yield refused(
            part,
            f"t_ref = {value_at(part, 't_ref', neuron):g} ms",
            f"it is {steps} steps, and the refractory register holds at most {REFRACTORY_LIMIT - 1}",
            f"use at most {(REFRACTORY_LIMIT - 1) * h:g} ms, or a coarser resolution",
        )


def _potentials(inputs: Inputs) -> Iterator[Problem]:
    """Yield problems with reset potentials and thresholds."""
    part, p = inputs.part, inputs.part.parameters
    mismatched = np.flatnonzero(np.broadcast_to((p["V_reset"] != p["E_L"]) & ~resets_by_subtraction(part), part.size))
    if mismatched.size:
        v_reset, e_l = value_at(part, "V_reset", mismatched[0]), value_at(part, "E_L", mismatched[0])
        yield refused(
            part,
            f"V_reset = {v_reset:g} mV",
            f"a spike sets the voltage register to 0, which is E_L = {e_l:g} mV",
            f"set V_reset to {e_l:g}, or run on spinnaker",
        )
    wrong_neurons = np.flatnonzero(np.broadcast_to(p["V_th"] <= p["E_L"], part.size))
    if wrong_neurons.size:
        v_th, e_l = value_at(part, "V_th", wrong_neurons[0]), value_at(part, "E_L", wrong_neurons[0])
        yield refused(
            part,
            f"V_th = {v_th:g} mV",
            f"the threshold register is unsigned, so V_th must be above E_L = {e_l:g} mV",
            "raise V_th or lower E_L, or run on spinnaker",
        )
    yield from lowest_potential_problems(part)


def _input(inputs: Inputs) -> Iterator[Problem]:
    """Yield problems with lost input, and with receptors of different time constants."""
    part, p = inputs.part, inputs.part.parameters
    if p.get("refractory_input", np.zeros(1)).any():
        yield refused(part, "refractory_input", "a compartment loses input while it is refractory", "leave it out")
    if "tau_syn_ex" not in p or not all(receives(inputs)):
        return
    different = np.flatnonzero(np.broadcast_to(p["tau_syn_ex"] != p["tau_syn_in"], part.size))
    if different.size:
        ex, inh = value_at(part, "tau_syn_ex", different[0]), value_at(part, "tau_syn_in", different[0])
        yield refused(
            part,
            f"tau_syn_ex = {ex:g} ms and tau_syn_in = {inh:g} ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        )


def overflows(part: Population, mv: InMillivolts, volt: float) -> Iterator[Problem]:
    """Yield a problem for each register that overflows at the scale `volt`, in units per mV."""
    for quantity, largest, limit, name in (
        ("V_th - E_L", float(mv.distance.max()) / 64.0, VTH_LIMIT, "the 17-bit threshold register"),
        ("the constant current", float(mv.drive.max()), BIAS_LARGEST, "the bias register, 4095 x 2^7,"),
        ("V_m at step 0", float(np.abs(mv.start).max()), V_LIMIT, "the 24-bit voltage register"),
        ("I_syn at step 0", float(np.abs(mv.current).max()), U_LIMIT - 1, "the 24-bit current register"),
    ):
        need = volt * largest
        if need > limit * (1.0 + TOLERANCE):
            yield refused(
                part,
                f"{quantity} needs {need:.6g} at {volt:.6g} units per mV",
                f"{name} holds at most {limit}",
                f"set its scale to at most {volt * limit / need:.6g}",
            )


SCALING = (
    Option("scales", "populations", is_positive, "units per mV, a number > 0"),
    Option(
        "exponents",
        "projections",
        lambda value: is_whole(value, WEIGHT_EXPONENTS),
        "a weight exponent, a whole number from -8 to 7",
    ),
)
"""Options with which a user fixes scales and exponents."""


def filled_current(cells: FixedPopulation, arriving: Floats) -> float:
    """Return the largest |u| that an input causes, as a share of 2^23; 0 for neurons without a current."""
    if "du" not in cells.registers:
        return 0.0
    keep = (4095 - cells.registers["du"]) / 4096
    u, largest = np.zeros(arriving[:, 0].shape), 0.0
    for step in range(arriving.shape[1]):
        u = keep * u + 64.0 * arriving[:, step]
        largest = max(largest, float(np.abs(u).max(initial=0.0)) / U_LIMIT)
    return largest


class Loihi(Arithmetic):
    """The integer arithmetic of Loihi 1."""

    name = "loihi"
    title = "Loihi"
    models: tuple[type[Neuron], ...] = (iaf_psc_exp, iaf_psc_delta)
    options: tuple[Option, ...] = (*SCALING, SIGNALS)
    state_limit = V_LIMIT
    register_of_one = REGISTER_OF_ONE
    one_bit = True
    word: type[np.signedinteger[Any]] = np.int16
    stands_for: Mapping[str, str] = {
        **{"V_m": "v", "I_syn_ex": "u", "I_syn_in": "u", "tau_m": "dv", "tau_syn_ex": "du", "tau_syn_in": "du"},
        **{"V_th": "vth", "I_e": "bias_mant", "t_ref": "refractory"},
    }
    states: Mapping[str, tuple[str, ...]] = {KIND: ("v", "u")}
    kind = KIND
    """Name of the integer step of neurons of `models`, see `FixedPopulation.kind`."""
    shifts_sums = False
    """Whether a negative exponent shifts the sum of a step instead of each weight."""

    def ends(self, mode: str, bits: int) -> tuple[int, int, int]:
        """Return the smallest and the largest mantissa of a sign mode, and the step between two mantissas."""
        return bounds(mode, bits)

    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Convert mantissas to words, the amounts that a spike adds."""
        return word(mantissas, wires.exponent, wires.bits, wires.sign_mode == "mixed")

    def wires(
        self,
        inputs: Inputs,
        index: int,
        mantissas: Words,
        rounding: WeightRounding,
        step: Floats = _ONE,
        exponent: int = 0,
        mode: str = "",
        bits: int = WEIGHT_BITS,
        native: bool = False,
        **other_attributes: Any,
    ) -> FixedProjection:
        """Return a projection with given mantissas, sign mode and rounding errors.

        Args:
            inputs: the target population.
            index: index of the projection.
            mantissas: mantissas, one for all or one per synapse.
            rounding: rounding errors of the weights.
            step: weight per mantissa.
            exponent: weight exponent.
            mode: sign mode; "" for mantissas that are sent unchanged.
            bits: bits of a mantissa.
            native: whether the weights in YAML are mantissas, including the bits that the chip drops.
            other_attributes: other attributes of `FixedProjection`.
        """
        low, high, grain = self.ends(mode, WEIGHT_BITS if native else bits)
        lag = inputs.lag(index)
        wires = FixedProjection(
            name=inputs.program.projections[index].name,
            mantissas=mantissas,
            words=mantissas,
            low=low,
            high=high,
            grain=1 if native else grain,
            exponent=exponent,
            sign_mode=mode,
            bits=bits,
            step=step,
            step_below=step,
            lag=lag,
            delay=register(lag, self.register_of_one),
            native=native,
            shift=max(-exponent, 0) if self.shifts_sums else 0,
            rounding=rounding,
            **other_attributes,
        )
        return replace(wires, words=self.words(wires, mantissas))

    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection onto a `loihi_lif`, whose weights are mantissas, and its refusals."""
        part = inputs.program.projections[index]
        numbers = part.synapse.parameters()
        exponent, bits = numbers.get("weight_exp", 0), numbers.get("num_weight_bits", WEIGHT_BITS)
        mode = numbers.get("sign_mode", "mixed")
        low, high, _ = bounds(mode, bits)
        lowest, highest, _ = bounds(mode)
        problems = []
        bad = np.flatnonzero((part.weight != np.rint(part.weight)) | (part.weight < lowest) | (part.weight > highest))
        if bad.size:
            value = part.weight[bad[0]]
            reason = f"a mantissa in sign mode {mode} is a whole number from {lowest} to {highest}"
            problems.append(refused(part, f"weight = {value:g}", reason, "raise weight_exp and lower the mantissas"))
        mantissas: Words = np.clip(np.rint(part.weight), lowest, highest).astype(np.int32)
        on_chip: Floats = word(mantissas, exponent, bits, mode == "mixed") * 2.0**-exponent
        rounding = judge_weights(mantissas.astype(np.float64), on_chip, 1.0, low, high)
        wires = self.wires(inputs, index, mantissas, rounding, exponent=exponent, mode=mode, bits=bits, native=True)
        return wires, problems

    def relay_projection(self, inputs: Inputs, index: int) -> FixedProjection:
        """Return a projection onto parrots. The host relays every spike, independent of the weight."""
        step = inputs.program.projections[index].weight.copy()
        return self.wires(inputs, index, np.ones(1, dtype=np.int32), LOSSLESS, step, mode="excitatory")

    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Quantise a population of `iaf_psc_delta` or `iaf_psc_exp` and the projections onto it.

        Args:
            inputs: the population and its input.
            options: scales and exponents that a user sets.
        """
        part = inputs.part
        mv, problems = in_millivolts(inputs), missing_features(inputs)
        volt = float(options.of("scales", part.name) or choose_scale(inputs, mv))
        problems += overflows(part, mv, volt)
        registers, errors = registers_of(inputs, mv, volt)
        if has_lowest_potential(part):
            rest, lowest = part.parameters["E_L"], part.parameters["V_min"]
            depth = volt * float((rest - lowest).max())
            registers["v_min"] = np.array([1 - 2 ** round(np.log2(max(depth, 0.0) + 1.0))])
            v_min = float(rest.min()) + registers["v_min"][0] / volt
            reason = f"a core's register holds a power of two: {v_min:.4g} mV"
            problems.append(approximated(part, f"V_min = {lowest.min():g} mV", reason))
        ampere = () if not mv.tau else (volt * mv.gain / (mv.fade if acts_late(part.model) else 1.0),) * 2
        initial = {
            name: np.rint(volt * values).astype(np.int64) for name, values in (("v", mv.start), ("u", mv.current))
        }
        fixed = FixedPopulation(
            part.name,
            self.kind,
            registers,
            initial,
            volt,
            part.parameters["E_L"].copy(),
            ampere,
            volt * mv.drift,
            errors,
        )
        wires = {}
        for index in inputs.spikes:
            wires[index], wire_problems = self.fitted_projection(inputs, index, mv, volt, options)
            problems += wire_problems
        return fixed, wires, problems

    def fitted_projection(
        self, inputs: Inputs, index: int, mv: InMillivolts, volt: float, options: Options
    ) -> tuple[FixedProjection, list[Problem]]:
        """Convert the weights onto a population with a known scale to mantissas and an exponent."""
        part = inputs.program.projections[index]
        mode = inputs.sign_mode(index)
        low, high, grain = bounds(mode)
        problems = one_kernel(inputs, index, mv.gain.size)
        exponent = options.of("exponents", part.name)
        if exponent is None:
            exponent = exponent_of(
                potential_changes(inputs, index, mv, few=True), volt, low, high, inputs.learns(index)
            )
        step = 64.0 * 2.0**exponent / (volt * (mv.gain if part.grid is None else mv.gain[:1]))
        per_synapse = step if step.size == 1 else step[inputs.targets(index)]
        keep = exponent < 0 or inputs.keeps(index)
        mantissas, rounding = round_weights(part.weight, per_synapse, per_synapse, low, high, grain, keep)
        if exponent < 0:  # learning uses the lowest bits of a mantissa, but spikes do not send them
            on_chip: Floats = word(mantissas, exponent, 8, False).astype(np.float64) * 2.0**-exponent
            rounding = judge_weights(np.broadcast_to(part.weight, mantissas.shape), on_chip, per_synapse, low, high)
        if rounding.saturated > 0.0:
            farthest = farthest_weight(part.weight, per_synapse, low, high)
            limit = low if farthest.weight < 0.0 else high
            problems.append(
                refused(
                    part,
                    f"weight = {farthest.weight:g}",
                    f"a mantissa in sign mode {mode} holds at most {limit}, which is {limit * farthest.step:.6g} "
                    f"at exponent {exponent} and {volt:.6g} units per mV",
                    "use a larger exponent or a smaller scale, or leave both to be chosen",
                )
            )
        return self.wires(inputs, index, mantissas, rounding, per_synapse, exponent=exponent, mode=mode), problems

    def give_rule(
        self, program: Program, chip: Chip, index: int, wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Set a rule of the learning engine for a projection; yield refusals and approximations."""
        if type(program.projections[index].synapse) is not static:
            from neuro.chips.loihi_learning import give_rule

            yield from give_rule(program, chip, index, wires, options)

    def scale_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the present scale and exponents of a population and of the projections onto it."""
        return Options({"scales": {cells.name: cells.volt}, "exponents": {part.name: part.exponent for part in wires}})

    def filled(self, cells: FixedPopulation, arriving: Floats) -> float:
        """Return the larger share: of the 22 bits for the input of a step, or of the 24 bits for |u|."""
        if "du" not in cells.registers:
            return 0.0
        return max(64.0 * float(np.abs(arriving).max(initial=0.0)) / INPUT_LIMIT, filled_current(cells, arriving))

    def scale_text(self, cells: FixedPopulation, wires: FixedProjection) -> str:
        """Return the exponent of a projection for the report."""
        return f"exponent {wires.exponent}"

    def lossless(self, wires: FixedProjection) -> str:
        """Return a hint how to avoid that the exponent or the weight memory drops bits of a mantissa."""
        grain = max(grain_of(wires.bits, wires.sign_mode == "mixed"), 2 ** max(0, -wires.exponent))
        ways_out = [f"use mantissas that are multiples of {grain}"] if grain <= wires.high else []
        ways_out += ["use a larger weight_exp"] if wires.exponent < 0 else []
        return ", or ".join(ways_out)

    def current(self, cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a synaptic current in pA.

        A compartment has one current: above 0 it is excitatory, below 0 inhibitory.
        """
        units = np.maximum(states["u"], 0) if name == "I_syn_ex" else np.minimum(states["u"], 0)
        current: Floats = units / cells.ampere[0]
        return current

    def units(self, cells: FixedPopulation, name: str, values: Floats) -> Floats:
        """Return a synaptic current in pA as units of u."""
        units: Floats = values * cells.ampere[name == "I_syn_in"]
        return units

    def bias(self, cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
        """Return the bias of each step: the constant bias plus the bias of an extra current in pA."""
        r = cells.registers
        mantissas = r["bias_mant"] + np.rint(current * cells.drive / 2.0 ** r["bias_exp"]).astype(np.int64)
        if mantissas.min() < -BIAS_MANTISSA - 1 or mantissas.max() > BIAS_MANTISSA:
            raise ModelError(
                f"population '{cells.name}': a current of {np.abs(current).max():g} pA overflows the bias register",
                hint="describe the dc_generator with its largest amplitude: the scale follows from it",
            )
        value: NDArray[np.int32] = (mantissas << r["bias_exp"]).astype(np.int32)
        return value

    def way_out(self, cells: FixedPopulation) -> str:
        """Return a hint with the option that divides the scale by four."""
        return f"scales={{'{cells.name}': {cells.volt / 4:.4g}}} makes all registers a quarter as full"


LOIHI = Loihi()
