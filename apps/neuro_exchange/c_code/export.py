"""A network in a chip's integers as a folder of C: `NAME.c`, `NAME.h`, and a test with a recorded run.

The test compares digests. A digest is the sum of one word a number, a hash of its place and value, modulo 2^64. So two
runs with the same digests in all steps have the same spikes and states, but for a chance of 2^-64 a step.
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
_BYTES = Quantity(unit="bytes", doc="of a memory", kind="integer", at_least=0, optional=True)
_DURATION = Quantity(unit="ms", doc="of the recorded run", above=0, optional=True)
_FLAG = Quantity(kind="boolean")
_WORD = re.compile(r"[a-z][a-z0-9_]{0,39}")
_TEMPLATES = files("neuro_exchange.c_code").joinpath("templates")
_SHORTEST, _LONGEST, _AFTER, _MOST = 100, 1000, 20, 100_000
_DRAWN = 0.05


@dataclass(frozen=True, slots=True)
class CCode:
    """What was written.

    Attributes:
        folder: where.
        name: with which its public names begin.
        chip: whose integers it computes in.
        flash: bytes of constant tables; `code` those of machine code on a Cortex-M4, at most.
        ram: bytes of states and of the gaps between them, at most.
        steps: of the recorded run.
        drawn: whether its input was drawn, since the network's own inputs send nothing.
        input_spikes, output_spikes: of the recorded run.
        rewards: how often it sets signals.
    """

    folder: Path
    name: str
    chip: str
    flash: int
    code: int
    ram: int
    steps: int
    drawn: bool
    input_spikes: int
    output_spikes: int
    rewards: int

    def __str__(self) -> str:
        drawn = ", drawn, since the network's own send nothing" if self.drawn else ""
        rewards = f", {self.rewards:,} rewards" if self.rewards else ""
        return "\n".join(
            [
                f"{self.folder}: {self.name}.c and {self.name}.h, in the integers of {self.chip}",
                f"  flash  {self.flash + self.code:,} bytes: tables {self.flash:,}, code at most {self.code:,}",
                f"  RAM    at most {self.ram:,} bytes, beside the stack and the caller's events",
                f"  test   {self.steps:,} steps: {self.input_spikes:,} spikes of inputs{drawn}, "
                f"{self.output_spikes:,} of outputs{rewards}",
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
    given: Given | None = None,
    frozen: bool = False,
    seed: int = 0,
    signals: Mapping[str, float] | None = None,
) -> CCode:
    """Write a network in the integers of an emulated chip as C99 for a microcontroller.

    The program allocates nothing and uses no floating-point numbers. Its spikes and states are those of the emulator in
    every step. Spikes of generators and values of signals are input, also where the description has such. Output are
    the populations of which spikes are probed, or else those that send to no other.

    Args:
        net: the network.
        folder: for the files; made where there is none.
        chip: name or table of a chip.
        name: with which its public names begin: small letters, digits, `_`.
        ram: bytes that its states may take.
        flash: bytes that its tables and its code may take.
        duration: of the recorded run in ms; some steps longer than the network's listed spikes if not given.
        given: spikes of inputs in the recorded run: steps, from 1, neurons, and payloads where they have such, by the
            input's name. Otherwise those of the network; drawn ones if it has none. Signals by their names: numbers of
            the steps after which they are set, and values in 1/ms, one each or one for each neuron; drawn if not given.
        frozen: whether what learns is left out; weights stay as they are in the network.
        seed: of everything random.
        signals: the largest dopamine that a signal will set in 1/ms, by projection; 4/tau_n if not given.

    Raises:
        ModelError: the chip does not run the network, a part of it cannot be written, or it does not fit.
    """
    if not isinstance(net, Network):
        raise ModelError(f"save_c: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    limits = {"flash": check(_BYTES, flash, "flash"), "RAM": check(_BYTES, ram, "ram")}
    taken = {Path(each.name).stem for each in _TEMPLATES.iterdir()}
    if not (isinstance(name, str) and _WORD.fullmatch(name)) or name in taken or name.endswith(("_run", "_test")):
        hint = f"files that lie beside it are {', '.join(sorted(taken))}, and those that end in _run or _test"
        raise ModelError(f"name = {name!r:.60}: expected small letters, digits and _, as in 'net'", hint=hint)
    target = check_chip(chip)
    written = net.frozen() if check(_FLAG, frozen, "frozen") else net
    recorded = watched(written, given if isinstance(given, Mapping) else ())
    sim, fixed = _compiled(recorded, target, {"backend": chip, "seed": seed}, signals)
    program = sim.program
    # The populations whose spikes are output.
    neurons = [part.name for part in program.populations if part.kind == "neuron"]
    probed = {probe.of for probe in net.probes.values() if "spikes" in probe.record}
    ends = {part.source for part in net.projections.values() if part.source != part.target}
    ends |= {program.populations[part.dopamine].name for part in program.projections if part.dopamine >= 0}
    found = tuple(name for name in neurons if name in probed)
    outputs = found or tuple(name for name in neurons if name not in ends) or tuple(neurons)
    source = source_of(fixed, name, outputs)
    code = 400 + 16 * source.code.count(";")
    for what, limit, size in (("flash", limits["flash"], source.flash + code), ("RAM", limits["RAM"], source.ram)):
        if limit is not None and size > limit:
            hint = "fewer neurons, shorter delays or shared kernels (grid) take less"
            raise ModelError(
                f"{what}: network '{net.name}' takes {size:,} bytes: expected at most {limit:,}", hint=hint
            )
    shown, rewards = _check_given(given, source.signals)
    steps = _steps(program, check(_DURATION, duration, "duration"), shown, rewards)
    rewards = {**_draw_rewards(source.signals, steps), **rewards}
    run, drawn = _run(sim, source, outputs, steps, shown, rewards)
    place = file_path(folder, "folder")
    words = {"name": name, "NAME": name.upper(), "chip": target.arithmetic, "mark": f"{MARK}.", "steps": str(steps)}
    words |= {"data": _data(run, name, source.signals), "id": source.id}
    words |= {"field": FAMILIES[target.arithmetic].field}
    texts = {
        f"{name}.h": source.header,
        f"{name}.c": source.code,
        f"{name}_run.h": filled("c_code/network/run.h", **words),
        f"{name}_test.c": filled("c_code/templates/test.c", **words),
    }
    shared = ["integers.h", f"{target.arithmetic}.h", "Makefile", "m4.c", "m4.ld"]
    shared += [file for file in ("learning.h", "deferred.h") if f'"{file}"' in source.code]
    # Write all files, or none if one of them cannot be written.
    make_folder(place)
    with ExitStack() as parts:  # none takes its name before all are written
        for file, text in (texts | {file: filled(f"c_code/templates/{file}", **words) for file in shared}).items():
            parts.enter_context(output(place / file, KIND)).write_text(KIND.seal(text), "utf-8")
    graded = words["field"] == "payload"
    input_spikes, output_spikes = (each.shape[1] if graded else int(each[2].sum()) for each in (run.sent, run.told))
    sets = sum(when.size for when, _ in rewards.values())
    sizes = source.flash, code, source.ram
    return CCode(place, name, fixed.chip.title, *sizes, steps, drawn, input_spikes, output_spikes, sets)


def _compiled(net: Network, chip: Chip, words: dict[str, Any], signals: Any) -> tuple[Simulation, FixedProgram]:
    """Compile and quantise a network; where signals have values, again without them, at their scale."""
    options: dict[str, Any] = {} if signals is None else {"signals": signals}
    sim = compile(net, **words, **options)
    fixed, program = quantise(sim.program, chip, **options), sim.program
    refuse(fixed)
    if any(part.values is not None for part in program.signals):
        largest = {part.name: program.signals[part.signal].largest for part in program.projections if part.signal >= 0}
        options = {"signals": {name: value for name, value in largest.items() if value} | dict(signals or {})}
        net = copy.copy(net)
        net.signals = {name: replace(part, values=None) for name, part in net.signals.items()}
        with warnings.catch_warnings(action="ignore", category=ApproximationWarning):  # the first call has told them
            sim = compile(net, **words, **options)
        fixed = quantise(sim.program, chip, **options)
    return sim, fixed


def _check_given(given: Given | None, signals: Mapping[str, Dopamine]) -> tuple[Given, Rewards]:
    if not isinstance(given or {}, Mapping):
        raise ModelError(f"given = {given!r:.60}: expected arrays of steps and neurons, by the name of an input")
    inputs, rewards = dict[str, Sequence[Ints]](), dict[str, tuple[Ints, Ints]]()
    for name, spikes in (given or {}).items():
        if name in signals:
            rewards[name] = _check_rewards(name, spikes, signals[name])
            continue
        inputs[name] = arrays = [np.asarray(each) for each in spikes] if isinstance(spikes, Sequence) else []
        if not 2 <= len(arrays) <= 3 or any(each.shape != (arrays[0].size,) for each in arrays):
            wish = "expected arrays of steps, of neurons, and of payloads where it has such"
            raise ModelError(f"given[{name!r}] = {spikes!r:.60}: {wish}")
    return inputs, rewards


def _check_rewards(name: str, rewards: Any, signal: Dopamine) -> tuple[Ints, Ints]:
    """Return the steps after which a signal is set, in order, and whole numbers for its neurons."""
    try:
        when, values = (np.asarray(each, dtype=np.float64) for each in rewards)
        each = np.broadcast_to(values[:, None] if values.ndim == 1 else values, (when.size, signal.size))
    except (TypeError, ValueError):
        when = each = np.full((1, 1), np.nan)
    units = np.rint(each * signal.one)
    if not (when.ndim == 1 and np.all(when >= 0) and np.all(when % 1 == 0) and np.all(abs(units) < 2**31)):
        wish = f"expected arrays of steps, from 0, and of values, one each or one for each of {signal.size} neurons"
        raise ModelError(f"given[{name!r}] = {rewards!r:.60}: {wish}")
    order = np.argsort(when, kind="stable")
    return when[order].astype(np.int64), units[order].astype(np.int64)


def _draw_rewards(signals: Mapping[str, Dopamine], steps: int) -> Rewards:
    """Draw values of signals at random steps."""
    draws, rewards = np.random.default_rng(1), dict[str, tuple[Ints, Ints]]()
    for name, signal in signals.items():
        when = np.flatnonzero(draws.random(steps) < _DRAWN)
        rewards[name] = when, draws.integers(-signal.largest, signal.largest, (when.size, signal.size))
    return rewards


def _steps(program: Program, duration: float | None, given: Given, rewards: Rewards) -> int:
    if duration is not None:
        steps = Clock(program.resolution).step(duration, "duration")
        if steps > _MOST:
            raise ModelError(f"duration = {duration:g} ms, {steps:,} steps: expected at most {_MOST:,}")
        return max(1, steps)
    listed = [part.spike_steps for part in program.populations if part.kind == "listed"]
    listed += [spikes[0] for spikes in (*given.values(), *rewards.values())]
    last = max((int(steps.max()) for steps in listed if steps.size), default=0)
    return min(max(last + _AFTER, _SHORTEST), _LONGEST)


def _run(
    sim: Simulation, source: Source, outputs: tuple[str, ...], steps: int, given: Given, rewards: Rewards
) -> tuple[Recorded, bool]:
    """The recorded run, and whether its input was drawn."""
    inputs = [part for part in sim.program.populations if part.kind in INPUTS]
    listed = [part.name for part in inputs if part.kind == "listed"]
    for name, (when, *rest) in given.items():
        if name not in listed:
            raise unknown("input", name, [*listed, *source.signals])
        sim.inject(name, when * sim.program.resolution, *rest)
    found = record(sim, source, outputs, steps, rewards)
    if found.sent.size or given or not inputs:
        return found, False
    sim.reset()
    draws = np.random.default_rng(0)
    for part in inputs:
        if part.kind == "poisson":
            sim.set(part.name, rate=1000.0 * _DRAWN / sim.program.resolution)
        else:
            when, neurons = np.nonzero(draws.random((steps, part.size)) < _DRAWN)
            payloads = [draws.integers(1, 128, neurons.size)] if part.model.graded else []
            sim.inject(part.name, (when + 1) * sim.program.resolution, neurons, *payloads)
    return record(sim, source, outputs, steps, rewards), True


def _data(run: Recorded, name: str, signals: Mapping[str, Dopamine]) -> str:
    """What the test compares with."""
    memory = Memory()
    for word, spikes in (("in", run.sent), ("out", run.told)):
        ends = np.searchsorted(spikes[0], np.arange(run.steps + 1), side="right")
        memory.table(f"{word}_ends", ends, f"where the {word}put events of each step end", True)
        events = [f"{{{neuron}, {number(times)}}}" for neuron, times in spikes[1:].T.tolist()]
        memory.constants(f"{word}_events", f"{name}_event", [*events, "{0, 0}"])
    sets = ["(void)step;"]
    for k, (signal, (when, values)) in enumerate(run.rewards.items()):
        ends = np.searchsorted(when, np.arange(-1, run.steps), side="right")
        memory.table(f"reward_ends_{k}", ends, f"where the values of {signal} before each step end", True)
        memory.constants(f"reward_values_{k}", "int32_t", [*(number(each) for each in values.ravel().tolist()), "0"])
        at = f"(reward_ends_{k}[step + 1u] - 1u) * {signals[signal].size}u"
        fresh = f"reward_ends_{k}[step + 1u] > reward_ends_{k}[step]"
        sets.append(f"if ({fresh}) {signals[signal].call}(reward_values_{k} + {at});")
    memory.lines += function("static inline void reward(uint32_t step)", sets)
    for word, digests in (("spike", run.spikes), ("state", run.states)):
        memory.constants(f"{word}_digests", "uint64_t", [f"UINT64_C({digest})" for digest in digests.tolist()])
    return "\n".join(memory.lines)


Given = Mapping[str, Sequence[Ints]]
"""Steps, from 1, neurons, and payloads where it has such, of the spikes that are given to an input, by its name."""

Rewards = Mapping[str, tuple[Ints, Ints]]
"""Steps after which a signal is set, and numbers for its neurons, shape (steps, neurons), by the signal's name."""

Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A run.

    Attributes:
        steps: of it.
        sent: steps, neurons (of the network) and numbers, multiplicities or payloads, of the spikes of inputs, by step.
        told: the same of outputs.
        spikes, states: the digest of each step, of all spikes of neurons and of all states after it.
        rewards: what signals were set to.
    """

    steps: int
    sent: Ints
    told: Ints
    spikes: Words
    states: Words
    rewards: Rewards


def record(sim: Simulation, source: Source, outputs: tuple[str, ...], steps: int, rewards: Rewards) -> Recorded:
    """Run a simulation of a chip from step 0 on, step by step.

    Args:
        sim: with probes of all spikes, see `watched`.
        source: the network as C.
        outputs: whose spikes are output.
        steps: how many.
        rewards: what signals are set to.
    """
    digests = np.zeros(steps, dtype=np.uint64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OverflowWarning)  # the program in C overflows alike
        for step in range(steps):
            for name, (when, values) in rewards.items():
                for value in values[when == step]:
                    sim.signal(name, value / source.signals[name].one)
            sim.run(sim.program.resolution)
            digests[step] = _digest(sim, source)
    inputs = [part.name for part in sim.program.populations if part.kind in INPUTS]
    neurons = [part.name for part in sim.program.populations if part.kind == "neuron"]
    every = _spikes(sim, source, neurons)
    words = keyed_random.mix(every[1].astype(np.uint64) << np.uint64(32) | (every[2] & 0xFFFFFFFF).astype(np.uint64))
    spikes = np.zeros(steps, dtype=np.uint64)
    np.add.at(spikes, every[0] - 1, words)
    return Recorded(steps, _spikes(sim, source, inputs), _spikes(sim, source, outputs), spikes, digests, rewards)


def watched(net: Network, shown: Container[str] = ()) -> Network:
    """The network, with all spikes recorded; Poisson generators whose spikes are shown draw none."""
    other = copy.copy(net)
    other.probes, other.populations = dict(net.probes), dict(net.populations)
    for name, part in net.populations.items():
        if name in shown and isinstance(part.model, poisson_generator):
            other.populations[name] = replace(part, model=spike_generator())
    for name, part in net.populations.items():
        if part.model.role != "current":
            other.probe(f"{name}.spikes.c", name, "spikes")
    return other


def _digest(sim: Simulation, source: Source) -> np.uint64:
    values = [sim.get(name, word, raw=True) for name, words in source.states.items() for word in words]
    flat = np.concatenate(values).astype(np.int64) if values else np.zeros(0, dtype=np.int64)
    places = np.arange(flat.size, dtype=np.uint64) << np.uint64(32)
    total: np.uint64 = keyed_random.mix(places | (flat & 0xFFFFFFFF).astype(np.uint64)).sum(dtype=np.uint64)
    return total


def _spikes(sim: Simulation, source: Source, names: Any) -> Ints:
    """Steps, neurons and numbers of the spikes of some populations, by step, then neuron, shape (3, spikes)."""
    found = [np.zeros((3, 0), dtype=np.int64)]
    for part, first in zip(sim.program.populations, source.firsts, strict=False):
        if part.name in names:
            graded = part.model.graded
            times, ids, numbers = sim.payloads(part.name) if graded else (*sim.spikes(part.name), np.zeros(0))
            steps = np.rint(times / sim.program.resolution).astype(np.int64)
            pairs, counts = np.unique(np.stack([steps, ids + first]), axis=1, return_counts=True)
            found.append(np.vstack([steps, ids + first, numbers] if graded else [pairs, counts]))
    joined = np.concatenate(found, axis=1).astype(np.int64)
    return joined[:, np.lexsort((joined[1], joined[0]))]


_FROZEN = "--frozen (frozen=True) leaves the rule out: weights stay as they are in the network"
_READABLE = ("spikes", "V_m", "v", "sigma", "real")


def check_chip(name: str) -> Chip:
    """The chip of a name or a table, if its arithmetic is written as C.

    Raises:
        ModelError: there is no such chip, or it has another arithmetic.
    """
    found = chip(name)
    if found.arithmetic not in FAMILIES:
        known = " or ".join(FAMILIES).replace(" or ", ", ", 1)
        raise ModelError(f"chip '{name}' cannot be written as C: expected the arithmetic of {known}")
    return found


def refuse(fixed: FixedProgram) -> None:
    """Refuse a program with all reasons at once.

    Raises:
        ModelError: a part of it cannot be written.
    """
    problems = [*_populations(fixed), *_projections(fixed), *_groups(fixed), *_probes(fixed)]
    if problems:
        count = f"{len(problems)} problem" + "s" * (len(problems) > 1)
        message = f"network '{fixed.program.name}' cannot be written as C ({count})"
        raise ModelError(message, others=tuple(problem.error() for problem in problems))


def _populations(fixed: FixedProgram) -> Iterator[Problem]:
    for part, cells in zip(fixed.program.populations, fixed.populations, strict=True):
        if part.model.role == "current":
            why = "the host writes its current into registers while the network runs"
            yield _refused(part, part.said, why, "give the neurons a constant current, I_e, or spikes")
        elif cells.kind not in STEPS and part.kind not in INPUTS:
            known = ", ".join(model.__name__ for model in arithmetic_of(fixed.chip).models)
            known += " or parrot_neuron"
            yield _refused(part, part.said, f"it is no neuron of {fixed.chip.name}", f"use {known}")
    if not any(cells.kind in STEPS for cells in fixed.populations):
        yield Problem(True, f"network '{fixed.program.name}'", "it has no neurons", "add a population of iaf_psc_exp")


def _projections(fixed: FixedProgram) -> Iterator[Problem]:
    for part, wires in zip(fixed.program.projections, fixed.projections, strict=True):
        if part.synapse.learns and (wires is None or wires.rule is None or fixed.chip.arithmetic == "loihi2"):
            why = "the host applies the rule, and the program in C has none"
            if wires is not None and wires.rule is not None:
                why = f"the program in C has no learning of {fixed.chip.name}"
            yield _refused(part, part.synapse.name, why, _FROZEN)
        elif wires is not None and isinstance(wires.rule, sr.SpinnakerRule):
            if sr.TIMINGS[wires.rule.constants[sr.TIMING]] == "recurrent":
                why = "the program in C has no windows at random"
                yield _refused(part, part.synapse.name, why, "use another timing")
            if wires.delay.max(initial=0) > wires.rule.slots:
                why = f"a delay of {wires.delay.max()} steps: a neuron has {wires.rule.slots} slots"
                yield _refused(part, part.synapse.name, why, "use shorter delays")


def _refused(part: Population | Projection, what: str, why: str, way_out: str) -> Problem:
    kind = "population" if isinstance(part, Population) else "projection"
    return Problem(True, f"{kind} '{part.name}': {what}", why, way_out, part.origin)


def _groups(fixed: FixedProgram) -> Iterator[Problem]:
    for group in fixed.program.groups:
        if not supports(group.choice):
            why = f"{group.choice.noun} is not written as C"
            way = "use winner_take_all or lateral_reset"
            yield Problem(True, f"group '{group.name}'", why, way, group.origin)


def _probes(fixed: FixedProgram) -> Iterator[Problem]:
    for probe in fixed.program.probes:
        if probe.record not in _READABLE or probe.mean:
            what = f"probe '{probe.name}': {'mean ' * probe.mean}{probe.record}"
            way = "leave it out, or probe spikes; NAME_voltage() reads the voltage register"
            yield Problem(True, what, "the program in C keeps no record", way, probe.origin)
    for one in fixed.program.synapse_probes:
        way = "leave it out, or probe spikes of a population"
        yield Problem(True, f"probe '{one.name}': {one.record}", "the program in C keeps no record", way, one.origin)
