"""All checks of a network: what is described, a short run, and on request a chip and gradients."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from neuro import ModelError, Network
from neuro.apps import Quantity, check, compile_network, find_backend
from neuro.chips import chip as chip_of
from neuro.extend import Program
from neuro_doctor import activity, drift, learning, parts, structure
from neuro_doctor.activity import SHORT_MS
from neuro_doctor.diagnosis import Diagnosis, ordered
from neuro_doctor.findings import Finding
from neuro_doctor.observing import Observation, observe
from neuro_doctor.wiring import Wiring

SECONDS = 20.0
"""Of the clock on the wall that the short run may take, without compiling."""
EXPLAIN = ("silent", "silenced", "brief-input", "no-path", "weak-spike", "long-delay")
"""Warnings that are faults where no output fires, as they say why."""
_MS = Quantity("ms", above=0)
_RATE = Quantity("Hz", at_least=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a network is examined, see `doctor`; and whether it ran before, in ms, with signals that were set."""

    ms: float = 1000.0
    backend: str = "event"
    chip: str | None = None
    train: bool = False
    drive: float = 0.0
    reward_after: float | None = None
    ran: float = 0.0
    steered: bool = False


def doctor(
    net: Network,
    ms: float = 1000.0,
    *,
    backend: str = "event",
    seed: int = 0,
    chip: str | None = None,
    train: bool = False,
    drive: float = 0.0,
    reward_after: float | None = None,
) -> Diagnosis:
    """Find out why a network does not work: checks of the description and of a short run.

    The run ends early after 20 s, without the time to compile; the diagnosis says how long it was.

    Args:
        net: the network.
        ms: length of the run, to be rounded up to whole steps.
        backend: what to run on.
        seed: of everything random.
        chip: also judge what becomes of the network on this chip.
        train: also judge the gradients that training with surrogates would see.
        drive: rate in Hz of Poisson spikes for inputs that a program is to feed; 0: these stay silent.
        reward_after: how long after the spikes that earned it a reward comes, in ms; eligibility is judged by it.

    Returns:
        the findings, faults first. What a compiler or a backend refuses is a finding, too.

    Raises:
        ModelError: an argument is not as described.
    """
    if not isinstance(net, Network):
        raise ModelError(f"neuro.doctor: found {net!r}: expected a Network", hint="neuro.load reads one from YAML")
    options = options_of(ms=ms, backend=backend, chip=chip, train=train, drive=drive, reward_after=reward_after)
    try:
        program = compile_network(net, seed)
    except ModelError as error:
        return refused(net.name, [error])
    return lived(examine(program, options), net, options, seed)


def lived(found: Diagnosis, net: Network, options: Options, seed: int) -> Diagnosis:
    """Return a diagnosis with what a short life of the network in its world shows, if it has one."""
    if net.world_section is None:
        return found
    from neuro_doctor import world

    alone = [each for each in found.findings if not world.answers(net, each)]
    return replace(found, findings=ordered([*alone, *world.findings(net, options.backend, seed)]))


def options_of(**words: Any) -> Options:
    """Options that were checked.

    Raises:
        ModelError: one is not as described.
    """
    found = Options(**words)
    check(_MS, found.ms, "ms")
    check(_RATE, found.drive, "drive")
    if found.reward_after is not None:
        check(_MS, found.reward_after, "reward_after")
    find_backend(found.backend)
    if found.chip is not None:
        chip_of(found.chip)
    return found


def backend_of_copy(name: str) -> str:
    """What a copy of a simulation runs on: chips on themselves, floats on `event`.

    A second network may not be built where the first one runs: NEST has one kernel in a process.
    """
    try:
        return name if getattr(find_backend(name), "arithmetic", "float") == "integer" else "event"
    except ModelError:
        return "event"  # a backend that was given as an object


def refused(name: str, errors: list[ModelError]) -> Diagnosis:
    """The diagnosis of a network that cannot be compiled."""
    every = [each for error in errors for each in (error.but(others=()), *error.others)]
    return Diagnosis(name, tuple(map(_mistake, every)), "Nothing ran: the description is refused.")


def _mistake(error: ModelError) -> Finding:
    remedy = error.hint or "write what is expected; neuro check lists all mistakes of a file"
    return Finding("mistake", "fault", "description", error.where, error.message, remedy)


def examine(program: Program, options: Options) -> Diagnosis:
    """Judge a compiled network."""
    wiring = Wiring(program)
    findings = [*structure.findings(wiring), *parts.of_neurons(wiring), *parts.of_rules(wiring, options.reward_after)]
    findings += drift.findings(wiring)
    backend = find_backend(options.backend)
    problems = backend.problems(program)
    for each in problems:
        kind = ("refused", "fault") if each.refused else ("approximated", "warning")
        way = each.way_out or "run it on a backend that takes it: neuro backends"
        findings.append(Finding(*kind, each.what, each.origin, f"backend '{options.backend}': {each.why}", way))
    if any(each.refused for each in problems):
        return Diagnosis(program.name, ordered(findings), f"Nothing ran: {options.backend} refuses the network.")
    steps = math.ceil(options.ms / program.resolution - 1e-6)
    try:
        seen = observe(backend.build(program, threads=1), program, steps, options.drive, SECONDS)
    except ModelError as error:
        findings.append(_mistake(error))
        return Diagnosis(program.name, ordered(findings), "The run stopped with an error.")
    fired = {
        f"population '{p.name}'" for p, s in zip(program.populations, seen.populations, strict=True) if s.spikes.any()
    }
    # States at the start, or a model's own ways, may do what was thought impossible: then the run is right.
    findings = [each for each in findings if each.name not in ("cannot-fire", "no-path") or each.what not in fired]
    findings += structure.cut_off(wiring)
    acts = list(activity.findings(wiring, seen))
    # Inputs at their true rates say more than inputs that fire in every step: one factor for one population.
    silent = {each.what for each in acts if each.name == "silent" and each.severity == "fault"}
    findings = [each for each in findings if each.name != "cannot-fire" or each.what not in silent]
    findings += [*acts, *learning.findings(wiring, seen, options.ran, options.steered)]
    if options.chip is not None or options.train:
        from neuro_doctor import on_request

        findings += on_request.of_chip(wiring, seen, options.chip) if options.chip is not None else ()
        findings += on_request.of_gradients(wiring, seen) if options.train else ()
    if not (_works(wiring, seen) or seen.idle):
        causes = [each for each in findings if each.severity == "warning" and each.name in EXPLAIN]
        findings = [replace(each, severity="fault") if each in causes else each for each in findings]
    return Diagnosis(program.name, ordered(findings), _about(seen, options), seen)


def _works(wiring: Wiring, seen: Observation) -> bool:
    """Whether a neuron of an output fired; of all populations where each leads to another; a short run says nothing."""
    neurons = [k for k, part in enumerate(seen.program.populations) if part.kind == "neuron"]
    ends = [k for k in neurons if structure.is_end(wiring, k)] or neurons
    return seen.ms < SHORT_MS or not ends or any(seen.populations[k].spikes.any() for k in ends)


def _about(seen: Observation, options: Options) -> str:
    seed = f"seed {seen.program.seed}"
    early = f" of {options.ms:g}, as it was stopped after {SECONDS:g} s" if seen.steps < seen.wanted else ""
    names = ", ".join(seen.program.populations[k].name for k in sorted(seen.driven))
    driven = f"; {names} driven at {options.drive:g} Hz" if names else ""
    return f"It ran {seen.ms:g} ms{early} on {options.backend}, {seed}{driven}."
