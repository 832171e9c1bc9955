"""Loihi 1's integers: how a leaky integrate-and-fire neuron and its weights become registers.

With S units of the voltage register per mV, P32 the potential in mV that 1 pA gives in a step, and P30 that of a
constant current (exact integration, `neuro.neurons.propagators`):

| described | on the chip |
| --- | --- |
| V_m - E_L | v = S (V_m - E_L) |
| I_syn, read one step earlier | u = S P32 I_syn |
| weight of `iaf_psc_exp` | 64 m 2^e = S P32 w |
| weight of `iaf_psc_delta` | 64 m 2^e = S w, and du = 4095, so that u keeps nothing |
| tau_syn | (4096 - (du + 1)) / 4096 = exp(-h / tau_syn) |
| tau_m | (4096 - dv) / 4096 = exp(-h / tau_m) |
| V_m >= V_th | v > 64 vth, the largest 64 vth below S (V_th - E_L) |
| t_ref of R steps | refractory = R + 1 |
| delay of D steps | `iaf_psc_exp`: D, `iaf_psc_delta`: D - 1, as NEST's currents act a step later than they arrive |

Source: Davies et al., IEEE Micro 38(1):82, 2018; traces of lava 0.10, nengo-loihi 1.1 and Brian2Loihi 0.5.2. Where
these differ: each weight is shifted, not the sum of a step, and mantissas lose their lowest bits towards 0 (as in
Brian2Loihi, which reports a match with the chip); u wraps as a 24-bit two's complement and v is clipped (as in lava
and nengo-loihi).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from neuro.backend import Problem
from neuro.chips import scales
from neuro.chips.fixed import FixedPopulation, FixedProjection, Rounding, WeightRounding, Words
from neuro.chips.parts import Inputs, Options, constants_of, refused
from neuro.neurons import Neuron, iaf_psc_delta, iaf_psc_exp
from neuro.program import Floats, Ints, Population

V_LIMIT = 2**23 - 1
U_LIMIT = 2**23
VTH_LIMIT = 2**17 - 1
BIAS_MANTISSA = 4095
BIAS_EXPONENT = 7
WORD_LIMIT = 2**15 - 1
"""A spike adds at most 64 times this, 2^21 - 64."""

WEIGHT_EXPONENTS = range(-8, 8)
REFRACTORY_LIMIT = 64
COMFORT = 2.0**21
"""The threshold that automatic scales stay below, so that u has a factor 4 before it wraps."""

GENTLE = 1e-6


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


def sign_mode_of(low: float, high: float) -> str:
    """The sign mode that weights from low to high need."""
    if low >= 0.0:
        return "excitatory"
    return "inhibitory" if high <= 0.0 else "mixed"


# native parts


def native(part: Population) -> FixedPopulation:
    """A `loihi_lif`: its parameters are the registers."""
    registers = {name: values.astype(np.int64) for name, values in part.parameters.items() if name != "tau_minus"}
    initial = {name: values.astype(np.int64) for name, values in part.initial.items()}
    return FixedPopulation(part.name, "loihi_lif", registers, initial)


def native_projection(inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
    """A projection onto a `loihi_lif`: its weights are mantissas."""
    part = inputs.program.projections[index]
    told = part.synapse.parameters()
    exponent, bits, mode = (
        told.get("weight_exp", 0),
        told.get("num_weight_bits", 8),
        told.get("sign_mode", "mixed"),
    )
    low, high, grain = bounds(mode, bits)
    first, last, _ = bounds(mode)
    problems = []
    bad = np.flatnonzero(
        (part.weight != np.rint(part.weight)) | (part.weight < first) | (part.weight > last + (mode == "mixed"))
    )
    if bad.size:
        value = part.weight[bad[0]]
        what = f"projection '{part.name}': weight = {value:g}"
        why = f"a mantissa in sign mode {mode} is a whole number from {first} to {last}"
        problems.append(refused(part.origin, what, why, "raise weight_exp and lower the mantissas"))
    asked: Words = np.clip(np.rint(part.weight), first, last + 1).astype(np.int32)
    kept = dropped(asked, bits, mode == "mixed")
    found = scales.judged(asked.astype(np.float64), kept, 1.0, low, high)
    fixed = _fixed(part.name, asked, exponent, mode, bits, np.ones(1), (part.delay - 1).astype(np.int32), found)
    return fixed, problems


def _fixed(
    name: str,
    mantissas: Words,
    exponent: int,
    mode: str,
    bits: int,
    step: Floats,
    delay: Words,
    rounding: WeightRounding,
) -> FixedProjection:
    """A projection by its mantissas and its delay register."""
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
        lag=delay + np.int32(1),
        delay=delay,
        rounding=rounding,
    )


# leaky integrate-and-fire


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
        start: V_m - E_L in mV at step 0.
    """

    gain: Floats
    distance: Floats
    leak: Floats
    fade: Floats
    drive: Floats
    drift: Floats
    start: Floats


def described(inputs: Inputs) -> tuple[Described, list[Problem]]:
    """Constants of the exact integration, and what the chip cannot do of the model."""
    part = inputs.part
    problems = [*_times(inputs), *_lacking(inputs)]
    c = constants_of(part, inputs.program.resolution)
    p = part.parameters
    start = np.atleast_1d(part.initial["V_m"]) - p["E_L"]
    if isinstance(part.model, iaf_psc_delta):
        from neuro.neurons.iaf_psc_delta import I_E, P30, P33

        gain, fade = np.ones(1), np.zeros(1)
    else:
        from neuro.neurons.iaf_psc_exp import I_E, P11_EX, P11_IN, P30, P32_EX, P32_IN, P33

        only_negative = inputs.low < 0.0 and inputs.high <= 0.0
        gain, fade = (c[:, P32_IN], c[:, P11_IN]) if only_negative else (c[:, P32_EX], c[:, P11_EX])
        if inputs.low < 0.0 < inputs.high and np.any(p["tau_syn_ex"] != p["tau_syn_in"]):
            tau = (float(p["tau_syn_ex"].max()), float(p["tau_syn_in"].max()))
            problems.append(
                refused(
                    part.origin,
                    f"population '{part.name}': tau_syn_ex = {tau[0]:g} ms and tau_syn_in = {tau[1]:g} ms",
                    "a compartment has one current and so one synaptic time constant",
                    "use one time constant for both",
                )
            )
    drift = c[:, P30]
    drive = np.abs(c[:, I_E] * drift) + inputs.current * np.abs(drift)
    return Described(gain, p["V_th"] - p["E_L"], c[:, P33], fade, drive, drift, start), problems


def _times(inputs: Inputs) -> list[Problem]:
    """Time constants that 12-bit decays cannot hold."""
    part, h = inputs.part, inputs.program.resolution
    problems = []
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name not in part.parameters:
            continue
        tau = part.parameters[name]
        if tau.min() < h:
            problems.append(
                refused(
                    part.origin,
                    f"population '{part.name}': {name} = {tau.min():g} ms",
                    f"it is below a step of {h:g} ms",
                    "use a finer resolution or a longer time constant",
                )
            )
        longest = tau[np.isfinite(tau)].max(initial=0.0)
        if -np.expm1(-h / max(longest, h)) * 4096 < 0.5 + (name != "tau_m"):
            limit = -h / np.log1p(-(0.5 + (name != "tau_m")) / 4096)
            problems.append(
                refused(
                    part.origin,
                    f"population '{part.name}': {name} = {longest:g} ms",
                    f"a 12-bit decay holds at most {limit:.4g} ms at a resolution of {h:g} ms",
                    "use a coarser resolution" + (", or tau_m: .inf for no leak" if name == "tau_m" else ""),
                )
            )
    return problems


def _lacking(inputs: Inputs) -> list[Problem]:
    """Features of the models that a compartment lacks."""
    part, p, h = inputs.part, inputs.part.parameters, inputs.program.resolution
    problems = []
    off = np.flatnonzero(np.broadcast_to(p["V_reset"] != p["E_L"], part.size))
    if off.size:
        values = [float(np.broadcast_to(p[name], part.size)[off[0]]) for name in ("V_reset", "E_L")]
        problems.append(
            refused(
                part.origin,
                f"population '{part.name}': V_reset = {values[0]:g} mV",
                f"a spike sets the voltage register to 0, which is E_L = {values[1]:g} mV",
                f"set V_reset to {values[1]:g}, or run on spinnaker",
            )
        )
    if "V_min" in p and np.isfinite(p["V_min"]).any():
        told = f"population '{part.name}': V_min = {p['V_min'].max():g} mV"
        problems.append(refused(part.origin, told, "a compartment has no lowest potential", "leave V_min out"))
    if p.get("refractory_input", np.zeros(1)).any():
        told = f"population '{part.name}': refractory_input"
        problems.append(refused(part.origin, told, "input while refractory is lost on the chip", "leave it out"))
    r = round(float(p["t_ref"].max()) / h)
    if r + 1 > REFRACTORY_LIMIT:
        problems.append(
            refused(
                part.origin,
                f"population '{part.name}': t_ref = {p['t_ref'].max():g} ms",
                f"{r} steps: the refractory register holds at most {REFRACTORY_LIMIT - 1}",
                f"use at most {(REFRACTORY_LIMIT - 1) * h:g} ms or a coarser resolution",
            )
        )
    return problems


def population(inputs: Inputs, options: Options) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """A population of `iaf_psc_delta` or `iaf_psc_exp`, and the projections onto it.

    Args:
        inputs: the population and what arrives at it.
        options: scales set by hand.
    """
    part = inputs.part
    d, problems = described(inputs)
    by_hand = options.scales.get(part.name)
    volt = choose_scale(inputs, d) if by_hand is None else float(by_hand)
    problems += _overflows(part, d, volt)
    registers, rounding = _registers(inputs, d, volt)
    delta = isinstance(part.model, iaf_psc_delta)
    ampere = () if delta else (volt * d.gain, volt * d.gain)
    initial = {"v": np.rint(volt * d.start).astype(np.int64)}
    if not delta:
        now = part.initial["I_syn_ex"] + part.initial["I_syn_in"]
        initial["u"] = np.rint(now * volt * d.gain).astype(np.int64)
    fixed = FixedPopulation(
        part.name,
        "loihi_lif",
        registers,
        initial,
        volt,
        part.parameters["E_L"].copy(),
        ampere,
        volt * d.drift,
        rounding,
    )
    found = {}
    for index in inputs.spikes:
        found[index], more = projection(inputs, index, d, volt, options)
        problems += more
    return fixed, found, problems


def choose_scale(inputs: Inputs, d: Described) -> float:
    """Units per mV: the scale that loses least of the weights, as large as threshold, bias and weights allow.

    Candidates let the largest weight of the strongest projection have the mantissas 128..255; powers of two change no
    mantissa, so the largest allowed one is taken.
    """
    distance = float(np.max(d.distance, initial=1e-300))
    cap = COMFORT / distance
    hard = 64.0 * VTH_LIMIT / distance
    if (drive := float(d.drive.max(initial=0.0))) > 0.0:
        limit = BIAS_MANTISSA * 2.0**BIAS_EXPONENT / drive
        cap, hard = min(cap, limit), min(hard, limit)
    if (start := float(np.abs(d.start).max(initial=0.0))) > 0.0:
        cap, hard = min(cap, V_LIMIT / start), min(hard, V_LIMIT / start)
    values = [(index, scales.sample(_gained(inputs, index, d))) for index in inputs.spikes]
    values = [(index, v) for index, v in values if np.any(v)]
    if not values:
        return float(2.0 ** np.floor(np.log2(cap)))
    largest = max(float(np.abs(v).max()) for _, v in values)
    word_cap = 64.0 * WORD_LIMIT / largest * (1.0 - 2.0**-7)
    cap, hard = min(cap, word_cap), min(hard, word_cap)
    primary = max(values, key=lambda entry: float(np.abs(entry[1]).max()))[1]
    peak = float(np.abs(primary).max())
    mantissas = np.arange(255, 127, -1, dtype=np.float64)
    base = 64.0 * mantissas / peak  # scale at exponent 0
    wanted = np.where(base > cap, np.minimum(base, hard), cap)
    tried = base * 2.0 ** np.floor(np.log2(wanted / base) + 1e-12)
    tried = tried[tried <= hard * (1.0 + 1e-12)]
    lost = np.zeros(tried.size)
    for index, v in values:
        low, high, grain = bounds(inputs.sign_mode(index))
        steps = np.array([64.0 * 2.0 ** _exponent(v, s, low, high, inputs.learns(index)) / s for s in tried])
        lost += scales.errors(v, steps, low, high, grain)
    best = lost.min() * (1.0 + 1e-9)
    return float(tried[lost <= best].max())


def _gained(inputs: Inputs, index: int, d: Described) -> Floats:
    """What a spike along each synapse does to V_m in mV; of plastic synapses also what it may come to do."""
    weight = inputs.range_of(index)
    if d.gain.size == 1:
        return weight * float(d.gain[0])
    if weight.size == 1:
        return np.array([weight[0] * d.gain.min(), weight[0] * d.gain.max()])
    own = inputs.program.projections[index].weight
    gained = own * d.gain[inputs.targets(index)]
    return np.concatenate((gained, weight[own.size :] * d.gain.max()))


def _exponent(values: Floats, scale: float, low: int, high: int, plastic: bool) -> int:
    """The smallest exponent with which all values fit; below 0 only where learning needs finer steps."""
    up = float(values.max(initial=0.0)) * scale / 64.0 / max(high, 1)
    down = float(-values.min(initial=0.0)) * scale / 64.0 / max(-low, 1)
    need = max(up, down)
    exponent = int(np.ceil(np.log2(need) - 1e-9)) if need > 0.0 else 0
    return int(np.clip(exponent, WEIGHT_EXPONENTS[0] if plastic else 0, WEIGHT_EXPONENTS[-1]))


def _overflows(part: Population, d: Described, volt: float) -> list[Problem]:
    """Registers that a scale set by hand would overflow."""
    checks = (
        ("threshold", volt * float(d.distance.max()) / 64.0, VTH_LIMIT, "the 17-bit threshold register"),
        ("bias", volt * float(d.drive.max()), BIAS_MANTISSA << BIAS_EXPONENT, "the bias register, 4095 x 2^7"),
        ("initial V_m", volt * float(np.abs(d.start).max()), V_LIMIT, "the 24-bit voltage register"),
    )
    return [
        refused(
            part.origin,
            f"population '{part.name}': {what} needs {need:.6g} at {volt:.6g} units per mV",
            f"{name} holds at most {limit}",
            f"set its scale to at most {volt * limit / need:.6g}",
        )
        for what, need, limit, name in checks
        if need > limit * (1.0 + GENTLE)
    ]


def _registers(inputs: Inputs, d: Described, volt: float) -> tuple[dict[str, Ints], tuple[Rounding, ...]]:
    """All registers of the compartments and what they differ in from the description."""
    part, h = inputs.part, inputs.program.resolution
    p = part.parameters
    vth = threshold(volt * d.distance)
    du = np.full(1, 4095) if not d.fade.any() else np.rint(4096.0 * (1.0 - d.fade)).astype(np.int64) - 1
    dv = np.rint(4096.0 * (1.0 - d.leak)).astype(np.int64)
    bias_exp, bias_mant = bias(volt * d.drift * p["I_e"], inputs.current * float(np.abs(volt * d.drift).max()))
    refractory = np.rint(p["t_ref"] / h).astype(np.int64) + 1
    rounding = [_time_constant("tau_m", p["tau_m"], (4096 - dv) / 4096, h)]
    if d.fade.any():
        name = "tau_syn_in" if inputs.high <= 0.0 > inputs.low else "tau_syn_ex"
        rounding.append(_time_constant(name, p[name], (4095 - du) / 4096, h))
    got = part.parameters["E_L"] + 64.0 * (vth + 1) / volt
    rounding.append(worst("V_th", "mV", p["V_th"], got, np.abs(d.distance)))
    if p["I_e"].any():
        got = (bias_mant << bias_exp) / (volt * d.drift)
        rounding.append(worst("I_e", "pA", p["I_e"], got, float(np.abs(p["I_e"]).max())))
    rounding.append(worst("t_ref", "ms", p["t_ref"], (refractory - 1) * h, 1.0))
    registers = {
        "du": np.clip(du, 0, 4095),
        "dv": np.clip(dv, 0, 4095),
        "vth": np.clip(vth, 0, VTH_LIMIT),
        "bias_mant": np.clip(bias_mant, -BIAS_MANTISSA - 1, BIAS_MANTISSA),
        "bias_exp": bias_exp,
        "refractory": np.clip(refractory, 1, REFRACTORY_LIMIT),
    }
    return {name: np.atleast_1d(values).astype(np.int64) for name, values in registers.items()}, tuple(rounding)


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
    exponent = max(0, int(np.ceil(np.log2(largest / BIAS_MANTISSA)))) if largest > BIAS_MANTISSA else 0
    exponent = min(exponent, BIAS_EXPONENT)
    return np.full(1, exponent), np.rint(wanted / 2.0**exponent).astype(np.int64)


def _time_constant(name: str, tau: Floats, kept: Floats, h: float) -> Rounding:
    with np.errstate(divide="ignore", invalid="ignore"):
        got = np.where(kept >= 1.0, np.inf, -h / np.log(kept))
    return worst(name, "ms", tau, got, tau)


def worst(name: str, unit: str, wanted: ArrayLike, got: ArrayLike, scale: ArrayLike) -> Rounding:
    """The rounding of the neuron whose register differs most, relative to `scale`."""
    w, g, s = np.broadcast_arrays(np.atleast_1d(wanted), np.atleast_1d(got), np.asarray(scale, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        error = np.nan_to_num(np.where(w == g, 0.0, (g - w) / s), nan=np.inf)
    at = int(np.argmax(np.abs(error)))
    return Rounding(name, unit, float(w[at]), float(g[at]), float(error[at]) if abs(error[at]) > 1e-12 else 0.0)


def projection(
    inputs: Inputs, index: int, d: Described, volt: float, options: Options
) -> tuple[FixedProjection, list[Problem]]:
    """The weights onto a population with a scale, as mantissas and an exponent."""
    part = inputs.program.projections[index]
    mode = inputs.sign_mode(index)
    low, high, grain = bounds(mode)
    problems: list[Problem] = []
    exponent = options.exponents.get(part.name)
    if exponent is None:
        exponent = _exponent(_gained(inputs, index, d), volt, low, high, inputs.learns(index))
    elif exponent not in WEIGHT_EXPONENTS:
        told = f"projection '{part.name}': weight exponent {exponent}"
        problems.append(refused(part.origin, told, "it has 4 bits, -8 to 7", "choose one of these"))
        exponent = int(np.clip(exponent, -8, 7))
    if part.grid is not None and d.gain.size > 1:
        told = f"projection '{part.name}': a shared kernel onto neurons that differ"
        problems.append(refused(part.origin, told, "a kernel has one scale", "give the neurons the same tau and C_m"))
    step = 64.0 * 2.0**exponent / (volt * (d.gain if part.grid is None else d.gain[:1]))
    per_synapse = step if step.size == 1 else step[inputs.targets(index)]
    mantissas = scales.rounded(part.weight, per_synapse, low, high, grain)
    found = scales.judged(np.broadcast_to(part.weight, mantissas.shape), mantissas, per_synapse, low, high)
    if found.saturated > 0.0:
        largest = float(np.abs(part.weight).max())
        problems.append(
            refused(
                part.origin,
                f"projection '{part.name}': weight = {largest:g} at exponent {exponent} and {volt:.6g} units per mV",
                f"the weight register holds at most {max(high, -low) * float(step.max()):.6g} there",
                "lower the largest weight or the threshold, or leave the scale to be chosen",
            )
        )
    delta = isinstance(inputs.part.model, iaf_psc_delta)
    register = (part.delay - delta).astype(np.int32)
    fixed = _fixed(part.name, mantissas, exponent, mode, 8, per_synapse, register, found)
    return fixed, problems


def relay_projection(inputs: Inputs, index: int) -> FixedProjection:
    """A projection onto parrots: every spike counts, whatever its weight."""
    part = inputs.program.projections[index]
    ones: Words = np.ones(1, dtype=np.int32)
    lossless = WeightRounding(0.0, 0.0, 0.0, 0.0)
    return _fixed(part.name, ones, 0, "excitatory", 8, part.weight.copy(), (part.delay - 1).astype(np.int32), lossless)


def runs(model: object) -> bool:
    """Whether a compartment can be this model."""
    return isinstance(model, Neuron) and isinstance(model, (iaf_psc_delta, iaf_psc_exp))
