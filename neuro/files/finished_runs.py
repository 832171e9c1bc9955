"""What follows from results: the network of a run and its program, its bill on a chip, chosen weights and delays."""

from __future__ import annotations

import copy
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
from neuro.model.views import View, named, view
from neuro.program.backend import EngineCounts
from neuro.program.program import Floats, Ints, Program
from neuro.program.synapse_pairs import Ends, places_of_pairs, refuse_some_of_a_grid

if TYPE_CHECKING:
    from neuro.chips.energy import Energy

_NATIVE = "native."
READABLE = "spikes, traces and weights are read without"


class Sought:
    """Looks for recordings in folders, and remembers which are in none.

    Args:
        folders: where to look, in this order.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = list(folders)
        self._missing: list[str | None] = []

    def find(self, name: str | None) -> Path | None:
        """The path of a recording; one in the first folder that is not there if it is in none. None of a program's."""
        if name is None:
            self._missing.append(None)
            return None
        places = [folder / part for folder in self._folders for part in dict.fromkeys((name, Path(name).name))]
        there = next((place for place in places if place.is_file()), None)
        if there is None:
            self._missing.append(name)
        return there or places[0]

    def check(self) -> None:
        """Refuse to go on without what was not found.

        Raises:
            ModelError: a recording is in none of the folders, or was made by a program.
        """
        for name in self._missing:
            if name is None:
                message = "the network plays events of a program, which results do not hold"
                raise ModelError(message, hint=f"describe it again with these events; {READABLE} them")
            looked = ", ".join(map(str, self._folders))
            hint = f"results.network(recordings=FOLDER) says where it lies; {READABLE} it"
            raise ModelError(f"the network plays the recording {name!r}: not found in {looked}", hint=hint)


def resolved(results: Any, net: Network) -> Program:
    """What ran; what a camera emitted is listed in it, so that no recording is needed.

    Args:
        results: of the run.
        net: what ran.
    """
    from neuro.compiler import compile_network

    for name, part in results.projections.items():
        if part.drawn_by:
            raise ModelError(f"the synapses of '{name}' were drawn by {part.drawn_by}, and are not known", hint=_DRAWN)
    return compile_network(without_recordings(results, net), int(results.about["seed"]))


_DRAWN = "without 'draw: backend' in its rule they are"


def without_recordings(results: Any, net: Network) -> Network:
    """The same network with a list of spikes, of which none are there, for each event camera."""
    listed = copy.copy(net)
    listed.populations = {
        name: replace(part, model=spike_generator(), shape=results.populations[name].shape)
        if isinstance(part.model, event_camera)
        else part
        for name, part in net.populations.items()
    }
    return listed


def energy(
    results: Any,
    net: Network,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """What a run would take on a chip, from the counts of each neuron and projection.

    Args:
        results: of the run.
        net: what ran.
        target: as of `neuro.Simulation.energy`.
        step_s: likewise.
        chips: likewise.

    Raises:
        ModelError: the target has no costs, or the network does not fit on it.
    """
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
    return bill(program, counts, target, step_s=step_s, chips=chips, ran_on=results.about.get("backend", ""))


def native_counts(results: Any) -> dict[str, int]:
    """Return what only the backend of a run counts, by name."""
    counts = {name: value for name, value in results.about.items() if name.startswith(_NATIVE)}
    return {name.removeprefix(_NATIVE): int(value) for name, value in counts.items()}


def weights(results: Any, name: Any, of: Any, pre: Any, post: Any, delays: bool) -> Any:
    """What `Simulation.weights` gives, of the end of a run.

    Raises:
        ModelError: there is no such projection, its weights were not kept, or no such neurons are at its ends.
    """
    part = _kept(results, name)
    chosen = _chosen(results, part, name, of, pre, post)
    late = (_delays(results, part, name),) if delays else ()
    if part.pre is None:
        return (part.weight, float(late[0][0])) if late else part.weight
    rows = (part.pre, part.post, part.weight, *late)
    return rows if chosen is None else tuple(row[chosen] for row in rows)


def one_each(results: Any, name: Any, what: Any, of: Any, pre: Any, post: Any) -> Any:
    """What `Simulation.get` gives of the weights and delays of synapses.

    Raises:
        ModelError: a file does not have it.
    """
    if what not in ("weight", "delay"):
        message = f"projection '{name}': a file of results has no {what!r}: expected 'weight' or 'delay'"
        raise ModelError(message, hint=f"a probe records states of synapses: net.probe('name', '{name}', {what!r})")
    part = _kept(results, name)
    chosen = _chosen(results, part, name, of, pre, post)
    values = part.weight.reshape(-1) if what == "weight" else _delays(results, part, name)
    return values if chosen is None else values[chosen]


def _kept(results: Any, name: Any) -> Any:
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


def _chosen(results: Any, part: Any, name: str, of: Any, pre: Any, post: Any) -> Ints | None:
    """The places of the synapses that are asked for, None for all."""
    said = [word for word, given in (("of", of), ("pre", pre), ("post", post)) if given is not None]
    if not said:
        return None
    if part.pre is None:
        refuse_some_of_a_grid(name, said[0])
    if of is not None:
        if len(said) > 1:
            raise ModelError(f"found both 'of' and '{said[1]}': expected pairs, or the neurons at either end")
        sizes = (results.populations[part.source].size, results.populations[part.target].size)
        return places_of_pairs(Ends(name, (part.source, part.target), sizes, part.pre, part.post), of)
    kept = np.ones(part.pre.size, dtype=np.bool_)
    for word, given, population, ids in (("pre", pre, part.source, part.pre), ("post", post, part.target, part.post)):
        if given is not None:
            kept &= np.isin(ids, _neurons(results, name, word, given, population))
    return np.flatnonzero(kept)


def _neurons(results: Any, name: str, word: str, given: Any, population: str) -> Ints:
    """The neurons of a population that are named by it, by a view or by ids."""
    shape = results.populations[population].shape
    given = named(given, {each: results.laid(each) for each in results.populations})
    if isinstance(given, (Part, View, str)):
        of = given.population if isinstance(given, View) else given
        found = of if isinstance(of, str) else of.name
        if found != population or (isinstance(of, Part) and not isinstance(of, Population)):
            message = repr(given) if isinstance(given, View) else f"'{found}'"
            raise ModelError(f"{word} = {message}: expected neurons of '{population}', as '{name}' has there")
        return given.within(shape)[0] if isinstance(given, View) else np.arange(prod(shape))
    try:
        ids = [given] if isinstance(given, (int, np.integer)) else np.asarray(given)
        return view(results.laid(population), ids).ids
    except ModelError as error:
        raise error.at(None, word) from None


def _delays(results: Any, part: Any, name: str) -> Floats:
    """The delay of each synapse in ms; one that no rule changes follows from the network and the seed."""
    if part.delay_ms is not None:
        return np.asarray(part.delay_ms)
    program = resolved(results, results.network(played=False))
    index, found = next((k, each) for k, each in enumerate(program.projections) if each.name == name)
    if part.pre is not None and not all(map(np.array_equal, program.connections(index), (part.pre, part.post))):
        message = f"the delays of '{name}': this version draws other synapses than the file has, of version"
        hint = "run.network() runs once more, and a simulation has them"
        raise ModelError(f"{message} {results.about.get('neuro')}", hint=hint)
    return np.broadcast_to(Clock(program.resolution).array_ms(found.delay.astype(np.int64)), found.size).copy()
