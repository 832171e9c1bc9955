"""A neuron that repeats what it hears."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.neurons.base import Neuron


@dataclass(frozen=True, kw_only=True, eq=False)
class parrot_neuron(Neuron):
    """Repeats every spike that arrives, with its multiplicity and whatever its weight. Source: NEST 3.10."""

    equation: ClassVar[str] = "emits at t what arrives at t"
    source: ClassVar[str] = "NEST 3.10 parrot_neuron"
    relay: ClassVar[bool] = True


def constants(p, h, c):
    """A parrot has none."""


def step(s, c, x, i_0, lo, hi, fired):
    """Fire where something arrived."""
    for i in range(lo, hi):
        fired[i] = x[0, i] > 0.0


def fire(s, c, i):
    """Nothing is left to reset."""


def quiet(s, c, i_0, lo, hi):
    """Always: only input makes it fire."""
    return True
