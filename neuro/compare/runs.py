"""Run one network on several backends with the same input, and compare each run with the first."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.placing import Placement, place
from neuro.chips.pricing import RULES_APPLIED
from neuro.chips.quantising import quantise
from neuro.compare.differences import (
    ComparedSpikes,
    difference,
    distance,
    divergence,
    histograms,
    learnt,
    rounding,
    same_steps,
)
from neuro.compare.result import Bill, Comparison, PopulationResult, Run, WorldResult
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.extras import install
from neuro.model.network import Network
from neuro.model.neurons import CurrentGenerator, Generator
from neuro.program.backend import OverflowWarning, find_backend
from neuro.program.program import Program
from neuro.run.collect import record_of
from neuro.run.compiled import ApproximationWarning, compile
from neuro.run.simulation import Simulation

if TYPE_CHECKING:
    from neuro.realtime.closed_loop import ClosedLoop

TARGETS = ("loihi", "spinnaker", "cpu", "gpu")
"""Targets for which the first run gets a bill. A run on a chip backend also gets the bill of its own chip."""

Advance = Callable[[Simulation, int], object]


def compare(
    net: Network,
    backends: Sequence[str | PathLike[str]],
    ms: float,
    seed: int = 0,
    *,
    threads: int = 1,
    advance: Advance | None = None,
) -> Comparison:
    """Run a network on several backends and compare each run with the first.

    If a backend refuses the network, the result has the reason. The first backend that runs is the reference.

    Args:
        net: the network; it is not changed.
        backends: two or more names of backends, or table files of chips.
        ms: duration of the runs, a multiple of the resolution.
        seed: seed of all random numbers; all backends receive the same input.
        threads: number of cores, for backends that use several.
        advance: function that runs a simulation for some steps, e.g. to show progress; by default `sim.run`.

    Raises:
        ModelError: a name is unknown or repeated, fewer than two backends run the network, or `ms` is off the grid.
    """
    names = [str(name) for name in backends]
    if len(names) < 2:
        raise ModelError(f"backends = {', '.join(names) or 'none'}: expected two or more to compare")
    for index, name in enumerate(names):
        find_backend(name)
        if name in names[:index]:
            raise ModelError(f"backends: found '{name}' twice: expected different names")
    steps = Clock(net.resolution).step(ms, "ms")
    probed_net, runs = _recording(net), list[Run]()
    for name in names:
        first = next((run for run in runs if not run.refused), None)
        with _warnings() as warning_texts:
            try:
                loop = None
                if probed_net.world_section is not None:
                    from neuro.realtime.closed_loop import lived

                    loop = lived(probed_net, ms, backend=name, seed=seed, threads=threads, record=True)
                    sim = loop.sim
                else:
                    sim = compile(probed_net, backend=name, seed=seed, threads=threads)
                    if advance is None:
                        sim.run(Clock(sim.program.resolution).ms(steps))
                    else:
                        advance(sim, steps)
            except ModelError as error:
                run = Run(name, refused=str(error), reason=next(iter(error.others), error).alone())
            else:
                run = _against(_gather(sim, name, first is None), first, sim.time)
                run = run if loop is None else _in_world(run, loop, first)
        runs.append(replace(run, warnings=tuple(warning_texts)))
    record = record_of(net, backend=", ".join(names), threads=threads, seed=seed)
    return _comparison(net, ms, seed, runs, record)


def _comparison(net: Network, ms: float, seed: int, runs: list[Run], record: Mapping[str, Any]) -> Comparison:
    """Return the comparison of two or more runs."""
    _check_number_of_runs(runs)
    program = next(run.program for run in runs if run.program is not None)
    fixed = {run.backend: run.fixed for run in runs if run.fixed is not None}
    return Comparison(
        network=net.name,
        ms=float(ms),
        resolution_ms=net.resolution,
        seed=seed,
        runs=tuple(runs),
        histograms=histograms(program, fixed),
        learnt=learnt(program, {run.backend: run.final for run in runs if not run.refused}),
        notes=tuple(_notes(runs, float(ms))),
        record=record,
    )


def _check_number_of_runs(runs: list[Run]) -> None:
    """Raise an error if fewer than two backends ran. An error common to all backends is raised unchanged."""
    ran = sum(not run.refused for run in runs)
    refusals = dict.fromkeys(run.refused for run in runs if run.refused)
    if ran == 0 and len(refusals) == 1:
        raise ModelError(*refusals)
    if ran < 2:
        reasons = "\n".join(refusals)
        runs_left = {0: "none", 1: "only 1"}[ran]
        verb = "runs" if ran else "run"
        raise ModelError(f"{runs_left} of the {len(runs)} backends {verb} this network: nothing to compare\n{reasons}")


def _recording(net: Network) -> Network:
    """Return a copy of the network in which all generators of spikes have a probe."""
    copied = copy.copy(net)
    copied.probes = dict(net.probes)
    probed = {probe.of for probe in net.probes.values() if probe.record == "spikes"}
    for name, part in net.populations.items():
        emits = isinstance(part.model, Generator) and not isinstance(part.model, CurrentGenerator)
        if name not in probed and emits:
            probe_name = f"{name}.spikes"
            while probe_name in copied.probes:
                probe_name += "_"
            copied.probe(probe_name, name)
    return copied


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect the warnings of backends; other warnings are passed on."""
    texts: list[str] = []
    kinds = (ApproximationWarning, OverflowWarning)
    with warnings.catch_warnings(record=True) as caught:
        for kind in kinds:
            warnings.simplefilter("always", kind)
        yield texts
        texts += dict.fromkeys(str(w.message) for w in caught if issubclass(w.category, kinds))
    for w in caught:
        if not issubclass(w.category, kinds):
            warnings.warn_explicit(w.message, w.category, w.filename, w.lineno)


def _gather(sim: Simulation, backend: str, first: bool) -> Run:
    """Return the results of a run for comparison and display."""
    program, counts = sim.program, sim.counts()
    clock = Clock(program.resolution)
    trains, results = dict[str, ComparedSpikes](), dict[str, PopulationResult]()
    for part in program.populations:
        if isinstance(part.model, CurrentGenerator):
            continue
        times, ids = sim.spikes(part.name)
        trains[part.name] = ComparedSpikes(part.size, times, clock.steps(times, "spikes"), ids)
        rate = times.size / max(part.size, 1) / (sim.time / 1000.0)
        results[part.name] = PopulationResult(part.size, times.size, rate, isinstance(part.model, Generator))
    fixed, placement = on_chip(program, backend)
    return Run(
        backend,
        counts=counts,
        populations=results,
        rounding=rounding(fixed) if fixed else None,
        fixed=fixed,
        placement=placement,
        bills=_bills(sim, backend, first),
        trains=trains,
        program=program,
        final={part.name: sim.get(part.name, "weight") for part in program.projections if part.size},
        final_delays={p.name: sim.get(p.name, "delay") for p in program.projections if p.size and p.synapse.delays},
    )


def chip_of(backend: str) -> Chip | None:
    """Return the chip emulated by a backend; None for a float backend."""
    backend_chip = getattr(find_backend(backend), "chip", None)
    return backend_chip if isinstance(backend_chip, Chip) else None


def on_chip(program: Program, backend: str) -> tuple[FixedProgram | None, Placement | None]:
    """Return a program in the integers of a backend's chip, and its placement on the cores."""
    backend_chip = chip_of(backend)
    if backend_chip is None:
        return None, None
    return quantise(program, backend_chip), place(program, backend_chip)


def _against(run: Run, first: Run | None, duration_ms: float) -> Run:
    """Return a run with its differences from the first."""
    if first is None:
        return run
    populations = {}
    for name, part in run.populations.items():
        first_train, train = first.trains[name], run.trains[name]
        first_difference = divergence(first_train, train)
        edits = distance(first_train, train, duration_ms)
        populations[name] = replace(part, same=first_difference is None, first=first_difference, distance=edits)
    inputs = [name for name, part in populations.items() if part.generator and not part.same]
    # Inputs are "merged" if the same neurons spike in the same steps, but not equally often in a step.
    merged = all(same_steps(first.trains[name], run.trains[name]) for name in inputs)
    return replace(
        run,
        populations=populations,
        weights={name: difference(first.final[name], weights) for name, weights in run.final.items()},
        delays={name: difference(first.final_delays[name], delays) for name, delays in run.final_delays.items()},
        inputs="same" if not inputs else "merged" if merged else "other",
    )


def _in_world(run: Run, loop: ClosedLoop, first: Run | None) -> Run:
    """Return a run with steps, episodes and decisions of its world."""
    records = loop.recorded()
    actions = np.asarray(records["actions"], dtype=np.float64)
    share = 1.0
    if first is not None and first.actions is not None:
        n = min(len(actions), len(first.actions))
        is_equal = (actions[:n] == first.actions[:n]).reshape(n, -1).all(axis=1)
        share = float(is_equal.mean()) if n else 1.0
    returns = records["returns"]
    mean_return = float(np.mean(returns)) if len(returns) else None
    return replace(run, actions=actions, world=WorldResult(len(actions), len(returns), mean_return, share))


def _bills(sim: Simulation, backend: str, first: bool) -> tuple[Bill, ...]:
    """Return the bill of a run on its own chip; for the first run also bills on other targets."""
    own_chip = (backend,) if chip_of(backend) else ()
    others = tuple(name for name in TARGETS if first and name not in own_chip)
    return tuple(_bill(sim, backend, name) for name in own_chip + others)


def _bill(sim: Simulation, backend: str, target: str) -> Bill:
    try:
        return Bill(target, backend, sim.energy(target))
    except ModelError as error:
        return Bill(target, backend, None, str(error))


def _notes(runs: list[Run], ms: float) -> Iterable[str]:
    ran = [run for run in runs if not run.refused]
    if runs[0].refused:
        yield f"'{runs[0].backend}' did not run: others are compared with '{ran[0].backend}'"
    if not any(part.spikes for part in ran[0].neurons.values()):
        yield f"no neuron fired on '{ran[0].backend}': there is little to compare"
    populations = [(name, part) for run in ran[1:] for name, part in run.populations.items()]
    if any(part.distance is None for _, part in populations):
        yield f"spike-train distances are left out: {install('compare')} installs the library for them"
    measured = dict[str, None]()
    for name, part in populations:
        distance = part.distance
        if distance is not None and (distance.neurons < part.neurons or distance.until_ms < ms):
            chosen = f"{distance.neurons:,} of {part.neurons:,} neurons, evenly chosen"
            neurons = chosen if distance.neurons < part.neurons else "all neurons"
            time = f", up to {distance.until_ms:g} ms" if distance.until_ms < ms else ""
            measured[f"the distance of '{name}' covers {neurons}{time}"] = None
    yield from measured
    for bill in ran[0].bills:
        if bill.energy is not None and bill.energy.refused:
            yield f"no total for {bill.target}, which refuses the network: {bill.energy.refused}"
    if any(name.startswith("rules applied") for run in ran if run.counts for name in run.counts.native):
        yield RULES_APPLIED
