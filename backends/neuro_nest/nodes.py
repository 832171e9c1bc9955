"""Which of NEST's nodes stand for the neurons of a population."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.program.program import Ints


@dataclass(frozen=True, slots=True)
class Nodes:
    """Nodes that stand for neurons.

    Attributes:
        first: the number of the first node; the others follow.
        at: which of them stands for each neuron; None: they are in order.
    """

    first: int
    at: Ints | None

    def places(self, neurons: Ints) -> Ints:
        """Which of the nodes stand for some neurons, counted from 0."""
        return neurons if self.at is None else self.at[neurons]

    def of(self, neurons: Ints) -> Ints:
        """The numbers of the nodes of some neurons."""
        return self.first + self.places(neurons)

    def in_turn(self, neurons: int) -> Ints:
        """The neurons in the order of their nodes."""
        return np.arange(neurons) if self.at is None else np.argsort(self.at)

    def neurons(self, nodes: Ints) -> Ints:
        """The neurons for which some nodes stand."""
        places = nodes - self.first
        return places if self.at is None else np.argsort(self.at)[places]


def dealt_out(neurons: int, processes: int) -> Ints:
    """Which node stands for each neuron, so that each process has neighbouring ones though nodes are dealt in turn."""
    return np.concatenate([np.arange(rank, neurons, processes) for rank in range(processes)])
