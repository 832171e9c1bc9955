"""Probes. A run is divided at the steps of the probes, so that any backend can be probed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.memory import LEAST, Need, check_room
from neuro.core.clock import NEVER, Clock
from neuro.program.backend import Engine, Notes, Samples, Sent
from neuro.program.program import Floats, Ints, Probe, Program, SynapseProbe
from neuro.program.spikes import one_by_one


class Series:
    """The records of one probe, by step.

    Args:
        clock: clock of the network.
        columns: number of values per record.
        single: whether the value is one number for all neurons or synapses, such as a rate or a mean.
    """

    def __init__(self, clock: Clock, columns: int, single: bool = False) -> None:
        self._clock, self._columns, self._single = clock, columns, single
        self.clear()

    def clear(self) -> None:
        """Forget all records."""
        self._steps: list[int] = []
        self._values: list[Floats] = []

    def add(self, step: int, values: Floats) -> None:
        """Append the values of a step."""
        self._steps.append(step)
        self._values.append(values)

    def extend(self, steps: Ints, values: Floats) -> None:
        """Append the values of many steps, shape (steps, columns)."""
        self._steps += steps.tolist()
        self._values += list(values)

    def after(self, step: int, most: int) -> tuple[Ints, Floats]:
        """Return steps and values after a step. If there are more than `most` records, every n-th is returned.

        The time that the call needs depends on the number of returned records only.
        """
        begin = bisect_right(self._steps, step)
        interval = -(-(len(self._steps) - begin) // most) or 1
        steps = np.array(self._steps[begin::interval], dtype=np.int64)
        return steps, np.array(self._values[begin::interval], dtype=np.float64).reshape(len(steps), self._columns)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trace; a single number per record has the shape (times,)."""
        steps, values = self.after(-1, len(self._steps) + 1)
        return {"times_ms": self._clock.array_ms(steps), "values": values[:, 0] if self._single else values}

    def forget(self, before: int) -> None:
        """Drop the records up to a step."""
        begin = bisect_right(self._steps, before)
        del self._steps[:begin], self._values[:begin]

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all records."""
        return dict(zip(("steps", "values"), self.after(-1, len(self._steps) + 1), strict=True))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace the records by those of a snapshot."""
        self._steps, self._values = arrays["steps"].tolist(), list(arrays["values"])


class Recorder:
    """Records the probes of a program: states at the steps that are multiples of their interval.

    Args:
        program: the program with the probes.
        engine: the engine that runs the program.
        ends: function that returns source and target of every synapse of a projection, by its index.

    Attributes:
        series: records at intervals, by name.
        records: all records by name, those at presynaptic spikes last.
    """

    def __init__(self, program: Program, engine: Engine, ends: Callable[[int], tuple[Ints, Ints]]) -> None:
        self._engine = engine
        probes = [p for p in program.probes if p.record != "spikes"]
        self._to_read: dict[str, Probe | SynapseProbe] = {p.name: p for p in probes}
        self._to_read |= {p.name: p for p in program.synapse_probes if p.every}
        self._probes, self._program = tuple(self._to_read.values()), program
        self._sampled: dict[str, int] = {}
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
        for probe in self._probes:
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
            while engine.step < end:
                step = engine.step
                engine.run(min(end, *(step - step % p.every + p.every for p in self._to_read.values())) - step)
                for name, probe in self._to_read.items():
                    if engine.step % probe.every == 0:
                        self.series[name].add(engine.step, self._values(probe))
        if self._samples is not None:
            for name, number in self._sampled.items():
                self.series[name].extend(*self._samples.sampled(number))
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


_NO_IDS: Ints = np.zeros(0, dtype=np.int64)


class PreSpikes:
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
        self._program, self._index, self._clock, self._ends = program, index, clock, ends
        self._probe = program.synapse_probes[index]
        self._part = program.projections[self._probe.projection]
        self._source = self._part.source
        self.clear()

    def clear(self) -> None:
        """Forget all records."""
        self._records: list[Sent] = []
        self._last_step, self._pending = -1, (_NO_IDS, _NO_IDS)

    def update(self, engine: Engine) -> None:
        """Add the records since the last call."""
        learns = self._part.synapse.learns == "pairs"
        new = engine.noted(self._index) if isinstance(engine, Notes) and learns else self._from_spikes(engine)
        if new.steps.size:
            order = np.lexsort((new.synapses, new.steps))
            self._records.append(Sent(new.steps[order], new.synapses[order], new.values[order]))

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

    def _read(self) -> Sent:
        """Return all records, by step, then synapse."""
        none = Sent(_NO_IDS, _NO_IDS, np.zeros(0))
        parts = [none, *self._records]
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trace."""
        records, (pre, post) = self._read(), self._ends(self._probe.projection)
        ends = {"pre": pre[records.synapses], "post": post[records.synapses]}
        return {"times_ms": self._clock.array_ms(records.steps), "values": records.values, **ends}

    def forget(self, before: int) -> None:
        """Drop the records of spikes up to a step."""
        records = self._read()
        is_later = records.steps > before
        self._records = [Sent(records.steps[is_later], records.synapses[is_later], records.values[is_later])]

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all records, and the spikes that have not acted yet."""
        records = self._read()
        steps, ids = self._pending
        pending = {"waiting_steps": steps, "waiting_ids": ids, "seen": np.array(self._last_step)}
        return {**{word: getattr(records, word) for word in Sent.__slots__}, **pending}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace all records by those of a snapshot."""
        self._records = [Sent(*(arrays[word].copy() for word in Sent.__slots__))]
        self._pending = arrays["waiting_steps"].copy(), arrays["waiting_ids"].copy()
        self._last_step = int(arrays["seen"])
