"""Weights and delays that a run has left, all or chosen ones by their ends, as of a simulation."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any, Protocol

import numpy as np

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, unknown
from neuro.files.run_networks import Over, resolved
from neuro.model.network import Network
from neuro.model.parts import Part, Population
from neuro.model.views import Laid, View, named, view
from neuro.program.program import Floats, Ints
from neuro.program.synapse_pairs import Ends, places_of_pairs, refuse_some_of_a_grid


class FinishedRun(Over, Protocol):
    """What is asked of results."""

    @property
    def projections(self) -> Mapping[str, Any]:
        """Weights by projection."""

    @property
    def finished(self) -> bool:
        """Whether the run came to its end."""

    def laid(self, name: str) -> Laid:
        """A population as something of which there may be views."""

    def network(self, *, played: bool) -> Network:
        """What ran."""


def weights(results: FinishedRun, name: Any, of: Any, pre: Any, post: Any, delays: bool) -> Any:
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


def one_each(results: FinishedRun, name: Any, what: Any, of: Any, pre: Any, post: Any) -> Any:
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


def _kept(results: FinishedRun, name: Any) -> Any:
    if name not in results.projections:
        raise unknown("projection", name, results.projections)
    part = results.projections[name]
    if part.weight is None:
        hint = "--all-weights keeps them" if results.finished else "weights are written when a run ends"
        raise ModelError(f"the weights of '{name}' were not kept", hint=hint)
    return part


def _chosen(results: FinishedRun, part: Any, name: str, of: Any, pre: Any, post: Any) -> Ints | None:
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


def _neurons(results: FinishedRun, name: str, word: str, given: Any, population: str) -> Ints:
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


def _delays(results: FinishedRun, part: Any, name: str) -> Floats:
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
