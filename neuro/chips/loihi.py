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
| delay of D steps | `iaf_psc_exp`: D, `iaf_psc_delta`: D - 1, see `neuro.chips.inputs` |

Source: Davies et al., IEEE Micro 38(1):82, 2018; traces of lava 0.10, nengo-loihi 1.1 and Brian2Loihi 0.5.2. Where
these differ: each weight is shifted, not the sum of a step, and mantissas lose their lowest bits towards 0 (as in
Brian2Loihi, which reports a match with the chip); the sum of a step wraps as a two's complement of 22 bits, u and
u + bias as one of 24, and v is clipped (as in nengo-loihi, whose sums are held to the chip by its own tests).

The registers' limits, weight words and parts that are described in registers come first. Their source is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetic import Arithmetic, Option, Projections, is_positive, is_whole
from neuro.chips.description import Chip
from neuro.chips.fixed import (
    FixedPopulation,
    FixedProjection,
    Rounding,
    WeightRounding,
    Words,
    farthest_weight,
    judge_weights,
    round_weights,
    sampled,
    scale_errors,
    thinned,
    worst_rounding,
)
from neuro.chips.inputs import (
    Inputs,
    Options,
    acts_late,
    approximated,
    constants_of,
    converging,
    fall_register,
    falls,
    has_lowest,
    of_falls,
    of_lowest,
    one_kernel,
    refused,
    register,
    too_long,
    too_short,
    value_at,
)
from neuro.core.errors import ModelError
from neuro.model.neurons import Neuron, iaf_psc_delta, iaf_psc_exp
from neuro.model.synapses import static
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Population, Program

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
WEIGHT_BITS = 8
LOSSLESS = WeightRounding(0.0, 0.0, 0.0, 0.0)
_ONE = np.ones(1)


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


COMFORT = 2.0**21
"""The threshold that automatic scales stay below: a step's input may be as large, and u four times so."""

FINE = 2.0**17
"""Units that a scale with room keeps for the threshold; half as many, the power of two below, are 1024 steps of 64."""

BIAS_LARGEST = BIAS_MANTISSA << BIAS_EXPONENT
SPARE = 1.0 - 2.0**-7
"""Room for the rounding of mantissas: of the largest word, and of a bias that is the sum of two."""


@dataclass(frozen=True, slots=True, eq=False)
class Described:
    """What a population of `iaf_psc_delta` or `iaf_psc_exp` is, before its scale is chosen; one entry or one a neuron.

    Attributes:
        gain: mV in the step of arrival per unit of weight.
        distance: V_th - E_L in mV.
        leak: share of V - E_L left after a step.
        fade: share of the current left after a step; 0 for delta input.
        drive: mV in a step by the constant current, and by the largest that generators add.
        drift: mV in a step per pA of constant current.
        bias: mV in a step by the constant current.
        start: V_m - E_L in mV at step 0.
        current: mV in a step by the synaptic current at step 0, taken one step back.
        tau: the parameter that `fade` follows from, "" for delta input.
    """

    gain: Floats
    distance: Floats
    leak: Floats
    fade: Floats
    drive: Floats
    drift: Floats
    bias: Floats
    start: Floats
    current: Floats
    tau: str


def described(inputs: Inputs) -> Described:
    """Constants of the exact integration, and the states at step 0."""
    part, p = inputs.part, inputs.part.parameters
    c = constants_of(part, inputs.program.resolution)
    tau = ""
    if isinstance(part.model, iaf_psc_delta):
        from neuro.model.neurons.potentials import I_E, P30, P33

        gain, fade, current = np.ones(1), np.zeros(1), np.zeros(1)
    else:
        from neuro.model.neurons.currents import I_E, P11_EX, P11_IN, P30, P32_EX, P32_IN, P33

        tau = "tau_syn_in" if only_inhibitory(inputs) else "tau_syn_ex"
        gain, fade = (c[:, P32_IN], c[:, P11_IN]) if tau == "tau_syn_in" else (c[:, P32_EX], c[:, P11_EX])
        gain = np.where(np.isfinite(gain) & (gain > 0.0), gain, 1.0)  # always so where the time constants are accepted
        current = (part.initial["I_syn_ex"] + part.initial["I_syn_in"]) * gain
        current = current / fade if acts_late(part.model) else current
    drift = c[:, P30]
    bias = np.unique(c[:, I_E] * drift)
    drive = np.abs(c[:, I_E] * drift) + inputs.current * np.abs(drift)
    start = part.initial["V_m"] - p["E_L"]
    return Described(gain, p["V_th"] - p["E_L"], c[:, P33], fade, drive, drift, bias, start, current, tau)


def receives(inputs: Inputs) -> tuple[bool, bool]:
    """Whether an excitatory and an inhibitory current flow, from spikes or at step 0."""
    initial = inputs.part.initial
    return (
        inputs.high > 0.0 or bool(np.any(initial.get("I_syn_ex", 0.0))),
        inputs.low < 0.0 or bool(np.any(initial.get("I_syn_in", 0.0))),
    )


def only_inhibitory(inputs: Inputs) -> bool:
    """Whether the one current of a compartment is the inhibitory one."""
    return receives(inputs) == (False, True)


def ceilings(d: Described) -> tuple[float, float]:
    """The largest scale that is comfortable, and the largest that all registers but those of weights allow."""
    limits = ((BIAS_LARGEST * SPARE, d.drive), (V_LIMIT, d.start), (U_LIMIT - 1, d.current))
    others = min(limit / _largest(values) for limit, values in limits)
    distance = _largest(d.distance)
    return min(COMFORT / distance, others), min(64.0 * VTH_LIMIT / distance, others)


def calm(inputs: Inputs, d: Described) -> tuple[float, float]:
    """The scale at which all synapses of a neuron may be active in every step and neither their sum nor u wraps.

    Returns:
        it, and the same made so large that the threshold and the truncation of decays are off by no more than 0.1 %.
    """
    total = 0.0
    for sign in (1.0, -1.0):
        arriving = np.zeros(inputs.part.size)
        for index in inputs.spikes:
            low, high = inputs.bounds(index)
            extreme = np.full(1, high if sign > 0.0 else low)
            arriving += converging(inputs, index, sign, extreme if inputs.learns(index) else None)
        total = max(total, _largest(arriving) * float(d.gain.max()))
    summed = total / (1.0 - float(min(d.fade.max(), 1.0 - 2.0**-12)))
    room = min((INPUT_LIMIT - 1) / total, (U_LIMIT - 1) / summed) * SPARE
    lost = 1.0 - np.concatenate((d.leak, d.fade))
    fine = max(FINE, 1000.0 / float(lost[lost > 0.0].min(initial=1.0)))
    return room, max(room, fine / _largest(d.distance))


def _largest(values: Floats) -> float:
    """The largest magnitude; a tiny one in place of 0, so that it bounds nothing."""
    return max(float(np.abs(values).max(initial=0.0)), 1e-200)


def choose_scale(inputs: Inputs, d: Described) -> float:
    """Units per mV: the scale that loses least of the weights, as large as threshold, bias and weights allow.

    Candidates let the largest weight of the strongest projection have the mantissas 129..256; powers of two change no
    mantissa, so the largest allowed one is taken. Where weights learn in pairs, the largest that they may reach is the
    largest mantissa, at which the chip stops, too. Of two that lose the same, the one that keeps sums from wrapping.
    """
    cap, hard = ceilings(d)
    values = [(index, sampled(gained(inputs, index, d, few=True))) for index in inputs.spikes]
    values = [(index, v) for index, v in values if np.any(v)]
    if not values:
        return float(2.0 ** np.floor(np.log2(cap)))
    strongest = max(_largest(v) for _, v in values)
    word_cap = 64.0 * WORD_LIMIT / strongest * SPARE
    cap, hard = min(cap, word_cap), min(hard, word_cap)
    largest, lost = _search(inputs, d, values, cap, hard, np.inf)
    room, quiet = calm(inputs, d)
    if quiet < cap:
        smaller, lost_too = _search(inputs, d, values, quiet, hard, room)
        if lost_too <= lost * (1.0 + 1e-9):
            return smaller
    return largest


def _search(
    inputs: Inputs, d: Described, values: list[tuple[int, Floats]], cap: float, hard: float, room: float
) -> tuple[float, float]:
    """The largest of the scales up to `cap` that lose least, at most `hard`; and what it loses.

    Of those that lose the same of the weights the ones that lose least of the constant drive and the threshold; where
    all of these are above `room`, the smallest.
    """
    pairs = [inputs.program.projections[index].synapse.learns == "pairs" for index, _ in values]
    plastic = [each for each, learns in zip(values, pairs, strict=True) if learns and inputs.learns(each[0])]
    peak = max(_largest(v) for _, v in plastic or values)
    mantissas = np.array([255.0]) if plastic else np.arange(256.0, 128.0, -1.0)
    base = 64.0 * mantissas / peak  # scale at exponent 0
    wanted = np.where(base > cap, np.minimum(base, hard), cap)
    tried = base * 2.0 ** np.floor(np.log2(wanted / base) + 1e-12)
    tried = tried[tried <= hard * (1.0 + 1e-12)]
    lost = np.zeros(tried.size)
    for index, v in values:
        low, high, grain = bounds(inputs.sign_mode(index))
        steps = np.array([64.0 * 2.0 ** exponent_of(v, s, low, high, inputs.learns(index)) / s for s in tried])
        lost += scale_errors(v, steps, low, high, grain)
    least = float(lost.min())
    equal = tried[lost <= least * (1.0 + 1e-9)]
    rest = _misfit(equal, d)
    best = equal[rest <= rest.min()]
    roomy = best[best <= room]
    return float(roomy.max() if roomy.size else best.min()), least


def _misfit(volts: Floats, d: Described) -> Floats:
    """What the constant drive and the threshold lose at some scales, relative to them.

    It matters where nothing leaks and so nothing else is rounded; elsewhere all scales are alike.
    """
    if np.any(d.leak < 1.0):
        return np.zeros(volts.size)
    drive = volts[:, None] * d.bias[None, :]
    largest = np.maximum(np.abs(drive).max(axis=1, keepdims=True, initial=0.0), 1.0)
    grain = 2.0 ** np.maximum(0.0, np.ceil(np.log2(largest / BIAS_MANTISSA)))
    lost: Floats = np.abs(np.rint(drive / grain) * grain - drive).max(axis=1, initial=0.0) / largest[:, 0]
    steps = volts[:, None] * d.distance[None, :] / 64.0
    lost += (np.abs(np.rint(steps) - steps) / np.maximum(steps, 1.0)).max(axis=1)
    lost[lost < 1e-12] = 0.0
    return lost


def gained(inputs: Inputs, index: int, d: Described, few: bool = False) -> Floats:
    """What a spike along each synapse does to V_m in mV; of plastic synapses also what it may come to do.

    Args:
        inputs: the population.
        index: of the projection.
        d: what the population is.
        few: of many synapses the largest, the smallest and others evenly between are enough.
    """
    weight, part = inputs.range_of(index), inputs.program.projections[index]
    thin = thinned if few else np.asarray
    if d.gain.size == 1:
        return thin(weight) * float(d.gain[0])
    if part.weight.size == 1 or part.grid is not None:
        return thin(np.concatenate((weight * d.gain.min(), weight * d.gain.max())))
    own = part.weight * d.gain[inputs.targets(index)]
    return thin(np.concatenate((own, weight[part.weight.size :] * d.gain.max())))


def exponent_of(values: Floats, scale: float, low: int, high: int, plastic: bool) -> int:
    """The smallest exponent with which all values fit; below 0 only where learning needs finer steps."""
    up = float(values.max(initial=0.0)) * scale / 64.0 / max(high, 1)
    down = float(-values.min(initial=0.0)) * scale / 64.0 / max(-low, 1)
    need = max(up, down)
    exponent = int(np.ceil(np.log2(need) - 1e-9)) if need > 0.0 else 0
    return int(np.clip(exponent, WEIGHT_EXPONENTS[0] if plastic else 0, WEIGHT_EXPONENTS[-1]))


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
    errors.append(worst_rounding("V_th", "mV", p["V_th"], got, np.abs(d.distance)))
    if p["I_e"].any():
        got = (bias_mant << bias_exp) / (volt * d.drift)
        errors.append(worst_rounding("I_e", "pA", p["I_e"], got, float(np.abs(p["I_e"]).max())))
    errors.append(worst_rounding("t_ref", "ms", p["t_ref"], (refractory - 1) * h, 1.0))
    registers = fall_register(inputs.part, volt) | {
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
    return worst_rounding(name, "ms", tau, got, tau)


GENTLE = 1e-6


SOFT_RESET = (
    "takes two compartments a neuron, the second of which inhibits the first (Rueckauer et al., ACM J. Emerg. Technol. "
    "Comput. Syst. 18:48, 2022); only one is placed and priced"
)


def lacking(inputs: Inputs) -> list[Problem]:
    """Return all that a compartment lacks of a population, whatever its scale."""
    return [*_times(inputs), *_potentials(inputs), *_input(inputs), *of_falls(inputs.part, SOFT_RESET)]


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
            part,
            f"t_ref = {value_at(part, 't_ref', at):g} ms",
            f"it is {steps} steps, and the refractory register holds at most {REFRACTORY_LIMIT - 1}",
            f"use at most {(REFRACTORY_LIMIT - 1) * h:g} ms, or a coarser resolution",
        )


def _potentials(inputs: Inputs) -> Iterator[Problem]:
    """Potentials that a compartment cannot tell apart, or has not."""
    part, p = inputs.part, inputs.part.parameters
    off = np.flatnonzero(np.broadcast_to((p["V_reset"] != p["E_L"]) & ~falls(part), part.size))
    if off.size:
        v_reset, e_l = value_at(part, "V_reset", off[0]), value_at(part, "E_L", off[0])
        yield refused(
            part,
            f"V_reset = {v_reset:g} mV",
            f"a spike sets the voltage register to 0, which is E_L = {e_l:g} mV",
            f"set V_reset to {e_l:g}, or run on spinnaker",
        )
    below = np.flatnonzero(np.broadcast_to(p["V_th"] <= p["E_L"], part.size))
    if below.size:
        v_th, e_l = value_at(part, "V_th", below[0]), value_at(part, "E_L", below[0])
        yield refused(
            part,
            f"V_th = {v_th:g} mV",
            f"the threshold register is unsigned, so V_th must be above E_L = {e_l:g} mV",
            "raise V_th or lower E_L, or run on spinnaker",
        )
    yield from of_lowest(part)


def _input(inputs: Inputs) -> Iterator[Problem]:
    """Input that a compartment does not keep apart, or not keep."""
    part, p = inputs.part, inputs.part.parameters
    if p.get("refractory_input", np.zeros(1)).any():
        yield refused(part, "refractory_input", "a compartment loses input while it is refractory", "leave it out")
    if "tau_syn_ex" not in p or not all(receives(inputs)):
        return
    apart = np.flatnonzero(np.broadcast_to(p["tau_syn_ex"] != p["tau_syn_in"], part.size))
    if apart.size:
        ex, inh = value_at(part, "tau_syn_ex", apart[0]), value_at(part, "tau_syn_in", apart[0])
        yield refused(
            part,
            f"tau_syn_ex = {ex:g} ms and tau_syn_in = {inh:g} ms",
            "a compartment has one current and so one synaptic time constant",
            "use one time constant for both, or run on spinnaker",
        )


def overflows(part: Population, d: Described, volt: float) -> Iterator[Problem]:
    """Registers that a scale overflows: one that a user set, or one kept while parameters change."""
    for what, largest, limit, name in (
        ("V_th - E_L", float(d.distance.max()) / 64.0, VTH_LIMIT, "the 17-bit threshold register"),
        ("the constant current", float(d.drive.max()), BIAS_LARGEST, "the bias register, 4095 x 2^7,"),
        ("V_m at step 0", float(np.abs(d.start).max()), V_LIMIT, "the 24-bit voltage register"),
        ("I_syn at step 0", float(np.abs(d.current).max()), U_LIMIT - 1, "the 24-bit current register"),
    ):
        need = volt * largest
        if need > limit * (1.0 + GENTLE):
            yield refused(
                part,
                f"{what} needs {need:.6g} at {volt:.6g} units per mV",
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
"""What a user may fix of a chip's scales."""


def filled_current(cells: FixedPopulation, arriving: Floats) -> float:
    """How much of the 24 bits of u is filled by what arrives in each step, and what came before."""
    if "du" not in cells.registers:
        return 0.0
    keep = (4095 - cells.registers["du"]) / 4096
    u, most = np.zeros(arriving[:, 0].shape), 0.0
    for step in range(arriving.shape[1]):
        u = keep * u + 64.0 * arriving[:, step]
        most = max(most, float(np.abs(u).max(initial=0.0)) / U_LIMIT)
    return most


class Loihi(Arithmetic):
    """The integers of Loihi 1."""

    name = "loihi"
    title = "Loihi"
    models: tuple[type[Neuron], ...] = (iaf_psc_exp, iaf_psc_delta)
    options: tuple[Option, ...] = (
        *SCALING,
        Option(
            "signals", "projections", is_positive, "the largest dopamine that the signal sets in 1/ms, a number > 0"
        ),
    )
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
    """The step that `models` with a potential take, see `FixedPopulation.kind`."""
    shifts_sums = False
    """Whether a negative exponent shifts the sum of a step, not each weight."""

    def ends(self, mode: str, bits: int) -> tuple[int, int, int]:
        """Return the smallest and the largest mantissa of a sign mode, and the step between two."""
        return bounds(mode, bits)

    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Return what a spike adds for some mantissas."""
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
        **more: Any,
    ) -> FixedProjection:
        """Return a projection by its mantissas, their sign mode and what became of the weights.

        Args:
            inputs: the population on which it ends.
            index: of the projection.
            mantissas: one, or one per synapse.
            rounding: what became of the weights.
            step: weight per mantissa.
            exponent: of the weights.
            mode: the sign mode; "" for words as they are.
            bits: of a mantissa.
            native: whether the weights of the language are the mantissas, bits that the chip drops included.
            more: other attributes of `FixedProjection`.
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
            **more,
        )
        return replace(wires, words=self.words(wires, mantissas))

    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection onto a `loihi_lif`, whose weights are mantissas, and what cannot be."""
        part = inputs.program.projections[index]
        numbers = part.synapse.parameters()
        exponent, bits = numbers.get("weight_exp", 0), numbers.get("num_weight_bits", WEIGHT_BITS)
        mode = numbers.get("sign_mode", "mixed")
        low, high, _ = bounds(mode, bits)
        first, last, _ = bounds(mode)
        problems = []
        bad = np.flatnonzero((part.weight != np.rint(part.weight)) | (part.weight < first) | (part.weight > last))
        if bad.size:
            value = part.weight[bad[0]]
            why = f"a mantissa in sign mode {mode} is a whole number from {first} to {last}"
            problems.append(refused(part, f"weight = {value:g}", why, "raise weight_exp and lower the mantissas"))
        asked: Words = np.clip(np.rint(part.weight), first, last).astype(np.int32)
        sent: Floats = word(asked, exponent, bits, mode == "mixed") * 2.0**-exponent
        rounding = judge_weights(asked.astype(np.float64), sent, 1.0, low, high)
        wires = self.wires(inputs, index, asked, rounding, exponent=exponent, mode=mode, bits=bits, native=True)
        return wires, problems

    def relay_projection(self, inputs: Inputs, index: int) -> FixedProjection:
        """Return a projection onto parrots, which the host relays: every spike counts, whatever its weight."""
        step = inputs.program.projections[index].weight.copy()
        return self.wires(inputs, index, np.ones(1, dtype=np.int32), LOSSLESS, step, mode="excitatory")

    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """A population of `iaf_psc_delta` or `iaf_psc_exp`, and the projections onto it.

        Args:
            inputs: the population and what arrives at it.
            options: scales that a user sets.
        """
        part = inputs.part
        d, problems = described(inputs), lacking(inputs)
        volt = float(options.of("scales", part.name) or choose_scale(inputs, d))
        problems += overflows(part, d, volt)
        registers, errors = _registers(inputs, d, volt)
        if has_lowest(part):
            rest, lowest = part.parameters["E_L"], part.parameters["V_min"]
            depth = volt * float((rest - lowest).max())
            registers["v_min"] = np.array([1 - 2 ** round(np.log2(max(depth, 0.0) + 1.0))])
            got = float(rest.min()) + registers["v_min"][0] / volt
            why = f"a core's register holds a power of two: {got:.4g} mV"
            problems.append(approximated(part, f"V_min = {lowest.min():g} mV", why))
        ampere = () if not d.tau else (volt * d.gain / (d.fade if acts_late(part.model) else 1.0),) * 2
        initial = {name: np.rint(volt * values).astype(np.int64) for name, values in (("v", d.start), ("u", d.current))}
        fixed = FixedPopulation(
            part.name,
            self.kind,
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
            found[index], more = self.fitted_projection(inputs, index, d, volt, options)
            problems += more
        return fixed, found, problems

    def fitted_projection(
        self, inputs: Inputs, index: int, d: Described, volt: float, options: Options
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
        mantissas, found = round_weights(part.weight, per_synapse, per_synapse, low, high, grain, keep)
        if exponent < 0:  # the lowest bits of a mantissa are kept for learning, but not sent
            sent: Floats = word(mantissas, exponent, 8, False).astype(np.float64) * 2.0**-exponent
            found = judge_weights(np.broadcast_to(part.weight, mantissas.shape), sent, per_synapse, low, high)
        if found.saturated > 0.0:
            beyond = farthest_weight(part.weight, per_synapse, low, high)
            limit = low if beyond.weight < 0.0 else high
            problems.append(
                refused(
                    part,
                    f"weight = {beyond.weight:g}",
                    f"a mantissa in sign mode {mode} holds at most {limit}, which is {limit * beyond.step:.6g} "
                    f"at exponent {exponent} and {volt:.6g} units per mV",
                    "use a larger exponent or a smaller scale, or leave them to be chosen",
                )
            )
        return self.wires(inputs, index, mantissas, found, per_synapse, exponent=exponent, mode=mode), problems

    def give_rules(self, program: Program, chip: Chip, wires: Projections, options: Options) -> Iterator[Problem]:
        """Give rules to the projections that learn on the chip; yield what is refused and what is approximated."""
        if all(type(part.synapse) is static for part in program.projections):
            return iter(())
        from neuro.chips.loihi_learning import give_rules

        return give_rules(program, chip, wires, options)

    def kept_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the scale and the exponents that a population and the projections onto it have."""
        return Options({"scales": {cells.name: cells.volt}, "exponents": {part.name: part.exponent for part in wires}})

    def filled(self, cells: FixedPopulation, arriving: Floats) -> float:
        """Return how much of the 22 bits of a step's input, or of the 24 of u, is filled by what arrives."""
        if "du" not in cells.registers:
            return 0.0
        return max(64.0 * float(np.abs(arriving).max(initial=0.0)) / INPUT_LIMIT, filled_current(cells, arriving))

    def told_scale(self, cells: FixedPopulation, wires: FixedProjection) -> str:
        """Return the name of a projection's scale in a report."""
        return f"exponent {wires.exponent}"

    def lossless(self, wires: FixedProjection) -> str:
        """Return how mantissas lose nothing to the shift of the exponent and to the bits of the memory."""
        grain = max(grain_of(wires.bits, wires.sign_mode == "mixed"), 2 ** max(0, -wires.exponent))
        ways = [f"use mantissas that are multiples of {grain}"] if grain <= wires.high else []
        ways += ["use a larger weight_exp"] if wires.exponent < 0 else []
        return ", or ".join(ways)

    def current(self, cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a synaptic current in pA: a compartment has one; what is above 0 is excitatory."""
        units = np.maximum(states["u"], 0) if name == "I_syn_ex" else np.minimum(states["u"], 0)
        current: Floats = units / cells.ampere[0]
        return current

    def units(self, cells: FixedPopulation, name: str, values: Floats) -> Floats:
        """Return a synaptic current in pA as units of u."""
        units: Floats = values * cells.ampere[name == "I_syn_in"]
        return units

    def bias(self, cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
        """Return what the bias register adds in each step, with a current in pA beside the constant one."""
        r = cells.registers
        mantissas = r["bias_mant"] + np.rint(current * cells.drive / 2.0 ** r["bias_exp"]).astype(np.int64)
        if mantissas.min() < -BIAS_MANTISSA - 1 or mantissas.max() > BIAS_MANTISSA:
            raise ModelError(
                f"population '{cells.name}': a current of {np.abs(current).max():g} pA overflows the bias register",
                hint="describe the dc_generator with its largest amplitude: the scale leaves room for it",
            )
        value: NDArray[np.int32] = (mantissas << r["bias_exp"]).astype(np.int32)
        return value

    def way_out(self, cells: FixedPopulation) -> str:
        """Return the scale that leaves four times the room."""
        return f"scales={{'{cells.name}': {cells.volt / 4:.4g}}} leaves 4 times the room"


LOIHI = Loihi()
