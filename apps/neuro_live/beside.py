"""Slow computations in a second process: the F-I curve of a neuron, and joules on chips.

The second process loads the network from a file and compiles it.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterable
from copy import copy
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from neuro import (
    ModelError,
    Network,
    Simulation,
    compile as compiled,
    dc_generator,
    event_camera,
    load,
    one_to_one,
)
from neuro.apps import Lost, Processes, Task, Work, compile_network, difference, save, settable
from neuro.chips import Chip, HostWork, Placement, chip, chips, place, price
from neuro.extend import EngineCounts, Neuron, Program

CURRENTS = 24
"""Number of currents of an F-I curve."""
CURVE_MS = 1000.0
"""Duration of the run for an F-I curve, ms."""
LARGEST = 3_000_000
"""Largest number of synapses of a network that is compiled a second time for its energy."""
MOST_WAITING = 2
"""Number of waiting jobs above which a request for a curve is refused."""
NICE = 10

Job = dict[str, Any]


class Beside:
    """The second process, which starts with the first job.

    Args:
        sim: the simulation.
    """

    def __init__(self, sim: Simulation) -> None:
        self._sim = sim
        self._folder = tempfile.TemporaryDirectory(prefix="neuro-live-")
        self._pool = Processes(begin, 1)
        self._last_counts: EngineCounts | None = None
        self._curves = 0
        self.refused = self._refusal()

    def _refusal(self) -> str:
        """Return the reason why the network has no energy figures, or ""."""
        if all(part.kind != "neuron" for part in self._sim.program.populations):
            return "no population of neurons"
        synapses = sum(part.size for part in self._sim.program.projections)
        if synapses > LARGEST:
            return f"{synapses:,} synapses: energy is shown up to {LARGEST:,}"
        try:
            save(without_recordings(self._sim), self._path)
        except ModelError as error:
            return error.message
        return ""

    @property
    def _path(self) -> Path:
        return Path(self._folder.name) / "network.yaml"

    def begin(self) -> None:
        """Restart the counts at the present time."""
        self._last_counts = self._sim.taken().raw_counts

    def price(self) -> None:
        """Request the energy of the operations since the last request, on each chip."""
        if self.refused or self._pool.busy:
            return
        counts = self._sim.taken().raw_counts
        last_counts, self._last_counts = self._last_counts, counts
        if last_counts is not None and counts.steps > last_counts.steps:
            job = {"path": str(self._path), "seed": self._sim.program.seed, "host": tuple(self._sim.host_work)}
            self._pool.put({"do": "price", "counts": difference(counts, last_counts), **job})

    def curve(self, population: str, neuron: int) -> None:
        """Request the rates of a neuron at constant currents.

        Raises:
            ModelError: the neuron accepts no current, its model cannot be written, or too many curves are requested.
        """
        if self._pool.waiting > MOST_WAITING:
            raise ModelError("too many curves requested: try again when the last one is shown")
        net = curve_of(self._sim, population, neuron)
        self._curves += 1
        path = Path(self._folder.name) / f"curve-{self._curves}.yaml"
        save(net, path)
        self._pool.put({"do": "curve", "path": str(path), "population": population, "neuron": neuron})

    def results(self) -> list[tuple[Job, Any]]:
        """Return the finished jobs with their results, or the error text of failed jobs, without waiting."""
        try:
            ended = self._pool.hear(0.0) if self._pool.busy else []
        except ModelError as error:
            self.refused = str(error)
            return []
        return [(task.job, _result(task)) for task in ended]

    def close(self) -> None:
        """End the process."""
        self._pool.close()
        self._folder.cleanup()


def _result(task: Task) -> Any:
    try:
        return task.result()
    except Lost as lost:
        return f"its process {lost.how}"
    except BaseException as error:
        return getattr(error, "message", str(error))


def without_recordings(sim: Simulation) -> Network:
    """Return the network, in which cameras have no recordings. The counts already contain the cameras' spikes."""
    net = copy(sim._net)
    shapes = {part.name: part.shape for part in sim.program.populations}
    net.populations = {
        name: replace(part, model=replace(part.model, file=None, events=None), shape=shapes[name])
        if isinstance(part.model, event_camera)
        else part
        for name, part in net.populations.items()
    }
    return net


def begin() -> Work:
    """Set up the second process; return its function that executes a job."""
    os.nice(NICE)
    work = {"price": _price, "curve": _curve}

    def do(job: Job, attempt: int, tell: Any) -> Any:
        return work[job["do"]](job)

    return do


@lru_cache(1)
def _placements(path: str, seed: int) -> tuple[Program, list[tuple[Chip, Placement | None] | tuple[Chip, str]]]:
    """Compile the network; return the program, and for each priced chip the placement or the reason for a refusal."""
    program = compile_network(load(path), seed, 1)
    placements: list[Any] = []
    for name in chips():
        target = chip(name)
        if target.costs:
            try:
                placements.append((target, place(program, target) if target.mesh is not None else None))
            except ModelError as error:
                placements.append((target, error.message))
    return program, placements


def _price(job: Job) -> list[dict[str, Any]]:
    program, placements = _placements(job["path"], job["seed"])
    return [_bill(program, job["counts"], job["host"], *priced) for priced in placements]


def _bill(
    program: Program, counts: EngineCounts, host: Iterable[HostWork], chip: Chip, placement: Any
) -> dict[str, Any]:
    """Return the joules per second of network time on a chip in real time.

    If the chip is slower than real time, `late` is the chip's time in units of network time.
    """
    row = {"chip": chip.name, "title": chip.title}
    if isinstance(placement, str):
        return row | {"refused": placement}
    try:
        energy = price(program, counts, placement, chip, host=host).real_time
    except ModelError as error:
        return row | {"refused": "; ".join(dict.fromkeys(problem.message for problem in (error.others or (error,))))}
    if energy.refused:
        return row | {"refused": energy.refused}
    seconds = energy.duration_s
    static = energy.static_j / seconds if energy.static_known else None
    slowdown = (energy.chip_time_s or 0.0) / seconds if energy.late else None
    host_j = energy.by_cost().get("host", 0.0) / seconds
    dynamic = energy.dynamic_j / seconds - host_j
    joules = {"dynamic": dynamic, "host": host_j, "static": static, "missing": list(energy.missing)}
    return row | joules | {"chips": energy.chips, "late": slowdown}


def curve_of(sim: Simulation, population: str, neuron: int) -> Network:
    """Return a network of copies of a neuron with its present parameters, each with a current generator.

    Raises:
        ModelError: there is no such neuron, or the neuron accepts no current.
    """
    neurons = sim.handles.neurons(population)
    ids, model = settable.neuron_ids([neuron], neurons.part.size), neurons.part.model
    if not isinstance(model, Neuron) or not has_curve(model):
        raise ModelError(f"'{population}' is {neurons.part.model_name}: expected a neuron that accepts a current")
    parameters = model.parameters()
    for name in parameters:
        if name in neurons.part.parameters and model.quantities()[name].kind == "number":
            parameters[name] = float(sim._engine.get(neurons.index, name, ids)[0])
    net = Network("curve", resolution=sim.program.resolution)
    cells = net.population("cells", CURRENTS, type(model).from_words(parameters))
    currents = net.population("currents", CURRENTS, dc_generator(amplitude=np.zeros(CURRENTS)))
    net.connect(currents, cells, one_to_one(), delay=sim.program.resolution)
    return net


def has_curve(model: Neuron) -> bool:
    """Return whether an F-I curve of the model can be computed."""
    return model.takes_current and not model.chip and not model.most


def _curve(job: Job) -> dict[str, Any]:
    """Return the rates at currents from 0 to three times the smallest current with spikes, found by a coarse scan."""
    sim = compiled(load(job["path"]))
    rates = partial(_rates, sim)
    coarse = np.concatenate(([0.0], np.geomspace(1.0, 1e5, CURRENTS - 1)))
    firing = np.flatnonzero(rates(coarse) > 0.0)
    first = coarse[firing[0]] if firing.size else math.nan
    if not firing.size:
        return {"currents": [], "rates": []}
    top = 3.0 * first if first else 1000.0
    currents = np.linspace(0.0, top, CURRENTS)
    return {"currents": currents.tolist(), "rates": rates(currents).tolist()}


def _rates(sim: Simulation, currents: Any) -> Any:
    """Return the rates of the neurons in Hz at these currents."""
    sim.reset()
    sim.set("currents", amplitude=currents)
    sim.run(CURVE_MS)
    return sim.taken().raw_counts.spikes[0] / (CURVE_MS * 1e-3)
