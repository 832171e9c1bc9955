"""The engine: a program stepped as tensors for one recording, its record, what is read and written between steps."""

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
    """Spikes in the order of their steps, and counts.

    Attributes:
        steps, ids, multiplicity: what was recorded, an array for each step that had spikes.
        events, spikes: of each neuron, a spike of multiplicity m once and m times.
        active: neuron-steps with an arrival or a spike.

    Args:
        size: neurons.
        keeps: whether spikes are kept.
        graded: whether multiplicities are payloads, of which each counts as one spike.
    """

    def __init__(self, size: int, keeps: bool, graded: bool = False) -> None:
        self._size, self._keeps, self._graded = size, keeps, graded
        self.start_anew()

    @property
    def nbytes(self) -> int:
        """Bytes of the recorded spikes."""
        return 24 * sum(len(steps) for steps in self.steps)

    def start_anew(self) -> None:
        """Nothing happened yet."""
        self.steps: list[Ints] = []
        self.ids: list[Ints] = []
        self.multiplicity: list[Ints] = []
        self.events: Ints = np.zeros(self._size, dtype=np.int64)
        self.spikes: Ints = np.zeros(self._size, dtype=np.int64)
        self.active = 0

    def add(self, step: int, ids: Ints, multiplicity: Ints) -> None:
        """The spikes of one step."""
        self.events[ids] += 1
        self.spikes[ids] += 1 if self._graded else multiplicity
        if self._keeps and len(ids):
            self.steps.append(np.full(len(ids), step, dtype=np.int64))
            self.ids.append(ids)
            self.multiplicity.append(multiplicity)

    def since(self, step: int) -> Spikes:
        """The spikes after a step."""
        first = next((k for k, steps in enumerate(self.steps) if steps[0] > step), len(self.steps))
        none = np.zeros(0, dtype=np.int64)
        columns = (np.concatenate([none, *column[first:]]) for column in (self.steps, self.ids, self.multiplicity))
        steps, ids, multiplicity = columns
        return Spikes(steps, ids, multiplicity.astype(np.int64))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        self.keep(self.since(before))

    def keep(self, spikes: Spikes) -> None:
        """Have these spikes and no others; counts stay."""
        cuts = np.flatnonzero(np.diff(spikes.steps)) + 1
        some = len(spikes.steps) > 0
        self.steps = np.split(spikes.steps, cuts) if some else []
        self.ids = np.split(spikes.ids, cuts) if some else []
        self.multiplicity = np.split(spikes.multiplicity.astype(np.int64), cuts) if some else []


class TorchEngine:
    """A program in execution; `neuro.program.backend.Engine` says what each method does.

    Args:
        program: the network, of which nothing is refused.
        threads: of torch, while it runs.
        device: where its tensors are.
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
        """Advance."""
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
                heard = self.stepper.heard[k][0]
                heard[emitted.neuron] = True
                record.active += int(heard.sum())

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population, with payloads where it is graded."""
        self.stepper.sources[population].inject(steps, ids, self.step, payloads)

    def signal(self, signal: int, values: Floats) -> None:
        """Nothing listens: rules under dopamine are refused."""

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of every neuron, or of some."""
        every: Floats = np.broadcast_to(self._values(population, name), self.program.populations[population].size)
        found: Floats = every.copy() if ids is None else every[ids]
        return found

    def _values(self, population: int, name: str) -> Floats:
        if (cells := self.stepper.cells.get(population)) is not None and name in cells.names:
            values: Floats = cells.states[cells.names.index(name)][0].cpu().numpy()
            return values
        source = self.stepper.sources.get(population)
        if source is not None and name in source.names:
            drawn: Floats = source.states[source.names.index(name)]
            return drawn
        return self.stepper.parameters(population)[name]

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters."""
        part = self.stepper.cells.get(population) or self.stepper.sources.get(population)
        for name, each in values.items():
            if part is not None and name in part.names:
                part.put(name, each)
            else:
                self.stepper.parameters(population)[name] = each.copy()
        if part is not None:
            part.refresh()

    def get_synapses(self, projection: int, name: str) -> Floats:
        """The weight of every synapse: they have nothing else here."""
        if projection in self.stepper.flows:
            return self.stepper.flows[projection].weights.copy()
        weights: Floats = self.stepper.weights(projection).cpu().numpy()
        return np.broadcast_to(weights, self.program.projections[projection].size).copy()

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Nothing is there to change: static synapses have no numbers."""

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that are chosen."""
        where = slice(None) if chosen is None else chosen
        kept = self.get_synapses(projection, "weight")
        kept[where] = np.broadcast_to(weights, kept.shape)[where]
        if projection in self.stepper.flows:
            self.stepper.flows[projection].weights = kept
        else:
            self.stepper.set_weights(projection, torch.from_numpy(kept).to(self.stepper.device))

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes after a step."""
        return carrying(self.program.populations[population], self.records[population].since(since))

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        for record in self.records:
            record.forget(before)

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""
        return EngineCounts(
            steps=self.step,
            events=tuple(record.events.copy() for record in self.records),
            spikes=tuple(record.spikes.copy() for record in self.records),
            active=np.array([record.active for record in self.records], dtype=np.int64),
            trial_updates=np.zeros(len(self.program.projections), dtype=np.int64),
        )

    def memory(self) -> dict[str, int]:
        """Bytes of states, synapses and recorded spikes."""
        return {**self.stepper.memory(), "spikes": sum(record.nbytes for record in self.records)}

    def reset(self, weights: bool) -> None:
        """Back to step 0."""
        self.stepper.start_anew()
        for record in self.records:
            record.start_anew()
        if weights:
            for k, part in enumerate(self.program.projections):
                self.set_weights(k, part.weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs."""
        return take_snapshot(self.stepper, self.records)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        put_snapshot(self.stepper, self.records, arrays)

    def present(self, trial: Trial) -> Outcome:
        """Never called: networks with trials are refused."""
        raise NotImplementedError

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Never called, as `present`."""
        raise NotImplementedError

    def encourage(self, projection: int, maps: Ints) -> None:
        """Never called, as `present`."""
        raise NotImplementedError


@contextmanager
def _threads(number: int) -> Iterator[None]:
    """Let torch compute with some threads, and afterwards with as many as before."""
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


Arrays = Mapping[str, NDArray[Any]]
_LISTED = ("states", "steps", "ids", "numbers")
"""What a source keeps between steps."""


def take_snapshot(stepper: Stepper, records: Sequence[TensorRecord]) -> dict[str, NDArray[Any]]:
    """Copies of everything that changes while it runs."""
    found: dict[str, NDArray[Any]] = {"step": np.array(stepper.now)}
    for k, cells in stepper.cells.items():
        found[f"cells/{k}"] = (
            torch.stack([state[0] for state in cells.states]).cpu().numpy() if cells.states else np.zeros(0)
        )
    for k, source in stepper.sources.items():
        found |= {f"sources/{k}/{name}": getattr(source, name).copy() for name in _LISTED}
    for k, flow in stepper.flows.items():
        found |= {f"flows/{k}/{name}": getattr(flow, name).copy() for name in ("due", "held", "weights")}
    for k in range(len(records)):
        found |= {f"parameters/{k}/{word}": values.copy() for word, values in stepper.parameters(k).items()}
        found[f"sent/{k}"] = _listed(stepper.sent[k])
    for k, versions in stepper.versions.items():
        rows = [[float(since), *weights.cpu().tolist()] for since, weights in versions]
        widest = max(len(row) for row in rows)
        found[f"weights/{k}"] = np.array(
            [row if len(row) == widest else row[:1] + row[1:] * (widest - 1) for row in rows]
        )
    for k, record in enumerate(records):
        spikes = record.since(-1)
        found |= {f"records/{k}/{name}": getattr(spikes, name) for name in ("steps", "ids", "multiplicity")}
        found |= {f"records/{k}/counted_{name}": getattr(record, name).copy() for name in ("events", "spikes")}
        found[f"records/{k}/active"] = np.array(record.active)
    return found


def put_snapshot(stepper: Stepper, records: Sequence[TensorRecord], arrays: Arrays) -> None:
    """Set a stepper of the same program to what `take_snapshot` gave."""
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
        for name in _LISTED:
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


def _listed(sent: Sequence[tuple[int, Emitted]]) -> NDArray[Any]:
    """Step, neuron and multiplicity of all spikes that are under way, shape (3, spikes)."""
    columns = [np.zeros((3, 0), dtype=np.int64)]
    for step, emitted in sent:
        of: Tensor = torch.stack([emitted.neuron, emitted.multiplicity.to(torch.int64)]).cpu()
        columns.append(np.concatenate([np.full((1, of.shape[1]), step), of.numpy()]))
    return np.concatenate(columns, axis=1)


def _emitted(listed: NDArray[Any], size: int, device: torch.device) -> list[tuple[int, Emitted]]:
    found = []
    for step in np.unique(listed[0]).tolist():
        _, ids, multiplicity = listed[:, listed[0] == step]
        spikes = torch.zeros(1, size, dtype=torch.float64, device=device)
        spikes[0, torch.from_numpy(ids).to(device)] = torch.from_numpy(multiplicity).to(torch.float64).to(device)
        found.append((step, Emitted(spikes)))
    return found
