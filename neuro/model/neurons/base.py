"""What a neuron model is: parameters, state rows and four plain functions.

A model's arithmetic is written once, as functions over arrays that run as they stand in the reference backend and
compiled in the event backend. They stand in the body of the class, without `self`, or in its module. All neurons of a
network lie side by side; `lo` and `hi` bound the neurons of one call, which share one vector of constants `c`.

    constants(p, h, c)                    fill `c` from the parameters `p` (in order of definition) for a step of h ms
    step(s, c, x, i_0, lo, hi, fired)     advance one step: `s` states, `x` arrived input, `i_0` current in pA;
                                          `fired[i]` becomes 1 where the threshold is reached,
                                          0 elsewhere; more where it `resets_in_step` and is reached again
    fire(s, c, i)                         what a spike does to neuron i
    quiet(s, c, i_0, lo, hi)              whether none of them can fire before its next input

A model that says `linear`, and for which n steps without input are not one step of n h, has a fifth function:

    catch_up(s, p, c, i_0, lo, hi, h, n)  advance n steps of h ms without input, in which none fires; `c` is room for
                                          constants

A neuron that fires at random says `draws`; then it is `step(s, c, x, i_0, lo, hi, fired, u)`, where `u[i]` is a number
in [0, 1) that is drawn anew for each neuron and step, and `quiet` is false wherever a draw can make a neuron fire.

A generator has, beside `constants`,

    emit(s, c, u, step, lo, hi, out)      `out[i]`, 0 before, is how many spikes neuron i emits in a step (an integer,
                                          from 1 on, which covers the last h ms up to step x h); `u[i]` is a number in
                                          [0, 1) that is drawn anew for each neuron and step
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.choice import Choice
from neuro.core.errors import ModelError, here
from neuro.core.quantities import Quantity, Value, quantity
from neuro.core.registry import OfModule

PAYLOAD = "payload"
"""The state of a graded neuron that its spikes carry."""


@dataclass(frozen=True, slots=True)
class State:
    """A state variable: its name, unit and meaning, and the bounds of what it may be set to.

    `hidden`: an internal counter, not recorded. `follows`: computed from other states; recorded, not settable.
    """

    name: str
    unit: str
    doc: str
    hidden: bool = False
    follows: bool = False
    at_least: float | None = None
    at_most: float | None = None

    def quantity(self) -> Quantity:
        """What it may be set to."""
        return Quantity(self.unit, self.doc, at_least=self.at_least, at_most=self.at_most, arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Model(Choice):
    """Base of every population model.

    Class attributes:
        equation: the dynamics, one line for people.
        source: paper or simulator that defines it.
        chip: the chip whose registers the parameters are, "" for a model of all backends.
        role: what backends do with it: "neuron" (stepped), "poisson", "listed" and "current" (the generators of this
            package), "generator" (any other).
        width: the most numbers among its parameters, `tau_minus` among them, and the most constants.
        fixed: parameters that cannot be set while it runs.
        graded: whether a spike carries a whole number, its payload, in place of a multiplicity; of a neuron that of its
            state `payload`, which `step` sets where it sets `fired`.
    """

    kind: ClassVar[str] = "model"
    role: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    chip: ClassVar[str] = ""
    states: ClassVar[tuple[State, ...]] = ()
    width: ClassVar[int] = 20
    fixed: ClassVar[tuple[str, ...]] = ()
    graded: ClassVar[bool] = False

    def sizes(self, said: tuple[int | str, ...]) -> tuple[int | str, ...]:
        """The shape of a population of it, as far as the model knows it where `auto` is said."""
        return said

    @classmethod
    def identity(cls) -> str:
        """The names of a third-party model's states: an edit may swap two, and all arrays still fit."""
        return "" if cls.__module__.startswith("neuro.") else repr([state.name for state in cls.states])


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator(Model):
    """A population without input: each of its neurons emits one spike train, or a current.

    Class attributes:
        timed: whether it has the words `start` and `stop`, and emits nothing before and after; backends see to it, so
            `constants` is not given them.
        schedule: the words of the times at which it changes, and of the values from each on; () if it has none.
        arithmetic: what has `constants` and `emit`, see above: the class or its module, see `OfModule`.
    """

    role: ClassVar[str] = "generator"
    timed: ClassVar[bool] = False
    schedule: ClassVar[tuple[str, ...]] = ()
    arithmetic: ClassVar[OfModule] = OfModule(("emit",))

    def __post_init__(self) -> None:
        super().__post_init__()
        start, stop = (self.parameters().get(word) for word in ("start", "stop"))
        if start is not None and stop is not None and stop < start:
            message = f"{self.name}.stop = {stop:g} ms: expected at least start = {start:g} ms"
            raise ModelError(message, where=here(), path=("stop",))
        if self.schedule:
            times, values = (getattr(self, word) for word in self.schedule)
            if len(times) != values.shape[-1]:
                message = f"{self.name}.{self.schedule[1]}: {values.shape[-1]} values for {len(times)} times"
                raise ModelError(f"{message}: expected as many", where=here(), path=(self.schedule[1],))

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The state at time 0, by name; a state that is not named starts at 0."""
        return {}


@dataclass(frozen=True, kw_only=True, eq=False)
class Timed(Generator):
    """Base of the generators that emit within some time alone."""

    timed: ClassVar[bool] = True

    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Neuron(Model):
    """A population that is stepped.

    Class attributes:
        receptors: the number of inputs that it distinguishes; `x[k]` is that of receptor k. 1: all input is summed. 2:
            weights >= 0 go to the first, negative ones to the second. 3 or more: a synapse must name its receptor, else
            the network is refused.
        receptor_names: their names, for synapses that name one; "ex" and "in" if two have none.
        conductances: names of the receptors that are conductances. Weights to a named one must be >= 0. Of two
            receptors the second receives -w, as it does when routed by sign.
        filters: receptors that accept a current, by name: the state that filters it, and the parameter that is its time
            constant.
        collects: two adjacent states, one for each of two receptors, to which `step` adds its input, unscaled and as
            its last operation, and which `fire` does not change. The event loop may then add the input itself. ()
            otherwise.
        weight_unit: of the weights onto it, "" where they have none.
        relay: whether a spike carries the multiplicity that arrived, whatever the weight.
        linear: whether n steps of h without input can be done at once: by `catch_up`, or by one step of length n h.
        resets_in_step: whether `step` itself resets a neuron that spikes, and `fire` does nothing; a winner-take-all
            group, which chooses between the two, cannot have such neurons.
        takes_current: whether currents of generators act on it.
        draws: whether `step` takes a random number for each neuron, see above.
        signed: whether weights are routed by sign to two receptors, if a synapse names none; else it must name one.
        most: the largest population, whose neurons `step` sees together; 0: it sees neurons one by one.
        arithmetic: what has `constants`, `step`, `fire` and `quiet`, see above: the class or its module, see
            `OfModule`. The first constant is the threshold and the first state V_m, where the model has them.
    """

    role: ClassVar[str] = "neuron"
    receptors: ClassVar[int] = 1
    receptor_names: ClassVar[tuple[str, ...]] = ()
    conductances: ClassVar[tuple[str, ...]] = ()
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {}
    collects: ClassVar[tuple[str, ...]] = ()
    weight_unit: ClassVar[str] = ""
    relay: ClassVar[bool] = False
    linear: ClassVar[bool] = False
    resets_in_step: ClassVar[bool] = False
    takes_current: ClassVar[bool] = True
    draws: ClassVar[bool] = False
    signed: ClassVar[bool] = True
    most: ClassVar[int] = 0
    arithmetic: ClassVar[OfModule] = OfModule(("step", "fire", "quiet"))

    tau_minus: Value = quantity(
        20.0,
        "ms",
        "time constant of the post trace that plastic synapses onto this neuron read",
        above=0,
        arrays=True,
    )

    @classmethod
    def named_receptors(cls) -> tuple[str, ...]:
        """The names by which synapses may name its receptors; none where all input is summed and has no name."""
        return cls.receptor_names or (("ex", "in") if cls.receptors == 2 else ())

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """The state at time 0, by name; a state that is not named starts at 0."""
        return {}

    @staticmethod
    def caution(parameters: Mapping[str, Any], resolution: float) -> str:
        """What is likely a mistake in resolved parameters, for steps of `resolution` ms; "" if nothing is."""
        return ""

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Refuse resolved parameters with which it cannot run in steps of `resolution` ms.

        Args:
            parameters: by word; where some are changed, those alone.
            resolution: the length of a step.

        Raises:
            ModelError: it cannot; its path is `(name of the model, parameter)`.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Resting(Neuron):
    """Base of the neurons whose V_m starts at their parameter E_L."""

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """V_m starts at E_L."""
        return {"V_m": parameters["E_L"]}
