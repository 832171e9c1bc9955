"""A simulation as it is now as a program: for a copy that starts anew with its weights, parameters and inputs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from neuro.model.synapses import Synapse
from neuro.program.backend import Engine, Spikes
from neuro.program.program import Population, Program, Projection

_OF_WEIGHTS = ("set", "set_weights", "silence", "restore", "trials")


def present(program: Program, engine: Engine, rules: Mapping[int, Synapse], steered: Collection[str]) -> Program:
    """The program with the present weights and parameters, whose listed inputs emit what they have emitted.

    Args:
        program: what was compiled.
        engine: it runs; it is only read.
        rules: the present synapse models of projections.
        steered: the calls by which the simulation was changed.
    """
    populations = tuple(_population(k, part, engine) for k, part in enumerate(program.populations))
    changed = any(call in steered for call in _OF_WEIGHTS)
    projections = tuple(_projection(q, part, engine, rules[q], changed) for q, part in enumerate(program.projections))
    return replace(program, populations=populations, projections=projections)


def _population(k: int, part: Population, engine: Engine) -> Population:
    if part.kind == "listed":
        if part.stream is not None and part.stream.again:
            return part
        emitted = engine.spikes(k, -1) if part.records else None
        if emitted is None or not emitted.steps.size:
            return part
        if emitted.payloads is not None:
            return _with_payloads(part, emitted)
        listed, several = np.unique(part.spike_steps * part.size + part.spike_ids, return_counts=True)
        keys = np.concatenate([listed, emitted.steps * part.size + emitted.ids])
        spikes, places = np.unique(keys, return_inverse=True)
        most = np.zeros(spikes.size, dtype=np.int64)  # what is listed was emitted, too, if it was its time
        np.maximum.at(most, places, np.concatenate([several, emitted.multiplicity]))
        spikes = np.repeat(spikes, most)
        return replace(part, spike_steps=spikes // part.size, spike_ids=spikes % part.size, stream=None)
    if part.kind == "current" or part.schedule is not None:
        return part
    now = {word: engine.get(k, word) for word in part.parameters}
    return replace(part, parameters={word: v[:1] if (v == v[0]).all() else v for word, v in now.items()})


def _with_payloads(part: Population, emitted: Spikes) -> Population:
    """A graded population that lists what it has emitted, and what it still lists for later."""
    later = part.spike_steps > emitted.steps[-1]
    steps, ids = (
        np.concatenate([sent, listed[later]])
        for sent, listed in ((emitted.steps, part.spike_steps), (emitted.ids, part.spike_ids))
    )
    payloads = np.concatenate([emitted.payloads, part.spike_payloads[later]]).astype(np.int64)
    return replace(part, spike_steps=steps, spike_ids=ids, spike_payloads=payloads)


def _projection(q: int, part: Projection, engine: Engine, rule: Synapse, changed: bool) -> Projection:
    if part.carries == "current" or not part.size or not (changed or part.synapse.learns):
        return part
    return replace(part, synapse=rule, weight=engine.get_synapses(q, "weight"))
