"""Write a network as a folder of C: `NAME.c`, `NAME.h`, and a test with a recorded run.

The C code computes with the same integers as an emulated chip.

The test compares digests. A digest is the sum of hashes of all numbers and their places, modulo 2^64. Two runs with the
same digests in all steps have the same spikes and states, up to a chance of 2^-64 per step.
"""

from __future__ import annotations

import copy
import re
import warnings
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import (
    ApproximationWarning,
    ModelError,
    Network,
    OverflowWarning,
    Simulation,
    compile,
    poisson_generator,
    spike_generator,
)
from neuro.apps import Clock, Quantity, check, file_path, keyed_random, make_folder, output, sealed, unknown
from neuro.chips import FixedProgram, arithmetic_of, chip, quantise
from neuro.extend import Chip, Ints, Population, Problem, Program, Projection, spinnaker_rule as sr
from neuro_exchange.c_code.arrays import Memory, number
from neuro_exchange.c_code.cells import function, supports
from neuro_exchange.c_code.source import FAMILIES, INPUTS, MARK, STEPS, Dopamine, Source, source_of
from neuro_exchange.templates import filled

__all__ = ["CCode", "save_c"]

KIND = sealed("a file of C of neuro, as it was written", MARK, "; digest {}")
_BYTES = Quantity(unit="bytes", doc="size of a memory", kind="integer", at_least=0, optional=True)
_DURATION = Quantity(unit="ms", doc="duration of the recorded run", above=0, optional=True)
_FLAG = Quantity(kind="boolean")
_WORD = re.compile(r"[a-z][a-z0-9_]{0,39}")
_TEMPLATES = files("neuro_exchange.c_code").joinpath("templates")
_SHORTEST, _LONGEST, _AFTER = 100, 1000, 20
"""Default duration of the recorded run in steps: `_AFTER` steps after the last spike, within these bounds."""
_MOST = 100_000
"""Longest recorded run in steps."""
_PROBABILITY = 0.05
"""Probability of a spike of an input, or of a new value of a signal, in a step of random input."""


@dataclass(frozen=True, slots=True)
class CCode:
    """Summary of an exported network. Summaries print as a few lines.

    Attributes:
        folder: folder of the files.
        name: prefix of the public names.
        chip: chip whose integers the program computes with.
        flash: bytes of constant tables.
        code: upper bound of the bytes of machine code on a Cortex-M4.
        ram: upper bound of the bytes of states and the gaps between them.
        steps: steps of the recorded run.
        random_input: whether the input of the recorded run is random, since the network's inputs send no spikes.
        input_spikes: spikes of inputs in the recorded run.
        output_spikes: spikes of outputs in the recorded run.
        rewards: number of times that the recorded run sets a signal.
    """

    folder: Path
    name: str
    chip: str
    flash: int
    code: int
    ram: int
    steps: int
    random_input: bool
    input_spikes: int
    output_spikes: int
    rewards: int

    def __str__(self) -> str:
        random = " (random, since the network's inputs send none)" if self.random_input else ""
        rewards = f", {self.rewards:,} rewards" if self.rewards else ""
        return "\n".join(
            [
                f"{self.folder}: {self.name}.c and {self.name}.h, in the integers of {self.chip}",
                f"  flash  {self.flash + self.code:,} bytes: tables {self.flash:,}, code at most {self.code:,}",
                f"  RAM    at most {self.ram:,} bytes, without the stack and the caller's events",
                f"  test   {self.steps:,} steps: {self.input_spikes:,} input spikes{random}, "
                f"{self.output_spikes:,} output spikes{rewards}",
                f"  make -C {self.folder} test compares every spike and state with the emulator",
            ]
        )


def save_c(
    net: Network,
    folder: str | PathLike[str],
    *,
    chip: str = "loihi",
    name: str = "net",
    ram: int | None = None,
    flash: int | None = None,
    duration: float | None = None,
    given: InputSpikes | None = None,
    frozen: bool = False,
    seed: int = 0,
    signals: Mapping[str, float] | None = None,
) -> CCode:
    """Write a network in the integers of an emulated chip as C99 for a microcontroller.

    The program allocates no memory and uses no floating-point numbers. Spikes and states are equal to those of the
    emulator in every step. Inputs are the spikes of all generators and the values of all signals. Outputs are the
    populations whose spikes are probed; without probes, the populations that send to no other population.

    Args:
        net: the network.
        folder: folder for the files; a missing folder is created.
        chip: name or table of a chip.
        name: prefix of the public names: small letters, digits, `_`.
        ram: largest size of the states in bytes; an error above.
        flash: largest size of tables and code in bytes; an error above.
        duration: duration of the recorded run in ms; default: a few steps longer than the network's listed spikes.
        given: inputs of the recorded run by name. For an input: arrays of steps (from 1), neurons, and payloads if it
            has payloads; default: the network's own spikes, or random spikes if it has none. For a signal: arrays of
            the steps after which it is set, and of values in 1/ms, one per step or one per step and neuron; default:
            random values.
        frozen: whether to leave out learning rules, and keep the weights of the network.
        seed: seed of everything random.
        signals: the largest dopamine in 1/ms that a signal will set, by projection; default: 4/tau_n.

    Returns:
        A summary with the sizes.

    Raises:
        ModelError: the chip cannot run the network, a part has no counterpart in C, or the program is too large.
    """
    if not isinstance(net, Network):
        raise ModelError(f"save_c: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    limits = {"flash": check(_BYTES, flash, "flash"), "RAM": check(_BYTES, ram, "ram")}
    reserved = {Path(path.name).stem for path in _TEMPLATES.iterdir()}
    if not (isinstance(name, str) and _WORD.fullmatch(name)) or name in reserved or name.endswith(("_run", "_test")):
        hint = f"reserved: {', '.join(sorted(reserved))}, and names that end in _run or _test"
        raise ModelError(f"name = {name!r:.60}: expected small letters, digits and _, as in 'net'", hint=hint)
    target = check_chip(chip)
    exported_net = net.frozen() if check(_FLAG, frozen, "frozen") else net
    recording_net = with_recorded_spikes(exported_net, given if isinstance(given, Mapping) else ())
    sim, fixed = _compile(recording_net, target, {"backend": chip, "seed": seed}, signals)
    program = sim.program
    neurons = [part.name for part in program.populations if part.kind == "neuron"]
    probed_names = {probe.of for probe in net.probes.values() if "spikes" in probe.record}
    sending_names = {part.source for part in net.projections.values() if part.source != part.target}
    sending_names |= {program.populations[part.dopamine].name for part in program.projections if part.dopamine >= 0}
    probed_neurons = tuple(name for name in neurons if name in probed_names)
    outputs = probed_neurons or tuple(name for name in neurons if name not in sending_names) or tuple(neurons)
    source = source_of(fixed, name, outputs)
    code = 400 + 16 * source.code.count(";")  # upper bound on a Cortex-M4
    for memory, limit, size in (("flash", limits["flash"], source.flash + code), ("RAM", limits["RAM"], source.ram)):
        if limit is not None and size > limit:
            hint = "fewer neurons, shorter delays or shared kernels (grid) need less"
            raise ModelError(
                f"{memory}: network '{net.name}' needs {size:,} bytes: expected at most {limit:,}", hint=hint
            )
    input_events, rewards = _check_given(given, source.signals)
    steps = _steps(program, check(_DURATION, duration, "duration"), input_events, rewards)
    rewards = {**_draw_rewards(source.signals, steps), **rewards}
    run, random_input = _run(sim, source, outputs, steps, input_events, rewards)
    place = file_path(folder, "folder")
    values = {"name": name, "NAME": name.upper(), "chip": target.arithmetic, "mark": f"{MARK}.", "steps": str(steps)}
    values |= {"data": _data(run, name, source.signals), "id": source.id}
    values |= {"field": FAMILIES[target.arithmetic].field}
    texts = {
        f"{name}.h": source.header,
        f"{name}.c": source.code,
        f"{name}_run.h": filled("c_code/network/run.h", **values),
        f"{name}_test.c": filled("c_code/templates/test.c", **values),
    }
    shared = ["integers.h", f"{target.arithmetic}.h", "Makefile", "m4.c", "m4.ld"]
    shared += [file for file in ("learning.h", "deferred.h") if f'"{file}"' in source.code]
    make_folder(place)
    with ExitStack() as parts:  # files get their names at the end; none does if an error occurs
        for file, text in (texts | {file: filled(f"c_code/templates/{file}", **values) for file in shared}).items():
            parts.enter_context(output(place / file, KIND)).write_text(KIND.seal(text), "utf-8")
    graded = values["field"] == "payload"
    spikes = (run.input_spikes, run.output_spikes)
    input_spikes, output_spikes = (array.shape[1] if graded else int(array[2].sum()) for array in spikes)
    n_rewards = sum(reward_steps.size for reward_steps, _ in rewards.values())
    sizes = source.flash, code, source.ram
    return CCode(place, name, fixed.chip.title, *sizes, steps, random_input, input_spikes, output_spikes, n_rewards)


def _compile(net: Network, chip: Chip, settings: dict[str, Any], signals: Any) -> tuple[Simulation, FixedProgram]:
    """Compile and quantise a network without the values of its signals.

    A program in C gets signals from its caller, so values in the network determine only the scale of dopamine.
    """
    options: dict[str, Any] = {} if signals is None else {"signals": signals}
    sim = compile(net, **settings, **options)
    fixed, program = quantise(sim.program, chip, **options), sim.program
    refuse(fixed)
    if any(part.values is not None for part in program.signals):
        largest = {part.name: program.signals[part.signal].largest for part in program.projections if part.signal >= 0}
        options = {"signals": {name: value for name, value in largest.items() if value} | dict(signals or {})}
        net = copy.copy(net)
        net.signals = {name: replace(part, values=None) for name, part in net.signals.items()}
        with warnings.catch_warnings(action="ignore", category=ApproximationWarning):  # the first call has warned
            sim = compile(net, **settings, **options)
        fixed = quantise(sim.program, chip, **options)
    return sim, fixed


def _check_given(given: InputSpikes | None, signals: Mapping[str, Dopamine]) -> tuple[InputSpikes, Rewards]:
    if not isinstance(given or {}, Mapping):
        raise ModelError(f"given = {given!r:.60}: expected arrays of steps and neurons by input, such as {{'in': ...}}")
    inputs, rewards = dict[str, Sequence[Ints]](), dict[str, tuple[Ints, Ints]]()
    for name, spikes in (given or {}).items():
        if name in signals:
            rewards[name] = _check_rewards(name, spikes, signals[name])
            continue
        inputs[name] = arrays = [np.asarray(array) for array in spikes] if isinstance(spikes, Sequence) else []
        if not 2 <= len(arrays) <= 3 or any(array.shape != (arrays[0].size,) for array in arrays):
            expected = "expected arrays of steps, neurons, and payloads if the input has payloads"
            raise ModelError(f"given[{name!r}] = {spikes!r:.60}: {expected}")
    return inputs, rewards


def _check_rewards(name: str, rewards: Any, signal: Dopamine) -> tuple[Ints, Ints]:
    """Check rewards, and return them as in `Rewards`: sorted steps, and integers of shape (steps, neurons)."""
    try:
        steps, values = (np.asarray(array, dtype=np.float64) for array in rewards)
        array = np.broadcast_to(values[:, None] if values.ndim == 1 else values, (steps.size, signal.size))
    except (TypeError, ValueError):
        steps = array = np.full((1, 1), np.nan)
    units = np.rint(array * signal.one)
    if not (steps.ndim == 1 and np.all(steps >= 0) and np.all(steps % 1 == 0) and np.all(abs(units) < 2**31)):
        expected = f"expected arrays of steps, from 0, and values, one per step (and neuron, of {signal.size})"
        raise ModelError(f"given[{name!r}] = {rewards!r:.60}: {expected}")
    order = np.argsort(steps, kind="stable")
    return steps[order].astype(np.int64), units[order].astype(np.int64)


def _draw_rewards(signals: Mapping[str, Dopamine], steps: int) -> Rewards:
    """Draw random values of signals at random steps."""
    rng, rewards = np.random.default_rng(1), dict[str, tuple[Ints, Ints]]()
    for name, signal in signals.items():
        reward_steps = np.flatnonzero(rng.random(steps) < _PROBABILITY)
        rewards[name] = reward_steps, rng.integers(-signal.largest, signal.largest, (reward_steps.size, signal.size))
    return rewards


def _steps(program: Program, duration: float | None, inputs: InputSpikes, rewards: Rewards) -> int:
    if duration is not None:
        steps = Clock(program.resolution).step(duration, "duration")
        if steps > _MOST:
            raise ModelError(f"duration = {duration:g} ms, {steps:,} steps: expected at most {_MOST:,}")
        return max(1, steps)
    spike_steps = [part.spike_steps for part in program.populations if part.kind == "listed"]
    spike_steps += [spikes[0] for spikes in (*inputs.values(), *rewards.values())]
    last_step = max((int(steps.max()) for steps in spike_steps if steps.size), default=0)
    return min(max(last_step + _AFTER, _SHORTEST), _LONGEST)


def _run(
    sim: Simulation, source: Source, outputs: tuple[str, ...], steps: int, input_spikes: InputSpikes, rewards: Rewards
) -> tuple[RecordedRun, bool]:
    """Record a run with the given input, else the network's own input, else random input.

    Return the run, and whether its input is random.
    """
    inputs = [part for part in sim.program.populations if part.kind in INPUTS]
    names = [part.name for part in inputs if part.kind == "listed"]
    for name, (spike_steps, *ids) in input_spikes.items():
        if name not in names:
            raise unknown("input", name, [*names, *source.signals])
        sim.inject(name, spike_steps * sim.program.resolution, *ids)
    run = record(sim, source, outputs, steps, rewards)
    if run.input_spikes.size or input_spikes or not inputs:
        return run, False
    sim.reset()
    rng = np.random.default_rng(0)
    for part in inputs:
        if part.kind == "poisson":
            sim.set(part.name, rate=1000.0 * _PROBABILITY / sim.program.resolution)
        else:
            spike_steps, neurons = np.nonzero(rng.random((steps, part.size)) < _PROBABILITY)
            payloads = [rng.integers(1, 128, neurons.size)] if part.model.graded else []
            sim.inject(part.name, (spike_steps + 1) * sim.program.resolution, neurons, *payloads)
    return record(sim, source, outputs, steps, rewards), True


def _data(run: RecordedRun, name: str, signals: Mapping[str, Dopamine]) -> str:
    """Return the declarations of the recorded run, with which the test compares."""
    memory = Memory()
    for word, spikes in (("in", run.input_spikes), ("out", run.output_spikes)):
        row_ends = np.searchsorted(spikes[0], np.arange(run.steps + 1), side="right")
        memory.table(f"{word}_ends", row_ends, f"ends of the {word}put events of each step", True)
        events = [f"{{{neuron}, {number(times)}}}" for neuron, times in spikes[1:].T.tolist()]
        memory.constants(f"{word}_events", f"{name}_event", [*events, "{0, 0}"])
    statements = ["(void)step;"]
    for k, (signal, (steps, values)) in enumerate(run.rewards.items()):
        row_ends = np.searchsorted(steps, np.arange(-1, run.steps), side="right")
        memory.table(f"reward_ends_{k}", row_ends, f"ends of the values of {signal} before each step", True)
        memory.constants(f"reward_values_{k}", "int32_t", [*(number(value) for value in values.ravel().tolist()), "0"])
        first_value = f"(reward_ends_{k}[step + 1u] - 1u) * {signals[signal].size}u"
        is_set = f"reward_ends_{k}[step + 1u] > reward_ends_{k}[step]"
        statements.append(f"if ({is_set}) {signals[signal].call}(reward_values_{k} + {first_value});")
    memory.lines += function("static inline void reward(uint32_t step)", statements)
    for word, digests in (("spike", run.spike_digests), ("state", run.state_digests)):
        memory.constants(f"{word}_digests", "uint64_t", [f"UINT64_C({digest})" for digest in digests.tolist()])
    return "\n".join(memory.lines)


InputSpikes = Mapping[str, Sequence[Ints]]
"""Spikes by input: arrays of steps (from 1), of neurons, and of payloads if the input has payloads."""

Rewards = Mapping[str, tuple[Ints, Ints]]
"""Values of each signal by its name: the steps after which the signal is set, and integers for its neurons, shape
(steps, neurons)."""

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRun:
    """A recorded run of the emulator.

    Attributes:
        steps: number of steps.
        input_spikes: spikes of inputs, shape (3, spikes): steps, neurons, and multiplicities or payloads. Neurons are
            numbered across all populations.
        output_spikes: spikes of outputs in the same form.
        spike_digests: digest of all spikes of neurons in each step.
        state_digests: digest of all states after each step.
        rewards: values of signals.
    """

    steps: int
    input_spikes: Ints
    output_spikes: Ints
    spike_digests: Words
    state_digests: Words
    rewards: Rewards


def record(sim: Simulation, source: Source, outputs: tuple[str, ...], steps: int, rewards: Rewards) -> RecordedRun:
    """Run a simulation of a chip step by step from step 0, and record spikes and digests.

    Args:
        sim: simulation with probes of all spikes, see `with_recorded_spikes`.
        source: the network as C.
        outputs: populations whose spikes are output.
        steps: number of steps.
        rewards: values of signals.
    """
    digests = np.zeros(steps, dtype=np.uint64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)  # the C code overflows in the same way
        for step in range(steps):
            for name, (spike_steps, values) in rewards.items():
                for value in values[spike_steps == step]:
                    sim.signal(name, value / source.signals[name].one)
            sim.run(sim.program.resolution)
            digests[step] = _digest(sim, source)
    inputs = [part.name for part in sim.program.populations if part.kind in INPUTS]
    neurons = [part.name for part in sim.program.populations if part.kind == "neuron"]
    spike_steps, ids, counts = _spikes(sim, source, neurons)
    hashes = keyed_random.mix(ids.astype(np.uint64) << np.uint64(32) | (counts & 0xFFFFFFFF).astype(np.uint64))
    spike_digests = np.zeros(steps, dtype=np.uint64)
    np.add.at(spike_digests, spike_steps - 1, hashes)
    input_spikes, output_spikes = _spikes(sim, source, inputs), _spikes(sim, source, outputs)
    return RecordedRun(steps, input_spikes, output_spikes, spike_digests, digests, rewards)


def with_recorded_spikes(net: Network, names: Container[str] = ()) -> Network:
    """Return a copy of the network that records all spikes. Poisson generators in `names` do not draw spikes."""
    recording_net = copy.copy(net)
    recording_net.probes, recording_net.populations = dict(net.probes), dict(net.populations)
    for name, part in net.populations.items():
        if name in names and isinstance(part.model, poisson_generator):
            recording_net.populations[name] = replace(part, model=spike_generator())
    for name, part in net.populations.items():
        if part.model.role != "current":
            recording_net.probe(f"{name}.spikes.c", name, "spikes")
    return recording_net


def _digest(sim: Simulation, source: Source) -> np.uint64:
    values = [sim.get(name, word, raw=True) for name, state_names in source.states.items() for word in state_names]
    flat = np.concatenate(values).astype(np.int64) if values else np.zeros(0, dtype=np.int64)
    indices = np.arange(flat.size, dtype=np.uint64) << np.uint64(32)
    total: np.uint64 = keyed_random.mix(indices | (flat & 0xFFFFFFFF).astype(np.uint64)).sum(dtype=np.uint64)
    return total


def _spikes(sim: Simulation, source: Source, names: Any) -> Ints:
    """Return steps, neurons and multiplicities or payloads of some populations' spikes, sorted by step and neuron."""
    arrays = [np.zeros((3, 0), dtype=np.int64)]
    for part, first in zip(sim.program.populations, source.firsts, strict=False):
        if part.name in names:
            graded = part.model.graded
            times, ids, numbers = sim.payloads(part.name) if graded else (*sim.spikes(part.name), np.zeros(0))
            steps = np.rint(times / sim.program.resolution).astype(np.int64)
            pairs, counts = np.unique(np.stack([steps, ids + first]), axis=1, return_counts=True)
            arrays.append(np.vstack([steps, ids + first, numbers] if graded else [pairs, counts]))
    spikes = np.concatenate(arrays, axis=1).astype(np.int64)
    return spikes[:, np.lexsort((spikes[1], spikes[0]))]


_FROZEN = "--frozen (frozen=True) leaves out the rule, and keeps the weights of the network"
_NO_RECORDS = "a program in C does not record"
_READABLE = ("spikes", "V_m", "v", "sigma", "real")


def check_chip(name: str) -> Chip:
    """Return the chip of a name or a table, if its arithmetic is supported in C.

    Raises:
        ModelError: the name is unknown, or the arithmetic of the chip is not supported.
    """
    target = chip(name)
    if target.arithmetic not in FAMILIES:
        families = " or ".join(FAMILIES).replace(" or ", ", ", 1)
        raise ModelError(f"chip '{name}' cannot be written as C: expected the arithmetic of {families}")
    return target


def refuse(fixed: FixedProgram) -> None:
    """Check that all parts of a program are supported in C.

    Raises:
        ModelError: parts are not supported. The error lists all of them.
    """
    problems = [*_populations(fixed), *_projections(fixed), *_groups(fixed), *_probes(fixed)]
    if problems:
        count = f"{len(problems)} problem" + "s" * (len(problems) > 1)
        message = f"network '{fixed.program.name}' cannot be written as C ({count})"
        raise ModelError(message, others=tuple(problem.error() for problem in problems))


def _populations(fixed: FixedProgram) -> Iterator[Problem]:
    for part, cells in zip(fixed.program.populations, fixed.populations, strict=True):
        if part.model.role == "current":
            reason = "currents of generators are written by a host, which a program in C lacks"
            yield _problem(part, part.model_name, reason, "give the neurons a constant current, I_e, or spikes")
        elif cells.kind not in STEPS and part.kind not in INPUTS:
            models = ", ".join(model.__name__ for model in arithmetic_of(fixed.chip).models)
            models += " or parrot_neuron"
            yield _problem(part, part.model_name, f"not a neuron of {fixed.chip.name}", f"use {models}")
    if not any(cells.kind in STEPS for cells in fixed.populations):
        yield Problem(True, f"network '{fixed.program.name}'", "found no neurons", "add a population of iaf_psc_exp")


def _projections(fixed: FixedProgram) -> Iterator[Problem]:
    for part, wires in zip(fixed.program.projections, fixed.projections, strict=True):
        if part.synapse.learns and (wires is None or wires.rule is None or fixed.chip.arithmetic == "loihi2"):
            reason = "the rule is applied by a host, which a program in C lacks"
            if wires is not None and wires.rule is not None:
                reason = f"learning of {fixed.chip.name} is not supported in C"
            yield _problem(part, part.synapse.name, reason, _FROZEN)
        elif wires is not None and isinstance(wires.rule, sr.SpinnakerRule):
            if sr.TIMINGS[wires.rule.constants[sr.TIMING]] == "recurrent":
                reason = "random windows (timing: recurrent) are not supported in C"
                yield _problem(part, part.synapse.name, reason, "use another timing")
            if wires.delay.max(initial=0) > wires.rule.slots:
                reason = f"a delay of {wires.delay.max()} steps: a neuron has {wires.rule.slots} slots"
                yield _problem(part, part.synapse.name, reason, "use shorter delays")


def _problem(part: Population | Projection, subject: str, reason: str, way_out: str) -> Problem:
    kind = "population" if isinstance(part, Population) else "projection"
    return Problem(True, f"{kind} '{part.name}': {subject}", reason, way_out, part.origin)


def _groups(fixed: FixedProgram) -> Iterator[Problem]:
    for group in fixed.program.groups:
        if not supports(group.choice):
            reason = f"{group.choice.noun} is not supported in C"
            way_out = "use winner_take_all or lateral_reset"
            yield Problem(True, f"group '{group.name}'", reason, way_out, group.origin)


def _probes(fixed: FixedProgram) -> Iterator[Problem]:
    for probe in fixed.program.probes:
        if probe.record not in _READABLE or probe.mean:
            subject = f"probe '{probe.name}': {'mean ' * probe.mean}{probe.record}"
            way_out = "leave it out, or probe spikes; NAME_voltage() reads the voltage register"
            yield Problem(True, subject, _NO_RECORDS, way_out, probe.origin)
    for synapse_probe in fixed.program.synapse_probes:
        subject = f"probe '{synapse_probe.name}': {synapse_probe.record}"
        yield Problem(True, subject, _NO_RECORDS, "leave it out, or probe spikes of a population", synapse_probe.origin)
