"""SpiNNaker 1 as a family of chips; any table with `arithmetic: spinnaker` computes so.

Its integers are s16.15 neurons, unsigned 0.32 decays and 16-bit ring-buffer slots.

| described | on the chip |
| --- | --- |
| mV, nA | s16.15: the number times 32768 |
| `iaf_psc_exp`, weight w | a word of w/1000 x 2^(15 - shift), times a constant factor |
| `iaf_psc_delta`, weight w | a word of w 2^(15 - shift), added to v |
| V_m >= V_th | v >= v_thresh |
| t_ref of R steps | t_refract = R |
| delay of D steps | `iaf_psc_exp`: D + 1, `iaf_psc_delta`: D, see `neuro.chips.arrival_rule` |

The constant factor is that between the chip's integration, which holds the current for a tick, and the exact one: V_m
is then the same at every tick. `iaf_psc_delta` exists on no released SpiNNaker binary. It is emulated as its authors
would write it: the same s16.15 products, slots added to v. Source: sPyNNaker's neuron core (Rhodes et al., Front.
Neurosci. 12:816, 2018).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from neuro.chips.arithmetic import Arithmetic, Option, is_whole
from neuro.chips.arrival_rule import acts_late, register
from neuro.chips.quantising import rounding
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Rounding, WeightRounding, Words
from neuro.chips.quantising.inputs import (
    Inputs,
    Options,
    approximated,
    constants_of,
    converging,
    fall_register,
    has_lowest,
    of_falls,
    of_lowest,
    one_kernel,
    refuse_rules,
    refused,
    too_long,
    too_short,
)
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Population, Program, Projection

LIF, DELTA = "spinnaker_lif", "spinnaker_delta"
"""The steps that neurons take, see `FixedPopulation.kind`."""

REGISTER_OF_ONE = 1
"""What the delay register holds of a spike that acts in the tick after its emission."""

FINE = 256
"""Steps that the largest weight keeps although a slot might then saturate."""


def native(part: Population) -> FixedPopulation:
    """A `spinnaker_lif`: its parameters are the registers."""
    registers = {name: values.astype(np.int64) for name, values in part.parameters.items() if name != "tau_minus"}
    initial = {name: values.astype(np.int64) for name, values in part.initial.items()}
    return FixedPopulation(part.name, LIF, registers, initial, float(ONE))


def native_projection(inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
    """A projection onto a `spinnaker_lif`: its weights are words, negative ones for the inhibitory receptor."""
    part = inputs.program.projections[index]
    problems = [*other_receptor(inputs, index)]
    bad = np.flatnonzero((part.weight != np.rint(part.weight)) | (np.abs(part.weight) > SLOT))
    if bad.size:
        why = f"a word is a whole number from -{SLOT} to {SLOT}"
        problems.append(refused(part, f"weight = {part.weight[bad[0]]:g}", why, "change exc_shift or inh_shift"))
    words: Words = np.clip(np.rint(part.weight), -SLOT, SLOT).astype(np.int32)
    found = rounding.judged(words.astype(float), words, 1.0, -SLOT, SLOT)
    return _projection(part, words, np.ones(1), np.ones(1), inputs.lag(index), found), problems


def _projection(
    part: Projection, words: Words, step: Floats, below: Floats, lag: Words, rounding: WeightRounding
) -> FixedProjection:
    named = None if part.receptor is None else part.receptor.index
    return FixedProjection(
        name=part.name,
        mantissas=words,
        words=words,
        low=0 if named == 0 else -SLOT,
        high=0 if named == 1 else SLOT,
        grain=1,
        exponent=0,
        sign_mode="",
        bits=16,
        step=step,
        step_below=below,
        lag=lag,
        delay=register(lag, REGISTER_OF_ONE),
        rounding=rounding,
    )


def relay_projection(inputs: Inputs, index: int) -> FixedProjection:
    """A projection onto parrots: every spike counts, whatever its weight."""
    part = inputs.program.projections[index]
    ones: Words = np.ones(1, dtype=np.int32)
    return _projection(
        part, ones, part.weight.copy(), part.weight.copy(), inputs.lag(index), WeightRounding(0.0, 0.0, 0.0, 0.0)
    )


def population(inputs: Inputs, options: Options) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """A population of `iaf_psc_delta` or `iaf_psc_exp`, and the projections onto it."""
    delta = isinstance(inputs.part.model, iaf_psc_delta)
    registers, gain, drive, errors = _delta(inputs) if delta else _exponential(inputs)
    shifts = options.of("shifts", inputs.part.name) or _shifts(inputs, gain)
    registers["exc_shift"], registers["inh_shift"] = (np.full(1, shift, dtype=np.int64) for shift in shifts)
    part, p = inputs.part, inputs.part.parameters
    ampere: tuple[Floats, ...] = ()
    initial = {"v": part.initial["V_m"] * ONE}
    if not delta:
        h = inputs.program.resolution
        ampere = tuple(
            g * registers[f"{word}_init"] / FRACTION * ONE / (np.exp(-h / p[tau]) if acts_late(part.model) else 1.0)
            for word, tau, g in zip(("exc", "inh"), ("tau_syn_ex", "tau_syn_in"), gain, strict=True)
        )
        initial["g_exc"], initial["g_inh"] = part.initial["I_syn_ex"] * ampere[0], -part.initial["I_syn_in"] * ampere[1]
    problems = [*lacking(inputs), *overflows(inputs, initial, drive)]
    states = {name: np.clip(np.rint(values), -LARGEST, LARGEST).astype(np.int64) for name, values in initial.items()}
    kind = DELTA if delta else LIF
    fixed = FixedPopulation(part.name, kind, registers, states, float(ONE), np.zeros(1), ampere, drive, tuple(errors))
    found = {}
    for index in inputs.spikes:
        found[index], more = _weights(inputs, index, gain, shifts)
        problems += more
    if delta:
        why = "no released SpiNNaker binary has it: it is emulated in the same arithmetic, slots added to v"
        problems.append(approximated(part, "iaf_psc_delta", why))
    return fixed, found, problems


def _exponential(inputs: Inputs) -> tuple[dict[str, Ints], tuple[Floats, Floats], Floats, list[Rounding]]:
    """Registers of `iaf_psc_exp`, nA in a slot per pA of weight by receptor, i_offset per pA, and what is rounded."""
    from neuro.model.neurons.currents import P11_EX, P11_IN, P32_EX, P32_IN, P33

    part, h = inputs.part, inputs.program.resolution
    p, c = part.parameters, constants_of(inputs.part, inputs.program.resolution)
    r_m = p["tau_m"] / p["C_m"] * 1000.0
    registers = _potentials(inputs, c[:, P33])
    registers["r_m"] = np.rint(np.where(np.isfinite(r_m), r_m, 0.0) * ONE).astype(np.int64)
    registers["i_offset"] = np.rint(p["I_e"] / 1000.0 * ONE).astype(np.int64)
    errors = _rounded_potentials(inputs, registers, c[:, P33])
    gains = []
    for word, tau, kept, exact in (("exc", "tau_syn_ex", P11_EX, P32_EX), ("inh", "tau_syn_in", P11_IN, P32_IN)):
        share = p[tau] / h * -np.expm1(-h / p[tau])
        registers[f"{word}_decay"] = np.floor(FRACTION * c[:, kept]).astype(np.int64)
        registers[f"{word}_init"] = np.minimum(np.floor(FRACTION * share), FRACTION - 1).astype(np.int64)
        with np.errstate(divide="ignore", invalid="ignore"):
            own = c[:, exact] / (r_m * -np.expm1(-h / p["tau_m"]) * share)
        gains.append(np.where(np.isfinite(own), own, 0.001))
    if np.isfinite(p["tau_m"]).all():
        got = p["tau_m"] / np.maximum(registers["r_m"] / ONE, 1e-300) * 1000.0
        errors.append(rounding.worst("C_m", "pF", p["C_m"], got, p["C_m"]))
    errors += _rounded_current(p["I_e"], registers["i_offset"] / ONE * 1000.0)
    return registers, (gains[0], gains[1]), np.full(1, ONE / 1000.0), errors


def _delta(inputs: Inputs) -> tuple[dict[str, Ints], tuple[Floats, Floats], Floats, list[Rounding]]:
    """Registers of `iaf_psc_delta`, mV in a slot per mV of weight, units per pA of current, and what is rounded."""
    from neuro.model.neurons.potentials import P30, P33

    p, c = inputs.part.parameters, constants_of(inputs.part, inputs.program.resolution)
    registers = _potentials(inputs, c[:, P33])
    registers["i_offset"] = np.rint(c[:, P30] * p["I_e"] * ONE).astype(np.int64)
    if has_lowest(inputs.part):
        registers["v_min"] = np.rint(p["V_min"].min(keepdims=True) * ONE).astype(np.int64)
    errors = _rounded_potentials(inputs, registers, c[:, P33])
    errors += _rounded_current(p["I_e"], registers["i_offset"] / ONE / c[:, P30])
    return registers, (np.ones(1), np.ones(1)), c[:, P30] * ONE, errors


def _rounded_current(wanted: Floats, got: Floats) -> list[Rounding]:
    if not wanted.any():
        return []
    return [rounding.worst("I_e", "pA", wanted, got, float(np.abs(wanted).max()))]


def _potentials(inputs: Inputs, leak: Floats) -> dict[str, Ints]:
    p, h = inputs.part.parameters, inputs.program.resolution
    names = {"v_rest": "E_L", "v_reset": "V_reset", "v_thresh": "V_th"}
    registers = {name: np.rint(p[word] * ONE).astype(np.int64) for name, word in names.items()}
    registers["exp_tc"] = np.rint(leak * ONE).astype(np.int64)
    registers["t_refract"] = np.rint(p["t_ref"] / h).astype(np.int64)
    return registers | fall_register(inputs.part, ONE)


def _rounded_potentials(inputs: Inputs, registers: dict[str, Ints], leak: Floats) -> list[Rounding]:
    p, h = inputs.part.parameters, inputs.program.resolution
    with np.errstate(divide="ignore", invalid="ignore"):
        tau = np.where(registers["exp_tc"] >= ONE, np.inf, -h / np.log(registers["exp_tc"] / ONE))
    distance = np.abs(p["V_th"] - p["E_L"])
    return [
        rounding.worst("tau_m", "ms", p["tau_m"], tau, p["tau_m"]),
        rounding.worst("V_th", "mV", p["V_th"], registers["v_thresh"] / ONE, distance),
        rounding.worst("V_reset", "mV", p["V_reset"], registers["v_reset"] / ONE, distance),
        rounding.worst("t_ref", "ms", p["t_ref"], registers["t_refract"] * h, 1.0),
    ]


def _shifts(inputs: Inputs, gain: tuple[Floats, Floats]) -> tuple[int, int]:
    """Shifts of the two receptors: one spike of every synapse saturates no slot, unless weights lose their grain.

    A slot that could hold all synapses of a neuron at once is too coarse for a weight where many converge; then the
    largest weight keeps `FINE` steps and saturation, should it happen, is counted.
    """
    found = []
    for sign, own in zip((1.0, -1.0), gain, strict=True):
        largest, total = 0.0, np.zeros(inputs.part.size)
        for index in inputs.spikes:
            low, high = inputs.bounds(index)
            largest = max(largest, high if sign > 0.0 else -low)
            total += converging(inputs, index, sign)
        scale = ONE * float(own.max())
        safe = _fitting(float(total.max(initial=0.0)) * scale)
        fine = int(np.floor(np.log2(max(largest * scale / FINE, 1.0))))
        found.append(int(np.clip(max(_fitting(largest * scale), min(safe, fine)), 0, LARGEST_SHIFT)))
    return found[0], found[1]


def _fitting(value: float) -> int:
    """The smallest shift with which a value fits into a slot."""
    return max(0, int(np.ceil(np.log2(value / SLOT)))) if value > SLOT else 0


def _weights(
    inputs: Inputs, index: int, gain: tuple[Floats, Floats], shifts: tuple[int, int]
) -> tuple[FixedProjection, list[Problem]]:
    """The weights of a projection as words."""
    part = inputs.program.projections[index]
    problems = [*one_kernel(inputs, index, gain[0].size), *other_receptor(inputs, index)]
    steps = [2.0**shift / (ONE * own) for shift, own in zip(shifts, gain, strict=True)]
    if steps[0].size > 1 and part.grid is None:
        steps = [step[inputs.targets(index)] for step in steps]
    else:
        steps = [step[:1] for step in steps]
    words, found = rounding.fitted(part.weight, steps[0], steps[1], -SLOT, SLOT, 1, inputs.keeps(index))
    if found.saturated > 0.0:
        step = np.where(part.weight < 0.0, steps[1], steps[0])
        beyond = rounding.beyond(part.weight, step, -SLOT, SLOT)
        word, shift = ("inh_shift", shifts[1]) if beyond.weight < 0.0 else ("exc_shift", shifts[0])
        problems.append(
            refused(
                part,
                f"weight = {beyond.weight:g}",
                f"a word of 16 bits holds at most {SLOT * beyond.step:.6g} at {word} {shift}",
                "use a larger shift, or leave it to be chosen" if shift < LARGEST_SHIFT else "scale the weights down",
            )
        )
    return _projection(part, words, steps[0], steps[1], inputs.lag(index), found), problems


ONE = 32768
"""1.0 in s16.15."""

SLOT = 65535
LARGEST = 2**31 - 1
FRACTION = 2.0**32
LARGEST_SHIFT = 15


def lacking(inputs: Inputs) -> Iterator[Problem]:
    """All that the chip's programs lack of a population."""
    part, p, h = inputs.part, inputs.part.parameters, inputs.program.resolution
    delta = isinstance(inputs.part.model, iaf_psc_delta)
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in p:
            yield from too_short(part, name, h)
    if np.isinf(p["tau_m"]).any() and not delta:
        why = "the membrane resistance tau_m / C_m would be infinite"
        yield refused(part, "tau_m = inf", why, "use a finite tau_m, or iaf_psc_delta")
    yield from too_long(part, "tau_m", h, -h / np.log1p(-1.0 / ONE), "a decay of 15 bits", delta)
    ticks = float(p["t_ref"].max()) / h
    if ticks > LARGEST:
        why = f"{ticks:g} ticks, and t_refract holds at most {LARGEST}"
        yield refused(part, f"t_ref = {p['t_ref'].max():g} ms", why, f"use at most {LARGEST * h:g} ms")
    yield from of_lowest(part)
    if p.get("refractory_input", np.zeros(1)).any():
        why = "the chip's programs lose input while a neuron is refractory"
        yield refused(part, "refractory_input", why, "leave it out")
    yield from of_falls(part, "no released SpiNNaker binary has it: it is one subtraction in the same arithmetic")


def other_receptor(inputs: Inputs, index: int) -> Iterator[Problem]:
    """Why a projection cannot name its receptor: it is not the one that the signs of its weights choose."""
    part = inputs.program.projections[index]
    if part.receptor is not None and not part.as_by_sign(part.weight):
        yield refused(
            part,
            f"receptor '{part.receptor.name}' by name",
            "slots have no sign: what is excitatory is added, what is inhibitory subtracted",
            "use weights of at least 0 onto 'ex' and of at most 0 onto 'in', or run it on event",
        )


def overflows(inputs: Inputs, initial: Mapping[str, Floats], drive: Floats) -> Iterator[Problem]:
    """Numbers that s16.15 does not hold.

    Args:
        inputs: the population.
        initial: its state registers at step 0.
        drive: units of a constant current per pA.
    """
    part, p = inputs.part, inputs.part.parameters
    current = np.abs(p["I_e"]) + inputs.current
    held = [(f"{name} = {_largest(p[name]):g} mV", p[name] * ONE) for name in ("E_L", "V_reset", "V_th")]
    held.append((f"V_m = {_largest(part.initial['V_m']):g} mV at step 0", initial["v"]))
    if "tau_syn_ex" in p and np.isfinite(p["tau_m"]).all():
        resistance = p["tau_m"] / p["C_m"] * 1000.0
        held.append((f"tau_m / C_m = {_largest(resistance):g} MOhm", resistance * ONE))
    held.append((f"a constant current of {_largest(current):g} pA", current * drive))
    for name, state in (("I_syn_ex", "g_exc"), ("I_syn_in", "g_inh")):
        if state in initial:
            held.append((f"{name} = {_largest(part.initial[name]):g} pA at step 0", initial[state]))
    for what, values in held:
        if np.abs(values).max(initial=0.0) > LARGEST:
            units = float(np.abs(values).max()) / ONE
            why = f"it takes {units:.6g} in s16.15, which holds numbers below 65536"
            yield refused(part, what, why, "scale the model down")


def _largest(values: Floats) -> float:
    return float(values.flat[int(np.argmax(np.abs(values)))])


_TICK_MS = 1.0


def _two_shifts(value: Any) -> bool:
    shifts = range(LARGEST_SHIFT + 1)
    return isinstance(value, (tuple, list)) and len(value) == 2 and all(is_whole(shift, shifts) for shift in value)


_OPTIONS = (
    Option(
        "shifts",
        "populations",
        _two_shifts,
        f"the shifts of excitatory and inhibitory slots, two whole numbers up to {LARGEST_SHIFT}",
    ),
)


def _kept_shifts(cells: FixedPopulation) -> tuple[int, int] | None:
    r = cells.registers
    return (int(r["exc_shift"][0]), int(r["inh_shift"][0])) if "exc_shift" in r else None


def _kept_options(cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
    shifts = _kept_shifts(cells)
    return Options({} if shifts is None else {"shifts": {cells.name: shifts}})


def _told_scale(cells: FixedPopulation, wires: FixedProjection) -> str:
    shifts = _kept_shifts(cells)
    return "-" if shifts is None else "shifts {}, {}".format(*shifts)


def _notes(program: Program) -> Iterator[str]:
    if program.resolution != _TICK_MS:
        yield f"a step of {program.resolution:g} ms takes a tick of {_TICK_MS:g} ms on the machine"


SPINNAKER = Arithmetic(
    name="spinnaker",
    title="SpiNNaker",
    models=(iaf_psc_exp, iaf_psc_delta),
    options=_OPTIONS,
    state_limit=LARGEST,
    register_of_one=REGISTER_OF_ONE,
    one_bit=False,
    graded=False,
    in_rows=True,
    keeps_kernels=False,
    multicast=True,
    population=population,
    native=native,
    native_projection=native_projection,
    relay_projection=relay_projection,
    give_rules=refuse_rules,
    kept_options=_kept_options,
    filled=None,
    told_scale=_told_scale,
    lossless=lambda wires: "",
    notes=_notes,
)
