"""Predictions of a network for recordings on a backend, and their energy."""

from __future__ import annotations

import copy
import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError, Network, Readout, Simulation, compile
from neuro.apps import Population, chip_of
from neuro.chips import Energy
from neuro.extend import Program
from neuro_events import Events
from neuro_events.dataset import Sample
from neuro_predict.asked import Pixels, fires, load, name_of, readout_of
from neuro_predict.decisions import SILENT, Evaluation, by_counts, by_first, by_potential, evaluate
from neuro_predict.showing import Overflows, Showing

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Report = Callable[[int, int], object]
"""Function that is called with the number of finished recordings and of all recordings."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownRecording:
    """Activity of the output during a recording.

    Attributes:
        name: name of the recording.
        ms: duration of the run.
        times: times of the output's spikes, ms.
        ids: neuron of each spike.
        V_m: (steps, neurons), mV; None if spikes decide.
    """

    name: str
    ms: float
    times: Floats
    ids: Ints
    V_m: Floats | None


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """Decisions of a network on a backend.

    Attributes:
        backend: name of the backend.
        readout: the readout; `classes` has the name of each neuron.
        names: names of the recordings.
        decided: (recordings,) decided class, -1 for none.
        scores: (recordings, classes) scores, see `neuro_predict.decisions`.
        spikes: (recordings,) spikes of the output.
        labels: (recordings,) true classes; None if unknown.
        bill: mean bill of a recording, for a chip with costs.
        overflows: number of recordings with overflows, by register of a chip.
        shown: the first recordings in full, up to the requested number.
    """

    backend: str
    readout: Readout
    names: tuple[str, ...]
    decided: Ints
    scores: Floats
    spikes: Ints
    labels: Ints | None = None
    bill: Energy | None = None
    overflows: Overflows | None = None
    shown: tuple[ShownRecording, ...] = ()

    @property
    def own(self) -> Evaluation | None:
        """Evaluation of the decisions; None if the true classes are unknown."""
        return None if self.labels is None else evaluate(self.decided, self.labels, self.readout.classes)

    def class_of(self, k: int) -> str | None:
        """Return the name of the decided class of recording k, or None without a decision."""
        return None if self.decided[k] == SILENT else str(self.readout.classes[self.decided[k]])

    def agrees(self, other: Predictions) -> float:
        """Return the share of recordings for which both predictions decide alike."""
        return float(np.mean(self.decided == other.decided))


def predict(
    net: Network,
    recordings: Sequence[Sample | Events],
    *,
    backend: str | PathLike[str] = "event",
    labels: Sequence[str] | None = None,
    seed: int = 0,
    **options: Any,
) -> Predictions:
    """Show recordings to a network, each from time 0 on, and decide the classes by the output.

    Args:
        net: the network.
        recordings: the result of `neuro.events.recordings`, or a list of events.
        backend: name of the backend, or table file of a chip.
        labels: name of the true class of each recording; without labels nothing is evaluated.
        seed: seed of all random numbers.
        options: settings of `neuro.Readout` that replace those of the network's readout. By default the input is the
            only spike_generator, and the output is the only probed population, or the only one without outgoing
            projections. Potentials decide if the output never fires.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: the network has no such input or output, a recording has another sensor size, a label is not the
            name of a class, or the backend cannot run the network.
    """
    if not isinstance(net, Network):
        raise ModelError(f"predict: found {net!r:.60}: expected a Network", hint="neuro.load reads one from YAML")
    readout = readout_of(net, **options)
    check_recordings(recordings, readout, net)
    return ask(net, recordings, readout, str(backend), labels=labels, seed=seed)


def check_recordings(recordings: Sequence[Sample | Events], readout: Readout, net: Network) -> None:
    """Check that all recordings can be read and fit the input of the network.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: a recording has another sensor size, or there is no recording.
    """
    if not len(recordings):
        raise ModelError("found no recording: expected at least one")
    pixels = Pixels(net, readout)
    for k, item in enumerate(recordings):
        pixels.check(item, name_of(item, k))


def ask(
    net: Network,
    recordings: Sequence[Sample | Events],
    readout: Readout,
    backend: str = "event",
    *,
    labels: Sequence[str] | None = None,
    seed: int = 0,
    keep: int = 0,
    report: Report = lambda count, total: None,
) -> Predictions:
    """Return the predictions for recordings that `check_recordings` accepts.

    Args:
        net: the network.
        recordings: see `predict`.
        readout: result of `readout_of`.
        backend: name of the backend.
        labels: see `predict`.
        seed: seed of all random numbers.
        keep: number of recordings, from the first, whose activity is in `Predictions.shown`.
        report: called after each recording.

    Raises:
        ModelError: see `predict`.
    """
    true_classes = None if labels is None else _numbers(labels, readout, len(recordings))
    sim, probe = _compiled(net, readout, backend, seed)
    pixels, path_steps, h = Pixels(net, readout), _path_steps(sim.program, readout), net.resolution
    total, neurons = len(recordings), len(readout.classes)
    decided, spikes, scores = np.zeros(total, np.int64), np.zeros(total, np.int64), np.zeros((total, neurons))
    showing, shown_recordings = Showing(sim, readout.input, readout.output), list[ShownRecording]()
    for k, item in enumerate(recordings):
        step, neuron = pixels.spikes(load(item), name_of(item, k))
        steps = pixels.steps or int(step.max(initial=-1)) + 1 + path_steps
        times, ids, payloads = showing.show(step, neuron, steps, pixels.events)
        V_m = sim.trace(probe)[1] if probe else None
        decided[k], scores[k] = _decision(readout.decide, times, ids, payloads, V_m, neurons)
        spikes[k] = len(ids)
        if k < keep:
            shown_recordings.append(ShownRecording(name_of(item, k), steps * h, times, ids, V_m))
        report(k + 1, total)
    names = tuple(name_of(item, k) for k, item in enumerate(recordings))
    bill = _bill(showing, backend, total, readout.decide or "")
    return Predictions(
        backend, readout, names, decided, scores, spikes, true_classes, bill, showing.overflows, tuple(shown_recordings)
    )


def _numbers(labels: Sequence[str], readout: Readout, recordings: int) -> Ints:
    if len(labels) != recordings:
        raise ModelError(f"labels: found {len(labels)} for {recordings} recordings: expected a label for each")
    numbers = {name: k for k, name in enumerate(readout.classes)}
    for name in labels:
        if name not in numbers:
            message = f"--output {readout.output} has no class '{name}': expected {', '.join(numbers)}"
            raise ModelError(message, hint="--classes A,B,... names its neurons in order")
    return np.array([numbers[name] for name in labels], np.int64)


def _compiled(net: Network, readout: Readout, backend: str, seed: int) -> tuple[Simulation, str]:
    """Return the simulation, and the name of the probe of the deciding potentials, "" if spikes decide."""
    if readout.decide != "potential":
        return compile(net, backend=backend, seed=seed), ""
    _check_threshold(net.populations[readout.output], backend)
    probed_net, name = copy.copy(net), f"{readout.output}.V_m"
    probed_net.probes = {key: probe for key, probe in net.probes.items() if key != name}
    probed_net.probe(name, readout.output, "V_m")
    return compile(probed_net, backend=backend, seed=seed), name


def _check_threshold(output: Population, backend: str) -> None:
    """Raise an error if a threshold is so high that all potentials below it round to 0 in a chip's registers."""
    if chip_of(backend) is not None and not fires(output):
        message = f"backend '{backend}': V_th of '{output.name}' is never reached, but sets the scale of its registers"
        hint = "set V_th just above the largest V_m on backend 'event', and use --decide potential"
        raise ModelError(f"{message}: expected V_th near V_m", hint=hint)


def _path_steps(program: Program, readout: Readout) -> int:
    """Return the largest number of steps of a spike from the input to the output, on the fastest path.

    Raises:
        ModelError: there is no path.
    """
    index = {part.name: k for k, part in enumerate(program.populations)}
    queue, visited = [(0, index[readout.input])], set[int]()
    while queue:
        steps, population = heapq.heappop(queue)
        if population == index[readout.output]:
            return steps
        if population not in visited:
            visited.add(population)
            for part in program.projections:
                if part.source == population and part.size:
                    heapq.heappush(queue, (steps + int(np.max(part.delay)), part.target))
    raise ModelError(f"no projection leads from --input {readout.input} to --output {readout.output}: expected a path")


def _decision(
    rule: str, times: Floats, ids: Ints, payloads: Ints | None, V_m: Floats | None, neurons: int
) -> tuple[int, Floats]:
    if V_m is not None:
        return by_potential(V_m)
    return by_counts(times, ids, neurons, payloads) if rule == "counts" else by_first(times, ids, neurons)


def _bill(showing: Showing, backend: str, recordings: int, decide: str) -> Energy | None:
    """Return the bill of a recording on the chip that a backend emulates."""
    chip = chip_of(backend)
    if chip is None or not chip.costs:
        return None
    bill = showing.sim.energy(backend, of=showing.taken, host=showing.host(decide))
    return bill.per(recordings, "recording")
