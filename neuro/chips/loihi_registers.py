"""Loihi 1's registers: their limits, the words of weights, and what a leaky integrate-and-fire neuron is at a scale.

See `neuro.chips.loihi` for what each register means, and for sources.
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
    fall_register,
)
from neuro.model.neurons import iaf_psc_delta
from neuro.program.program import Floats, Ints

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
GENTLE = 1e-6
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


def registers_of(inputs: Inputs, d: Described, volt: float) -> tuple[dict[str, Ints], tuple[Rounding, ...]]:
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
