"""Probes. A run is divided at the steps of the probes, so that any backend can be probed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.memory import LEAST, Need, check_room
from neuro.core.clock import NEVER, Clock
from neuro.files.parts import Trace
from neuro.program.backend import Engine, Notes, Samples, Sent
from neuro.program.program import Floats, Ints, Probe, Program, SynapseProbe
from neuro.program.spikes import one_by_one

_NO_IDS: Ints = np.zeros(0, dtype=np.int64)


class Columns:
    """Records by step, as blocks of arrays with an entry for each record.

    Args:
        empty: arrays without entries, by name, for their types and columns; the first are the steps.
    """

    def __init__(self, **empty: NDArray[Any]) -> None:
        self._empty, self._blocks = empty, list[tuple[NDArray[Any], ...]]()

    def clear(self) -> None:
        """Forget all records."""
        self._blocks.clear()

    def add(self, *block: NDArray[Any]) -> None:
        """Append the records of later steps, one array for each name."""
        if len(block[0]):
            self._blocks.append(block)

    def after(self, step: int) -> dict[str, NDArray[Any]]:
        """Return copies of the records after a step, by name. Earlier blocks are not read."""
        later = list(takewhile(lambda block: block[0][-1] > step, reversed(self._blocks)))
        columns = zip(self._empty.values(), *reversed(later), strict=True)
        joined = dict(zip(self._empty, map(np.concatenate, columns), strict=True))
        begin = np.searchsorted(joined["steps"], step, side="right")
        return {name: array[begin:] for name, array in joined.items()}

    def forget(self, before: int) -> None:
        """Drop the records up to a step."""
        later = self.after(before)
        self._blocks.clear()
        self.add(*later.values())

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all records."""
        return self.after(-1)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace the records by those of a snapshot."""
        self._blocks.clear()
        self.add(*(arrays[name].copy() for name in self._empty))


class Series(Columns):
    """The records of a probe at intervals, shape (steps, columns).

    Args:
        clock: clock of the network.
        columns: number of values per record.
        single: whether the value is one number for all neurons or synapses, such as a rate or a mean.
    """

    def __init__(self, clock: Clock, columns: int, single: bool = False) -> None:
        super().__init__(steps=_NO_IDS, values=np.zeros((0, columns)))
        self._clock, self._single = clock, single

    def thinned(self, step: int, most: int) -> tuple[Ints, Floats]:
        """Return steps and values after a step. If there are more than `most` records, every n-th is returned."""
        steps, values = self.after(step).values()
        interval = -(-len(steps) // most) or 1
        return steps[::interval], values[::interval]

    def arrays(self, step: int = -1) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trace after a step; a single number per record has the shape (times,)."""
        steps, values = self.after(step).values()
        return {"times_ms": self._clock.array_ms(steps), "values": values[:, 0] if self._single else values}


class Recorder:
    """Records the probes of a program: states at the steps that are multiples of their interval.

    Args:
        program: the program with the probes.
        engine: the engine that runs the program.
        ends: function that returns source and target of every synapse of a projection, by its index.

    Attributes:
        probes: probes of states by name.
        series: records at intervals, by name.
        records: all records by name, those at presynaptic spikes last.
    """

    def __init__(self, program: Program, engine: Engine, ends: Callable[[int], tuple[Ints, Ints]]) -> None:
        self._engine = engine
        self._program, self._sampled = program, dict[str, int]()
        probes: list[Probe | SynapseProbe] = [probe for probe in program.probes if probe.record != "spikes"]
        self.probes = {probe.name: probe for probe in (*probes, *program.synapse_probes)}
        self._to_read = {name: probe for name, probe in self.probes.items() if probe.every}
        clock = Clock(program.resolution)
        self.series = {
            name: Series(clock, columns(program, probe), is_single(probe)) for name, probe in self._to_read.items()
        }
        self._pre_spikes = {
            p.name: PreSpikes(program, index, clock, ends)
            for index, p in enumerate(program.synapse_probes)
            if not p.every
        }
        self.records: dict[str, Series | PreSpikes] = {**self.series, **self._pre_spikes}
        self._samples = engine if isinstance(engine, Samples) else None
        if isinstance(engine, Samples):
            self._sampled = {program.probes[number].name: number for number in engine.samples}
            self._to_read = {name: probe for name, probe in self._to_read.items() if name not in self._sampled}
        self._last_rate = {p.name: (0, 0) for p in probes if p.record == "rate"}
        per_step = sum(8.0 * (columns(program, probe) + 1) / probe.every for probe in probes)
        self.few_steps = int(LEAST / per_step) if per_step else NEVER

    def check_room(self, steps: int, file: Path | None) -> None:
        """Refuse a run whose records do not fit into memory, or onto the disk of a file.

        Raises:
            ModelError: the records do not fit. The message names the largest probe.
        """
        needs = []
        for probe in (self.probes[name] for name in self.series):
            times, values = steps // probe.every, columns(self._program, probe)
            text = f"probe '{probe.name}', {times:,} times {values:,} values"
            needs.append(Need(8.0 * times * (values + 1), text, probe.origin))  # + 1: the time of each record
        check_room(self._program.name, needs, file)

    def clear(self) -> None:
        """Forget all records."""
        for records in self.records.values():
            records.clear()
        self._last_rate = dict.fromkeys(self._last_rate, (0, 0))

    def run(self, steps: int) -> None:
        """Advance the engine and record."""
        engine = self._engine
        if not self._to_read:
            engine.run(steps)
        else:
            end = engine.step + steps
            rows: dict[str, tuple[list[int], list[Floats]]] = {name: ([], []) for name in self._to_read}
            try:
                while engine.step < end:
                    step = engine.step
                    engine.run(min(end, *(step - step % p.every + p.every for p in self._to_read.values())) - step)
                    for name, probe in self._to_read.items():
                        if engine.step % probe.every == 0:
                            rows[name][0].append(engine.step)
                            rows[name][1].append(self._values(probe))
            finally:  # an interrupt leaves the records of the finished steps
                for name, (steps_of_rows, values) in rows.items():
                    self.series[name].add(np.array(steps_of_rows, np.int64), np.array(values, np.float64))
        if self._samples is not None:
            for name, number in self._sampled.items():
                self.series[name].add(*self._samples.sampled(number))
        for records in self._pre_spikes.values():
            records.update(engine)

    def _values(self, probe: Probe | SynapseProbe) -> Floats:
        if isinstance(probe, SynapseProbe):
            values = self._engine.get_synapses(probe.projection, probe.record)
            values = values if probe.synapses is None else values[probe.synapses]
        elif probe.record == "rate":
            # Mean rate per neuron in Hz since the last record.
            spikes = self._engine.counts().spikes[probe.population]
            spikes = spikes if probe.ids is None else spikes[probe.ids]
            before, since = self._last_rate[probe.name]
            spike_count, step = int(spikes.sum()), self._engine.step
            self._last_rate[probe.name] = spike_count, step
            return np.array([(spike_count - before) / (spikes.size * (step - since) * self._program.resolution * 1e-3)])
        else:
            values = self._engine.get(probe.population, probe.record, probe.ids)
        return values.mean(keepdims=True) if probe.mean else values

    def trace_after(self, name: str, step: int, probe_name: str) -> Trace:
        """Return the part of a trace after a step; `probe_name` is the name of the probe that recorded it."""
        probe = self.probes[name]
        fields: dict[str, Any] = {"state": probe.record, "probe": probe_name, "mean": probe.mean}
        fields |= self.records[name].arrays(step)
        if isinstance(probe, Probe):
            part = self._program.populations[probe.population]
            unit = {**{state.name: state.unit for state in part.model.states}, "rate": "Hz"}[probe.record]
            return Trace(part.name, unit=unit, ids=None if is_single(probe) else probe.ids, **fields)
        projection = self._program.projections[probe.projection]
        unit = {state.name: state.unit for state in projection.synapse.states}.get(probe.record, "")
        if probe.every and not probe.mean and projection.grid is None:
            synapses = slice(None) if probe.synapses is None else probe.synapses
            pre, post = self._program.connections(probe.projection)
            fields |= {"pre": pre[synapses], "post": post[synapses]}
        return Trace("", unit=unit, projection=projection.name, **fields)

    def take(self) -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
        """Yield the arrays of all traces by name, and forget them."""
        for name, records in self.records.items():
            yield name, records.arrays()
        self.forget(self._engine.step)

    def forget(self, before: int) -> None:
        """Drop the records up to a step."""
        for records in self.records.values():
            records.forget(before)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all records."""
        arrays = {f"{name}/counted": np.array(last_rate) for name, last_rate in self._last_rate.items()}
        for name, records in self.records.items():
            arrays |= {f"{name}/{word}": array for word, array in records.snapshot().items()}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace all records by those of a snapshot."""
        for name in self._last_rate:
            spikes, step = arrays[f"{name}/counted"].tolist()
            self._last_rate[name] = spikes, step
        for name, records in self.records.items():
            words = [key.removeprefix(f"{name}/") for key in arrays if key.startswith(f"{name}/")]
            records.restore({word: arrays[f"{name}/{word}"] for word in words})


def is_single(probe: Probe | SynapseProbe) -> bool:
    """Return whether a probe records one number for all neurons or synapses, a rate or a mean."""
    return probe.mean or (isinstance(probe, Probe) and probe.record == "rate")


def columns(program: Program, probe: Probe | SynapseProbe) -> int:
    """Return the number of values that a probe records each time."""
    if is_single(probe):
        return 1
    if isinstance(probe, SynapseProbe):
        return program.projections[probe.projection].size if probe.synapses is None else probe.synapses.size
    return program.populations[probe.population].size if probe.ids is None else probe.ids.size


class PreSpikes(Columns):
    """The records of one probe at presynaptic spikes.

    A spike that is emitted in a step acts when the next step begins, so a spike of the last step is recorded later. For
    rules that learn from spike pairs, the engine records the state after each spike. Other weights do not change during
    a run, so the present weights are recorded.

    Args:
        program: the whole network.
        index: index of the probe in `synapse_probes`.
        clock: clock of the network.
        ends: function that returns source and target of every synapse of a projection, by its index.
    """

    def __init__(self, program: Program, index: int, clock: Clock, ends: Callable[[int], tuple[Ints, Ints]]) -> None:
        super().__init__(steps=_NO_IDS, synapses=_NO_IDS, values=np.zeros(0))
        self._program, self._index, self._clock, self._ends = program, index, clock, ends
        self._probe = program.synapse_probes[index]
        self._part = program.projections[self._probe.projection]
        self._source = self._part.source
        self.clear()

    def clear(self) -> None:
        """Forget all records, also the spikes that have not acted yet."""
        super().clear()
        self._last_step, self._pending = -1, (_NO_IDS, _NO_IDS)

    def update(self, engine: Engine) -> None:
        """Add the records since the last call."""
        learns = self._part.synapse.learns == "pairs"
        new = engine.noted(self._index) if isinstance(engine, Notes) and learns else self._from_spikes(engine)
        if new.steps.size:
            order = np.lexsort((new.synapses, new.steps))
            self.add(new.steps[order], new.synapses[order], new.values[order])

    def _from_spikes(self, engine: Engine) -> Sent:
        """Return the synapses of the neurons that have fired, with their present weights."""
        spikes = engine.spikes(self._source, self._last_step)
        name = self._program.populations[self._source].name
        steps, ids = one_by_one(name, spikes.multiplicity, spikes.steps, spikes.ids)
        steps, ids = np.concatenate((self._pending[0], steps)), np.concatenate((self._pending[1], ids))
        has_acted, self._last_step = steps < engine.step, engine.step
        self._pending = steps[~has_acted], ids[~has_acted]
        # The synapses of each neuron that fired, one neuron after the other. Connections are sorted by source.
        sources, _ = self._ends(self._probe.projection)
        chosen = np.arange(sources.size) if self._probe.synapses is None else np.sort(self._probe.synapses)
        begin, end = (np.searchsorted(sources[chosen], ids[has_acted], side=side) for side in ("left", "right"))
        fan_out = end - begin
        indices = np.arange(fan_out.sum()) + np.repeat(begin - np.cumsum(fan_out) + fan_out, fan_out)
        synapses = chosen[indices]
        values = engine.get_synapses(self._probe.projection, self._probe.record)
        return Sent(np.repeat(steps[has_acted], fan_out), synapses, values[synapses])

    def arrays(self, step: int = -1) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trace after a step."""
        records, (pre, post) = self.after(step), self._ends(self._probe.projection)
        ends = {"pre": pre[records["synapses"]], "post": post[records["synapses"]]}
        return {"times_ms": self._clock.array_ms(records["steps"]), "values": records["values"], **ends}

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all records, and the spikes that have not acted yet."""
        steps, ids = self._pending
        pending = {"waiting_steps": steps, "waiting_ids": ids, "seen": np.array(self._last_step)}
        return {**super().snapshot(), **pending}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace all records by those of a snapshot."""
        super().restore(arrays)
        self._pending = arrays["waiting_steps"].copy(), arrays["waiting_ids"].copy()
        self._last_step = int(arrays["seen"])
