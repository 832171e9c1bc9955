"""Messages to the page: weights, and the spikes, rates, traces and pictures of cameras since the last frame.

A frame is a head of JSON and arrays of 4-byte numbers behind each other, little-endian: for each entry of `spikes` the
steps since the frame before and the neurons (uint32), for each of `traces` the times in ms since then and the values by
column (float32), likewise for `watched`, for each of `cameras` the events of each pixel (uint8, OFF then ON where they
are apart).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import Simulation
from neuro.apps import Clock, Fired, settable, unknown
from neuro.extend import Floats, Ints, Population, Projection

MOST_SPIKES = 2000
"""Of a population in a frame; of more an even choice, and all are counted."""
MOST_READ = 8 * MOST_SPIKES
"""Of a population in a frame that are looked at; of more about so many of the last."""
MOST_COLUMNS = 4
MOST_SAMPLES = 500
WIDEST = 200
"""Pixels of a camera's picture along a side; of a larger sensor squares of pixels are summed."""


class Frames:
    """Makes frames of a simulation.

    Args:
        sim: the simulation.

    Attributes:
        step: up to which the last frame went.
        traces: what probes record: names and units.
        watched: the population, neuron and state that `sample` takes; empty for none.
    """

    def __init__(self, sim: Simulation) -> None:
        self._sim, self._engine, self._clock = sim, sim._engine, Clock(sim.program.resolution)
        self._populations = list(enumerate(sim.program.populations))
        self._cameras = [(k, p) for k, p in self._populations if p.kind == "listed" and p.stream is not None]
        self.traces = _recorded(sim)
        self._sampled: list[tuple[float, float]] = []
        self.watched: dict[str, Any] = {}
        self.begin()

    def begin(self) -> None:
        """Forget what was before: the simulation went back, or to another state."""
        self.step = self._gathered = self._engine.step
        self._totals = {k: self._total(k) for k, p in self._populations if p.kind != "current"}
        self._rate = [0.0] * len(self._populations)
        self._seen = {k: self._fired(k) for k, _ in self._cameras}
        self._sampled = []
        self._spikes: dict[int, list[tuple[Ints, Ints]]] = {k: [] for k, p in self._populations if p.records}
        self._samples: dict[int, list[tuple[Ints, Floats]]] = {k: [] for k in range(len(self.traces))}

    def watch(self, population: str, neuron: int, state: str) -> None:
        """Show a state of a neuron, as it is when `sample` is called.

        Raises:
            ModelError: there is no such neuron or state.
        """
        neurons = self._sim.handles.neurons(population)
        settable.neuron_ids([neuron], neurons.part.size)
        if state not in self._sim.states(population):
            raise unknown("state", state, self._sim.states(population))
        self.watched, self._sampled = {"population": population, "neuron": neuron, "state": state}, []

    @property
    def time(self) -> float:
        """Up to which the last frame went, in ms."""
        return self._clock.ms(self.step)

    def sample(self) -> None:
        """Take the value of the state that is watched."""
        if self.watched and len(self._sampled) < MOST_SAMPLES:
            population, neuron, state = self.watched.values()
            index = self._sim.handles.neurons(population).index
            value = self._engine.get(index, state, np.array([neuron], dtype=np.int64))
            self._sampled.append((self._sim.time, float(value[0])))

    def gather(self) -> None:
        """Take what was recorded since the last time, before it is forgotten."""
        since, now = self._gathered, self._engine.step
        self._gathered = now
        for k, spikes in self._spikes.items():
            expected = self._rate[k] * self._populations[k][1].size * (now - since) * self._clock.resolution * 1e-3
            found = self._engine.spikes(k, max(since, now - int((now - since) * MOST_READ / max(expected, 1.0))))
            if found.ids.size:
                spikes.append((found.steps, found.ids))
        for k, samples in self._samples.items():
            steps, values = self._sim._records.recorder.series[self.traces[k]["name"]].after(since, MOST_SAMPLES)
            if steps.size:
                samples.append((steps, values[:, :MOST_COLUMNS]))

    @property
    def is_forgotten(self) -> bool:
        """Whether what is recorded is not kept until the next frame."""
        records = self._sim._records
        return records.recording is not None or records.held >= max(self.step, 1)

    @property
    def went_back(self) -> bool:
        """Whether the simulation was reset meanwhile, or took over an earlier state."""
        return self._engine.step < self._gathered

    def take(self) -> tuple[dict[str, Any], bytes]:
        """The next frame."""
        self.gather()
        since, now = self.step, self._engine.step
        self._began, body = self._clock.ms(since), list[bytes]()
        head: dict[str, Any] = {"time": self._clock.ms(now), "began": self._began, "rates": self._rates(now - since)}
        head["spikes"] = [entry for k in self._spikes if (entry := self._of_spikes(k, since, body))]
        head["traces"] = [entry for k in self._samples if (entry := self._of_samples(k, since, body))]
        if self._sampled:
            times, values = (np.array(self._sampled) - (self._began, 0.0)).T.astype("<f4")
            head["watched"] = {"samples": len(self._sampled)}
            body += [times.tobytes(), values.tobytes()]
            self._sampled = []
        head["cameras"] = [self._picture(k, part, body) for k, part in self._cameras]
        self.step = now
        return head, b"".join(body)

    def _rates(self, steps: int) -> list[float]:
        """Of each population the mean rate of a neuron in Hz, also where spikes are not recorded."""
        seconds = steps * self._clock.resolution * 1e-3
        rates = dict.fromkeys(range(len(self._populations)), 0.0)
        for k, before in self._totals.items():
            self._totals[k] = self._total(k)
            if seconds and (size := self._populations[k][1].size):
                rates[k] = round((self._totals[k] - before) / (size * seconds), 3)
        self._rate = list(rates.values())
        return self._rate

    def _fired(self, index: int) -> Ints:
        engine = self._engine
        return engine.fired(index) if isinstance(engine, Fired) else engine.counts().spikes[index]

    def _total(self, index: int) -> int:
        return int(self._fired(index).sum())

    def _of_spikes(self, index: int, since: int, body: list[bytes]) -> list[int]:
        """Population, and of how many spikes steps and neurons are in the body; nothing where there is none."""
        found, self._spikes[index] = self._spikes[index], []
        if not found:
            return []
        steps, ids = (np.concatenate(parts) for parts in zip(*found, strict=True))
        every = -(-ids.size // MOST_SPIKES)
        steps, ids = steps[::every], ids[::every]
        body += [(steps - since).astype("<u4").tobytes(), ids.astype("<u4").tobytes()]
        return [index, ids.size]

    def _of_samples(self, index: int, since: int, body: list[bytes]) -> list[int]:
        """Trace, samples and columns of what a probe has recorded; nothing where there is none."""
        found, self._samples[index] = self._samples[index], []
        if not found:
            return []
        steps, values = (np.concatenate(parts) for parts in zip(*found, strict=True))
        every = -(-steps.size // MOST_SAMPLES)
        steps, values = steps[::every], values[::every]
        body += [((steps - since) * self._clock.resolution).astype("<f4").tobytes(), values.T.astype("<f4").tobytes()]
        return [index, steps.size, values.shape[1]]

    def _picture(self, index: int, part: Population, body: list[bytes]) -> list[int]:
        """Population, sides and layers of the events of a camera since the last frame."""
        now = self._fired(index)
        events = (now - self._seen[index]).reshape(-1, *part.shape[-2:])
        self._seen[index] = now
        image = smaller(events).clip(0, 255).astype(np.uint8)
        pad = -image.size % 4
        body.append(image.tobytes() + b"\0" * pad)
        return [index, *image.shape]


def smaller(events: Ints) -> NDArray[np.int64]:
    """Pictures, shape (layers, rows, columns), whose squares of pixels are summed until they are small enough."""
    layers, height, width = events.shape
    side = -(-max(height, width) // WIDEST)
    if side == 1:
        return events
    padded = np.pad(events, ((0, 0), (0, -height % side), (0, -width % side)))
    rows, columns = padded.shape[1] // side, padded.shape[2] // side
    summed: NDArray[np.int64] = padded.reshape(layers, rows, side, columns, side).sum(axis=(2, 4))
    return summed


def _recorded(sim: Simulation) -> list[dict[str, Any]]:
    """The probes that record every so many steps."""
    program, found = sim.program, list[dict[str, Any]]()
    for probe in program.probes:
        if probe.record == "spikes":
            continue
        part = program.populations[probe.population]
        unit = "Hz" if probe.record == "rate" else {s.name: s.unit for s in part.model.states}.get(probe.record, "")
        found.append({"name": probe.name, "of": part.name, "state": probe.record, "unit": unit})
    for synapses in program.synapse_probes:
        if synapses.every:
            part_ = program.projections[synapses.projection]
            found.append({"name": synapses.name, "of": part_.name, "state": synapses.record, "unit": ""})
    return found


BINS = 48
SIDE = 40
"""Rows and columns of the matrix at most; of more neurons the mean of several."""
MOST_MAPS = 12
LARGEST = 1_000_000
"""Synapses of a projection that is read while the network runs."""
CHOSEN = 50_000
"""Synapses of which histogram and matrix are; of more an even choice."""


def weights_of(sim: Simulation, index: int) -> dict[str, Any]:
    """A histogram and a matrix of the weights of a projection, by its index."""
    part = sim.program.projections[index]
    found: dict[str, Any] = {"projection": part.name, "size": part.size}
    if part.size > LARGEST:
        return found | {"refused": f"{part.size:,} synapses: weights are shown up to {LARGEST:,}"}
    values = sim._engine.get_synapses(index, "weight")
    every = -(-part.size // CHOSEN) or 1
    finite = values[np.isfinite(values)]
    if not finite.size:
        return found | {"refused": "no synapse" if not values.size else "no weight is finite"}
    low, high = float(finite.min()), float(finite.max())
    bins = np.histogram(finite[::every], BINS, (low, high))[0] if high > low else np.array([finite.size])
    with np.errstate(over="ignore"):
        mean = float(finite.mean())
    found |= {"low": low, "high": high, "mean": mean if math.isfinite(mean) else None, "bins": bins.tolist()}
    matrix = _kernels(part, values) if part.grid is not None else _matrix(sim, index, values, every)
    plain = [[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix]
    return found | {"matrix": plain, "kernels": part.grid is not None}


def _matrix(sim: Simulation, index: int, values: Floats, every: int) -> Floats:
    """Mean weights of some synapses by blocks of sources, rows, and targets, columns; NaN where there is no synapse."""
    part, populations = sim.program.projections[index], sim.program.populations
    ends = sim.handles.ends(index)
    sides = [min(SIDE, populations[end].size) for end in (part.source, part.target)]
    blocks = [
        ids[::every] * side // populations[end].size
        for ids, side, end in zip(ends, sides, (part.source, part.target), strict=True)
    ]
    places = blocks[0] * sides[1] + blocks[1]
    room = sides[0] * sides[1]
    count = np.bincount(places, minlength=room)
    total = np.bincount(places, weights=values[::every], minlength=room)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    matrix: Floats = mean.reshape(sides[0], sides[1])
    return matrix


def _kernels(part: Projection, values: Floats) -> Floats:
    """The kernels of some maps beside each other, their channels below each other."""
    assert part.grid is not None
    kernels = values.reshape(part.grid.kernels)[:MOST_MAPS, :4]
    framed = np.pad(kernels, ((0, 0), (0, 0), (0, 1), (0, 1)), constant_values=np.nan)
    maps, channels, height, width = framed.shape
    mosaic: Floats = framed.transpose(1, 2, 0, 3).reshape(channels * height, maps * width)
    return mosaic[:-1, :-1]
