"""A simulation as it is now: its network with what it learnt, its program for a copy, and its whole state in a file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.quantities import word_of
from neuro.files.state import Identity, fingerprint, read_state, write_state
from neuro.model import parts
from neuro.model.network import Network
from neuro.model.rules import all_to_all, grid, pairs
from neuro.model.synapses import Synapse
from neuro.model.synapses.base import steps_of
from neuro.model.views import View
from neuro.program.backend import Engine, Spikes
from neuro.program.program import (
    Floats,
    Ints,
    Population,
    Program,
    Projection,
)
from neuro.run import settable
from neuro.run.inputs import StreamFeeder
from neuro.run.records import Records
from neuro.run.trials import TrialLoop


def learnt_network(
    net: Network, program: Program, engine: Engine, clock: Clock, rules: Mapping[int, Synapse]
) -> Network:
    """A copy of `net` that holds the present weights and parameters and nothing random in its connections.

    Delays that learn are those that the next spikes would take, in whole steps.
    Synapses that were drawn at random become listed pairs; weights, delays and initial states that were drawn
    become arrays, and what was encoded becomes spikes or rates. States such as V_m begin anew.

    Args:
        net: what was compiled.
        program: its resolved form.
        engine: holds the present weights and parameters.
        clock: of the network.
        rules: the present synapse models of projections.
    """
    copy = Network(net.name, resolution=net.resolution)
    for index, population in enumerate(program.populations):
        copy.populations[population.name] = _population(net.populations[population.name], population, index, engine)
    for index, projection in enumerate(program.projections):
        copy.projections[projection.name] = _projection(
            net.projections[projection.name], projection, program, index, engine, clock, rules[index]
        )
    copy.signals, copy.groups = dict(net.signals), dict(net.groups)
    for name, probe in net.probes.items():
        view, pre, post = (_moved(each, copy) for each in (probe.view, probe.pre, probe.post))
        copy.probes[name] = replace(probe, view=view, pre=pre, post=post)
    copy.trials_section, copy.trials_origin = net.trials_section, net.trials_origin
    copy.readout_section = net.readout_section
    return copy


def _moved(view: View | None, net: Network) -> View | None:
    """The same neurons of the population of that name."""
    return None if view is None else net.populations[view.population.name][view.index]


def _population(part: parts.Population, resolved: Population, index: int, engine: Engine) -> parts.Population:
    if resolved.stream is not None:
        return replace(part, shape=resolved.shape)
    model = resolved.model
    changed = {}
    for entry in fields(model):
        word = word_of(entry.name)
        if word in resolved.parameters:
            now = _one_or_all(engine.get(index, word))
            changed[entry.name] = bool(now) if entry.metadata["quantity"].kind == "boolean" else now
    initial = {name: _one_or_all(resolved.initial[name]) for name in part.initial}
    return replace(part, shape=resolved.shape, model=replace(model, **changed), initial=initial)


def _projection(
    part: parts.Projection,
    resolved: Projection,
    program: Program,
    index: int,
    engine: Engine,
    clock: Clock,
    synapse: Synapse,
) -> parts.Projection:
    weight = engine.get_synapses(index, "weight")
    delay = clock.array_ms(_steps(program, index, engine))
    shape: Callable[[Floats], Any] = _one_or_all
    rule = part.rule
    if isinstance(rule, all_to_all) and resolved.whole_layout == "dense":
        sizes = (program.populations[resolved.source].size, program.populations[resolved.target].size)
        shape = lambda values: _one_or_all(values, sizes)  # noqa: E731
    elif isinstance(rule, grid) and resolved.grid is not None:
        kernels = weight.reshape(resolved.grid.kernels)
        return replace(part, synapse=synapse, weight=kernels, delay=float(delay[0]))
    elif resolved.whole_layout != "one_to_one":
        pre, post = program.connections(index)
        rule = pairs(pre=pre, post=post)
    whole = replace(part, source_view=None, target_view=None)
    each = {f.name: shape(value) for f in fields(synapse) if isinstance(value := getattr(synapse, f.name), np.ndarray)}
    synapse = replace(synapse, **each) if each else synapse
    return replace(whole, rule=rule, synapse=synapse, weight=shape(weight), delay=shape(delay))


def _steps(program: Program, index: int, engine: Engine) -> Ints:
    """The delays in steps, those that learn as the next spike would take them."""
    part, h = program.projections[index], program.resolution
    if not part.synapse.delays:
        return program.delays(index).astype(np.int64)
    fewest, most = part.delay_range(h)
    learnt = engine.get_synapses(index, "delay")
    return np.array([steps_of(delay, h, fewest, most) for delay in learnt], dtype=np.int64)


def _one_or_all(values: Floats, shape: tuple[int, ...] | None = None) -> Any:
    """A number where all are equal, else an array that cannot be changed."""
    if values.size and (values == values[0]).all():
        return float(values[0])
    array = values.copy() if shape is None else values.reshape(shape).copy()
    array.flags.writeable = False
    return array


class Saved:
    """Writes and reads states of one simulation.

    Args:
        program: the network.
        backend: the name of the backend.
        engine: runs it.
        records: what it has recorded.
        rules: the present synapse models of projections; changed in place.
        inflow: what it plays.
    """

    def __init__(
        self,
        program: Program,
        backend: str,
        engine: Engine,
        records: Records,
        rules: dict[int, Synapse],
        inflow: StreamFeeder,
    ) -> None:
        self._identity = Identity(program.name, backend, program.seed, fingerprint(program))
        self._engine, self._records, self._rules, self._inflow = engine, records, rules, inflow

    @property
    def fingerprint(self) -> str:
        """Hash of the resolved network."""
        return self._identity.fingerprint

    def write(
        self, path: Path, trials: TrialLoop | None, record: Mapping[str, Any], files: Mapping[str, bytes]
    ) -> None:
        """Write the state.

        Args:
            path: of the file.
            trials: of a network that has them.
            record: where it comes from, see `neuro.core.provenance`.
            files: of the network, by name.

        Raises:
            ModelError: the file cannot be written.
        """
        arrays = {f"engine/{name}": values for name, values in self._engine.snapshot().items()}
        arrays |= {f"probes/{name}": values for name, values in self._records.recorder.snapshot().items()}
        arrays |= {f"rules/{index}": rule.vector() for index, rule in self._rules.items()}
        arrays |= {f"streams/{name}": step for name, step in self._inflow.state().items()}
        arrays["held"] = np.array(self._records.held)
        if trials is not None:
            arrays["trials"] = trials.state()
        write_state(path, self._identity, arrays, record, files)

    def read(self, path: Path, trials: TrialLoop | None) -> None:
        """Go on from a state.

        Raises:
            ModelError: it is of something else; all stays as it is.
        """
        arrays = read_state(path, self._identity)
        self._engine.restore(_below("engine/", arrays))
        self._records.restore(_below("probes/", arrays), int(arrays.get("held", 0)))
        for index, rule in self._rules.items():
            self._rules[index] = settable.rule_of(rule, arrays[f"rules/{index}"])
        self._inflow.put(_below("streams/", arrays))
        if trials is not None:
            trials.put(arrays["trials"])


def _below(begin: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The arrays of one part, by their names there."""
    return {name.removeprefix(begin): values for name, values in arrays.items() if name.startswith(begin)}


_OF_WEIGHTS = ("set", "set_weights", "silence", "restore", "trials")


def present(program: Program, engine: Engine, rules: Mapping[int, Synapse], steered: Collection[str]) -> Program:
    """The program with the present weights and parameters, whose listed inputs emit what they have emitted.

    Args:
        program: what was compiled.
        engine: it runs; it is only read.
        rules: the present synapse models of projections.
        steered: the calls by which the simulation was changed.
    """
    populations = tuple(_present_population(k, part, engine) for k, part in enumerate(program.populations))
    changed = any(call in steered for call in _OF_WEIGHTS)
    projections = tuple(
        _present_projection(q, part, engine, rules[q], changed) for q, part in enumerate(program.projections)
    )
    return replace(program, populations=populations, projections=projections)


def _present_population(k: int, part: Population, engine: Engine) -> Population:
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


def _present_projection(q: int, part: Projection, engine: Engine, rule: Synapse, changed: bool) -> Projection:
    if part.carries == "current" or not part.size or not (changed or part.synapse.learns):
        return part
    return replace(part, synapse=rule, weight=engine.get_synapses(q, "weight"))
