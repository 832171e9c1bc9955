"""The engine: steps a program as tensors for one recording, records spikes, reads and writes states between steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from neuro.program.backend import EngineCounts, Outcome, Spikes, Trial
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import carrying
from neuro_torch.stepping import Stepper
from neuro_torch.wires import Emitted


class TensorRecord:
    """Recorded spikes in the order of their steps, and counts.

    Attributes:
        steps, ids, multiplicity: recorded spikes, one array for each step with spikes.
        events, spikes: counts by neuron; a spike of multiplicity m counts once in `events` and m times in `spikes`.
        active: number of neuron updates with an arrival or a spike.

    Args:
        size: number of neurons.
        keeps: whether to record spikes; counts are always recorded.
        graded: whether multiplicities are payloads, so that each message counts as one spike.
    """

    def __init__(self, size: int, keeps: bool, graded: bool = False) -> None:
        self._size, self._keeps, self._graded = size, keeps, graded
        self.start_anew()

    @property
    def nbytes(self) -> int:
        """Bytes of the recorded spikes."""
        return 24 * sum(len(steps) for steps in self.steps)

    def start_anew(self) -> None:
        """Drop all spikes and counts."""
        self.steps: list[Ints] = []
        self.ids: list[Ints] = []
        self.multiplicity: list[Ints] = []
        self.events: Ints = np.zeros(self._size, dtype=np.int64)
        self.spikes: Ints = np.zeros(self._size, dtype=np.int64)
        self.active = 0

    def add(self, step: int, ids: Ints, multiplicity: Ints) -> None:
        """Add the spikes of one step."""
        self.events[ids] += 1
        self.spikes[ids] += 1 if self._graded else multiplicity
        if self._keeps and len(ids):
            self.steps.append(np.full(len(ids), step, dtype=np.int64))
            self.ids.append(ids)
            self.multiplicity.append(multiplicity)

    def since(self, step: int) -> Spikes:
        """Return the spikes after a step."""
        first = next((k for k, steps in enumerate(self.steps) if steps[0] > step), len(self.steps))
        no_spikes = np.zeros(0, dtype=np.int64)
        columns = (np.concatenate([no_spikes, *column[first:]]) for column in (self.steps, self.ids, self.multiplicity))
        steps, ids, multiplicity = columns
        return Spikes(steps, ids, multiplicity.astype(np.int64))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        self.keep(self.since(before))

    def keep(self, spikes: Spikes) -> None:
        """Replace the recorded spikes; counts stay."""
        cuts = np.flatnonzero(np.diff(spikes.steps)) + 1
        has_spikes = len(spikes.steps) > 0
        self.steps = np.split(spikes.steps, cuts) if has_spikes else []
        self.ids = np.split(spikes.ids, cuts) if has_spikes else []
        self.multiplicity = np.split(spikes.multiplicity.astype(np.int64), cuts) if has_spikes else []


class TorchEngine:
    """A program in execution, see `neuro.program.backend.Engine` for the methods.

    Args:
        program: the network, which `problems` accepts.
        threads: number of threads that torch uses during a run.
        device: device of the tensors.
    """

    def __init__(self, program: Program, threads: int, device: torch.device) -> None:
        self.program, self._threads = program, threads
        self.stepper = Stepper(program, device=device, hears=True)
        self.records = [TensorRecord(part.size, part.records, part.model.graded) for part in program.populations]

    @property
    def step(self) -> int:
        """The last finished step."""
        return self.stepper.now

    def run(self, steps: int) -> None:
        """Advance by some steps."""
        with torch.no_grad(), _threads(self._threads), np.errstate(over="ignore", invalid="ignore"):
            for _ in range(steps):
                self.stepper.step()
                self._record()

    def _record(self) -> None:
        for k, record in enumerate(self.records):
            if (emitted := self.stepper.emitted(k)) is None:
                continue
            ids = emitted.neuron.cpu().numpy()
            record.add(self.step, ids, emitted.multiplicity.cpu().numpy().astype(np.int64))
            if k in self.stepper.heard:
                received = self.stepper.heard[k][0]
                received[emitted.neuron] = True
                record.active += int(received.sum())

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population, with payloads if it is graded."""
        self.stepper.sources[population].inject(steps, ids, self.step, payloads)

    def signal(self, signal: int, values: Floats) -> None:
        """Ignore a signal: no projection receives it, because rules with dopamine are refused."""

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a state or parameter of all neurons, or of some."""
        values: Floats = np.broadcast_to(self._values(population, name), self.program.populations[population].size)
        selected: Floats = values.copy() if ids is None else values[ids]
        return selected

    def _values(self, population: int, name: str) -> Floats:
        if (cells := self.stepper.cells.get(population)) is not None and name in cells.names:
            values: Floats = cells.states[cells.names.index(name)][0].cpu().numpy()
            return values
        source = self.stepper.sources.get(population)
        if source is not None and name in source.names:
            source_values: Floats = source.states[source.names.index(name)]
            return source_values
        return self.stepper.parameters(population)[name]

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters."""
        part = self.stepper.cells.get(population) or self.stepper.sources.get(population)
        for name, array in values.items():
            if part is not None and name in part.names:
                part.put(name, array)
            else:
                self.stepper.parameters(population)[name] = array.copy()
        if part is not None:
            part.refresh()

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return the weight of every synapse; static synapses have no other state."""
        if projection in self.stepper.flows:
            return self.stepper.flows[projection].weights.copy()
        weights: Floats = self.stepper.weights(projection).cpu().numpy()
        return np.broadcast_to(weights, self.program.projections[projection].size).copy()

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Do nothing: static synapses have no rule parameters."""

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that a mask selects."""
        indices = slice(None) if chosen is None else chosen
        updated = self.get_synapses(projection, "weight")
        updated[indices] = np.broadcast_to(weights, updated.shape)[indices]
        if projection in self.stepper.flows:
            self.stepper.flows[projection].weights = updated
        else:
            self.stepper.set_weights(projection, torch.from_numpy(updated).to(self.stepper.device))

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes after a step."""
        return carrying(self.program.populations[population], self.records[population].since(since))

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        for record in self.records:
            record.forget(before)

    def counts(self) -> EngineCounts:
        """Return counts since the start or the last reset."""
        return EngineCounts(
            steps=self.step,
            events=tuple(record.events.copy() for record in self.records),
            spikes=tuple(record.spikes.copy() for record in self.records),
            active=np.array([record.active for record in self.records], dtype=np.int64),
            trial_updates=np.zeros(len(self.program.projections), dtype=np.int64),
        )

    def memory(self) -> dict[str, int]:
        """Return bytes of states, synapses and recorded spikes."""
        return {**self.stepper.memory(), "spikes": sum(record.nbytes for record in self.records)}

    def reset(self, weights: bool) -> None:
        """Return to step 0."""
        self.stepper.start_anew()
        for record in self.records:
            record.start_anew()
        if weights:
            for k, part in enumerate(self.program.projections):
                self.set_weights(k, part.weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return everything that `restore` needs."""
        return take_snapshot(self.stepper, self.records)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        put_snapshot(self.stepper, self.records, arrays)

    def present(self, trial: Trial) -> Outcome:
        """Raise NotImplementedError: networks with trials are refused."""
        raise NotImplementedError

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Raise NotImplementedError, as `present` does."""
        raise NotImplementedError

    def encourage(self, projection: int, maps: Ints) -> None:
        """Raise NotImplementedError, as `present` does."""
        raise NotImplementedError


@contextmanager
def _threads(number: int) -> Iterator[None]:
    """Set the number of torch's threads within a block."""
    n_threads = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(n_threads)


Arrays = Mapping[str, NDArray[Any]]
_SOURCE_STATE = ("states", "steps", "ids", "numbers")
"""Attributes of a source that change between steps."""


def take_snapshot(stepper: Stepper, records: Sequence[TensorRecord]) -> dict[str, NDArray[Any]]:
    """Copy everything that changes while a stepper runs."""
    arrays: dict[str, NDArray[Any]] = {"step": np.array(stepper.now)}
    for k, cells in stepper.cells.items():
        arrays[f"cells/{k}"] = (
            torch.stack([state[0] for state in cells.states]).cpu().numpy() if cells.states else np.zeros(0)
        )
    for k, source in stepper.sources.items():
        arrays |= {f"sources/{k}/{name}": getattr(source, name).copy() for name in _SOURCE_STATE}
    for k, flow in stepper.flows.items():
        arrays |= {f"flows/{k}/{name}": getattr(flow, name).copy() for name in ("due", "held", "weights")}
    for k in range(len(records)):
        arrays |= {f"parameters/{k}/{word}": values.copy() for word, values in stepper.parameters(k).items()}
        arrays[f"sent/{k}"] = _spikes_in_flight(stepper.sent[k])
    for k, versions in stepper.versions.items():
        rows = [[float(begin), *weights.cpu().tolist()] for begin, weights in versions]
        widest = max(len(row) for row in rows)
        arrays[f"weights/{k}"] = np.array(
            [row if len(row) == widest else row[:1] + row[1:] * (widest - 1) for row in rows]
        )
    for k, record in enumerate(records):
        spikes = record.since(-1)
        arrays |= {f"records/{k}/{name}": getattr(spikes, name) for name in ("steps", "ids", "multiplicity")}
        arrays |= {f"records/{k}/counted_{name}": getattr(record, name).copy() for name in ("events", "spikes")}
        arrays[f"records/{k}/active"] = np.array(record.active)
    return arrays


def put_snapshot(stepper: Stepper, records: Sequence[TensorRecord], arrays: Arrays) -> None:
    """Restore a stepper of the same program from the arrays of `take_snapshot`."""
    stepper.start_anew()
    stepper.now = int(arrays["step"])
    for k in range(len(records)):
        for word in stepper.parameters(k):
            stepper.parameters(k)[word] = arrays[f"parameters/{k}/{word}"].copy()
        stepper.sent[k] = _emitted(arrays[f"sent/{k}"], stepper.program.populations[k].size, stepper.device)
    for k, cells in stepper.cells.items():
        for name, values in zip(cells.names, arrays[f"cells/{k}"], strict=True):
            cells.put(name, values)
        cells.refresh()
    for k, source in stepper.sources.items():
        for name in _SOURCE_STATE:
            setattr(source, name, arrays[f"sources/{k}/{name}"].copy())
        source.refresh()
    for k, flow in stepper.flows.items():
        for name in ("due", "held", "weights"):
            setattr(flow, name, arrays[f"flows/{k}/{name}"].copy())
    for k in stepper.versions:
        rows = arrays[f"weights/{k}"]
        stepper.versions[k] = [(int(row[0]), torch.tensor(row[1:], device=stepper.device)) for row in rows]
    for k, record in enumerate(records):
        steps, ids, multiplicity = (arrays[f"records/{k}/{name}"] for name in ("steps", "ids", "multiplicity"))
        record.keep(Spikes(steps, ids, multiplicity))
        record.events, record.spikes = (arrays[f"records/{k}/counted_{name}"].copy() for name in ("events", "spikes"))
        record.active = int(arrays[f"records/{k}/active"])


def _spikes_in_flight(emissions: Sequence[tuple[int, Emitted]]) -> NDArray[Any]:
    """Return step, neuron and multiplicity of spikes that some targets have not received, shape (3, spikes)."""
    columns = [np.zeros((3, 0), dtype=np.int64)]
    for step, emitted in emissions:
        rows: Tensor = torch.stack([emitted.neuron, emitted.multiplicity.to(torch.int64)]).cpu()
        columns.append(np.concatenate([np.full((1, rows.shape[1]), step), rows.numpy()]))
    return np.concatenate(columns, axis=1)


def _emitted(columns: NDArray[Any], size: int, device: torch.device) -> list[tuple[int, Emitted]]:
    emissions = []
    for step in np.unique(columns[0]).tolist():
        _, ids, multiplicity = columns[:, columns[0] == step]
        spikes = torch.zeros(1, size, dtype=torch.float64, device=device)
        spikes[0, torch.from_numpy(ids).to(device)] = torch.from_numpy(multiplicity).to(torch.float64).to(device)
        emissions.append((step, Emitted(spikes)))
    return emissions
