"""Loihi 2 as a family of chips: payloads, sums that are shifted as a whole, and neurons in registers.

Any table with `arithmetic: loihi2` computes so.

| described | on the chip |
| --- | --- |
| weight of `loihi2_static` | the mantissa; bits that the memory does not keep are dropped downwards |
| weight of `static` onto neurons in whole numbers | m 2^e: with the largest e that is exact, else the nearest |
| `iaf_psc_exp`, `iaf_psc_delta` | as on Loihi 1 (`neuro.chips.loihi.arithmetic`); without a refractory period |
| `sigma_delta` and such | vth and bias in units of the states, 2^-(spike_exp + state_exp) |

What differs from Loihi 1: mixed mantissas are rounded down, not towards 0; a negative exponent shifts the sum of a
step, not each weight; a step's input has 32 bits; there is no refractory period. Source: lava 0.10.0, `src/lava/proc`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.loihi import arithmetic as loihi1
from neuro.chips.quantising import rounding
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Rounding, WeightRounding, Words
from neuro.chips.quantising.inputs import (
    Inputs,
    Options,
    approximated,
    falls,
    has_lowest,
    refuse_rules,
    refused,
    value_at,
)
from neuro.model.neurons import (
    delta_encoder,
    graded_product,
    graded_vector,
    iaf_psc_delta,
    iaf_psc_exp,
    sigma_decoder,
    sigma_delta,
)
from neuro.model.neurons.base import Model, Neuron
from neuro.model.synapses import loihi2_convolution, loihi2_learning, loihi2_static
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Population, Projection

LIF = "loihi2_lif"
GRADED = (sigma_delta, delta_encoder, sigma_decoder, graded_vector, graded_product)
"""Models in whole numbers, whose parameters are registers on a scale of their own."""

STATE_LIMIT = 2**31 - 1
WEIGHT_EXPONENTS = range(-8, 8)
WEIGHT_BITS = 8
REGISTER_OF_ONE = 0
LOSSLESS = WeightRounding(0.0, 0.0, 0.0, 0.0)
SIGN_MODES = {"mixed": (-256, 255), "excitatory": (0, 255), "inhibitory": (-255, 0)}
"""The smallest and the largest mantissa of each."""


def dropped(mantissas: Words, bits: int, mode: str) -> Words:
    """Mantissas as the weight memory keeps them: clipped, and without the lowest bits, rounded down."""
    low, high = SIGN_MODES[mode]
    lost = WEIGHT_BITS - bits + (mode == "mixed")
    kept = np.clip(mantissas, low, high)
    # Inhibitory mantissas are magnitudes, so rounding down is towards 0 there.
    words: Words = -(-kept >> lost << lost) if mode == "inhibitory" else kept >> lost << lost
    return words.astype(np.int32)


def words_of(fixed: FixedProjection, mantissas: Words) -> Words:
    """What a spike of payload 1 adds to the sum of a step: a negative exponent shifts the sum."""
    if not fixed.sign_mode:
        return mantissas
    # What has been learnt keeps its lowest bits, as in lava.
    kept = mantissas if fixed.rule is not None else dropped(mantissas, fixed.bits, fixed.sign_mode)
    return kept << max(fixed.exponent, 0)


def projection(inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
    """A projection onto neurons in registers, by its synapse model."""
    part = inputs.program.projections[index]
    if isinstance(part.synapse, (loihi2_static, loihi2_learning)):
        fixed, problems = _in_mantissas(inputs, index, part.synapse)
    elif isinstance(part.synapse, loihi2_convolution):
        fixed, problems = _convolution(inputs, index, part.synapse)
    else:
        fixed, problems = _fitted(inputs, index)
    second = has_two_inputs(inputs.part.model) and part.receptor is not None and part.receptor.index == 1
    return replace(fixed, receptor=int(second)), problems


def has_two_inputs(model: Model) -> bool:
    """Whether the synapses onto a neuron name one of two inputs."""
    return isinstance(model, Neuron) and model.receptors == 2 and not model.signed


def _in_mantissas(
    inputs: Inputs, index: int, synapse: loihi2_static | loihi2_learning
) -> tuple[FixedProjection, list[Problem]]:
    """Weights that are mantissas."""
    part = inputs.program.projections[index]
    exponent, bits, mode = synapse.weight_exp, synapse.num_weight_bits, synapse.sign_mode
    low, high = SIGN_MODES[mode]
    problems = [*_not_whole(part)]
    beyond = np.flatnonzero((part.weight < low) | (part.weight > high))
    if beyond.size:
        why = f"a mantissa in sign mode {mode} is clipped to {low}..{high}"
        problems.append(approximated(part, f"weight = {part.weight[beyond[0]]:g}", why, "raise weight_exp"))
    asked = np.clip(np.rint(part.weight), low, high).astype(np.int32)
    found = rounding.judged(asked.astype(np.float64), dropped(asked, bits, mode), 1.0, low, high)
    rule = synapse.rule() if isinstance(synapse, loihi2_learning) else None
    mantissas = asked if rule is None else dropped(asked, bits, mode)
    fixed = loihi1.fixed_projection(part.name, mantissas, exponent, mode, bits, np.ones(1), inputs.lag(index), found)
    return _by_own_rules(replace(fixed, rule=rule), native=True), problems


def _convolution(inputs: Inputs, index: int, synapse: loihi2_convolution) -> tuple[FixedProjection, list[Problem]]:
    """Weights as they are, whose sum may wrap."""
    part = inputs.program.projections[index]
    problems = [*_not_whole(part)]
    beyond = np.flatnonzero(np.abs(part.weight) > 255)
    if beyond.size:
        found = f"weight = {part.weight[beyond[0]]:g}"
        problems.append(refused(part, found, "a weight has 8 bits and a sign", "scale it"))
    asked = np.rint(part.weight).astype(np.int32)
    fixed = loihi1.fixed_projection(part.name, asked, 0, "mixed", WEIGHT_BITS, np.ones(1), inputs.lag(index), LOSSLESS)
    return _by_own_rules(replace(fixed, sign_mode="", wraps=synapse.wraps), native=True), problems


def _not_whole(part: Projection) -> Iterator[Problem]:
    bad = np.flatnonzero(part.weight != np.rint(part.weight))
    if bad.size:
        why = "a mantissa is a whole number"
        yield refused(part, f"weight = {part.weight[bad[0]]:g}", why, "raise weight_exp and lower the mantissas")


def _fitted(inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
    """Weights as the description has them: m 2^e with the largest exponent that loses nothing, else the smallest."""
    part, mode = inputs.program.projections[index], inputs.sign_mode(index)
    low, high = SIGN_MODES[mode]
    grain = 1 + (mode == "mixed")
    fitting = [e for e in WEIGHT_EXPONENTS if _fits(part.weight * 2.0**-e, low, high - grain + 1)]
    if not fitting:
        most = high * 2.0 ** WEIGHT_EXPONENTS[-1]
        why = f"a mantissa in sign mode {mode} holds at most {high}, which is {most:g} at the largest exponent"
        bad = part.weight[np.argmax(np.abs(part.weight))]
        problem = refused(part, f"weight = {bad:g}", why, "lower the weights and vth, or raise the payloads")
        fitting, problems = [WEIGHT_EXPONENTS[-1]], [problem]
    else:
        problems = []
    exact = [e for e in fitting if np.array_equal(part.weight, np.rint(part.weight * 2.0**-e / grain) * grain * 2.0**e)]
    exponent = max(exact, default=fitting[0])
    step = np.full(1, 2.0**exponent)
    mantissas, found = rounding.fitted(part.weight, step, step, low, high, grain, inputs.keeps(index))
    fixed = loihi1.fixed_projection(part.name, mantissas, exponent, mode, WEIGHT_BITS, step, inputs.lag(index), found)
    return _by_own_rules(fixed), problems


def _fits(mantissas: Floats, low: int, high: int) -> bool:
    return float(mantissas.min(initial=0.0)) >= low and float(mantissas.max(initial=0.0)) <= high


def _by_own_rules(fixed: FixedProjection, native: bool = False) -> FixedProjection:
    """A projection of Loihi 1 with the bounds, steps and words of Loihi 2; `native` if its weights are mantissas."""
    low, high = SIGN_MODES.get(fixed.sign_mode, (-255, 255))
    grain = 1 if native else 1 << (WEIGHT_BITS - fixed.bits + (fixed.sign_mode == "mixed"))
    fixed = replace(fixed, low=low, high=high, grain=grain, native=native, shift=max(-fixed.exponent, 0))
    return replace(fixed, words=words_of(fixed, fixed.mantissas))


def native(part: Population) -> FixedPopulation:
    """A neuron of Loihi 2: its parameters are the registers, and its model's name is its step."""
    fixed = loihi1.native(part)
    if "cos_decay" in fixed.registers:
        vth = np.trunc(part.parameters["vth"] * 2.0 ** part.parameters["state_exp"]).astype(np.int64)
        fixed = replace(fixed, registers=fixed.registers | {"vth": vth})
    return replace(fixed, kind=part.model.name)


def population(inputs: Inputs, options: Options) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """A population of `models`, and the projections onto it."""
    if isinstance(inputs.part.model, GRADED):
        return _graded(inputs)
    fixed, found, problems = loihi1.population(inputs, options)
    wires = {index: _by_own_rules(each) for index, each in found.items()}
    registers = {name: values for name, values in fixed.registers.items() if name != "refractory"}
    return replace(fixed, kind=LIF, registers=registers), wires, [*problems, *_without_reference(inputs.part)]


def _without_reference(part: Population) -> Iterator[Problem]:
    """What lava's fixed-point neuron has not."""
    if np.any(part.parameters["t_ref"] > 0.0):
        at = int(np.argmax(part.parameters["t_ref"]))
        what, why = (
            f"t_ref = {value_at(part, 't_ref', at):g} ms",
            "no fixed-point neuron of Loihi 2 has a refractory period",
        )
        yield refused(part, what, why, "give it t_ref: 0, or run on loihi")
    if falls(part).any() or has_lowest(part):
        why = "no fixed-point neuron of Loihi 2 resets by subtraction or has a lowest potential"
        yield refused(part, part.model.name, why, "leave it out, or run on loihi")


def _graded(inputs: Inputs) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """Neurons that send payloads: their parameters in units of the states."""
    part, p = inputs.part, inputs.part.parameters
    unit = 2.0 ** (p.get("spike_exp", np.zeros(1)) + p.get("state_exp", np.zeros(1)))
    wanted = {name: p[name] * unit for name in ("vth", "bias") if name in p}
    registers: dict[str, Ints] = {name: np.rint(values).astype(np.int64) for name, values in wanted.items()}
    registers |= {n: values.astype(np.int64) for n, values in p.items() if n not in (*wanted, "tau_minus")}
    problems: list[Problem] = []
    errors: list[Rounding] = []
    for name, values in wanted.items():
        if np.any(np.abs(values) > STATE_LIMIT):
            why = f"a register holds at most {STATE_LIMIT}"
            problems.append(refused(part, f"{name} = {p[name].max():g}", why, "lower it, or the exponents"))
        elif not np.array_equal(values, registers[name]):
            errors.append(rounding.worst(name, "", p[name], registers[name] / unit, max(np.abs(p[name]).max(), 1.0)))
    initial = {name: np.rint(values).astype(np.int64) for name, values in part.initial.items()}
    fixed = FixedPopulation(part.name, part.model.name, registers, initial, rounding=tuple(errors))
    found = {}
    for index in inputs.spikes:
        found[index], more = projection(inputs, index)
        problems += more
    return fixed, found, problems


def relay_projection(inputs: Inputs, index: int) -> FixedProjection:
    """A projection onto parrots: every spike counts, whatever its weight."""
    return _by_own_rules(loihi1.relay_projection(inputs, index))


def lossless(fixed: FixedProjection) -> str:
    """How mantissas that a user sets lose nothing to the bits of the memory."""
    return f"use mantissas that are multiples of {1 << (WEIGHT_BITS - fixed.bits + (fixed.sign_mode == 'mixed'))}"


def _kept_options(cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
    return loihi1.LOIHI.kept_options(cells, wires) if cells.kind == LIF else Options({})


LOIHI2 = Arithmetic(
    name="loihi2",
    title="Loihi 2",
    models=(iaf_psc_exp, iaf_psc_delta, *GRADED),
    options=loihi1.SCALING,
    state_limit=STATE_LIMIT,
    register_of_one=REGISTER_OF_ONE,
    one_bit=False,
    graded=True,
    in_rows=False,
    keeps_kernels=True,
    multicast=False,
    population=population,
    native=native,
    native_projection=projection,
    relay_projection=relay_projection,
    give_rules=refuse_rules,
    kept_options=_kept_options,
    filled=loihi1.filled_current,
    told_scale=loihi1.told_scale,
    lossless=lossless,
    notes=lambda program: iter(()),
)
