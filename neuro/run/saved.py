"""Present state of a simulation: the learnt network, the program of a copy, and the state in a file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.quantities import word_of
from neuro.files.state import Identity, fingerprint, read_state, write_state
from neuro.model import parts
from neuro.model.network import Network
from neuro.model.rules import all_to_all, grid, pairs
from neuro.model.synapses.base import steps_of
from neuro.program.backend import Engine, Spikes
from neuro.program.program import (
    Floats,
    Population,
    Program,
)
from neuro.run import settable
from neuro.run.handles import Run
from neuro.run.records import Records
from neuro.run.streams import StreamFeeder
from neuro.run.trials import TrialLoop

if TYPE_CHECKING:
    from neuro.run.signals import SignalFeeder


def learnt_network(run: Run) -> Network:
    """Return a copy of a network in execution with the present weights and parameters, and without random connections.

    Learnt delays are those of the next spikes, in whole steps. Random synapses become listed pairs. Random
    weights, delays and initial states become arrays, and encoded input becomes spikes or rates. States such as V_m
    start from the initial values.
    """
    net, program = run.net, run.program
    copy = Network(net.name, resolution=net.resolution)
    for index, population in enumerate(program.populations):
        copy.populations[population.name] = _population(net.populations[population.name], run, index)
    for index, projection in enumerate(program.projections):
        copy.projections[projection.name] = _projection(net.projections[projection.name], run, index)
    copy.signals, copy.groups = dict(net.signals), dict(net.groups)
    for name, probe in net.probes.items():
        view, pre, post = (
            None if selection is None else copy.populations[selection.population.name][selection.index]
            for selection in (probe.view, probe.pre, probe.post)
        )
        copy.probes[name] = replace(probe, view=view, pre=pre, post=post)
    copy.trials_section, copy.trials_origin = net.trials_section, net.trials_origin
    copy.readout_section = net.readout_section
    copy.world_section, copy.world_origin = net.world_section, net.world_origin
    return copy


def _population(part: parts.Population, run: Run, index: int) -> parts.Population:
    resolved = run.program.populations[index]
    if resolved.stream is not None:
        return replace(part, shape=resolved.shape)
    model = resolved.model
    changed = {}
    for entry in fields(model):
        word = word_of(entry.name)
        if word in resolved.parameters:
            present = _one_or_all(run.engine.get(index, word))
            changed[entry.name] = bool(present) if entry.metadata["quantity"].kind == "boolean" else present
    initial = {name: _one_or_all(resolved.initial[name]) for name in part.initial}
    return replace(part, shape=resolved.shape, model=replace(model, **changed), initial=initial)


def _projection(part: parts.Projection, run: Run, index: int) -> parts.Projection:
    program, resolved, synapse = run.program, run.program.projections[index], run.rules[index]
    weight = run.engine.get_synapses(index, "weight")
    if resolved.synapse.delays:  # the delays of the next spikes
        fewest, most = resolved.delay_range(program.resolution)
        learnt_delays = run.engine.get_synapses(index, "delay")
        steps = np.array([steps_of(ms, program.resolution, fewest, most) for ms in learnt_delays], dtype=np.int64)
    else:
        steps = program.delays(index).astype(np.int64)
    delay = run.clock.array_ms(steps)
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
    unrestricted = replace(part, source_view=None, target_view=None)
    arrays = {f.name: shape(a) for f in fields(synapse) if isinstance(a := getattr(synapse, f.name), np.ndarray)}
    synapse = replace(synapse, **arrays) if arrays else synapse
    return replace(unrestricted, rule=rule, synapse=synapse, weight=shape(weight), delay=shape(delay))


def _one_or_all(values: Floats, shape: tuple[int, ...] | None = None) -> Any:
    """Return a number if all values are equal, else a read-only array."""
    if values.size and (values == values[0]).all():
        return float(values[0])
    array = values.copy() if shape is None else values.reshape(shape).copy()
    array.flags.writeable = False
    return array


class Saved:
    """Writes and reads states of one simulation.

    Args:
        run: the network in execution.
        records: the records of the simulation.
        inflow: feeder of the streams, if any.
        signals: feeder of the signals, if they have values.
    """

    def __init__(
        self, run: Run, records: Records, inflow: StreamFeeder | None, signals: SignalFeeder | None = None
    ) -> None:
        self._identity = Identity(run.program.name, run.backend, run.program.seed, fingerprint(run.program))
        self._engine, self._rules, self._records, self._inflow = run.engine, run.rules, records, inflow
        self._signals = signals

    @property
    def fingerprint(self) -> str:
        """Hash of the compiled network."""
        return self._identity.fingerprint

    def write(
        self, path: Path, trials: TrialLoop | None, record: Mapping[str, Any], files: Mapping[str, bytes]
    ) -> None:
        """Write the state to a file.

        Args:
            path: path of the file.
            trials: the trial loop of a network with trials.
            record: the provenance, see `neuro.core.provenance`.
            files: files of the network, by name.

        Raises:
            ModelError: the file cannot be written.
        """
        arrays = {f"engine/{name}": values for name, values in self._engine.snapshot().items()}
        arrays |= {f"probes/{name}": values for name, values in self._records.recorder.snapshot().items()}
        arrays |= {f"rules/{index}": rule.vector() for index, rule in self._rules.items()}
        if self._inflow is not None:
            arrays |= {f"streams/{name}": step for name, step in self._inflow.state().items()}
        if self._signals is not None:
            arrays |= {f"signals/{name}": array for name, array in self._signals.state().items()}
        arrays["held"] = np.array(self._records.held)
        if trials is not None:
            arrays["trials"] = trials.state()
        write_state(path, self._identity, arrays, record, files)

    def read(self, path: Path, trials: TrialLoop | None) -> None:
        """Continue from a state in a file.

        Raises:
            ModelError: the file belongs to another network, backend or seed. Nothing is changed in this case.
        """
        arrays = read_state(path, self._identity)
        self._engine.restore(_without_prefix("engine/", arrays))
        self._records.restore(_without_prefix("probes/", arrays), int(arrays.get("held", 0)))
        for index, rule in self._rules.items():
            self._rules[index] = settable.rule_of(rule, arrays[f"rules/{index}"])
        if self._inflow is not None:
            self._inflow.put(_without_prefix("streams/", arrays))
        if self._signals is not None:
            self._signals.put(_without_prefix("signals/", arrays))
        if trials is not None:
            trials.put(arrays["trials"])


def _without_prefix(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the arrays whose names begin with a prefix, without that prefix."""
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


_CALLS_THAT_SET_WEIGHTS = ("set", "set_weights", "silence", "restore", "trials")


def present(run: Run, steered: Collection[str]) -> Program:
    """Return the program with the present weights and parameters, and with listed inputs that repeat their spikes.

    Args:
        run: the network in execution; its engine is not changed.
        steered: the names of the calls that changed the simulation.
    """
    program, engine = run.program, run.engine
    populations = tuple(_present_population(k, part, engine) for k, part in enumerate(program.populations))
    changed = any(call in steered for call in _CALLS_THAT_SET_WEIGHTS)
    projections = list(program.projections)
    for q, part in enumerate(program.projections):
        if part.carries == "spikes" and part.size and (changed or part.synapse.learns):
            projections[q] = replace(part, synapse=run.rules[q], weight=engine.get_synapses(q, "weight"))
    return replace(program, populations=populations, projections=tuple(projections))


def _present_population(index: int, part: Population, engine: Engine) -> Population:
    if part.kind == "listed":
        if part.stream is not None and part.stream.repeatable:
            return part
        emitted = engine.spikes(index, -1) if part.records else None
        if emitted is None or not emitted.steps.size:
            return part
        if emitted.payloads is not None:
            return _with_payloads(part, emitted)
        listed_keys, listed_counts = np.unique(part.spike_steps * part.size + part.spike_ids, return_counts=True)
        keys = np.concatenate([listed_keys, emitted.steps * part.size + emitted.ids])
        spikes, positions = np.unique(keys, return_inverse=True)
        # A listed spike is also among the emitted spikes if its time has passed.
        multiplicity = np.zeros(spikes.size, dtype=np.int64)
        np.maximum.at(multiplicity, positions, np.concatenate([listed_counts, emitted.multiplicity]))
        spikes = np.repeat(spikes, multiplicity)
        return replace(part, spike_steps=spikes // part.size, spike_ids=spikes % part.size, stream=None)
    if part.kind == "current" or part.schedule is not None:
        return part
    values = {word: engine.get(index, word) for word in part.parameters}
    return replace(part, parameters={word: v[:1] if (v == v[0]).all() else v for word, v in values.items()})


def _with_payloads(part: Population, emitted: Spikes) -> Population:
    """Return a graded population that lists the emitted spikes and the listed spikes still to come."""
    is_later = part.spike_steps > emitted.steps[-1]
    steps, ids = (
        np.concatenate([emitted_values, listed_values[is_later]])
        for emitted_values, listed_values in ((emitted.steps, part.spike_steps), (emitted.ids, part.spike_ids))
    )
    payloads = np.concatenate([emitted.payloads, part.spike_payloads[is_later]]).astype(np.int64)
    return replace(part, spike_steps=steps, spike_ids=ids, spike_payloads=payloads)
