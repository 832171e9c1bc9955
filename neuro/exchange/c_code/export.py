"""A network in a chip's integers as a folder of C: `NAME.c`, `NAME.h`, and a test with a recorded run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.resources import files
from os import PathLike
from pathlib import Path

import numpy as np

from neuro.chips.quantising import quantise
from neuro.core.checks import check
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.outputs import make_folder, output, sealed
from neuro.core.paths import file_path
from neuro.core.quantities import Quantity
from neuro.exchange.c_code.arrays import Memory, number
from neuro.exchange.c_code.recorded import Given, Recorded, record, watched, without_learning
from neuro.exchange.c_code.source import FAMILIES, INPUTS, MARK, Source, source_of
from neuro.exchange.c_code.unsupported import check_chip, refuse
from neuro.model.network import Network
from neuro.program.program import Program
from neuro.run.compiled import compile
from neuro.run.simulation import Simulation

__all__ = ["CCode", "save_c"]

KIND = sealed("a file of C of neuro, as it was written", MARK, "; digest {}")
_BYTES = Quantity(unit="bytes", doc="of a memory", kind="integer", at_least=0, optional=True)
_DURATION = Quantity(unit="ms", doc="of the recorded run", above=0, optional=True)
_FLAG = Quantity(kind="boolean")
_WORD = re.compile(r"[a-z][a-z0-9_]{0,39}")
_TEMPLATES = files("neuro.exchange.c_code").joinpath("templates")
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

    def __str__(self) -> str:
        drawn = ", drawn, since the network's own send nothing" if self.drawn else ""
        return "\n".join(
            [
                f"{self.folder}: {self.name}.c and {self.name}.h, in the integers of {self.chip}",
                f"  flash  {self.flash + self.code:,} bytes: tables {self.flash:,}, code at most {self.code:,}",
                f"  RAM    at most {self.ram:,} bytes, beside the stack and the caller's events",
                f"  test   {self.steps:,} steps: {self.input_spikes:,} spikes of inputs{drawn}, "
                f"{self.output_spikes:,} of outputs",
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
) -> CCode:
    """Write a network in the integers of an emulated chip as C99 for a microcontroller.

    The program allocates nothing and uses no floating-point numbers. It has the spikes and the states of the emulator
    in every step. Spikes of generators are its input. Its output are the populations of which spikes are probed, or
    else those that send to no other.

    Args:
        net: the network, all of whose weights are fixed.
        folder: for the files; made where there is none.
        chip: name or table of a chip.
        name: with which its public names begin: small letters, digits, `_`.
        ram: bytes that its states may take.
        flash: bytes that its tables and its code may take.
        duration: of the recorded run in ms; some steps longer than the network's listed spikes if not given.
        given: spikes of inputs in the recorded run: steps, from 1, neurons, and payloads where they have such, by the
            input's name. Otherwise those of the network; drawn ones if it has none.
        frozen: whether what learns is left out; weights stay as they are in the network.
        seed: of everything random.

    Raises:
        ModelError: the chip does not run the network, a part of it cannot be written, or it does not fit.
    """
    if not isinstance(net, Network):
        raise ModelError(f"save_c: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    limits = {"flash": check(_BYTES, flash, "flash"), "RAM": check(_BYTES, ram, "ram")}
    taken = {Path(each.name).stem for each in _TEMPLATES.iterdir()}
    if not (isinstance(name, str) and _WORD.fullmatch(name)) or name in taken or name.endswith("_test"):
        hint = f"files that lie beside it are {', '.join(sorted(taken))}, and those that end in _test"
        raise ModelError(f"name = {name!r:.60}: expected small letters, digits and _, as in 'net'", hint=hint)
    target = check_chip(chip)
    sim = compile(watched(without_learning(net) if check(_FLAG, frozen, "frozen") else net), backend=chip, seed=seed)
    program = sim.program
    fixed = quantise(program, target)
    refuse(fixed)
    outputs = _outputs(net, program)
    source = source_of(fixed, name, outputs)
    code = _code(source)
    for what, limit, size in (("flash", limits["flash"], source.flash + code), ("RAM", limits["RAM"], source.ram)):
        if limit is not None and size > limit:
            hint = "fewer neurons, shorter delays or shared kernels (grid) take less"
            raise ModelError(
                f"{what}: network '{net.name}' takes {size:,} bytes: expected at most {limit:,}", hint=hint
            )
    shown = _check_given(given)
    steps = _steps(program, check(_DURATION, duration, "duration"), shown)
    run, drawn = _run(sim, source, outputs, steps, shown)
    place = file_path(folder, "folder")
    words = {"name": name, "NAME": name.upper(), "chip": target.arithmetic, "mark": f"{MARK}.", "steps": str(steps)}
    words |= {"data": _data(run, name), "id": source.id, "field": FAMILIES[target.arithmetic].field}
    texts = {f"{name}.h": source.header, f"{name}.c": source.code, f"{name}_test.c": _template("test.c", words)}
    shared = ["integers.h", f"{target.arithmetic}.h", "Makefile", "m4.c", "m4.ld"]
    shared += ["learning.h"] if '"learning.h"' in source.code else []
    _write(place, texts | {file: _template(file, words) for file in shared})
    graded = words["field"] == "payload"
    spikes = (each.shape[1] if graded else int(each[2].sum()) for each in (run.sent, run.told))
    return CCode(place, name, fixed.chip.title, source.flash, code, source.ram, steps, drawn, *spikes)


def _outputs(net: Network, program: Program) -> tuple[str, ...]:
    """The populations whose spikes are output."""
    neurons = [part.name for part in program.populations if part.kind == "neuron"]
    probed = {probe.of for probe in net.probes.values() if "spikes" in probe.record}
    ends = {part.source for part in net.projections.values() if part.source != part.target}
    found = tuple(name for name in neurons if name in probed)
    return found or tuple(name for name in neurons if name not in ends) or tuple(neurons)


def _code(source: Source) -> int:
    """Bytes of machine code of a Cortex-M4, at most: an estimate from its statements, of gcc 12 with -O2."""
    return 400 + 16 * source.code.count(";")


def _check_given(given: Given | None) -> Given:
    if not isinstance(given or {}, Mapping):
        raise ModelError(f"given = {given!r:.60}: expected arrays of steps and neurons, by the name of an input")
    found = {}
    for name, spikes in (given or {}).items():
        found[name] = arrays = [np.asarray(each) for each in spikes] if isinstance(spikes, Sequence) else []
        if not 2 <= len(arrays) <= 3 or any(each.shape != (arrays[0].size,) for each in arrays):
            wish = "expected arrays of steps, of neurons, and of payloads where it has such"
            raise ModelError(f"given[{name!r}] = {spikes!r:.60}: {wish}")
    return found


def _steps(program: Program, duration: float | None, given: Given) -> int:
    if duration is not None:
        steps = Clock(program.resolution).step(duration, "duration")
        if steps > _MOST:
            raise ModelError(f"duration = {duration:g} ms, {steps:,} steps: expected at most {_MOST:,}")
        return max(1, steps)
    listed = [part.spike_steps for part in program.populations if part.kind == "listed"]
    listed += [spikes[0] for spikes in given.values()]
    last = max((int(steps.max()) for steps in listed if steps.size), default=0)
    return min(max(last + _AFTER, _SHORTEST), _LONGEST)


def _run(sim: Simulation, source: Source, outputs: tuple[str, ...], steps: int, given: Given) -> tuple[Recorded, bool]:
    """The recorded run, and whether its input was drawn."""
    inputs = [part for part in sim.program.populations if part.kind in INPUTS]
    listed = [part.name for part in inputs if part.kind == "listed"]
    for name, (when, *rest) in given.items():
        if name not in listed:
            raise unknown("input", name, listed)
        sim.inject(name, when * sim.program.resolution, *rest)
    found = record(sim, source, outputs, steps)
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
    return record(sim, source, outputs, steps), True


def _data(run: Recorded, name: str) -> str:
    """What the test compares with."""
    memory = Memory()
    for word, spikes in (("in", run.sent), ("out", run.told)):
        ends = np.searchsorted(spikes[0], np.arange(run.steps + 1), side="right")
        memory.table(f"{word}_ends", ends, f"where the {word}put events of each step end", True)
        events = [f"{{{neuron}, {number(times)}}}" for neuron, times in spikes[1:].T.tolist()]
        memory.constants(f"{word}_events", f"{name}_event", [*events, "{0, 0}"])
    for word, digests in (("spike", run.spikes), ("state", run.states)):
        memory.constants(f"{word}_digests", "uint64_t", [f"UINT64_C({digest})" for digest in digests.tolist()])
    return "\n".join(memory.lines)


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    """Write all files, or none if one of them cannot be written."""
    make_folder(folder)
    with ExitStack() as parts:  # none takes its name before all are written
        for file, text in texts.items():
            parts.enter_context(output(folder / file, KIND)).write_text(KIND.seal(text), "utf-8")


def _template(file: str, words: Mapping[str, str]) -> str:
    """A file that is the same for all networks, but for some words."""
    text = _TEMPLATES.joinpath(file).read_text("utf-8")
    for word, value in words.items():
        text = text.replace(f"@{word}@", value)
    return text
