"""Loihi 1 as a family of chips, and how a leaky integrate-and-fire neuron becomes registers.

Any table with `arithmetic: loihi` computes so.

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
| delay of D steps | `iaf_psc_exp`: D, `iaf_psc_delta`: D - 1, see `neuro.chips.arrival_rule` |

Source: Davies et al., IEEE Micro 38(1):82, 2018; traces of lava 0.10, nengo-loihi 1.1 and Brian2Loihi 0.5.2. Where
these differ: each weight is shifted, not the sum of a step, and mantissas lose their lowest bits towards 0 (as in
Brian2Loihi, which reports a match with the chip); the sum of a step wraps as a two's complement of 22 bits, u and
u + bias as one of 24, and v is clipped (as in nengo-loihi, whose sums are held to the chip by its own tests).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.chips.arithmetic import Arithmetic, Option
from neuro.chips.loihi import words
from neuro.chips.loihi.learning import give_rules
from neuro.chips.loihi.words import (
    BIAS_EXPONENT,
    BIAS_LARGEST,
    BIAS_MANTISSA,
    DECAY_STEPS,
    KIND,
    REFRACTORY_LIMIT,
    U_LIMIT,
    V_LIMIT,
    VTH_LIMIT,
    Described,
    bounds,
    choose_scale,
    described,
    exponent_of,
    fixed_projection,
    gained,
    receives,
    word,
)
from neuro.chips.quantising import rounding
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Rounding
from neuro.chips.quantising.inputs import Inputs, Options, one_kernel, refused, too_long, too_short, value_at
from neuro.chips.quantising.options import is_positive, is_whole
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Population


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


GENTLE = 1e-6


def lacking(inputs: Inputs) -> list[Problem]:
    """All that a compartment lacks of a population, whatever its scale."""
    return [*_times(inputs), *_potentials(inputs), *_input(inputs)]


def _times(inputs: Inputs) -> Iterator[Problem]:
    """Time constants that 12-bit decays cannot hold, and refractory periods beyond their register."""
    part, h = inputs.part, inputs.program.resolution
    limit = -h / np.log1p(-1.0 / DECAY_STEPS)
    flows = dict(zip(("tau_syn_ex", "tau_syn_in"), receives(inputs), strict=True))
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in part.parameters and flows.get(name, True):
            yield from too_short(part, name, h)
            yield from too_long(part, name, h, limit, "a 12-bit decay", name == "tau_m")
    at = int(np.argmax(part.parameters["t_ref"]))
    steps = round(value_at(part, "t_ref", at) / h)
    if steps + 1 > REFRACTORY_LIMIT:
        yield refused(
            part.origin,
            f"population '{part.name}': t_ref = {value_at(part, 't_ref', at):g} ms",
            f"it is {steps} steps, and the refractory register holds at most {REFRACTORY_LIMIT - 1}",
            f"use at most {(REFRACTORY_LIMIT - 1) * h:g} ms, or a coarser resolution",
        )


def _potentials(inputs: Inputs) -> Iterator[Problem]:
    """Potentials that a compartment cannot tell apart, or has not."""
    part, p = inputs.part, inputs.part.parameters
    message = f"population '{part.name}'"
    off = np.flatnonzero(np.broadcast_to(p["V_reset"] != p["E_L"], part.size))
    if off.size:
        v_reset, e_l = value_at(part, "V_reset", off[0]), value_at(part, "E_L", off[0])
        yield refused(
            part.origin,
            f"{message}: V_reset = {v_reset:g} mV",
            f"a spike sets the voltage register to 0, which is E_L = {e_l:g} mV",
            f"set V_reset to {e_l:g}, or run on spinnaker",
        )
    below = np.flatnonzero(np.broadcast_to(p["V_th"] <= p["E_L"], part.size))
    if below.size:
        v_th, e_l = value_at(part, "V_th", below[0]), value_at(part, "E_L", below[0])
        yield refused(
            part.origin,
            f"{message}: V_th = {v_th:g} mV",
            f"the threshold register is unsigned, so V_th must be above E_L = {e_l:g} mV",
            "raise V_th or lower E_L, or run on spinnaker",
        )
    if "V_min" in p and np.isfinite(p["V_min"]).any():
        what = f"{message}: V_min = {p['V_min'].max():g} mV"
        yield refused(part.origin, what, "a compartment has no lowest potential", "leave V_min out")


def _input(inputs: Inputs) -> Iterator[Problem]:
    """Input that a compartment does not keep apart, or not keep."""
    part, p = inputs.part, inputs.part.parameters
    message = f"population '{part.name}'"
    if p.get("refractory_input", np.zeros(1)).any():
        what = f"{message}: refractory_input"
        yield refused(part.origin, what, "a compartment loses input while it is refractory", "leave it out")
    if "tau_syn_ex" not in p or not all(receives(inputs)):
        return
    apart = np.flatnonzero(np.broadcast_to(p["tau_syn_ex"] != p["tau_syn_in"], part.size))
    if apart.size:
        ex, inh = value_at(part, "tau_syn_ex", apart[0]), value_at(part, "tau_syn_in", apart[0])
        yield refused(
            part.origin,
            f"{message}: tau_syn_ex = {ex:g} ms and tau_syn_in = {inh:g} ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        )


def overflows(part: Population, d: Described, volt: float) -> Iterator[Problem]:
    """Registers that a scale overflows: one set by hand, or one kept while parameters change."""
    for what, largest, limit, name in (
        ("V_th - E_L", float(d.distance.max()) / 64.0, VTH_LIMIT, "the 17-bit threshold register"),
        ("the constant current", float(d.drive.max()), BIAS_LARGEST, "the bias register, 4095 x 2^7,"),
        ("V_m at step 0", float(np.abs(d.start).max()), V_LIMIT, "the 24-bit voltage register"),
        ("I_syn at step 0", float(np.abs(d.current).max()), U_LIMIT - 1, "the 24-bit current register"),
    ):
        need = volt * largest
        if need > limit * (1.0 + GENTLE):
            yield refused(
                part.origin,
                f"population '{part.name}': {what} needs {need:.6g} at {volt:.6g} units per mV",
                f"{name} holds at most {limit}",
                f"set its scale to at most {volt * limit / need:.6g}",
            )


_OPTIONS = (
    Option("scales", "populations", is_positive, "units per mV, a number > 0"),
    Option(
        "exponents",
        "projections",
        lambda value: is_whole(value, words.WEIGHT_EXPONENTS),
        "a weight exponent, a whole number from -8 to 7",
    ),
    Option("signals", "projections", is_positive, "the largest dopamine that the signal sets in 1/ms, a number > 0"),
)


def _kept_options(cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
    return Options({"scales": {cells.name: cells.volt}, "exponents": {part.name: part.exponent for part in wires}})


def _told_scale(cells: FixedPopulation, wires: FixedProjection) -> str:
    return f"exponent {wires.exponent}"


def _filled(cells: FixedPopulation, arriving: Floats) -> float:
    """Of the 22 bits of a step's input, or of the 24 of u, which also keeps what came before."""
    if "du" not in cells.registers:
        return 0.0
    keep = (4095 - cells.registers["du"]) / 4096
    u, most = np.zeros(arriving[:, 0].shape), 64.0 * float(np.abs(arriving).max(initial=0.0)) / words.INPUT_LIMIT
    for step in range(arriving.shape[1]):
        u = keep * u + 64.0 * arriving[:, step]
        most = max(most, float(np.abs(u).max(initial=0.0)) / words.U_LIMIT)
    return most


LOIHI = Arithmetic(
    name="loihi",
    title="Loihi",
    models=(iaf_psc_exp, iaf_psc_delta),
    options=_OPTIONS,
    state_limit=words.V_LIMIT,
    register_of_one=words.REGISTER_OF_ONE,
    one_bit=True,
    in_rows=False,
    multicast=False,
    population=population,
    native=words.native,
    native_projection=words.native_projection,
    relay_projection=words.relay_projection,
    give_rules=give_rules,
    kept_options=_kept_options,
    filled=_filled,
    told_scale=_told_scale,
    lossless=words.lossless,
    notes=lambda program: iter(()),
)
