"""Base classes of population models: parameters, states and the functions of their arithmetic.

The arithmetic of a model is written once, as functions over arrays. The reference backend runs the functions as Python,
and the event backend compiles them. The functions are in the body of the class, without `self`, or in the module of the
class. The arrays hold all neurons of a network. The neurons of one call, `lo` to `hi - 1`, share one vector of
constants `c`.

    constants(p, h, c)                    fill `c` from the parameters `p` (in order of definition) for a step of h ms
    step(s, c, x, i_0, lo, hi, fired)     advance one step: `s` states, `x` input of the step, `i_0` current in pA;
                                          set `fired[i]` to 1 if neuron i reaches its threshold, else to 0; with
                                          `resets_in_step` set `fired[i]` to the number of spikes in the step
    fire(s, c, i)                         apply the effects of a spike to neuron i
    quiet(s, c, i_0, lo, hi)              return whether no neuron can fire before its next input

The event backend skips steps without input. For a model with `linear`, one step of length n h must then be equal to n
steps of length h. If the two differ, the model needs a fifth function:

    catch_up(s, p, c, i_0, lo, hi, h, n)  advance n steps of h ms without input, in which no neuron fires;
                                          `c` is a buffer for constants

A neuron that fires at random sets `draws`. The step is then `step(s, c, x, i_0, lo, hi, fired, u)`, where `u[i]` is a
uniform random number in [0, 1) per neuron and step. `quiet` then returns false if a random number can make a neuron
fire.

A generator has, beside `constants`,

    emit(s, c, u, step, lo, hi, out)      set `out[i]`, initially 0, to the number of spikes of neuron i in a step;
                                          `step` is an integer from 1 on, and covers the last h ms up to step x h;
                                          `u[i]` is a uniform random number in [0, 1) per neuron and step
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
"""Name of the state that the spikes of a graded neuron carry."""


@dataclass(frozen=True, slots=True)
class State:
    """A state variable: name, unit, meaning, and bounds for values set by a user.

    A `hidden` state is an internal counter and is not recorded. A state that `follows` is computed from other states;
    it can be recorded but not set.
    """

    name: str
    unit: str
    doc: str
    hidden: bool = False
    follows: bool = False
    at_least: float | None = None
    at_most: float | None = None

    def quantity(self) -> Quantity:
        """Return the quantity of values that a user may set."""
        return Quantity(self.unit, self.doc, at_least=self.at_least, at_most=self.at_most, arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Model(Choice):
    """Base of all population models.

    Class attributes:
        equation: the dynamics in one line, for readers.
        source: the paper or simulator that defines the model.
        chip: the chip with the parameters as registers; "" for a model of all backends.
        role: the way in which backends run the model: "neuron" (stepped), "poisson", "listed", "encoded", "streamed"
            and "current" (generators of this package), or "generator" (any other generator).
        width: the length of `c`. A model may have at most this number of parameters, including `tau_minus`.
        fixed: parameters that cannot be set while the network runs.
        graded: whether a spike carries a whole number, its payload, instead of a multiplicity. The payload of a neuron
            is its state `payload`, which `step` sets together with `fired`.
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

    def sizes(self, shape: tuple[int | str, ...]) -> tuple[int | str, ...]:
        """Return the shape of a population, with `auto` replaced if the model knows the size."""
        return shape

    @classmethod
    def identity(cls) -> str:
        """Return the identity of a third-party model: the names of its states, because an edit may swap two states."""
        return "" if cls.__module__.startswith("neuro.") else repr([state.name for state in cls.states])


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator(Model):
    """Base of the populations without input. Each neuron emits a spike train or a current.

    Class attributes:
        timed: whether the model has the parameters `start` and `stop`. Backends apply both, so `constants` does not get
            them.
        schedule: for a generator that changes at listed times, the names of two parameters: the times, and the values
            that apply from each time on; otherwise ().
        arithmetic: the class or module with `constants` and `emit`, see above and `OfModule`.
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
        """Return the states at time 0 by name. Missing states start at 0."""
        return {}


@dataclass(frozen=True, kw_only=True, eq=False)
class Timed(Generator):
    """Base of the generators that emit only between two times."""

    timed: ClassVar[bool] = True

    start: float = quantity(0.0, "ms", "time after which the generator emits", at_least=0)
    stop: float = quantity(math.inf, "ms", "time up to which the generator emits", at_least=0, infinite=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Neuron(Model):
    """Base of the populations with a step.

    Class attributes:
        receptors: number of separate inputs; `x[k]` is the input of receptor k. With 1, all input is summed. With 2,
            weights >= 0 go to the first receptor and negative weights to the second. With 3 or more, a synapse must
            name its receptor.
        receptor_names: names of the receptors, for synapses that name a receptor. Two receptors are called "ex" and
            "in" by default.
        conductances: names of the receptors that are conductances. Weights of synapses that name a conductance must
            be >= 0. At the second of two receptors `x[1]` then sums -w, as for negative weights without a name.
        filters: receptors that accept the current of a generator. The key is the receptor; the value has the state that
            filters the current, and the parameter with the time constant of this filter.
        collects: two adjacent states, one for each of two receptors, or (). The last operation of `step` is to add the
            unscaled input to these states, and `fire` does not change the states. The event loop may then add the
            input.
        weight_unit: unit of the weights of incoming synapses, or "".
        relay: whether a neuron repeats incoming spikes with their multiplicity. Weights then have no effect.
        linear: whether n steps of h without input can be computed at once, by `catch_up` or by one step of length n h.
        resets_in_step: whether `step` itself resets a neuron that spikes, and `fire` does nothing. A winner-take-all
            group, which chooses between step and reset, cannot have such neurons.
        takes_current: whether the neurons accept currents of generators.
        draws: whether `step` gets a random number per neuron, see the module.
        signed: whether weights are routed to two receptors by sign if a synapse names no receptor. If not, a synapse
            must name a receptor.
        most: largest size of a population whose neurons depend on each other within a `step`; 0 for independent
            neurons, whose number is not limited.
        arithmetic: the class or module with `constants`, `step`, `fire` and `quiet`, see above and `OfModule`. The
            first constant is the threshold and the first state is V_m, if the model has them.
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
        "time constant of the postsynaptic trace that plastic synapses read",
        above=0,
        arrays=True,
    )

    @classmethod
    def named_receptors(cls) -> tuple[str, ...]:
        """Return the names of the receptors for synapses; none if all input is summed."""
        return cls.receptor_names or (("ex", "in") if cls.receptors == 2 else ())

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the states at time 0 by name. Missing states start at 0."""
        return {}

    @staticmethod
    def caution(parameters: Mapping[str, Any], resolution: float) -> str:
        """Return a warning if parameters are probably a mistake for steps of `resolution` ms, otherwise ""."""
        return ""

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Raise an error if the model cannot run with these parameters in steps of `resolution` ms.

        Args:
            parameters: parameters by name; after a change, only the changed parameters.
            resolution: length of a step in ms.

        Raises:
            ModelError: the model cannot run. The path of the error is `(name of the model, parameter)`.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class Resting(Neuron):
    """Base of the neurons with an initial V_m = E_L."""

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return V_m = E_L."""
        return {"V_m": parameters["E_L"]}
