"""What NEST cannot run as described, and the way out of each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.backend import Problem, floats_only
from neuro.neurons import Neuron, dc_generator
from neuro.program import Population, Program, Projection
from neuro_nest.tables import NODES, READABLE, SYNAPSE_MODELS, SYNAPSES, TICKS_PER_MS
from neuro_nest.wires import layers

ELSEWHERE = "backend 'event' runs it"


def problems(program: Program) -> list[Problem]:
    """All that is refused."""
    chips = floats_only(program)
    if chips:
        return chips
    found = [*_of_network(program)]
    for index, part in enumerate(program.populations):
        found += _of_population(program, index, part)
    for part in program.projections:
        found += _of_projection(part)
    return [*found, *_of_copies(program)]


def _refused(what: str, why: str, way_out: str, part: object) -> Problem:
    return Problem(True, what, why, way_out, getattr(part, "origin", None))


def _of_network(program: Program) -> Iterator[Problem]:
    ticks = program.resolution * TICKS_PER_MS
    if abs(ticks - round(ticks)) > 1e-9:
        yield _refused(
            f"resolution = {program.resolution:g} ms", "NEST's clock ticks in 0.001 ms", "use a multiple of it", None
        )
    for group in program.groups:
        yield _refused(f"group '{group.name}'", "NEST has no winner-take-all", ELSEWHERE, group)
    if program.trials is not None:
        yield _refused("trials", "NEST cannot drop what is under way", ELSEWHERE, program.trials)
    for probe in program.probes:
        if probe.record != "spikes" and probe.record not in READABLE:
            what = f"probe '{probe.name}': {probe.record}"
            yield _refused(what, f"NEST shows {' and '.join(READABLE)} only between steps", "probe V_m", probe)


def _of_population(program: Program, index: int, part: Population) -> Iterator[Problem]:
    told = f"population '{part.name}'"
    if part.model.name not in NODES:
        yield _refused(f"{told}: {part.model.name}", "NEST has no such model", ELSEWHERE, part)
        return
    for name, values in part.initial.items():
        if name not in READABLE and np.any(values != 0.0) and isinstance(part.model, Neuron):
            yield _refused(f"{told}: initial {name}", "NEST's starts at 0", ELSEWHERE, part)
    tau_m = part.parameters.get("tau_m")
    if tau_m is not None and np.isinf(tau_m).any() and _has_current(program, index, part):
        why = "NEST's propagator of a current, tau_m / C_m (1 - exp(-h / tau_m)), is then no number"
        yield _refused(f"{told}: infinite tau_m with a current", why, "use a large tau_m, say 1e6", part)


def _has_current(program: Program, index: int, part: Population) -> bool:
    """Whether more than spikes through delta or exponential synapses drives any of the neurons."""
    sources = [program.populations[p.source].model for p in program.projections if p.target == index]
    driven = bool(np.any(part.parameters["I_e"] != 0.0)) or any(isinstance(m, dc_generator) for m in sources)
    return driven or part.model.name == "iaf_psc_alpha"


def _of_projection(part: Projection) -> Iterator[Problem]:
    told = f"projection '{part.name}'"
    if part.synapse.name not in SYNAPSES:
        yield _refused(f"{told}: {part.synapse.name}", "NEST has no such rule", ELSEWHERE, part)
    elif part.grid is not None and part.synapse.learns:
        yield _refused(f"{told}: a kernel that learns", "NEST's synapses share no weights", ELSEWHERE, part)


def _of_copies(program: Program) -> Iterator[Problem]:
    """Synapses of the same ends, and post neurons with dopamine of their own, take a copy of the model each."""
    copies = 0
    for index, part in enumerate(program.projections):
        source, target, _ = program.synapses(index)
        deep = int(layers(source, target).max(initial=-1)) + 1
        copies += deep * (program.populations[part.target].size if part.dopamine_one_to_one else 1)
    if copies > SYNAPSE_MODELS:
        why = f"NEST would need {copies} copies of synapse models and holds {SYNAPSE_MODELS}"
        way_out = "connect pairs once (multapses: false), let neurons share dopamine, or use backend 'event'"
        yield _refused("the network", why, way_out, None)


