"""One projection as connections of NEST, and the order in which NEST lists them.

Synapses between the same two neurons cannot be told apart in NEST. So each of them is of another copy of its
model; those of post neurons with a dopamine of their own are, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from neuro.clock import Clock
from neuro.program import Floats, Ints, Program
from neuro_nest.ranks import Ranks
from neuro_nest.tables import SYNAPSES


def layers(source: Ints, target: Ints) -> Ints:
    """How many synapses of the same ends stand before each; they are sorted by source, then target."""
    fresh = np.ones(len(source), dtype=bool)
    fresh[1:] = (source[1:] != source[:-1]) | (target[1:] != target[:-1])
    starts = np.flatnonzero(fresh)
    return np.arange(len(source)) - np.repeat(starts, np.diff(np.append(starts, len(source))))


class Wires:
    """The synapses of a projection.

    Args:
        program: the whole network.
        index: which projection.
        weights: all weights, as the program has them.

    Attributes:
        source, target, slot, delay: of every synapse, by source, then target.
        row_ends: synapses of source i are row_ends[i] : row_ends[i + 1].
        weights: of a static projection those in force, else those it began with.
    """

    def __init__(self, program: Program, index: int, weights: Floats) -> None:
        self.part, self.index, self.weights = program.projections[index], index, weights
        self.source, self.target, self.slot = program.synapses(index)
        self.delay: Ints = np.broadcast_to(self.part.delay, len(self.source)).astype(np.int64)
        n_source, self.n_target = (program.populations[i].size for i in (self.part.source, self.part.target))
        self.row_ends = np.searchsorted(self.source, np.arange(n_source + 1))
        self.longest_row = max(1, int(np.diff(self.row_ends).max(initial=0)))
        layer = layers(self.source, self.target)
        self._copy = layer * self.n_target + self.target if self.part.dopamine_one_to_one else layer

    def rows(self, sources: Ints) -> tuple[Ints, Ints]:
        """The synapses of some sources, one after the other, and how many each has."""
        first, number = self.row_ends[sources], self.row_ends[sources + 1] - self.row_ends[sources]
        before = np.cumsum(number) - number
        return np.repeat(first - before, number) + np.arange(int(number.sum())), number

    def copies(self) -> Iterator[tuple[int, str, Ints]]:
        """Number, name and synapses of each copy of the model."""
        for copy in np.unique(self._copy).tolist():
            yield copy, f"neuro_{self.index}_{copy}", np.flatnonzero(self._copy == copy)

    def connect(
        self, nest: Any, first: tuple[int, int], clock: Clock, words: Mapping[str, Any], transmitters: Any
    ) -> None:
        """Make the connections.

        Args:
            nest: the module.
            first: the first node of source and target.
            clock: of the network.
            words: parameters of the synapse model in NEST's words.
            transmitters: of dopamine, one or one for each post neuron; None for other models.
        """
        weights = np.broadcast_to(self.weights, self.part.size)
        for copy, name, synapses in self.copies():
            own = {} if transmitters is None else {"volume_transmitter": transmitters[copy % len(transmitters)]}
            nest.CopyModel(SYNAPSES[self.part.synapse.name], name, dict(words) | own)
            nest.Connect(
                self.source[synapses] + first[0],
                self.target[synapses] + first[1],
                "one_to_one",
                {
                    "synapse_model": name,
                    "weight": weights[self.slot[synapses]],
                    "delay": clock.array_ms(self.delay[synapses]),
                },
            )

    def read(self, nest: Any, first: tuple[int, int], word: str, ranks: Ranks) -> Floats:
        """A state of every synapse, in NEST's word for it."""
        found: Floats = np.empty(len(self.source))
        for connections, synapses in self._listed(nest, first):
            values = np.array(connections.get(word), dtype=np.float64) if len(connections) else np.zeros(0)
            found[ranks.gather(synapses)] = ranks.gather(np.atleast_1d(values))
        return found

    def write(self, nest: Any, first: tuple[int, int], word: str, values: Floats) -> None:
        """Set a state of every synapse."""
        for connections, synapses in self._listed(nest, first):
            if len(connections):
                connections.set({word: values[synapses].tolist()})

    def _listed(self, nest: Any, first: tuple[int, int]) -> Iterator[tuple[Any, Ints]]:
        """The connections of each copy that this process has, and which synapses they are."""
        for _, name, synapses in self.copies():
            connections = nest.GetConnections(synapse_model=name)
            ends = connections.get(["source", "target"]) if len(connections) else {"source": [], "target": []}
            source, target = (np.atleast_1d(np.array(ends[word], dtype=np.int64)) for word in ("source", "target"))
            codes = self.source[synapses] * self.n_target + self.target[synapses]
            wanted = (source - first[0]) * self.n_target + target - first[1]
            yield connections, synapses[np.searchsorted(codes, wanted)]
