"""What the engine has to know of a family of chips, beside its `neuro.chips.arithmetic.Arithmetic`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection, Words
from neuro.program.program import Floats, Ints
from neuro_chip.tables import Arrays


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChipFamily:
    """A family of chips in the engine.

    Attributes:
        arithmetic: which family.
        steps: the compiled step of each kind of population (`FixedPopulation.kind`): step(net, pop, row, step) updates
            the neurons of a population and sets `fired` where the threshold is reached.
        receptors: slots of a neuron for each step to come: 1, words of any sign are summed in 32 bits; 2, one for each
            sign, which saturate.
        word: type of the array of words.
        stands_for: the register that holds a state or a parameter, by the names of the language.
        states: the state registers of each kind.
        write: puts the registers of a population, rows `here` of the arrays, where its step reads them; `row` is its
            row of the table of populations.
        current: a synaptic current in pA, of its name, from the state registers.
        units: that name's value in pA as units of its register.
        bias: what is added in each step, with a current in pA beside the constant one; a `ModelError` where it
            overflows.
        words: what the loop adds for some mantissas.
        way_out: what would keep the registers of a population from overflowing, "" where nothing is known.
    """

    arithmetic: Arithmetic
    steps: Mapping[str, Any]
    receptors: int
    word: type[np.signedinteger[Any]]
    stands_for: Mapping[str, str]
    states: Mapping[str, tuple[str, ...]]
    write: Callable[[Arrays, NDArray[np.int64], slice, Mapping[str, Ints]], None]
    current: Callable[[FixedPopulation, str, Mapping[str, NDArray[np.int32]]], Floats]
    units: Callable[[FixedPopulation, str, Floats], Floats]
    bias: Callable[[FixedPopulation, Floats], NDArray[np.int32]]
    words: Callable[[FixedProjection, Words], Words]
    way_out: Callable[[FixedPopulation], str]
