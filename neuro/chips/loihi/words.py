"""Loihi 1's registers: their limits, weight words, and parts of a network that are described in them.

Source of the limits: Davies et al., IEEE Micro 38(1):82, 2018; nengo-loihi 1.1; Brian2Loihi 0.5.2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neuro.chips.lag import register
from neuro.chips.quantising import rounding
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, WeightRounding, Words
from neuro.chips.quantising.inputs import Inputs, refused
from neuro.program.backend import Problem
from neuro.program.program import Floats, Population

KIND = "loihi_lif"
"""The step that compartments take, see `FixedPopulation.kind`."""

REGISTER_OF_ONE = 0
"""What the delay register holds of a spike that acts in the step after its emission."""

V_LIMIT = 2**23 - 1
"""The largest v, and the largest initial u, in registers."""

U_LIMIT = 2**23
INPUT_LIMIT = 2**21
"""What arrives in one step wraps as a two's complement of 22 bits (nengo-loihi 1.1)."""

VTH_LIMIT = 2**17 - 1
BIAS_MANTISSA = 4095
BIAS_EXPONENT = 7
WORD_LIMIT = 2**15 - 1
"""A spike adds at most 64 times this, 2^21 - 64."""

WEIGHT_EXPONENTS = range(-8, 8)
REFRACTORY_LIMIT = 64
DECAY_STEPS = 4096
LOSSLESS = WeightRounding(0.0, 0.0, 0.0, 0.0)


def word(mantissas: Words, exponent: int, bits: int, mixed: bool) -> Words:
    """What a spike adds, in units of 64: floor(m 2^exponent), clipped, after the lowest bits of m are dropped."""
    kept = dropped(mantissas, bits, mixed)
    shifted = kept << exponent if exponent >= 0 else kept >> -exponent
    clipped: Words = np.clip(shifted, -WORD_LIMIT, WORD_LIMIT).astype(np.int32)
    return clipped


def dropped(mantissas: Words, bits: int, mixed: bool) -> Words:
    """Mantissas without the bits that the weight memory does not keep."""
    grain = grain_of(bits, mixed)
    kept: Words = np.sign(mantissas) * (np.abs(mantissas) // grain * grain)
    return kept


def grain_of(bits: int, mixed: bool) -> int:
    """The step between two mantissas."""
    return 1 << (8 - bits + mixed)


def bounds(sign_mode: str, bits: int = 8) -> tuple[int, int, int]:
    """The smallest and the largest mantissa of a sign mode, and the step between two."""
    grain = grain_of(bits, sign_mode == "mixed")
    low, high = {"mixed": (-256, 254), "excitatory": (0, 255), "inhibitory": (-255, 0)}[sign_mode]
    return -(-low // grain) * grain if low > -256 else -256, high // grain * grain, grain


def native(part: Population) -> FixedPopulation:
    """A `loihi_lif`: its parameters are the registers."""
    registers = {name: values.astype(np.int64) for name, values in part.parameters.items() if name != "tau_minus"}
    initial = {name: values.astype(np.int64) for name, values in part.initial.items()}
    return FixedPopulation(part.name, KIND, registers, initial)


def native_projection(inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
    """A projection onto a `loihi_lif`: its weights are mantissas."""
    part = inputs.program.projections[index]
    told = part.synapse.parameters()
    exponent, bits, mode = (
        told.get("weight_exp", 0),
        told.get("num_weight_bits", 8),
        told.get("sign_mode", "mixed"),
    )
    low, high, _ = bounds(mode, bits)
    first, last, _ = bounds(mode)
    problems = []
    bad = np.flatnonzero((part.weight != np.rint(part.weight)) | (part.weight < first) | (part.weight > last))
    if bad.size:
        value = part.weight[bad[0]]
        what = f"projection '{part.name}': weight = {value:g}"
        why = f"a mantissa in sign mode {mode} is a whole number from {first} to {last}"
        problems.append(refused(part.origin, what, why, "raise weight_exp and lower the mantissas"))
    asked: Words = np.clip(np.rint(part.weight), first, last).astype(np.int32)
    sent: Floats = word(asked, exponent, bits, mode == "mixed") * 2.0**-exponent
    found = rounding.judged(asked.astype(np.float64), sent, 1.0, low, high)
    fixed = fixed_projection(part.name, asked, exponent, mode, bits, np.ones(1), inputs.lag(index), found)
    return replace(fixed, low=first, high=last, grain=1, native=True), problems


def fixed_projection(
    name: str,
    mantissas: Words,
    exponent: int,
    mode: str,
    bits: int,
    step: Floats,
    lag: Words,
    rounding: WeightRounding,
) -> FixedProjection:
    """A projection by its mantissas and the steps after which its spikes act."""
    low, high, grain = bounds(mode, bits)
    return FixedProjection(
        name=name,
        mantissas=mantissas,
        words=word(mantissas, exponent, bits, mode == "mixed"),
        low=low,
        high=high,
        grain=grain,
        exponent=exponent,
        sign_mode=mode,
        bits=bits,
        step=step,
        step_below=step,
        lag=lag,
        delay=register(lag, REGISTER_OF_ONE),
        rounding=rounding,
    )


def relay_projection(inputs: Inputs, index: int) -> FixedProjection:
    """A projection onto parrots: every spike counts, whatever its weight."""
    part = inputs.program.projections[index]
    ones: Words = np.ones(1, dtype=np.int32)
    return fixed_projection(part.name, ones, 0, "excitatory", 8, part.weight.copy(), inputs.lag(index), LOSSLESS)


def lossless(fixed: FixedProjection) -> str:
    """How mantissas that are set by hand lose nothing to the shift of the exponent and to the bits of the memory."""
    grain = max(grain_of(fixed.bits, fixed.sign_mode == "mixed"), 2 ** max(0, -fixed.exponent))
    ways = [f"use mantissas that are multiples of {grain}"] if grain <= fixed.high else []
    ways += ["use a larger weight_exp"] if fixed.exponent < 0 else []
    return ", or ".join(ways)
