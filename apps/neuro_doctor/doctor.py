"""All checks of a network: the description, a short run, and on request a chip and gradients."""

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
from neuro_doctor.diagnosis import Diagnosis, sort_findings
from neuro_doctor.findings import Finding
from neuro_doctor.observing import Observation, observe
from neuro_doctor.wiring import Wiring

SECONDS = 20.0
"""Longest short run, s of wall-clock time without compiling."""
EXPLAIN = ("silent", "silenced", "brief-input", "no-path", "weak-spike", "long-delay")
"""Warnings that become faults if no output fires, since they explain the silence."""
_MS = Quantity("ms", above=0)
_RATE = Quantity("Hz", at_least=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Options of a diagnosis, see `doctor`.

    Attributes:
        ran: time that the simulation ran before, ms; 0 for a network that did not run.
        steered: True if a program set signals in that time.
    """

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
    """Diagnose why a network does not work, from its description and a short run.

    The run ends early after 20 s of wall-clock time, without the time to compile. The diagnosis states its length.

    Args:
        net: the network.
        ms: length of the run, rounded up to whole steps, ms.
        backend: backend of the run.
        seed: seed of everything random.
        chip: name of a chip on which the network is also checked.
        train: True also checks the surrogate gradients of training.
        drive: rate of Poisson spikes for inputs that a program would feed, Hz; 0 keeps them silent.
        reward_after: delay of a reward after the spikes that earned it, ms; the check of eligibility uses it.

    Returns:
        The findings, faults first. Errors of the compiler and of the backend are findings, too.

    Raises:
        ModelError: an argument is invalid.
    """
    if not isinstance(net, Network):
        raise ModelError(f"neuro.doctor: found {net!r}: expected a Network", hint="neuro.load reads one from YAML")
    options = options_of(ms=ms, backend=backend, chip=chip, train=train, drive=drive, reward_after=reward_after)
    try:
        program = compile_network(net, seed)
    except ModelError as error:
        return diagnose_errors(net.name, [error])
    return add_world_findings(examine(program, options), net, options, seed)


def add_world_findings(diagnosis: Diagnosis, net: Network, options: Options, seed: int) -> Diagnosis:
    """Add the findings of a short run in the network's world, and drop the findings that the world resolves."""
    if net.world_section is None:
        return diagnosis
    from neuro_doctor import world

    findings = [finding for finding in diagnosis.findings if not world.resolves(net, finding)]
    return replace(diagnosis, findings=sort_findings([*findings, *world.findings(net, options.backend, seed)]))


def options_of(**settings: Any) -> Options:
    """Check the options and return them.

    Raises:
        ModelError: an option is invalid.
    """
    options = Options(**settings)
    check(_MS, options.ms, "ms")
    check(_RATE, options.drive, "drive")
    if options.reward_after is not None:
        check(_MS, options.reward_after, "reward_after")
    find_backend(options.backend)
    if options.chip is not None:
        chip_of(options.chip)
    return options


def backend_of_copy(name: str) -> str:
    """Return the backend for a copy of a simulation: the same for chips, `event` for backends in floats.

    The copy avoids the simulation's own backend, since e.g. NEST holds only one network per process.
    """
    try:
        return name if getattr(find_backend(name), "arithmetic", "float") == "integer" else "event"
    except ModelError:
        return "event"  # the backend is an object without a registered name


def diagnose_errors(name: str, errors: list[ModelError]) -> Diagnosis:
    """Return the diagnosis of a network that cannot be compiled: each error is a fault."""
    errors_of_file = [single for error in errors for single in (error.but(others=()), *error.others)]
    return Diagnosis(name, tuple(map(_mistake, errors_of_file)), "Nothing ran: the description is refused.")


def _mistake(error: ModelError) -> Finding:
    remedy = error.hint or "correct the description; neuro check lists all errors of a file"
    return Finding("mistake", "fault", "description", error.where, error.message, remedy)


def examine(program: Program, options: Options) -> Diagnosis:
    """Diagnose a compiled network."""
    wiring = Wiring(program)
    findings = [
        *structure.findings(wiring),
        *parts.neuron_findings(wiring),
        *parts.rule_findings(wiring, options.reward_after),
    ]
    findings += drift.findings(wiring)
    backend = find_backend(options.backend)
    problems = backend.problems(program)
    for item in problems:
        kind = ("refused", "fault") if item.refused else ("approximated", "warning")
        remedy = item.way_out or "run it on a backend that takes it: neuro backends"
        findings.append(Finding(*kind, item.what, item.origin, f"backend '{options.backend}': {item.why}", remedy))
    if any(problem.refused for problem in problems):
        return Diagnosis(program.name, sort_findings(findings), f"Nothing ran: {options.backend} refuses the network.")
    steps = math.ceil(options.ms / program.resolution - 1e-6)
    try:
        run = observe(backend.build(program, threads=1), program, steps, options.drive, SECONDS)
    except ModelError as error:
        findings.append(_mistake(error))
        return Diagnosis(program.name, sort_findings(findings), "The run stopped with an error.")
    fired = {
        f"population '{p.name}'" for p, s in zip(program.populations, run.populations, strict=True) if s.spikes.any()
    }
    # Initial states or a model's dynamics can make neurons fire against a check of the description: the run decides.
    findings = [f for f in findings if f.name not in ("cannot-fire", "no-path") or f.what not in fired]
    findings += structure.isolated_outputs(wiring)
    activity_findings = list(activity.findings(wiring, run))
    # "silent" uses the true rates of the inputs, "cannot-fire" assumes a spike in every step: only "silent" stays.
    silent = {f.what for f in activity_findings if f.name == "silent" and f.severity == "fault"}
    findings = [f for f in findings if f.name != "cannot-fire" or f.what not in silent]
    findings += [*activity_findings, *learning.findings(wiring, run, options.ran, options.steered)]
    if options.chip is not None or options.train:
        from neuro_doctor import on_request

        findings += on_request.chip_findings(wiring, run, options.chip) if options.chip is not None else ()
        findings += on_request.gradient_findings(wiring, run) if options.train else ()
    if not (_works(wiring, run) or run.idle):
        causes = [f for f in findings if f.severity == "warning" and f.name in EXPLAIN]
        findings = [replace(f, severity="fault") if f in causes else f for f in findings]
    return Diagnosis(program.name, sort_findings(findings), _about(run, options), run)


def _works(wiring: Wiring, run: Observation) -> bool:
    """Return whether an output fired, or any population if there is no output. True for runs shorter than SHORT_MS."""
    neurons = [k for k, part in enumerate(run.program.populations) if part.kind == "neuron"]
    ends = [k for k in neurons if structure.is_end(wiring, k)] or neurons
    return run.ms < SHORT_MS or not ends or any(run.populations[k].spikes.any() for k in ends)


def _about(run: Observation, options: Options) -> str:
    seed = f"seed {run.program.seed}"
    limit = f" of {options.ms:g}, as it was stopped after {SECONDS:g} s" if run.steps < run.max_steps else ""
    names = ", ".join(run.program.populations[k].name for k in sorted(run.driven))
    driven = f"; {names} driven at {options.drive:g} Hz" if names else ""
    return f"It ran {run.ms:g} ms{limit} on {options.backend}, {seed}{driven}."
