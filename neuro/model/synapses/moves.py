"""Rules that learn from move to move of an agent: what is common to those whose eligibility a signal teaches.

Beside `constants`, the module of such a rule has

    gather(y, e, c, pre, spikes, seen, gate)    what a step of the post neuron adds to the eligibility of synapse e
    teach(y, e, c, n)                           what the signal n of the post neuron does at the end of a move

In `y`, row 0 is the weight, the others are the states. `gather` is asked after each step, of the synapses whose pre
traces are not 0, where the neuron has spiked (`spikes`, how often) or the state that the rule `sees` is not 0; it must
do nothing where both are 0. `teach` is asked when the signal is set, of the synapses with a state that is not 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.core.registry import OfModule
from neuro.model.synapses.base import Synapse, Trace

GATHERING = {"constants": 3, "gather": 7, "teach": 4}
"""The functions of such a rule and how many arguments each takes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MoveRule(Synapse):
    """Base of rules that gather eligibility while an agent moves, and are taught by a signal at the end of each move.

    A signal acts at the moment at which it is set, once, on the eligibility that was gathered up to then; it is not
    held. States of the synapses can be set, so an episode ends with `sim.set(part, z=0.0, e=0.0)`. Spikes take one
    step, so that a neuron's spike teaches the synapses whose input it has just had. A source all of whose traces are
    below `x_min` counts as silent: its traces are 0.

    Class attributes:
        sees: the state of the post neuron that `gather` reads, as the step has left it; "" for none.
    """

    learns: ClassVar[str] = "moves"
    sees: ClassVar[str] = ""
    post: ClassVar[tuple[Trace, ...]] = ()
    arithmetic: ClassVar[OfModule] = OfModule(("gather", "teach"))

    signal: str | None = quantity(None, "", "the signal that teaches", kind="name")
    gate: str | None = quantity(
        None, "", "a signal that is held and says how much is gathered, one value a neuron; 1 without", kind="name"
    )
    receptor: str | None = quantity(
        None, "", "the target's receptor that spikes go to; by the sign of the weight if not said", kind="receptor"
    )
    x_min: float = quantity(
        1e-3, "", "pre trace below which a source counts as silent, and eligibility below which it is 0", above=0
    )
