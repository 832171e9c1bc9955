"""What takes long, computed in a process beside the simulation: the curve of a neuron, and joules on chips.

That process knows the network from a file, which it compiles itself.
"""

from __future__ import annotations

import math
import os
import tempfile
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
from neuro.apps import Done, Lost, Processes, Raised, Work, compile_network, difference, save, settable
from neuro.chips import Chip, Placement, chip, chips, place, price
from neuro.extend import EngineCounts, Neuron, Program

CURRENTS = 24
"""Points of a curve."""
CURVE_MS = 1000.0
LARGEST = 3_000_000
"""Synapses of a network that is compiled once more to be priced."""
MOST_WAITING = 2
NICE = 10

Job = dict[str, Any]


class Beside:
    """The process, which starts with the first job.

    Args:
        sim: the simulation.
    """

    def __init__(self, sim: Simulation) -> None:
        self._sim = sim
        self._folder = tempfile.TemporaryDirectory(prefix="neuro-live-")
        self._pool = Processes(begin, 1)
        self._before: EngineCounts | None = None
        self._curves = 0
        self.refused = self._refusal()

    def _refusal(self) -> str:
        """Why the network cannot be priced, "" if it can."""
        if all(part.kind != "neuron" for part in self._sim.program.populations):
            return "no population computes"
        synapses = sum(part.size for part in self._sim.program.projections)
        if synapses > LARGEST:
            return f"{synapses:,} synapses: a run is priced while it goes on up to {LARGEST:,}"
        try:
            save(without_recordings(self._sim), self._path)
        except ModelError as error:
            return error.message
        return ""

    @property
    def _path(self) -> Path:
        return Path(self._folder.name) / "network.yaml"

    def begin(self) -> None:
        """Count anew from now on."""
        self._before = self._sim.taken().raw_counts

    def price(self) -> None:
        """Ask what has happened since the last time costs on each chip."""
        if self.refused or self._pool.busy:
            return
        now = self._sim.taken().raw_counts
        before, self._before = self._before, now
        if before is not None and now.steps > before.steps:
            about = {"path": str(self._path), "seed": self._sim.program.seed}
            self._pool.put({"do": "price", "counts": difference(now, before), **about})

    def curve(self, population: str, neuron: int) -> None:
        """Ask for the rates of a neuron at constant currents.

        Raises:
            ModelError: it takes no current, its model cannot be written, or several curves are asked for already.
        """
        if self._pool.waiting > MOST_WAITING:
            raise ModelError("curves are computed one after the other: try again when the last one is shown")
        net = curve_of(self._sim, population, neuron)
        self._curves += 1
        path = Path(self._folder.name) / f"curve-{self._curves}.yaml"
        save(net, path)
        self._pool.put({"do": "curve", "path": str(path), "population": population, "neuron": neuron})

    def found(self) -> list[tuple[Job, Any]]:
        """Jobs that have ended, and what came of them, an error as text; without waiting."""
        try:
            events = self._pool.hear(0.0) if self._pool.busy else []
        except ModelError as error:
            self.refused = str(error)
            return []
        ended: list[tuple[Job, Any]] = []
        for event in events:
            if isinstance(event, Done):
                ended.append((event.job, event.result))
            elif isinstance(event, Raised):
                ended.append((event.job, getattr(event.error, "message", str(event.error))))
            elif isinstance(event, Lost):
                ended.append((event.job, f"its process {event.how}"))
        return ended

    def close(self) -> None:
        """End the process."""
        self._pool.close()
        self._folder.cleanup()


def without_recordings(sim: Simulation) -> Network:
    """The network with cameras that play nothing: what they have emitted is counted already."""
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
    """Be the process: what does a job."""
    os.nice(NICE)
    work = {"price": _price, "curve": _curve}

    def do(job: Job, attempt: int, tell: Any) -> Any:
        return work[job["do"]](job)

    return do


@lru_cache(1)
def _placed(path: str, seed: int) -> tuple[Program, list[tuple[Chip, Placement | None] | tuple[Chip, str]]]:
    """The network, and where it lies on each chip that has costs, or why it does not."""
    program = compile_network(load(path), seed, 1)
    found: list[Any] = []
    for name in chips():
        each = chip(name)
        if each.costs:
            try:
                found.append((each, place(program, each) if each.mesh is not None else None))
            except ModelError as error:
                found.append((each, error.message))
    return program, found


def _price(job: Job) -> list[dict[str, Any]]:
    program, placed = _placed(job["path"], job["seed"])
    return [_bill(program, job["counts"], *each) for each in placed]


def _bill(program: Program, counts: EngineCounts, chip: Chip, placement: Any) -> dict[str, Any]:
    """Joules of a second of the network on a chip in real time; a chip that is late is on for longer."""
    about = {"chip": chip.name, "title": chip.title}
    if isinstance(placement, str):
        return about | {"refused": placement}
    try:
        energy = price(program, counts, placement, chip).real_time
    except ModelError as error:
        return about | {"refused": "; ".join(dict.fromkeys(each.message for each in (error.others or (error,))))}
    if energy.refused:
        return about | {"refused": energy.refused}
    seconds = energy.duration_s
    static = energy.static_j / seconds if energy.static_known else None
    late = (energy.chip_time_s or 0.0) / seconds if energy.late else None
    joules = {"dynamic": energy.dynamic_j / seconds, "static": static, "missing": list(energy.missing)}
    return about | joules | {"chips": energy.chips, "late": late}


def curve_of(sim: Simulation, population: str, neuron: int) -> Network:
    """A network of copies of a neuron as it is now, each of which is to have a current of its own.

    Raises:
        ModelError: there is no such neuron, or it takes no current.
    """
    neurons = sim.handles.neurons(population)
    ids, model = settable.neuron_ids([neuron], neurons.part.size), neurons.part.model
    if not isinstance(model, Neuron) or not has_curve(model):
        raise ModelError(
            f"'{population}' is {neurons.part.model_name}: expected a neuron to which a current can be given"
        )
    words = model.parameters()
    for word in words:
        if word in neurons.part.parameters and model.quantities()[word].kind == "number":
            words[word] = float(sim._engine.get(neurons.index, word, ids)[0])
    net = Network("curve", resolution=sim.program.resolution)
    cells = net.population("cells", CURRENTS, type(model).from_words(words))
    currents = net.population("currents", CURRENTS, dc_generator(amplitude=np.zeros(CURRENTS)))
    net.connect(currents, cells, one_to_one(), delay=sim.program.resolution)
    return net


def has_curve(model: Neuron) -> bool:
    """Whether copies of a neuron can be given currents."""
    return model.takes_current and not model.chip and not model.most


def _curve(job: Job) -> dict[str, Any]:
    """Rates at currents from 0 to three times that of the first spikes."""
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
    """Spikes in a second of neurons with these currents."""
    sim.reset()
    sim.set("currents", amplitude=currents)
    sim.run(CURVE_MS)
    return sim.taken().raw_counts.spikes[0] / (CURVE_MS * 1e-3)
