"""Registers of Loihi 1: limits, words of weights, and the registers of a leaky integrate-and-fire neuron.

`neuro.chips.loihi` has the meaning of each register, and the sources.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.chips.fixed import (
    Rounding,
    WeightRounding,
    Words,
    sampled,
    scale_errors,
    thinned,
    worst_rounding,
)
from neuro.chips.inputs import (
    Inputs,
    acts_late,
    constants_of,
    converging,
    soft_reset_register,
)
from neuro.model.neurons import iaf_psc_delta
from neuro.program.program import Floats, Ints

KIND = "loihi_lif"
"""Integer step of a compartment, see `FixedPopulation.kind`."""

REGISTER_OF_ONE = 0
"""Content of the delay register for a delay of one step."""

V_LIMIT = 2**23 - 1
"""Largest v and largest initial u."""

U_LIMIT = 2**23
INPUT_LIMIT = 2**21
"""The input of one step wraps as a two's complement of 22 bits (nengo-loihi 1.1)."""

VTH_LIMIT = 2**17 - 1
BIAS_MANTISSA = 4095
BIAS_EXPONENT = 7
WORD_LIMIT = 2**15 - 1
"""A spike adds at most 64 times this number, 2^21 - 64."""

WEIGHT_EXPONENTS = range(-8, 8)
REFRACTORY_LIMIT = 64
DECAY_STEPS = 4096
WEIGHT_BITS = 8
TOLERANCE = 1e-6
LOSSLESS = WeightRounding(0.0, 0.0, 0.0, 0.0)


def word(mantissas: Words, exponent: int, bits: int, mixed: bool) -> Words:
    """Convert mantissas to words, the amounts that a spike adds in units of 64: floor(m 2^exponent), clipped."""
    stored = stored_mantissas(mantissas, bits, mixed)
    shifted = stored << exponent if exponent >= 0 else stored >> -exponent
    clipped: Words = np.clip(shifted, -WORD_LIMIT, WORD_LIMIT).astype(np.int32)
    return clipped


def stored_mantissas(mantissas: Words, bits: int, mixed: bool) -> Words:
    """Return mantissas after storage in the weight memory, which rounds them towards 0 to its bits."""
    grain = grain_of(bits, mixed)
    stored: Words = np.sign(mantissas) * (np.abs(mantissas) // grain * grain)
    return stored


def grain_of(bits: int, mixed: bool) -> int:
    """Return the step between two mantissas."""
    return 1 << (8 - bits + mixed)


def bounds(sign_mode: str, bits: int = 8) -> tuple[int, int, int]:
    """Return the smallest and the largest mantissa of a sign mode, and the step between two mantissas."""
    grain = grain_of(bits, sign_mode == "mixed")
    low, high = {"mixed": (-256, 254), "excitatory": (0, 255), "inhibitory": (-255, 0)}[sign_mode]
    return -(-low // grain) * grain if low > -256 else -256, high // grain * grain, grain


COMFORT = 2.0**21
"""Largest threshold of an automatic scale, in units of v. Before they wrap, the input of one step can be as large as
this threshold, and u four times as large."""

FINE = 2.0**17
"""Smallest threshold of an automatic scale, in units of v: 2,048 times the step of a weight, which is 64."""

BIAS_LARGEST = BIAS_MANTISSA << BIAS_EXPONENT
SPARE = 1.0 - 2.0**-7
"""Share of a limit that an automatic scale uses. The rest allows for rounding up: of the largest word, and of the two
mantissas whose sum is the bias."""


@dataclass(frozen=True, slots=True, eq=False)
class InMillivolts:
    """Quantities in mV of a population of `iaf_psc_delta` or `iaf_psc_exp`; they determine its scale.

    Each array has shape (1,) or (neurons,).

    Attributes:
        gain: mV per unit of weight, in the step of arrival.
        distance: V_th - E_L in mV.
        leak: share of V - E_L that remains after a step.
        fade: share of the current that remains after a step; 0 for delta input.
        drive: largest mV per step from the constant current and the currents of generators.
        drift: mV per step and pA of constant current.
        bias: mV per step from the constant current.
        start: V_m - E_L in mV at step 0.
        current: mV per step from the synaptic current at step 0. If input acts a step late (`acts_late`), the current
            is divided by `fade`, which gives its value one step earlier.
        tau: the parameter that determines `fade`, "" for delta input.
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


def in_millivolts(inputs: Inputs) -> InMillivolts:
    """Return the constants of the exact integration and the states at step 0, in mV."""
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
        gain = np.where(np.isfinite(gain) & (gain > 0.0), gain, 1.0)  # no accepted time constant gives 1.0
        current = (part.initial["I_syn_ex"] + part.initial["I_syn_in"]) * gain
        current = current / fade if acts_late(part.model) else current
    drift = c[:, P30]
    bias = np.unique(c[:, I_E] * drift)
    drive = np.abs(c[:, I_E] * drift) + inputs.current * np.abs(drift)
    start = part.initial["V_m"] - p["E_L"]
    return InMillivolts(gain, p["V_th"] - p["E_L"], c[:, P33], fade, drive, drift, bias, start, current, tau)


def receives(inputs: Inputs) -> tuple[bool, bool]:
    """Return whether an excitatory and whether an inhibitory current flows, from spikes or at step 0."""
    initial = inputs.part.initial
    return (
        inputs.high > 0.0 or bool(np.any(initial.get("I_syn_ex", 0.0))),
        inputs.low < 0.0 or bool(np.any(initial.get("I_syn_in", 0.0))),
    )


def only_inhibitory(inputs: Inputs) -> bool:
    """Return whether the single current of a compartment is inhibitory."""
    return receives(inputs) == (False, True)


def scale_limits(mv: InMillivolts) -> tuple[float, float]:
    """Return two upper bounds of the scale: for a threshold of at most `COMFORT`, and for the threshold register.

    At both scales the bias and the initial states fit into their registers.
    """
    limits = ((BIAS_LARGEST * SPARE, mv.drive), (V_LIMIT, mv.start), (U_LIMIT - 1, mv.current))
    state_limits = min(limit / _largest(values) for limit, values in limits)
    distance = _largest(mv.distance)
    return min(COMFORT / distance, state_limits), min(64.0 * VTH_LIMIT / distance, state_limits)


def safe_scales(inputs: Inputs, mv: InMillivolts) -> tuple[float, float]:
    """Return the largest scale at which no sum wraps, even if all synapses of a neuron are active in every step.

    Returns:
        This scale, and a finer scale: at least as large, and large enough that the threshold and the truncated decays
        have errors of at most 0.1 %.
    """
    total = 0.0
    for sign in (1.0, -1.0):
        arriving = np.zeros(inputs.part.size)
        for index in inputs.spikes:
            low, high = inputs.bounds(index)
            extreme = np.full(1, high if sign > 0.0 else low)
            arriving += converging(inputs, index, sign, extreme if inputs.learns(index) else None)
        total = max(total, _largest(arriving) * float(mv.gain.max()))
    summed = total / (1.0 - float(min(mv.fade.max(), 1.0 - 2.0**-12)))
    safe = min((INPUT_LIMIT - 1) / total, (U_LIMIT - 1) / summed) * SPARE
    decayed = 1.0 - np.concatenate((mv.leak, mv.fade))
    fine = max(FINE, 1000.0 / float(decayed[decayed > 0.0].min(initial=1.0)))
    return safe, max(safe, fine / _largest(mv.distance))


def _largest(values: Floats) -> float:
    """Return the largest magnitude, or a tiny number instead of 0, so that a limit divided by it is huge."""
    return max(float(np.abs(values).max(initial=0.0)), 1e-200)


def choose_scale(inputs: Inputs, mv: InMillivolts) -> float:
    """Return the scale in units per mV with the smallest rounding errors of the weights.

    Each candidate gives the largest weight of the strongest projection a mantissa from 129 to 256. Doubling a scale
    changes no mantissa, so each candidate is doubled as long as threshold, bias and weights fit. If weights learn from
    spike pairs, the upper bound of learning gets the largest mantissa, so that the chip has the same bound. A smaller
    scale at which no sum wraps is preferred if its error is not larger.
    """
    cap, limit = scale_limits(mv)
    values = [(index, sampled(potential_changes(inputs, index, mv, few=True))) for index in inputs.spikes]
    values = [(index, v) for index, v in values if np.any(v)]
    if not values:
        return float(2.0 ** np.floor(np.log2(cap)))
    strongest = max(_largest(v) for _, v in values)
    word_cap = 64.0 * WORD_LIMIT / strongest * SPARE
    cap, limit = min(cap, word_cap), min(limit, word_cap)
    largest, error = _search(inputs, mv, values, cap, limit, np.inf)
    safe, fine = safe_scales(inputs, mv)
    if fine < cap:
        smaller, error_of_smaller = _search(inputs, mv, values, fine, limit, safe)
        if error_of_smaller <= error * (1.0 + 1e-9):
            return smaller
    return largest


def _search(
    inputs: Inputs, mv: InMillivolts, values: list[tuple[int, Floats]], cap: float, limit: float, safe: float
) -> tuple[float, float]:
    """Return the scale with the smallest rounding error of the weights, and this error.

    A candidate up to `cap` is doubled as long as it does not exceed `cap`. A candidate above `cap` keeps exponent 0, or
    is halved until it does not exceed `limit`. Ties are broken by the error of the constant drive and the threshold,
    then by size: the largest scale up to `safe` wins, or the smallest scale if all exceed `safe`.
    """
    pairs = [inputs.program.projections[index].synapse.learns == "pairs" for index, _ in values]
    plastic = [item for item, learns in zip(values, pairs, strict=True) if learns and inputs.learns(item[0])]
    peak = max(_largest(v) for _, v in plastic or values)
    mantissas = np.array([255.0]) if plastic else np.arange(256.0, 128.0, -1.0)
    base = 64.0 * mantissas / peak  # scale at exponent 0
    bound = np.where(base > cap, np.minimum(base, limit), cap)
    scales = base * 2.0 ** np.floor(np.log2(bound / base) + 1e-12)
    scales = scales[scales <= limit * (1.0 + 1e-12)]
    errors = np.zeros(scales.size)
    for index, v in values:
        low, high, grain = bounds(inputs.sign_mode(index))
        steps = np.array([64.0 * 2.0 ** exponent_of(v, s, low, high, inputs.learns(index)) / s for s in scales])
        errors += scale_errors(v, steps, low, high, grain)
    smallest_error = float(errors.min())
    ties = scales[errors <= smallest_error * (1.0 + 1e-9)]
    misfit = _misfit(ties, mv)
    best = ties[misfit <= misfit.min()]
    without_wrap = best[best <= safe]
    return float(without_wrap.max() if without_wrap.size else best.min()), smallest_error


def _misfit(scales: Floats, mv: InMillivolts) -> Floats:
    """Return the relative rounding error of the constant drive and of the threshold, for each scale (units per mV).

    The error is only computed for neurons without a leak. With a leak the decay is rounded in each step anyway, and all
    scales are treated as equal.
    """
    if np.any(mv.leak < 1.0):
        return np.zeros(scales.size)
    drive = scales[:, None] * mv.bias[None, :]
    largest = np.maximum(np.abs(drive).max(axis=1, keepdims=True, initial=0.0), 1.0)
    grain = 2.0 ** np.maximum(0.0, np.ceil(np.log2(largest / BIAS_MANTISSA)))
    errors: Floats = np.abs(np.rint(drive / grain) * grain - drive).max(axis=1, initial=0.0) / largest[:, 0]
    steps = scales[:, None] * mv.distance[None, :] / 64.0
    errors += (np.abs(np.rint(steps) - steps) / np.maximum(steps, 1.0)).max(axis=1)
    errors[errors < 1e-12] = 0.0
    return errors


def potential_changes(inputs: Inputs, index: int, mv: InMillivolts, few: bool = False) -> Floats:
    """Return the change of V_m in mV by a spike along each synapse, now and at the bounds of learning.

    Args:
        inputs: the population.
        index: index of the projection.
        mv: quantities of the population in mV.
        few: whether to reduce many synapses to a sample: the largest, the smallest and evenly spaced others.
    """
    weight, part = inputs.range_of(index), inputs.program.projections[index]
    reduced = thinned if few else np.asarray
    if mv.gain.size == 1:
        return reduced(weight) * float(mv.gain[0])
    if part.weight.size == 1 or part.grid is not None:
        return reduced(np.concatenate((weight * mv.gain.min(), weight * mv.gain.max())))
    own_bounds = part.weight * mv.gain[inputs.targets(index)]
    return reduced(np.concatenate((own_bounds, weight[part.weight.size :] * mv.gain.max())))


def exponent_of(values: Floats, scale: float, low: int, high: int, plastic: bool) -> int:
    """Return the smallest exponent at which all values fit.

    Only plastic weights get exponents below 0, which resolve smaller changes of a weight.
    """
    need_above = float(values.max(initial=0.0)) * scale / 64.0 / max(high, 1)
    need_below = float(-values.min(initial=0.0)) * scale / 64.0 / max(-low, 1)
    need = max(need_above, need_below)
    exponent = int(np.ceil(np.log2(need) - 1e-9)) if need > 0.0 else 0
    return int(np.clip(exponent, WEIGHT_EXPONENTS[0] if plastic else 0, WEIGHT_EXPONENTS[-1]))


def registers_of(inputs: Inputs, mv: InMillivolts, volt: float) -> tuple[dict[str, Ints], tuple[Rounding, ...]]:
    """Return all registers of the compartments, and their rounding errors. `volt` is the scale in units per mV."""
    p, h = inputs.part.parameters, inputs.program.resolution
    vth = threshold(volt * mv.distance)
    du = np.full(1, 4095) if not mv.tau else np.rint(4096.0 * (1.0 - mv.fade)).astype(np.int64) - 1
    dv = np.rint(4096.0 * (1.0 - mv.leak)).astype(np.int64)
    bias_exp, bias_mant = bias_registers(
        volt * mv.drift * p["I_e"], inputs.current * float(np.abs(volt * mv.drift).max())
    )
    refractory = np.rint(p["t_ref"] / h).astype(np.int64) + 1
    errors = [_time_constant("tau_m", p["tau_m"], (4096 - dv) / 4096, h)]
    if mv.tau:
        errors.append(_time_constant(mv.tau, p[mv.tau], (4095 - du) / 4096, h))
    actual = p["E_L"] + 64.0 * (vth + 1) / volt
    errors.append(worst_rounding("V_th", "mV", p["V_th"], actual, np.abs(mv.distance)))
    if p["I_e"].any():
        actual = (bias_mant << bias_exp) / (volt * mv.drift)
        errors.append(worst_rounding("I_e", "pA", p["I_e"], actual, float(np.abs(p["I_e"]).max())))
    errors.append(worst_rounding("t_ref", "ms", p["t_ref"], (refractory - 1) * h, 1.0))
    registers = soft_reset_register(inputs.part, volt) | {
        "du": np.clip(du, 0, 4095),
        "dv": np.clip(dv, 0, 4095),
        "vth": np.clip(vth, 0, VTH_LIMIT),
        "bias_mant": np.clip(bias_mant, -BIAS_MANTISSA - 1, BIAS_MANTISSA),
        "bias_exp": bias_exp,
        "refractory": np.clip(refractory, 1, REFRACTORY_LIMIT),
    }
    return {name: np.atleast_1d(values).astype(np.int64) for name, values in registers.items()}, tuple(errors)


def threshold(distance: Floats) -> Ints:
    """Return the vth for which v > 64 vth is equivalent to v >= distance, for all multiples v of 64."""
    steps = distance / 64.0
    nearest = np.rint(steps)
    is_whole = np.abs(steps - nearest) <= TOLERANCE
    register: Ints = np.where(is_whole, nearest, np.ceil(steps)).astype(np.int64) - 1
    return register


def bias_registers(drive: Floats, extra: float) -> tuple[Ints, Ints]:
    """Return exponent and mantissas of a constant drive in units per step; `extra` is the drive of generators."""
    largest = float(np.abs(drive).max(initial=0.0)) + extra
    limit = BIAS_MANTISSA - (extra > 0.0)  # the sum of two rounded mantissas can be one larger
    exponent = min(int(np.ceil(np.log2(max(largest / limit, 1.0)))), BIAS_EXPONENT)
    return np.full(1, exponent), np.rint(drive / 2.0**exponent).astype(np.int64)


def _time_constant(name: str, tau: Floats, remaining: Floats, h: float) -> Rounding:
    with np.errstate(divide="ignore", invalid="ignore"):
        actual = np.where(remaining >= 1.0, np.inf, -h / np.log(remaining))
    return worst_rounding(name, "ms", tau, actual, tau)
