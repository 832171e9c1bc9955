"""Loihi 2: payloads, sums shifted as a whole, and neurons described in registers.

Any table with `arithmetic: loihi2` uses it.

| described | on the chip |
| --- | --- |
| weight of `loihi2_static` | the mantissa; bits that the memory lacks are rounded down |
| weight of `static` onto neurons in whole numbers | m 2^e with the largest exact e, else the smallest that fits |
| `iaf_psc_exp`, `iaf_psc_delta` | as on Loihi 1 (`neuro.chips.loihi`); without a refractory period |
| `sigma_delta` and other graded models | vth and bias in units of the states, 2^-(spike_exp + state_exp) |
| `stdp_dopa` with a signal | a three-factor rule (`neuro.chips.loihi_learning`) |

Differences from Loihi 1: mantissas of sign mode "mixed" are rounded down, not towards 0; a negative exponent shifts the
sum of a step, not each weight; the input of a step has 32 bits; there is no refractory period. Source: lava 0.10.0,
`src/lava/proc`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from neuro.chips.arithmetic import Arithmetic, Projections
from neuro.chips.description import Chip
from neuro.chips.fixed import (
    FixedPopulation,
    FixedProjection,
    Rounding,
    Words,
    judge_weights,
    round_weights,
    worst_rounding,
)
from neuro.chips.inputs import (
    Inputs,
    Options,
    approximated,
    has_lowest_potential,
    has_two_inputs,
    refused,
    resets_by_subtraction,
    value_at,
)
from neuro.chips.loihi import Loihi, filled_current
from neuro.chips.loihi_registers import LOSSLESS, WEIGHT_BITS, WEIGHT_EXPONENTS
from neuro.model.neurons import (
    delta_encoder,
    graded_product,
    graded_vector,
    iaf_psc_delta,
    iaf_psc_exp,
    sigma_decoder,
    sigma_delta,
)
from neuro.model.synapses import loihi2_convolution, loihi2_learning, loihi2_static
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Population, Program, Projection

LIF = "loihi2_lif"
GRADED = (sigma_delta, delta_encoder, sigma_decoder, graded_vector, graded_product)
"""Models with payloads. Their own exponents scale the parameters to registers."""

STATE_LIMIT = 2**31 - 1
SIGN_MODES = {"mixed": (-256, 255), "excitatory": (0, 255), "inhibitory": (-255, 0)}
"""The smallest and the largest mantissa of each sign mode."""


def stored_mantissas(mantissas: Words, bits: int, mode: str) -> Words:
    """Return mantissas after storage in the weight memory: clipped, and rounded down to its bits."""
    low, high = SIGN_MODES[mode]
    dropped_bits = WEIGHT_BITS - bits + (mode == "mixed")
    clipped = np.clip(mantissas, low, high)
    # Inhibitory mantissas are magnitudes, so they are rounded towards 0.
    words: Words = (
        -(-clipped >> dropped_bits << dropped_bits) if mode == "inhibitory" else clipped >> dropped_bits << dropped_bits
    )
    return words.astype(np.int32)


def _not_whole(part: Projection) -> Iterator[Problem]:
    bad = np.flatnonzero(part.weight != np.rint(part.weight))
    if bad.size:
        reason = "a mantissa is a whole number"
        yield refused(part, f"weight = {part.weight[bad[0]]:g}", reason, "raise weight_exp and lower the mantissas")


def _missing_features(part: Population) -> Iterator[Problem]:
    """Yield features that lava's fixed-point neuron lacks."""
    if np.any(part.parameters["t_ref"] > 0.0):
        neuron = int(np.argmax(part.parameters["t_ref"]))
        feature, reason = (
            f"t_ref = {value_at(part, 't_ref', neuron):g} ms",
            "no fixed-point neuron of Loihi 2 has a refractory period",
        )
        yield refused(part, feature, reason, "give it t_ref: 0, or run on loihi")
    if resets_by_subtraction(part).any() or has_lowest_potential(part):
        reason = "no fixed-point neuron of Loihi 2 resets by subtraction or has a lowest potential"
        yield refused(part, part.model.name, reason, "leave it out, or run on loihi")


_SIGMA = ("sigma", "act", "residue", "error", "payload")


class Loihi2(Loihi):
    """The integer arithmetic of Loihi 2. Payloads and the rounding of mantissas and sums differ from Loihi 1."""

    name = "loihi2"
    title = "Loihi 2"
    models = (iaf_psc_exp, iaf_psc_delta, *GRADED)
    state_limit = STATE_LIMIT
    one_bit = False
    graded = True
    keeps_kernels = True
    word = np.int32
    states: Mapping[str, tuple[str, ...]] = {
        LIF: ("v", "u"),
        "loihi2_ternary_lif": ("v", "u"),
        "loihi2_rf": ("real", "imag"),
        "loihi2_rf_iz": ("real", "imag"),
        "sigma_delta": _SIGMA,
        "delta_encoder": _SIGMA[1:],
        "sigma_decoder": ("sigma", "payload"),
        "graded_vector": ("payload",),
        "graded_product": ("payload",),
    }
    kind = LIF
    shifts_sums = True

    def ends(self, mode: str, bits: int) -> tuple[int, int, int]:
        """Return the smallest and the largest mantissa of a sign mode, and the step between two mantissas."""
        return (*SIGN_MODES.get(mode, (-255, 255)), 1 << (WEIGHT_BITS - bits + (mode == "mixed")))

    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Return the words that a spike of payload 1 adds. A negative exponent shifts the sum of a step instead."""
        if not wires.sign_mode:
            return mantissas
        # Learnt mantissas keep their lowest bits, as in lava.
        stored = mantissas if wires.rule is not None else stored_mantissas(mantissas, wires.bits, wires.sign_mode)
        return stored << max(wires.exponent, 0)

    def native(self, part: Population) -> FixedPopulation:
        """Return a population described in registers; its integer step has the name of the model."""
        fixed = super().native(part)
        if "cos_decay" in fixed.registers:
            vth = np.trunc(part.parameters["vth"] * 2.0 ** part.parameters["state_exp"]).astype(np.int64)
            fixed = replace(fixed, registers=fixed.registers | {"vth": vth})
        return fixed

    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection onto neurons in registers, and its refusals and approximations."""
        part = inputs.program.projections[index]
        if isinstance(part.synapse, (loihi2_static, loihi2_learning)):
            wires, problems = self._in_mantissas(inputs, index, part.synapse)
        elif isinstance(part.synapse, loihi2_convolution):
            wires, problems = self._convolution(inputs, index, part.synapse)
        else:
            wires, problems = self._fitted(inputs, index)
        is_second = has_two_inputs(inputs.part.model) and part.receptor is not None and part.receptor.index == 1
        return replace(wires, receptor=int(is_second)), problems

    def _in_mantissas(
        self, inputs: Inputs, index: int, synapse: loihi2_static | loihi2_learning
    ) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection whose weights are mantissas."""
        part = inputs.program.projections[index]
        exponent, bits, mode = synapse.weight_exp, synapse.num_weight_bits, synapse.sign_mode
        low, high = SIGN_MODES[mode]
        problems = [*_not_whole(part)]
        outside = np.flatnonzero((part.weight < low) | (part.weight > high))
        if outside.size:
            reason = f"a mantissa in sign mode {mode} is clipped to {low}..{high}"
            problems.append(approximated(part, f"weight = {part.weight[outside[0]]:g}", reason, "raise weight_exp"))
        clipped = np.clip(np.rint(part.weight), low, high).astype(np.int32)
        rounding = judge_weights(clipped.astype(np.float64), stored_mantissas(clipped, bits, mode), 1.0, low, high)
        rule = synapse.rule() if isinstance(synapse, loihi2_learning) else None
        mantissas = clipped if rule is None else stored_mantissas(clipped, bits, mode)
        wires = self.wires(
            inputs, index, mantissas, rounding, exponent=exponent, mode=mode, bits=bits, native=True, rule=rule
        )
        return wires, problems

    def _convolution(
        self, inputs: Inputs, index: int, synapse: loihi2_convolution
    ) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection with unchanged weights and a sum that may wrap."""
        part = inputs.program.projections[index]
        problems = [*_not_whole(part)]
        outside = np.flatnonzero(np.abs(part.weight) > 255)
        if outside.size:
            feature = f"weight = {part.weight[outside[0]]:g}"
            problems.append(refused(part, feature, "a weight has 8 bits and a sign", "scale it"))
        mantissas = np.rint(part.weight).astype(np.int32)
        return self.wires(inputs, index, mantissas, LOSSLESS, native=True, wraps=synapse.wraps), problems

    def _fitted(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Return weights m 2^e: with the largest exact exponent, else with the smallest exponent that fits."""
        part, mode = inputs.program.projections[index], inputs.sign_mode(index)
        low, high = SIGN_MODES[mode]
        grain = 1 + (mode == "mixed")
        lowest, highest = float(part.weight.min(initial=0.0)), float(part.weight.max(initial=0.0))
        fitting = [e for e in WEIGHT_EXPONENTS if lowest * 2.0**-e >= low and highest * 2.0**-e <= high - grain + 1]
        if not fitting:
            highest = high * 2.0 ** WEIGHT_EXPONENTS[-1]
            why = f"a mantissa in sign mode {mode} holds at most {high}, which is {highest:g} at the largest exponent"
            bad = part.weight[np.argmax(np.abs(part.weight))]
            problem = refused(part, f"weight = {bad:g}", why, "lower the weights and vth, or raise the payloads")
            fitting, problems = [WEIGHT_EXPONENTS[-1]], [problem]
        else:
            problems = []
        exact = [
            e for e in fitting if np.array_equal(part.weight, np.rint(part.weight * 2.0**-e / grain) * grain * 2.0**e)
        ]
        exponent = max(exact, default=fitting[0])
        step = np.full(1, 2.0**exponent)
        mantissas, rounding = round_weights(part.weight, step, step, low, high, grain, inputs.keeps(index))
        return self.wires(inputs, index, mantissas, rounding, step, exponent=exponent, mode=mode), problems

    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Quantise a population of `models` and the projections onto it; also return refusals and approximations."""
        if isinstance(inputs.part.model, GRADED):
            return self._graded(inputs)
        fixed, wires, problems = super().population(inputs, options)
        registers = {name: values for name, values in fixed.registers.items() if name != "refractory"}
        return replace(fixed, registers=registers), wires, [*problems, *_missing_features(inputs.part)]

    def _graded(self, inputs: Inputs) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Quantise neurons that send payloads: scale their parameters to units of the states."""
        part, p = inputs.part, inputs.part.parameters
        unit = 2.0 ** (p.get("spike_exp", np.zeros(1)) + p.get("state_exp", np.zeros(1)))
        scaled = {name: p[name] * unit for name in ("vth", "bias") if name in p}
        registers: dict[str, Ints] = {name: np.rint(values).astype(np.int64) for name, values in scaled.items()}
        registers |= {n: values.astype(np.int64) for n, values in p.items() if n not in (*scaled, "tau_minus")}
        problems: list[Problem] = []
        errors: list[Rounding] = []
        for name, values in scaled.items():
            if np.any(np.abs(values) > STATE_LIMIT):
                reason = f"a register holds at most {STATE_LIMIT}"
                problems.append(refused(part, f"{name} = {p[name].max():g}", reason, "lower it, or the exponents"))
            elif not np.array_equal(values, registers[name]):
                errors.append(
                    worst_rounding(name, "", p[name], registers[name] / unit, max(np.abs(p[name]).max(), 1.0))
                )
        initial = {name: np.rint(values).astype(np.int64) for name, values in part.initial.items()}
        fixed = FixedPopulation(part.name, part.model.name, registers, initial, rounding=tuple(errors))
        wires = {}
        for index in inputs.spikes:
            wires[index], more = self.native_projection(inputs, index)
            problems += more
        return fixed, wires, problems

    def give_rule(
        self, program: Program, chip: Chip, index: int, wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Set a three-factor rule; rules in registers are already set with the mantissas."""
        if program.projections[index].synapse.modulated:
            from neuro.chips.loihi_learning import give_rule

            yield from give_rule(program, chip, index, wires, options, from_target=True)
        else:
            yield from Arithmetic.give_rule(self, program, chip, index, wires, options)

    def lossless(self, wires: FixedProjection) -> str:
        """Return a hint that avoids mantissa bits dropped by the weight memory."""
        return f"use mantissas that are multiples of {1 << (WEIGHT_BITS - wires.bits + (wires.sign_mode == 'mixed'))}"

    def scale_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the present scale and exponents of a population and of the projections onto it."""
        return super().scale_options(cells, wires) if cells.kind == LIF else Options({})

    def filled(self, cells: FixedPopulation, arriving: Floats) -> float:
        """Return the largest |u| as a share of its 24 bits.

        The input of a step has 32 bits and cannot wrap before u.
        """
        return filled_current(cells, arriving)


LOIHI2 = Loihi2()
