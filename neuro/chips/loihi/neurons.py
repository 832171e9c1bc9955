"""Loihi 1's integers: how a leaky integrate-and-fire neuron and its weights become registers.

With S units of the voltage register per mV, P32 the potential in mV that 1 pA gives in a step, and P30 that of a
constant current (exact integration, `neuro.model.neurons.propagators`):

| described | on the chip |
| --- | --- |
| V_m - E_L | v = S (V_m - E_L) |
| I_syn, without what arrives in this step | u = S P32 I_syn / P11, with P11 = exp(-h / tau_syn) |
| weight of `iaf_psc_exp` | 64 m 2^e = S P32 w |
| weight of `iaf_psc_delta` | 64 m 2^e = S w, and du = 4095, so that u keeps nothing |
| tau_syn | (4096 - (du + 1)) / 4096 = exp(-h / tau_syn) |
| tau_m | (4096 - dv) / 4096 = exp(-h / tau_m) |
| V_m >= V_th | v > 64 vth, the largest 64 vth below S (V_th - E_L) |
| t_ref of R steps | refractory = R + 1 |
| delay of D steps | `iaf_psc_exp`: D, `iaf_psc_delta`: D - 1, see `neuro.chips.lag` |

Source: Davies et al., IEEE Micro 38(1):82, 2018; traces of lava 0.10, nengo-loihi 1.1 and Brian2Loihi 0.5.2. Where
these differ: each weight is shifted, not the sum of a step, and mantissas lose their lowest bits towards 0 (as in
Brian2Loihi, which reports a match with the chip); the sum of a step wraps as a two's complement of 22 bits, u and
u + bias as one of 24, and v is clipped (as in nengo-loihi, whose sums are held to the chip by its own tests).
"""

from __future__ import annotations

import numpy as np

from neuro.chips.loihi.limits import GENTLE, lacking, overflows
from neuro.chips.loihi.scale import Described, choose_scale, described, exponent_of, gained
from neuro.chips.loihi.words import (
    BIAS_EXPONENT,
    BIAS_MANTISSA,
    KIND,
    REFRACTORY_LIMIT,
    VTH_LIMIT,
    bounds,
    fixed_projection,
    word,
)
from neuro.chips.quantising import rounding
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Rounding
from neuro.chips.quantising.inputs import Inputs, Options, one_kernel, refused
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints


def population(inputs: Inputs, options: Options) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """A population of `iaf_psc_delta` or `iaf_psc_exp`, and the projections onto it.

    Args:
        inputs: the population and what arrives at it.
        options: scales set by hand.
    """
    part = inputs.part
    d, problems = described(inputs), lacking(inputs)
    volt = float(options.of("scales", part.name) or choose_scale(inputs, d))
    problems += overflows(part, d, volt)
    registers, errors = _registers(inputs, d, volt)
    ampere = () if not d.tau else (volt * d.gain / d.fade,) * 2
    initial = {name: np.rint(volt * values).astype(np.int64) for name, values in (("v", d.start), ("u", d.current))}
    fixed = FixedPopulation(
        part.name,
        KIND,
        registers,
        initial,
        volt,
        part.parameters["E_L"].copy(),
        ampere,
        volt * d.drift,
        errors,
    )
    found = {}
    for index in inputs.spikes:
        found[index], more = projection(inputs, index, d, volt, options)
        problems += more
    return fixed, found, problems


def _registers(inputs: Inputs, d: Described, volt: float) -> tuple[dict[str, Ints], tuple[Rounding, ...]]:
    """All registers of the compartments and what they differ in from the description."""
    p, h = inputs.part.parameters, inputs.program.resolution
    vth = threshold(volt * d.distance)
    du = np.full(1, 4095) if not d.tau else np.rint(4096.0 * (1.0 - d.fade)).astype(np.int64) - 1
    dv = np.rint(4096.0 * (1.0 - d.leak)).astype(np.int64)
    bias_exp, bias_mant = bias(volt * d.drift * p["I_e"], inputs.current * float(np.abs(volt * d.drift).max()))
    refractory = np.rint(p["t_ref"] / h).astype(np.int64) + 1
    errors = [_time_constant("tau_m", p["tau_m"], (4096 - dv) / 4096, h)]
    if d.tau:
        errors.append(_time_constant(d.tau, p[d.tau], (4095 - du) / 4096, h))
    got = p["E_L"] + 64.0 * (vth + 1) / volt
    errors.append(rounding.worst("V_th", "mV", p["V_th"], got, np.abs(d.distance)))
    if p["I_e"].any():
        got = (bias_mant << bias_exp) / (volt * d.drift)
        errors.append(rounding.worst("I_e", "pA", p["I_e"], got, float(np.abs(p["I_e"]).max())))
    errors.append(rounding.worst("t_ref", "ms", p["t_ref"], (refractory - 1) * h, 1.0))
    registers = {
        "du": np.clip(du, 0, 4095),
        "dv": np.clip(dv, 0, 4095),
        "vth": np.clip(vth, 0, VTH_LIMIT),
        "bias_mant": np.clip(bias_mant, -BIAS_MANTISSA - 1, BIAS_MANTISSA),
        "bias_exp": bias_exp,
        "refractory": np.clip(refractory, 1, REFRACTORY_LIMIT),
    }
    return {name: np.atleast_1d(values).astype(np.int64) for name, values in registers.items()}, tuple(errors)


def threshold(distance: Floats) -> Ints:
    """The register with which v > 64 vth says v >= distance where v is a multiple of 64: the step below."""
    steps = distance / 64.0
    nearest = np.rint(steps)
    exact = np.abs(steps - nearest) <= GENTLE
    register: Ints = np.where(exact, nearest, np.ceil(steps)).astype(np.int64) - 1
    return register


def bias(wanted: Floats, extra: float) -> tuple[Ints, Ints]:
    """Exponent and mantissas of a constant drive in units per step; `extra` is what generators may add."""
    largest = float(np.abs(wanted).max(initial=0.0)) + extra
    room = BIAS_MANTISSA - (extra > 0.0)  # the sum of two rounded ones may be one more
    exponent = min(int(np.ceil(np.log2(max(largest / room, 1.0)))), BIAS_EXPONENT)
    return np.full(1, exponent), np.rint(wanted / 2.0**exponent).astype(np.int64)


def _time_constant(name: str, tau: Floats, kept: Floats, h: float) -> Rounding:
    with np.errstate(divide="ignore", invalid="ignore"):
        got = np.where(kept >= 1.0, np.inf, -h / np.log(kept))
    return rounding.worst(name, "ms", tau, got, tau)


def projection(
    inputs: Inputs, index: int, d: Described, volt: float, options: Options
) -> tuple[FixedProjection, list[Problem]]:
    """The weights onto a population with a scale, as mantissas and an exponent."""
    part = inputs.program.projections[index]
    mode = inputs.sign_mode(index)
    low, high, grain = bounds(mode)
    problems = one_kernel(inputs, index, d.gain.size)
    exponent = options.of("exponents", part.name)
    if exponent is None:
        exponent = exponent_of(gained(inputs, index, d, few=True), volt, low, high, inputs.learns(index))
    step = 64.0 * 2.0**exponent / (volt * (d.gain if part.grid is None else d.gain[:1]))
    per_synapse = step if step.size == 1 else step[inputs.targets(index)]
    keep = exponent < 0 or inputs.keeps(index)
    mantissas, found = rounding.fitted(part.weight, per_synapse, per_synapse, low, high, grain, keep)
    if exponent < 0:  # the lowest bits of a mantissa are kept for learning, but not sent
        sent: Floats = word(mantissas, exponent, 8, False).astype(np.float64) * 2.0**-exponent
        found = rounding.judged(np.broadcast_to(part.weight, mantissas.shape), sent, per_synapse, low, high)
    if found.saturated > 0.0:
        beyond = rounding.beyond(part.weight, per_synapse, low, high)
        limit = low if beyond.weight < 0.0 else high
        problems.append(
            refused(
                part.origin,
                f"projection '{part.name}': weight = {beyond.weight:g}",
                f"a mantissa in sign mode {mode} holds at most {limit}, which is {limit * beyond.step:.6g} "
                f"at exponent {exponent} and {volt:.6g} units per mV",
                "use a larger exponent or a smaller scale, or leave them to be chosen",
            )
        )
    return fixed_projection(part.name, mantissas, exponent, mode, 8, per_synapse, inputs.lag(index), found), problems
