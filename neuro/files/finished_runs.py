"""Read network, program, energy, weights and delays of a finished run from its results."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterable
from dataclasses import replace
from math import prod
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.model.network import Network
from neuro.model.neurons import event_camera, spike_generator
from neuro.model.parts import Part, Population
from neuro.model.views import View, view, view_of_index
from neuro.program.backend import EngineCounts
from neuro.program.program import Floats, Ints, Program
from neuro.program.synapse_pairs import Ends, places_of_pairs, refuse_some_of_a_grid

if TYPE_CHECKING:
    from neuro.chips.energy import Energy

_NATIVE = "native."
READABLE = "spikes, traces and weights can be read without"


class RecordingSearch:
    """A search for recordings in folders, with a list of missing recordings.

    Args:
        folders: folders to search, in this order.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = list(folders)
        self._missing: list[str | None] = []

    def find(self, name: str | None) -> Path | None:
        """Return the path of a recording.

        A missing recording gets a path in the first folder. The name None means that a program made the events.
        """
        if name is None:
            self._missing.append(None)
            return None
        paths = [folder / part for folder in self._folders for part in dict.fromkeys((name, Path(name).name))]
        existing = next((path for path in paths if path.is_file()), None)
        if existing is None:
            self._missing.append(name)
        return existing or paths[0]

    def check(self) -> None:
        """Raise an error if a recording is missing.

        Raises:
            ModelError: a recording is in none of the folders, or its events came from a program.
        """
        for name in self._missing:
            if name is None:
                message = "the network plays events of a program, and a file of results does not contain them"
                raise ModelError(message, hint=f"describe it again with these events; {READABLE} them")
            folders = ", ".join(map(str, self._folders))
            hint = f"results.network(recordings=FOLDER) finds it in FOLDER; {READABLE} it"
            raise ModelError(f"the network plays the recording {name!r}: not found in {folders}", hint=hint)


def resolved(results: Any, net: Network) -> Program:
    """Return the program that ran, in which event cameras are replaced, so that no recording is needed.

    Args:
        results: results of the run.
        net: the network that ran.
    """
    from neuro.compiler import compile_network

    for name, part in results.projections.items():
        if part.drawn_by:
            raise ModelError(f"the synapses of '{name}' were drawn by {part.drawn_by}, and are not known", hint=_DRAWN)
    return compile_network(without_recordings(results, net), int(results.about["seed"]))


_DRAWN = "leave out 'draw: backend' in the rule: the synapses are then known"


def without_recordings(results: Any, net: Network) -> Network:
    """Return a copy of the network with a `spike_generator` without spikes in place of each event camera."""
    copied = copy.copy(net)
    copied.populations = {
        name: replace(part, model=spike_generator(), shape=results.populations[name].shape)
        if isinstance(part.model, event_camera)
        else part
        for name, part in net.populations.items()
    }
    return copied


def energy(
    results: Any,
    net: Network,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """Return the energy of a run on a chip, from the counts of each neuron and projection.

    Args:
        results: results of the run.
        net: the network that ran.
        target: chip or file of costs, see `neuro.Simulation.energy`.
        step_s: duration of a step in s, see `neuro.Simulation.energy`.
        chips: number of chips, see `neuro.Simulation.energy`.

    Raises:
        ModelError: the target has no costs, or the network does not fit on it.
    """
    from neuro.chips.hosting import HostWork
    from neuro.chips.pricing import bill

    program = resolved(results, net)
    trains = [results.populations[part.name] for part in program.populations]
    updates = [results.projections[part.name].counts["learning_updates"] for part in program.projections]
    by_trials = [part.synapse.learns == "trials" for part in program.projections]
    counts = EngineCounts(
        steps=int(results.about["counts.steps"]),
        events=tuple(np.asarray(train.event_counts) for train in trains),
        spikes=tuple(np.asarray(train.spike_counts) for train in trains),
        active=np.array([train.counts["neuron_updates_active"] for train in trains], np.int64),
        trial_updates=np.array([n * taught for n, taught in zip(updates, by_trials, strict=True)], np.int64),
        native=native_counts(results),
    )
    host = [HostWork.of_list(part) for part in json.loads(results.about.get("host_work", "[]"))]
    options: Any = {"step_s": step_s, "chips": chips, "ran_on": results.about.get("backend", ""), "host": host}
    return bill(program, counts, target, **options)


def native_counts(results: Any) -> dict[str, int]:
    """Return the counts of a run that only its backend has, by name."""
    counts = {name: value for name, value in results.about.items() if name.startswith(_NATIVE)}
    return {name.removeprefix(_NATIVE): int(value) for name, value in counts.items()}


def weights(results: Any, name: Any, of: Any, pre: Any, post: Any, delays: bool) -> Any:
    """Return the weights at the end of a run, in the form of `Simulation.weights`.

    Raises:
        ModelError: the projection does not exist, was stored without weights, or does not connect these neurons.
    """
    part = _with_weights(results, name)
    indices = _synapses(results, part, name, of, pre, post)
    delay_ms = (_delays(results, part, name),) if delays else ()
    if part.pre is None:
        return (part.weight, float(delay_ms[0][0])) if delay_ms else part.weight
    columns = (part.pre, part.post, part.weight, *delay_ms)
    return columns if indices is None else tuple(column[indices] for column in columns)


def one_each(results: Any, name: Any, quantity: Any, of: Any, pre: Any, post: Any) -> Any:
    """Return the weight or delay of each synapse, in the form of `Simulation.get`.

    Raises:
        ModelError: `quantity` is neither "weight" nor "delay", or the file has no such array.
    """
    if quantity not in ("weight", "delay"):
        message = f"projection '{name}': a file of results has no {quantity!r}: expected 'weight' or 'delay'"
        raise ModelError(message, hint=f"record states of synapses with net.probe('name', '{name}', {quantity!r})")
    part = _with_weights(results, name)
    indices = _synapses(results, part, name, of, pre, post)
    values = part.weight.reshape(-1) if quantity == "weight" else _delays(results, part, name)
    return values if indices is None else values[indices]


def _with_weights(results: Any, name: Any) -> Any:
    if name not in results.projections:
        raise unknown("projection", name, results.projections)
    part = results.projections[name]
    if part.weight is None:
        hint = "--all-weights keeps them" if results.finished else "weights are written when a run ends"
        message = f"the weights of '{name}' were not kept"
        if part.drawn_by:
            message, hint = f"{message}: its synapses were drawn by {part.drawn_by}, and are not known", _DRAWN
        raise ModelError(message, hint=hint)
    return part


def _synapses(results: Any, part: Any, name: str, of: Any, pre: Any, post: Any) -> Ints | None:
    """Return the indices of the synapses between the given neurons, or None for all synapses."""
    selections = [word for word, value in (("of", of), ("pre", pre), ("post", post)) if value is not None]
    if not selections:
        return None
    if part.pre is None:
        refuse_some_of_a_grid(name, selections[0])
    if of is not None:
        if len(selections) > 1:
            raise ModelError(f"found both 'of' and '{selections[1]}': expected pairs, or the neurons at either end")
        sizes = (results.populations[part.source].size, results.populations[part.target].size)
        return places_of_pairs(Ends(name, (part.source, part.target), sizes, part.pre, part.post), of)
    matches = np.ones(part.pre.size, dtype=np.bool_)
    for word, value, population, ids in (("pre", pre, part.source, part.pre), ("post", post, part.target, part.post)):
        if value is not None:
            matches &= np.isin(ids, _neurons(results, name, word, value, population))
    return np.flatnonzero(matches)


def _neurons(results: Any, name: str, word: str, value: Any, population: str) -> Ints:
    """Return ids of neurons of a population. `value` is the population, a view of it, or ids."""
    shape = results.populations[population].shape
    neurons = view_of_index(value, {key: results.laid(key) for key in results.populations})
    if isinstance(neurons, (Part, View, str)):
        part = neurons.population if isinstance(neurons, View) else neurons
        part_name = part if isinstance(part, str) else part.name
        if part_name != population or (isinstance(part, Part) and not isinstance(part, Population)):
            text = repr(neurons) if isinstance(neurons, View) else f"'{part_name}'"
            raise ModelError(f"{word} = {text}: expected neurons of '{population}', an end of '{name}'")
        return neurons.within(shape)[0] if isinstance(neurons, View) else np.arange(prod(shape))
    try:
        ids = [neurons] if isinstance(neurons, (int, np.integer)) else np.asarray(neurons)
        return view(results.laid(population), ids).ids
    except ModelError as error:
        raise error.at(None, word) from None


def _delays(results: Any, part: Any, name: str) -> Floats:
    """Return the delay of each synapse in ms, (synapses,).

    Delays that no rule changes are not in the file, but are drawn again from the network and the seed.
    """
    if part.delay_ms is not None:
        return np.asarray(part.delay_ms)
    program = resolved(results, results.network(played=False))
    index, projection = next((k, p) for k, p in enumerate(program.projections) if p.name == name)
    if part.pre is not None and not all(map(np.array_equal, program.connections(index), (part.pre, part.post))):
        message = f"the delays of '{name}': this version draws other synapses than the file has, of version"
        hint = "compile run.network() and run it: the simulation has the delays"
        raise ModelError(f"{message} {results.about.get('neuro')}", hint=hint)
    delay_ms = Clock(program.resolution).array_ms(projection.delay.astype(np.int64))
    return np.broadcast_to(delay_ms, projection.size).copy()
