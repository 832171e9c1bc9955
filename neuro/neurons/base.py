"""What a neuron model is: parameters, state rows and four plain functions.

A model's arithmetic is written once, as functions over arrays that run as they stand in the reference
backend and compiled in the event backend. All neurons of a network lie side by side; `lo` and `hi`
bound the neurons of one call, which share one vector of constants `c`.

    constants(p, h, c)                    fill `c` from the parameters `p` (in order of definition) for a step of h ms
    step(s, c, x, i_0, lo, hi, fired)     advance one step: `s` states, `x` arrived input, `i_0` current in pA;
                                          set `fired` where the threshold is reached
    fire(s, c, i)                         what a spike does to neuron i
    quiet(s, c, i_0, lo, hi)              whether none of them can fire before its next input
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

from neuro.quantities import Choice, Value, quantity


@dataclass(frozen=True, slots=True)
class State:
    """A state variable: its name, unit and meaning. Hidden ones count steps and are not recorded."""

    name: str
    unit: str
    doc: str
    hidden: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Model(Choice):
    """Base of every population model.

    Class attributes:
        equation: the dynamics, one line for people.
        source: paper or simulator that defines it.
    """

    kind: ClassVar[str] = "model"
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    states: ClassVar[tuple[State, ...]] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator(Model):
    """A population without input: each of its neurons emits one spike train, or a current."""

    emits: ClassVar[str] = "spikes"


@dataclass(frozen=True, kw_only=True, eq=False)
class Neuron(Model):
    """A population that is stepped.

    Class attributes:
        receptors: 1, all input is summed; 2, positive weights go to the first and negative to the second.
        relay: whether a spike carries the multiplicity that arrived, whatever the weight.
        linear: whether n quiet steps equal one step with the constants of n h.
        arithmetic: the module with `constants`, `step`, `fire` and `quiet`, see above. The first
            constant is the threshold and the first state V_m, where the model has them.
    """

    receptors: ClassVar[int] = 1
    relay: ClassVar[bool] = False
    linear: ClassVar[bool] = False
    arithmetic: ClassVar[ModuleType]

    tau_minus: Value = quantity(
        20.0,
        "ms",
        "time constant of the post trace that plastic synapses onto this neuron read",
        above=0,
        arrays=True,
    )

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The state at time 0, by name; a state that is not named starts at 0."""
        return {}


Function = Callable[..., Any]
