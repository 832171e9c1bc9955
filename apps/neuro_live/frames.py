"""Messages to the page: weights, and frames with the spikes, rates, traces and camera pictures since the last frame.

A frame is a JSON head and little-endian arrays one after another:

- for each entry of `spikes` the steps since the previous frame and the neurons (uint32),
- for each entry of `traces`, and for `watched`, the times in ms since the previous frame and the values by column
  (float32),
- for each entry of `cameras` the number of events of each pixel (uint8), first OFF and then ON if the camera separates
  polarities.
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
"""Largest number of spikes of a population in a frame. Of more spikes every n-th is sent; rates count all."""
MOST_READ = 8 * MOST_SPIKES
"""Approximate largest number of spikes of a population that are read for a frame. Of more spikes the last are read."""
MOST_COLUMNS = 4
"""Largest number of columns of a probe that are sent."""
MOST_SAMPLES = 500
"""Largest number of samples of a probe, or of the watched state, in a frame."""
WIDEST = 200
"""Largest side of a camera's picture in pixels. Larger sensors are reduced by sums over squares of pixels."""


class Frames:
    """Builds the frames of a simulation.

    Args:
        sim: the simulation.

    Attributes:
        step: end of the last frame.
        traces: names, states and units of the probes' recordings.
        watched: population, neuron and state that `sample` reads; empty for none.
    """

    def __init__(self, sim: Simulation) -> None:
        self._sim, self._engine, self._clock = sim, sim._engine, Clock(sim.program.resolution)
        self._populations = list(enumerate(sim.program.populations))
        self._cameras = [(k, p) for k, p in self._populations if p.kind == "listed" and p.stream is not None]
        self.traces = _traces_of(sim)
        self._sampled: list[tuple[float, float]] = []
        self.watched: dict[str, Any] = {}
        self.begin()

    def begin(self) -> None:
        """Discard all data after the simulation was reset or restored to another state."""
        self.step = self._gathered = self._engine.step
        self._totals = {k: self._total(k) for k, p in self._populations if p.kind != "current"}
        self._rate = [0.0] * len(self._populations)
        self._last_counts = {k: self._fired(k) for k, _ in self._cameras}
        self._sampled = []
        self._spikes: dict[int, list[tuple[Ints, Ints]]] = {k: [] for k, p in self._populations if p.records}
        self._samples: dict[int, list[tuple[Ints, Floats]]] = {k: [] for k in range(len(self.traces))}

    def watch(self, population: str, neuron: int, state: str) -> None:
        """Select a state of a neuron, whose value `sample` reads.

        Raises:
            ModelError: the neuron or the state does not exist.
        """
        neurons = self._sim.handles.neurons(population)
        settable.neuron_ids([neuron], neurons.part.size)
        if state not in self._sim.states(population):
            raise unknown("state", state, self._sim.states(population))
        self.watched, self._sampled = {"population": population, "neuron": neuron, "state": state}, []

    @property
    def time(self) -> float:
        """End of the last frame, ms."""
        return self._clock.ms(self.step)

    def sample(self) -> None:
        """Read the watched state."""
        if self.watched and len(self._sampled) < MOST_SAMPLES:
            population, neuron, state = self.watched.values()
            index = self._sim.handles.neurons(population).index
            value = self._engine.get(index, state, np.array([neuron], dtype=np.int64))
            self._sampled.append((self._sim.time, float(value[0])))

    def gather(self) -> None:
        """Copy the recordings since the last call, before the simulation deletes them."""
        begin, end = self._gathered, self._engine.step
        self._gathered = end
        for k, spikes in self._spikes.items():
            expected = self._rate[k] * self._populations[k][1].size * (end - begin) * self._clock.resolution * 1e-3
            train = self._engine.spikes(k, max(begin, end - int((end - begin) * MOST_READ / max(expected, 1.0))))
            if train.ids.size:
                spikes.append((train.steps, train.ids))
        for k, samples in self._samples.items():
            steps, values = self._sim._records.recorder.series[self.traces[k]["name"]].thinned(begin, MOST_SAMPLES)
            if steps.size:
                samples.append((steps, values[:, :MOST_COLUMNS]))

    @property
    def is_forgotten(self) -> bool:
        """Whether the simulation deletes recordings before the next frame."""
        records = self._sim._records
        return records.recording is not None or records.held >= max(self.step, 1)

    @property
    def went_back(self) -> bool:
        """Whether the simulation was reset or restored to an earlier state since the last call of `gather`."""
        return self._engine.step < self._gathered

    def take(self) -> tuple[dict[str, Any], bytes]:
        """Return the head and the body of the next frame."""
        self.gather()
        begin, end = self.step, self._engine.step
        self._begin_ms, body = self._clock.ms(begin), list[bytes]()
        head: dict[str, Any] = {"time": self._clock.ms(end), "began": self._begin_ms, "rates": self._rates(end - begin)}
        head["spikes"] = [entry for k in self._spikes if (entry := self._append_spikes(k, begin, body))]
        head["traces"] = [entry for k in self._samples if (entry := self._append_samples(k, begin, body))]
        if self._sampled:
            times, values = (np.array(self._sampled) - (self._begin_ms, 0.0)).T.astype("<f4")
            head["watched"] = {"samples": len(self._sampled)}
            body += [times.tobytes(), values.tobytes()]
            self._sampled = []
        head["cameras"] = [self._append_picture(k, part, body) for k, part in self._cameras]
        self.step = end
        return head, b"".join(body)

    def _rates(self, steps: int) -> list[float]:
        """Return the mean rate of each population's neurons in Hz, also of populations without recorded spikes."""
        seconds = steps * self._clock.resolution * 1e-3
        rates = dict.fromkeys(range(len(self._populations)), 0.0)
        for k, last_total in self._totals.items():
            self._totals[k] = self._total(k)
            if seconds and (size := self._populations[k][1].size):
                rates[k] = round((self._totals[k] - last_total) / (size * seconds), 3)
        self._rate = list(rates.values())
        return self._rate

    def _fired(self, index: int) -> Ints:
        engine = self._engine
        return engine.fired(index) if isinstance(engine, Fired) else engine.counts().spikes[index]

    def _total(self, index: int) -> int:
        return int(self._fired(index).sum())

    def _append_spikes(self, index: int, begin: int, body: list[bytes]) -> list[int]:
        """Append a population's spikes to the body; return the population and the number of spikes, or []."""
        recordings, self._spikes[index] = self._spikes[index], []
        if not recordings:
            return []
        steps, ids = (np.concatenate(parts) for parts in zip(*recordings, strict=True))
        interval = -(-ids.size // MOST_SPIKES)
        steps, ids = steps[::interval], ids[::interval]
        body += [(steps - begin).astype("<u4").tobytes(), ids.astype("<u4").tobytes()]
        return [index, ids.size]

    def _append_samples(self, index: int, begin: int, body: list[bytes]) -> list[int]:
        """Append a probe's samples to the body; return the trace and the numbers of samples and columns, or []."""
        recordings, self._samples[index] = self._samples[index], []
        if not recordings:
            return []
        steps, values = (np.concatenate(parts) for parts in zip(*recordings, strict=True))
        interval = -(-steps.size // MOST_SAMPLES)
        steps, values = steps[::interval], values[::interval]
        body += [((steps - begin) * self._clock.resolution).astype("<f4").tobytes(), values.T.astype("<f4").tobytes()]
        return [index, steps.size, values.shape[1]]

    def _append_picture(self, index: int, part: Population, body: list[bytes]) -> list[int]:
        """Append a camera's events since the last frame to the body; return the population and the picture's shape."""
        counts = self._fired(index)
        events = (counts - self._last_counts[index]).reshape(-1, *part.shape[-2:])
        self._last_counts[index] = counts
        image = smaller(events).clip(0, 255).astype(np.uint8)
        pad = -image.size % 4
        body.append(image.tobytes() + b"\0" * pad)
        return [index, *image.shape]


def smaller(events: Ints) -> NDArray[np.int64]:
    """Reduce pictures, shape (layers, rows, columns), to sides of at most `WIDEST` by sums over squares of pixels."""
    layers, height, width = events.shape
    side = -(-max(height, width) // WIDEST)
    if side == 1:
        return events
    padded = np.pad(events, ((0, 0), (0, -height % side), (0, -width % side)))
    rows, columns = padded.shape[1] // side, padded.shape[2] // side
    sums: NDArray[np.int64] = padded.reshape(layers, rows, side, columns, side).sum(axis=(2, 4))
    return sums


def _traces_of(sim: Simulation) -> list[dict[str, Any]]:
    """Return the name, part, state and unit of each probe that records at regular intervals."""
    program, traces = sim.program, list[dict[str, Any]]()
    for probe in program.probes:
        if probe.record == "spikes":
            continue
        part = program.populations[probe.population]
        unit = "Hz" if probe.record == "rate" else {s.name: s.unit for s in part.model.states}.get(probe.record, "")
        traces.append({"name": probe.name, "of": part.name, "state": probe.record, "unit": unit})
    for synapses in program.synapse_probes:
        if synapses.every:
            projection = program.projections[synapses.projection]
            traces.append({"name": synapses.name, "of": projection.name, "state": synapses.record, "unit": ""})
    return traces


BINS = 48
SIDE = 40
"""Largest number of rows and columns of the matrix; with more neurons an entry is a mean over several neurons."""
MOST_MAPS = 12
LARGEST = 1_000_000
"""Largest number of synapses of a projection whose weights are read during the run."""
CHOSEN = 50_000
"""Approximate number of synapses for the histogram and the matrix; of more synapses only every n-th is used."""


def weights_of(sim: Simulation, index: int) -> dict[str, Any]:
    """Return the range, mean, histogram and matrix of the weights of a projection, or the reason for their absence."""
    part = sim.program.projections[index]
    message: dict[str, Any] = {"projection": part.name, "size": part.size}
    if part.size > LARGEST:
        return message | {"refused": f"{part.size:,} synapses: weights are shown up to {LARGEST:,}"}
    values = sim._engine.get_synapses(index, "weight")
    interval = -(-part.size // CHOSEN) or 1
    finite = values[np.isfinite(values)]
    if not finite.size:
        return message | {"refused": "no synapse" if not values.size else "no weight is finite"}
    low, high = float(finite.min()), float(finite.max())
    bins = np.histogram(finite[::interval], BINS, (low, high))[0] if high > low else np.array([finite.size])
    with np.errstate(over="ignore"):
        mean = float(finite.mean())
    message |= {"low": low, "high": high, "mean": mean if math.isfinite(mean) else None, "bins": bins.tolist()}
    matrix = _kernels(part, values) if part.grid is not None else _matrix(sim, index, values, interval)
    rounded = [[None if np.isnan(v) else float(f"{v:.4g}") for v in row] for row in matrix]
    return message | {"matrix": rounded, "kernels": part.grid is not None}


def _matrix(sim: Simulation, index: int, values: Floats, interval: int) -> Floats:
    """Return the mean weights of every n-th synapse by blocks of sources (rows) and targets (columns).

    A block without a synapse is NaN.
    """
    part, populations = sim.program.projections[index], sim.program.populations
    ends = sim.handles.ends(index)
    sides = [min(SIDE, populations[end].size) for end in (part.source, part.target)]
    blocks = [
        ids[::interval] * side // populations[end].size
        for ids, side, end in zip(ends, sides, (part.source, part.target), strict=True)
    ]
    cells = blocks[0] * sides[1] + blocks[1]
    n_cells = sides[0] * sides[1]
    count = np.bincount(cells, minlength=n_cells)
    total = np.bincount(cells, weights=values[::interval], minlength=n_cells)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    matrix: Floats = mean.reshape(sides[0], sides[1])
    return matrix


def _kernels(part: Projection, values: Floats) -> Floats:
    """Return a mosaic of the first kernels: a column of the mosaic for each map, a row for each channel."""
    assert part.grid is not None
    kernels = values.reshape(part.grid.kernels)[:MOST_MAPS, :4]
    framed = np.pad(kernels, ((0, 0), (0, 0), (0, 1), (0, 1)), constant_values=np.nan)
    maps, channels, height, width = framed.shape
    mosaic: Floats = framed.transpose(1, 2, 0, 3).reshape(channels * height, maps * width)
    return mosaic[:-1, :-1]
