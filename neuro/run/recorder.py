"""Probes: the run is cut where one is due, so that any backend can be probed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.memory import LEAST, Need, check_room
from neuro.core.clock import NEVER
from neuro.program.backend import Engine, Notes, Samples, Sent
from neuro.program.program import Floats, Ints, Probe, Program, SynapseProbe
from neuro.program.spikes import one_by_one


class Series:
    """What one probe has recorded, by step.

    Args:
        columns: how many numbers it records each time.
        single: whether they are one number for all, a rate or a mean.
    """

    def __init__(self, columns: int, single: bool = False) -> None:
        self._columns, self.single = columns, single
        self._steps: list[int] = []
        self._values: list[Floats] = []

    def add(self, step: int, values: Floats) -> None:
        """Keep the values of a step."""
        self._steps.append(step)
        self._values.append(values)

    def extend(self, steps: Ints, values: Floats) -> None:
        """Keep the values of many steps, shape (steps, columns)."""
        self._steps += steps.tolist()
        self._values += list(values)

    def read(self) -> tuple[Ints, Floats]:
        """Steps, and the values in them, shape (steps, columns)."""
        steps = np.array(self._steps, dtype=np.int64)
        return steps, np.array(self._values, dtype=np.float64).reshape(len(steps), self._columns)

    def after(self, step: int, most: int) -> tuple[Ints, Floats]:
        """Likewise of the steps after one, of many an even choice; in a time that depends on neither number."""
        first = bisect_right(self._steps, step)
        every = -(-(len(self._steps) - first) // most) or 1
        steps = np.array(self._steps[first::every], dtype=np.int64)
        return steps, np.array(self._values[first::every], dtype=np.float64).reshape(len(steps), self._columns)

    def recorded(self) -> tuple[Ints, Floats]:
        """Likewise as people read them: of a single number the values have the shape (steps,)."""
        steps, values = self.read()
        return steps, values[:, 0] if self.single else values

    def take(self) -> tuple[Ints, Floats]:
        """Likewise as `recorded`; it is forgotten."""
        found = self.recorded()
        self._steps, self._values = [], []
        return found

    def put(self, steps: Ints, values: Floats) -> None:
        """Set what has been recorded."""
        self._steps, self._values = steps.tolist(), list(values)

    def forget(self, before: int) -> None:
        """Drop what was recorded up to a step."""
        first = int(np.searchsorted(self._steps, before, side="right"))
        del self._steps[:first], self._values[:first]


class Recorder:
    """Records what the probes of a program ask for: states at the steps that are multiples of their interval.

    Args:
        program: names the probes.
        engine: runs it.

    Attributes:
        series: by name, what is recorded every so many steps.
        pre_spikes: by name, what is recorded as pre spikes leave it.
    """

    def __init__(self, program: Program, engine: Engine) -> None:
        self._engine = engine
        probes = [p for p in program.probes if p.record != "spikes"]
        self._due: dict[str, Probe | SynapseProbe] = {p.name: p for p in probes}
        self._due |= {p.name: p for p in program.synapse_probes if p.every}
        self._probes, self._program = tuple(self._due.values()), program
        self._sampled: dict[str, int] = {}
        self.series = {name: Series(columns(program, probe), is_single(probe)) for name, probe in self._due.items()}
        self.pre_spikes = {
            p.name: PreSpikes(program, index) for index, p in enumerate(program.synapse_probes) if not p.every
        }
        self._samples = engine if isinstance(engine, Samples) else None
        if isinstance(engine, Samples):
            self._sampled = {program.probes[number].name: number for number in engine.samples}
            self._due = {name: probe for name, probe in self._due.items() if name not in self._sampled}
        self._counted = {p.name: (0, 0) for p in probes if p.record == "rate"}
        per_step = sum(8.0 * (columns(program, probe) + 1) / probe.every for probe in probes)
        self.few_steps = int(LEAST / per_step) if per_step else NEVER

    def check_room(self, steps: int, file: Path | None) -> None:
        """Refuse a run that records more values than memory, or the disk of a file, has room for.

        Raises:
            ModelError: it does; the message names the probe that needs most.
        """
        needs = []
        for probe in self._probes:
            times, values = steps // probe.every, columns(self._program, probe)
            what = f"probe '{probe.name}', {times:,} times {values:,} values"
            needs.append(Need(8.0 * times * (values + 1), what, probe.origin))  # the time of each, too
        check_room(self._program.name, needs, file)

    def clear(self) -> None:
        """Forget everything."""
        for series in self.series.values():
            series.put(np.zeros(0, dtype=np.int64), np.zeros(0))
        for sent in self.pre_spikes.values():
            sent.clear()
        self._counted = dict.fromkeys(self._counted, (0, 0))

    def run(self, steps: int) -> None:
        """Advance the engine, recording on the way."""
        engine = self._engine
        if not self._due:
            engine.run(steps)
        else:
            end = engine.step + steps
            while engine.step < end:
                now = engine.step
                engine.run(min(end, *(now - now % p.every + p.every for p in self._due.values())) - now)
                for name, probe in self._due.items():
                    if engine.step % probe.every == 0:
                        self.series[name].add(engine.step, self._values(probe))
        if self._samples is not None:
            for name, number in self._sampled.items():
                self.series[name].extend(*self._samples.sampled(number))
        for sent in self.pre_spikes.values():
            sent.look(engine)

    def _values(self, probe: Probe | SynapseProbe) -> Floats:
        if isinstance(probe, SynapseProbe):
            values = self._engine.get_synapses(probe.projection, probe.record)
            values = values if probe.synapses is None else values[probe.synapses]
        elif probe.record == "rate":
            # Spikes of a neuron in a second, the mean since the last record.
            spikes = self._engine.counts().spikes[probe.population]
            spikes = spikes if probe.ids is None else spikes[probe.ids]
            before, since = self._counted[probe.name]
            total, step = int(spikes.sum()), self._engine.step
            self._counted[probe.name] = total, step
            return np.array([(total - before) / (spikes.size * (step - since) * self._program.resolution * 1e-3)])
        else:
            values = self._engine.get(probe.population, probe.record, probe.ids)
        return values.mean(keepdims=True) if probe.mean else values

    def forget(self, before: int) -> None:
        """Drop what was recorded up to a step."""
        for series in self.series.values():
            series.forget(before)
        for sent in self.pre_spikes.values():
            sent.forget(before)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All that has been recorded."""
        arrays: dict[str, NDArray[Any]] = {}
        for name, series in self.series.items():
            arrays[f"{name}/steps"], arrays[f"{name}/values"] = series.read()
        for name, counted in self._counted.items():
            arrays[f"{name}/counted"] = np.array(counted)
        for name, sent in self.pre_spikes.items():
            arrays |= {f"{name}/{word}": array for word, array in sent.snapshot().items()}
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for name, series in self.series.items():
            series.put(arrays[f"{name}/steps"], arrays[f"{name}/values"])
        for name in self._counted:
            spikes, step = arrays[f"{name}/counted"].tolist()
            self._counted[name] = spikes, step
        for name, sent in self.pre_spikes.items():
            words = [key.removeprefix(f"{name}/") for key in arrays if key.startswith(f"{name}/")]
            sent.restore({word: arrays[f"{name}/{word}"] for word in words})


def is_single(probe: Probe | SynapseProbe) -> bool:
    """Whether a probe records one number for all, a rate or a mean."""
    return probe.mean or (isinstance(probe, Probe) and probe.record == "rate")


def columns(program: Program, probe: Probe | SynapseProbe) -> int:
    """How many numbers a probe records each time."""
    if is_single(probe):
        return 1
    if isinstance(probe, SynapseProbe):
        return program.projections[probe.projection].size if probe.synapses is None else probe.synapses.size
    return program.populations[probe.population].size if probe.ids is None else probe.ids.size


NOBODY: Ints = np.zeros(0, dtype=np.int64)


class PreSpikes:
    """What one probe has recorded at pre spikes.

    A spike that is emitted in a step acts when the next begins, so that of the last step is still to come. Where spike
    pairs teach, the engine notes what each spike leaves. Other weights do not change while a network runs: they are
    those of the moment in which the spikes set out.

    Args:
        program: the whole network.
        index: which of its `synapse_probes`.

    Attributes:
        probe: that one.
    """

    def __init__(self, program: Program, index: int) -> None:
        self._program, self._index = program, index
        self.probe = program.synapse_probes[index]
        self._part = program.projections[self.probe.projection]
        self._source = self._part.source
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._kept: list[Sent] = []
        self._seen, self._waiting = -1, (NOBODY, NOBODY)

    def look(self, engine: Engine) -> None:
        """Take over what spikes have left since the last look."""
        learns = self._part.synapse.learns == "pairs"
        new = engine.noted(self._index) if isinstance(engine, Notes) and learns else self._followed(engine)
        if new.steps.size:
            order = np.lexsort((new.synapses, new.steps))
            self._kept.append(Sent(new.steps[order], new.synapses[order], new.values[order]))

    def _followed(self, engine: Engine) -> Sent:
        """The synapses of neurons that have fired, with their weights of now."""
        spikes = engine.spikes(self._source, self._seen)
        name = self._program.populations[self._source].name
        steps, ids = one_by_one(name, spikes.multiplicity, spikes.steps, spikes.ids)
        steps, ids = np.concatenate((self._waiting[0], steps)), np.concatenate((self._waiting[1], ids))
        gone, self._seen = steps < engine.step, engine.step
        self._waiting = steps[~gone], ids[~gone]
        # The synapses of these neurons, one after the other, and how many each has.
        sources, _ = self._program.connections(self.probe.projection)
        chosen = np.arange(sources.size) if self.probe.synapses is None else np.sort(self.probe.synapses)
        first, end = (np.searchsorted(sources[chosen], ids[gone], side=side) for side in ("left", "right"))
        number = end - first
        places = np.arange(number.sum()) + np.repeat(first - np.cumsum(number) + number, number)
        synapses = chosen[places]
        values = engine.get_synapses(self.probe.projection, self.probe.record)
        return Sent(np.repeat(steps[gone], number), synapses, values[synapses])

    def read(self) -> Sent:
        """All that has been recorded, by step, then synapse."""
        none = Sent(NOBODY, NOBODY, np.zeros(0))
        parts = [none, *self._kept]
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))

    def take(self) -> Sent:
        """All that has been recorded; it is forgotten."""
        found, self._kept = self.read(), []
        return found

    def forget(self, before: int) -> None:
        """Drop what spikes up to a step have left."""
        found = self.take()
        late = found.steps > before
        self._kept = [Sent(found.steps[late], found.synapses[late], found.values[late])]

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All that has been recorded, and what is to come."""
        found = self.read()
        waiting = {"waiting_steps": self._waiting[0], "waiting_ids": self._waiting[1], "seen": np.array(self._seen)}
        return {**{word: getattr(found, word) for word in Sent.__slots__}, **waiting}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        self._kept = [Sent(*(arrays[word].copy() for word in Sent.__slots__))]
        self._waiting = arrays["waiting_steps"].copy(), arrays["waiting_ids"].copy()
        self._seen = int(arrays["seen"])
