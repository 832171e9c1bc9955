"""SpiNNaker 1: s16.15 neurons, unsigned 0.32 decays and 16-bit ring-buffer slots.

Any table with `arithmetic: spinnaker` uses it.

| described | on the chip |
| --- | --- |
| mV, nA | s16.15: the number times 32768 |
| `iaf_psc_exp`, weight w | a word of w/1000 x 2^(15 - shift), times a constant factor |
| `iaf_psc_delta`, weight w | a word of w 2^(15 - shift), added to v |
| V_m >= V_th | v >= v_thresh |
| t_ref of R steps | t_refract = R |
| delay of D steps | `iaf_psc_exp`: D + 1, `iaf_psc_delta`: D, see `neuro.chips.inputs` |

The constant factor compensates for the chip's integration, which holds the current constant during a tick. With the
factor, V_m equals the V_m of exact integration at every tick. No released SpiNNaker binary has `iaf_psc_delta`; its
emulation uses the same s16.15 products and adds slots to v. Source: sPyNNaker's neuron core (Rhodes et al., Front.
Neurosci. 12:816, 2018).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetic import SIGNALS, Arithmetic, Option, Projections, is_whole
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
    worst_rounding,
)
from neuro.chips.inputs import (
    Inputs,
    Options,
    acts_late,
    approximated,
    constants_of,
    converging,
    has_lowest_potential,
    lowest_potential_problems,
    one_kernel,
    refused,
    register,
    soft_reset_problems,
    soft_reset_register,
    too_long,
    too_short,
)
from neuro.core.errors import ModelError
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp
from neuro.model.synapses import static
from neuro.program.backend import Problem
from neuro.program.program import Floats, Ints, Program

LIF, DELTA = "spinnaker_lif", "spinnaker_delta"
"""Integer steps of neurons, see `FixedPopulation.kind`."""

REGISTER_OF_ONE = 1
"""Content of the delay register for a delay of one tick."""

FINE = 256
"""Smallest number of steps of the largest weight, even if slots can saturate."""


def _exponential(inputs: Inputs) -> tuple[dict[str, Ints], tuple[Floats, Floats], Floats, list[Rounding]]:
    """Return registers of `iaf_psc_exp`, nA in a slot per pA of weight by receptor, i_offset per pA, and roundings."""
    from neuro.model.neurons.currents import P11_EX, P11_IN, P32_EX, P32_IN, P33

    part, h = inputs.part, inputs.program.resolution
    p, c = part.parameters, constants_of(inputs.part, inputs.program.resolution)
    r_m = p["tau_m"] / p["C_m"] * 1000.0
    registers = _potentials(inputs, c[:, P33])
    registers["r_m"] = np.rint(np.where(np.isfinite(r_m), r_m, 0.0) * ONE).astype(np.int64)
    registers["i_offset"] = np.rint(p["I_e"] / 1000.0 * ONE).astype(np.int64)
    errors = _rounded_potentials(inputs, registers, c[:, P33])
    gains = []
    for word, tau, decay, response in (("exc", "tau_syn_ex", P11_EX, P32_EX), ("inh", "tau_syn_in", P11_IN, P32_IN)):
        share = p[tau] / h * -np.expm1(-h / p[tau])
        registers[f"{word}_decay"] = np.floor(FRACTION * c[:, decay]).astype(np.int64)
        registers[f"{word}_init"] = np.minimum(np.floor(FRACTION * share), FRACTION - 1).astype(np.int64)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = c[:, response] / (r_m * -np.expm1(-h / p["tau_m"]) * share)
        gains.append(np.where(np.isfinite(factor), factor, 0.001))
    if np.isfinite(p["tau_m"]).all():
        actual = p["tau_m"] / np.maximum(registers["r_m"] / ONE, 1e-300) * 1000.0
        errors.append(worst_rounding("C_m", "pF", p["C_m"], actual, p["C_m"]))
    if p["I_e"].any():
        actual = registers["i_offset"] / ONE * 1000.0
        errors.append(worst_rounding("I_e", "pA", p["I_e"], actual, float(np.abs(p["I_e"]).max())))
    return registers, (gains[0], gains[1]), np.full(1, ONE / 1000.0), errors


def _delta(inputs: Inputs) -> tuple[dict[str, Ints], tuple[Floats, Floats], Floats, list[Rounding]]:
    """Return registers of `iaf_psc_delta`, mV in a slot per mV of weight, units per pA of current, and roundings."""
    from neuro.model.neurons.potentials import P30, P33

    p, c = inputs.part.parameters, constants_of(inputs.part, inputs.program.resolution)
    registers = _potentials(inputs, c[:, P33])
    registers["i_offset"] = np.rint(c[:, P30] * p["I_e"] * ONE).astype(np.int64)
    if has_lowest_potential(inputs.part):
        registers["v_min"] = np.rint(p["V_min"].min(keepdims=True) * ONE).astype(np.int64)
    errors = _rounded_potentials(inputs, registers, c[:, P33])
    if p["I_e"].any():
        actual = registers["i_offset"] / ONE / c[:, P30]
        errors.append(worst_rounding("I_e", "pA", p["I_e"], actual, float(np.abs(p["I_e"]).max())))
    return registers, (np.ones(1), np.ones(1)), c[:, P30] * ONE, errors


def _potentials(inputs: Inputs, leak: Floats) -> dict[str, Ints]:
    p, h = inputs.part.parameters, inputs.program.resolution
    names = {"v_rest": "E_L", "v_reset": "V_reset", "v_thresh": "V_th"}
    registers = {name: np.rint(p[word] * ONE).astype(np.int64) for name, word in names.items()}
    registers["exp_tc"] = np.rint(leak * ONE).astype(np.int64)
    registers["t_refract"] = np.rint(p["t_ref"] / h).astype(np.int64)
    return registers | soft_reset_register(inputs.part, ONE)


def _rounded_potentials(inputs: Inputs, registers: dict[str, Ints], leak: Floats) -> list[Rounding]:
    p, h = inputs.part.parameters, inputs.program.resolution
    with np.errstate(divide="ignore", invalid="ignore"):
        tau = np.where(registers["exp_tc"] >= ONE, np.inf, -h / np.log(registers["exp_tc"] / ONE))
    distance = np.abs(p["V_th"] - p["E_L"])
    return [
        worst_rounding("tau_m", "ms", p["tau_m"], tau, p["tau_m"]),
        worst_rounding("V_th", "mV", p["V_th"], registers["v_thresh"] / ONE, distance),
        worst_rounding("V_reset", "mV", p["V_reset"], registers["v_reset"] / ONE, distance),
        worst_rounding("t_ref", "ms", p["t_ref"], registers["t_refract"] * h, 1.0),
    ]


def _shifts(inputs: Inputs, gain: tuple[Floats, Floats]) -> tuple[int, int]:
    """Return the shifts of both receptors. If possible, one spike of every synapse saturates no slot.

    If many synapses converge, a slot that can hold all of them is too coarse for a single weight. The largest weight
    then keeps `FINE` steps, and saturations are counted.
    """
    shifts = []
    for sign, gains in zip((1.0, -1.0), gain, strict=True):
        largest, total = 0.0, np.zeros(inputs.part.size)
        for index in inputs.spikes:
            low, high = inputs.bounds(index)
            largest = max(largest, high if sign > 0.0 else -low)
            total += converging(inputs, index, sign)
        scale = ONE * float(gains.max())
        safe_shift = _smallest_shift(float(total.max(initial=0.0)) * scale)
        fine = int(np.floor(np.log2(max(largest * scale / FINE, 1.0))))
        shifts.append(int(np.clip(max(_smallest_shift(largest * scale), min(safe_shift, fine)), 0, LARGEST_SHIFT)))
    return shifts[0], shifts[1]


def _host_shifts(inputs: Inputs, gain: tuple[Floats, Floats]) -> tuple[int, int]:
    """Return the shifts of both receptors, for projections that learn, by the rule of sPyNNaker's host.

    A slot holds one spike of every source with the largest weight of the projection. Random delays are treated as
    fixed.
    """
    shifts = []
    for sign, gains in zip((1.0, -1.0), gain, strict=True):
        largest = total = 0.0
        for index in inputs.spikes:
            low, high = inputs.bounds(index)
            weight = max(high if sign > 0.0 else -low, 0.0) * float(gains.max())
            counts = converging(inputs, index, 1.0, np.ones(1))
            largest, total = max(largest, weight), total + weight * float(counts.max(initial=0.0))
        bound = max(largest, total)
        shift = max(0, int(np.ceil(np.log2(bound)))) if bound > 1.0 else 0
        shifts.append(min(shift + (2.0**shift <= bound), LARGEST_SHIFT))
    return shifts[0], shifts[1]


def _smallest_shift(value: float) -> int:
    """Return the smallest shift with which a value fits into a slot."""
    return max(0, int(np.ceil(np.log2(value / SLOT)))) if value > SLOT else 0


ONE = 32768
"""1.0 in s16.15."""

SLOT = 65535
LARGEST = 2**31 - 1
FRACTION = 2.0**32
LARGEST_SHIFT = 15


def missing_features(inputs: Inputs) -> Iterator[Problem]:
    """Yield the features of a population that the chip's programs lack."""
    part, p, h = inputs.part, inputs.part.parameters, inputs.program.resolution
    delta = isinstance(inputs.part.model, iaf_psc_delta)
    for name in ("tau_m", "tau_syn_ex", "tau_syn_in"):
        if name in p:
            yield from too_short(part, name, h)
    if np.isinf(p["tau_m"]).any() and not delta:
        reason = "the membrane resistance tau_m / C_m would be infinite"
        yield refused(part, "tau_m = inf", reason, "use a finite tau_m, or iaf_psc_delta")
    yield from too_long(part, "tau_m", h, -h / np.log1p(-1.0 / ONE), "a decay of 15 bits", delta)
    ticks = float(p["t_ref"].max()) / h
    if ticks > LARGEST:
        reason = f"{ticks:g} ticks, and t_refract holds at most {LARGEST}"
        yield refused(part, f"t_ref = {p['t_ref'].max():g} ms", reason, f"use at most {LARGEST * h:g} ms")
    yield from lowest_potential_problems(part)
    if p.get("refractory_input", np.zeros(1)).any():
        reason = "the chip's programs lose input while a neuron is refractory"
        yield refused(part, "refractory_input", reason, "leave it out")
    yield from soft_reset_problems(
        part, "no released SpiNNaker binary has it: it is one subtraction in the same arithmetic"
    )


def other_receptor(inputs: Inputs, index: int) -> Iterator[Problem]:
    """Yield a problem if a projection names the receptor that the signs of its weights do not select."""
    part = inputs.program.projections[index]
    if part.receptor is not None and not part.as_by_sign(part.weight):
        yield refused(
            part,
            f"receptor '{part.receptor.name}' by name",
            "slots have no sign: excitatory input is added and inhibitory input subtracted",
            "use weights of at least 0 onto 'ex' and of at most 0 onto 'in', or run it on event",
        )


def overflows(inputs: Inputs, initial: Mapping[str, Floats], drive: Floats) -> Iterator[Problem]:
    """Yield values that s16.15 cannot hold.

    Args:
        inputs: the population.
        initial: state registers of the population at step 0.
        drive: units of a constant current per pA.
    """
    part, p = inputs.part, inputs.part.parameters
    current = np.abs(p["I_e"]) + inputs.current
    checks = [(f"{name} = {_largest(p[name]):g} mV", p[name] * ONE) for name in ("E_L", "V_reset", "V_th")]
    checks.append((f"V_m = {_largest(part.initial['V_m']):g} mV at step 0", initial["v"]))
    if "tau_syn_ex" in p and np.isfinite(p["tau_m"]).all():
        resistance = p["tau_m"] / p["C_m"] * 1000.0
        checks.append((f"tau_m / C_m = {_largest(resistance):g} MOhm", resistance * ONE))
    checks.append((f"a constant current of {_largest(current):g} pA", current * drive))
    for name, state in (("I_syn_ex", "g_exc"), ("I_syn_in", "g_inh")):
        if state in initial:
            checks.append((f"{name} = {_largest(part.initial[name]):g} pA at step 0", initial[state]))
    for quantity, values in checks:
        if np.abs(values).max(initial=0.0) > LARGEST:
            units = float(np.abs(values).max()) / ONE
            reason = f"it is {units:.6g} in s16.15, which holds numbers below 65536"
            yield refused(part, quantity, reason, "scale the model down")


def _largest(values: Floats) -> float:
    return float(values.flat[int(np.argmax(np.abs(values)))])


class SpiNNaker(Arithmetic):
    """The integer arithmetic of SpiNNaker 1."""

    name = "spinnaker"
    title = "SpiNNaker"
    models = (iaf_psc_exp, iaf_psc_delta)
    options = (
        Option(
            "shifts",
            "populations",
            lambda value: (
                isinstance(value, (tuple, list))
                and len(value) == 2
                and all(is_whole(shift, range(LARGEST_SHIFT + 1)) for shift in value)
            ),
            f"the shifts of excitatory and inhibitory slots, two whole numbers up to {LARGEST_SHIFT}",
        ),
        SIGNALS,
    )
    state_limit = LARGEST
    native_volt = float(ONE)
    register_of_one = REGISTER_OF_ONE
    in_rows = True
    multicast = True
    receptors = 2
    stands_for: Mapping[str, str] = {
        **{"V_m": "v", "I_syn_ex": "g_exc", "I_syn_in": "g_inh", "tau_m": "exp_tc", "V_th": "v_thresh"},
        **{"tau_syn_ex": "exc_decay", "tau_syn_in": "inh_decay", "I_e": "i_offset", "t_ref": "t_refract"},
        **{"E_L": "v_rest", "V_reset": "v_reset", "C_m": "r_m"},
    }
    states: Mapping[str, tuple[str, ...]] = {LIF: ("v", "g_exc", "g_inh"), DELTA: ("v",)}

    def words(self, wires: FixedProjection, mantissas: Words) -> Words:
        """Return the mantissas, which are the words."""
        return mantissas

    def _wires(
        self, inputs: Inputs, index: int, words: Words, step: Floats, below: Floats, rounding: WeightRounding
    ) -> FixedProjection:
        """Return a projection with given words, and with the weights of a positive and of a negative unit."""
        part, lag = inputs.program.projections[index], inputs.lag(index)
        receptor = None if part.receptor is None else part.receptor.index
        return FixedProjection(
            name=part.name,
            mantissas=words,
            words=words,
            low=0 if receptor == 0 else -SLOT,
            high=0 if receptor == 1 else SLOT,
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

    def native_projection(self, inputs: Inputs, index: int) -> tuple[FixedProjection, list[Problem]]:
        """Return a projection onto a `spinnaker_lif`, whose weights are words; negative words inhibit."""
        part = inputs.program.projections[index]
        problems = [*other_receptor(inputs, index)]
        bad = np.flatnonzero((part.weight != np.rint(part.weight)) | (np.abs(part.weight) > SLOT))
        if bad.size:
            reason = f"a word is a whole number from -{SLOT} to {SLOT}"
            problems.append(refused(part, f"weight = {part.weight[bad[0]]:g}", reason, "change exc_shift or inh_shift"))
        words: Words = np.clip(np.rint(part.weight), -SLOT, SLOT).astype(np.int32)
        rounding = judge_weights(words.astype(float), words, 1.0, -SLOT, SLOT)
        return self._wires(inputs, index, words, np.ones(1), np.ones(1), rounding), problems

    def relay_projection(self, inputs: Inputs, index: int) -> FixedProjection:
        """Return a projection onto parrots. The host relays every spike, independent of the weight."""
        step = inputs.program.projections[index].weight.copy()
        return self._wires(inputs, index, np.ones(1, dtype=np.int32), step, step, WeightRounding(0.0, 0.0, 0.0, 0.0))

    def population(self, inputs: Inputs, options: Options) -> tuple[FixedPopulation, Projections, list[Problem]]:
        """Quantise a population of `iaf_psc_delta` or `iaf_psc_exp` and the projections onto it."""
        delta = isinstance(inputs.part.model, iaf_psc_delta)
        registers, gain, drive, errors = _delta(inputs) if delta else _exponential(inputs)
        learns = any(inputs.program.projections[index].synapse.learns in ("pairs", "chip") for index in inputs.spikes)
        shifts = options.of("shifts", inputs.part.name) or (_host_shifts if learns else _shifts)(inputs, gain)
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
            initial["g_exc"], initial["g_inh"] = (
                part.initial["I_syn_ex"] * ampere[0],
                -part.initial["I_syn_in"] * ampere[1],
            )
        problems = [*missing_features(inputs), *overflows(inputs, initial, drive)]
        states = {
            name: np.clip(np.rint(values), -LARGEST, LARGEST).astype(np.int64) for name, values in initial.items()
        }
        kind = DELTA if delta else LIF
        fixed = FixedPopulation(
            part.name, kind, registers, states, float(ONE), np.zeros(1), ampere, drive, tuple(errors)
        )
        wires = {}
        for index in inputs.spikes:
            wires[index], more = self._weights(inputs, index, gain, shifts)
            problems += more
        if delta:
            reason = "no released SpiNNaker binary has it: it is emulated in the same arithmetic, slots added to v"
            problems.append(approximated(part, "iaf_psc_delta", reason))
        return fixed, wires, problems

    def _weights(
        self, inputs: Inputs, index: int, gain: tuple[Floats, Floats], shifts: tuple[int, int]
    ) -> tuple[FixedProjection, list[Problem]]:
        """Convert the weights of a projection to words."""
        part = inputs.program.projections[index]
        problems = [*one_kernel(inputs, index, gain[0].size), *other_receptor(inputs, index)]
        steps = [2.0**shift / (ONE * gains) for shift, gains in zip(shifts, gain, strict=True)]
        if steps[0].size > 1 and part.grid is None:
            steps = [step[inputs.targets(index)] for step in steps]
        else:
            steps = [step[:1] for step in steps]
        words, rounding = round_weights(part.weight, steps[0], steps[1], -SLOT, SLOT, 1, inputs.keeps(index))
        if rounding.saturated > 0.0:
            step = np.where(part.weight < 0.0, steps[1], steps[0])
            farthest = farthest_weight(part.weight, step, -SLOT, SLOT)
            word, shift = ("inh_shift", shifts[1]) if farthest.weight < 0.0 else ("exc_shift", shifts[0])
            problems.append(
                refused(
                    part,
                    f"weight = {farthest.weight:g}",
                    f"a word of 16 bits holds at most {SLOT * farthest.step:.6g} at {word} {shift}",
                    "use a larger shift, or leave out the option 'shifts'"
                    if shift < LARGEST_SHIFT
                    else "scale the weights down",
                )
            )
        return self._wires(inputs, index, words, steps[0], steps[1], rounding), problems

    def give_rules(
        self, program: Program, chip: Chip, cells: list[FixedPopulation], wires: Projections, options: Options
    ) -> Iterator[Problem]:
        """Set the rules of the projections that learn on the machine; yield refusals and approximations."""
        if all(type(part.synapse) is static for part in program.projections):
            return iter(())
        from neuro.chips.spinnaker_learning import give_rules

        return give_rules(program, chip, cells, wires, options)

    def core_bytes(self, program: Program, chip: Chip, population: int, neurons: int) -> int:
        """Return the bytes of a core's own memory for learning onto some neurons."""
        if all(type(part.synapse) is static for part in program.projections):
            return 0
        from neuro.chips.spinnaker_core import bytes_of

        return bytes_of(program, chip, population, neurons)

    def learning_notes(
        self,
        program: Program,
        chip: Chip,
        cores: Sequence[Sequence[tuple[int, int, int]]],
        visits: Mapping[int, tuple[float, float]] | None = None,
    ) -> Iterator[str]:
        """Yield notes on the memory and the cycles that learning needs."""
        if any(type(part.synapse) is not static for part in program.projections):
            from neuro.chips.spinnaker_core import learning_notes

            yield from learning_notes(program, chip, cores, visits)

    def scale_options(self, cells: FixedPopulation, wires: tuple[FixedProjection, ...]) -> Options:
        """Return the present shifts of a population."""
        shifts = self._shifts_of(cells)
        return Options({} if shifts is None else {"shifts": {cells.name: shifts}})

    def _shifts_of(self, cells: FixedPopulation) -> tuple[int, int] | None:
        r = cells.registers
        return (int(r["exc_shift"][0]), int(r["inh_shift"][0])) if "exc_shift" in r else None

    def scale_text(self, cells: FixedPopulation, wires: FixedProjection) -> str:
        """Return the shifts of the target for the report."""
        shifts = self._shifts_of(cells)
        return "-" if shifts is None else "shifts {}, {}".format(*shifts)

    def notes(self, program: Program) -> Iterator[str]:
        """Yield a note if a tick has another length than a step."""
        if program.resolution != 1.0:
            yield f"a step of {program.resolution:g} ms is a tick of 1 ms on the machine"

    def current(self, cells: FixedPopulation, name: str, states: Mapping[str, NDArray[np.int32]]) -> Floats:
        """Return a synaptic current in pA. The inhibitory register holds its negative."""
        return states["g_exc"] / cells.ampere[0] if name == "I_syn_ex" else -states["g_inh"] / cells.ampere[1]

    def units(self, cells: FixedPopulation, name: str, values: Floats) -> Floats:
        """Return a synaptic current in pA as units of its register."""
        return values * cells.ampere[0] if name == "I_syn_ex" else -values * cells.ampere[1]

    def bias(self, cells: FixedPopulation, current: Floats) -> NDArray[np.int32]:
        """Return the offset register: the constant current plus an extra current in pA."""
        offset = cells.registers["i_offset"] + np.rint(current * cells.drive).astype(np.int64)
        if np.abs(offset).max() > LARGEST:
            raise ModelError(
                f"population '{cells.name}': a current of {np.abs(current).max():g} pA overflows the offset register",
                hint="lower the amplitude of the dc_generator",
            )
        return offset.astype(np.int32)

    def way_out(self, cells: FixedPopulation) -> str:
        """Return the option with shifts that make the slots four times as large."""
        if (shifts := self._shifts_of(cells)) is None:
            return ""
        larger_shifts = tuple(min(LARGEST_SHIFT, shift + 2) for shift in shifts)
        return f"shifts={{'{cells.name}': {larger_shifts}}} makes the slots 4 times as large"


SPINNAKER = SpiNNaker()
