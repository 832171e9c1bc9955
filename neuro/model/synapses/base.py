"""Base classes of synapse models: parameters and, for plastic synapses, the functions of the learning rule.

A pairwise rule reads traces of the spikes of the source (`pre`) and of the target (`post`). The rule lists the traces,
and the backend updates them. A post spike reaches the synapse after the synapse's delay. Events at the same time are
handled in the order dopamine, post, pre. Synapse `e` has the states `y[:, e]`, of which the first is the weight. `c`
holds the constants of the rule.

    constants(p, h, c)                        fill `c` from the parameters `p` (numbers only, in order of definition);
                                              called once, or per synapse if a parameter has a value per synapse
    on_post(y, e, c, pre, post)               handle a post spike, with the traces of strictly earlier spikes
    on_pre(y, e, c, pre, post)                handle a pre spike, with the traces of strictly earlier spikes; with
                                              `draws` there is a sixth argument `u`, a random number in [0, 1)
    sent(y, e, c)                             return the value that the pre spike sends; by default the weight
    advance(y, e, c, begin, end, n, grid)     integrate between events, from step `begin` to `end`, for subclasses
                                              of `Modulated`: n is the modulator's concentration at `begin`, `grid`
                                              the delivery grid

A rule that changes delays (`delays`) has the delay in ms as its first state, `y[1]`. All times of such a rule are times
of emission: a spike in the traces `pre` arrives `y[1]` ms later, and post spikes reach the synapse without delay.

A rule for trials has a method `lessons`. The method returns a `Lesson` for each neuron that learns at the end of a
trial. The rule also has `constants` and

    teach(w, since, lesson, c)                return the new weight of an input of a taught neuron. `since` is the
                                              time in ms from the arrival of the input's first spike to the time of
                                              the lesson: negative for a later spike, and -inf without a spike.
                                              With `spikes: each` the function is called for each spike of the input.
                                              Rules with `delays` get and return the delay in ms, not the weight
    settle(w, since, total, c)                return the new weight after `teach` was called for all inputs of the
                                              neuron; `total` is the sum of their weights; optional
    encourage(w, c)                           return the new weight of an input of the maps that a `Growth` lists;
                                              required only if `lessons` returns a `Growth`
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity, word_of
from neuro.core.registry import OfModule
from neuro.model.neurons.base import State
from neuro.model.synapses.lessons import Growth as Growth, Lesson as Lesson, TrialEnd as TrialEnd

Floats = NDArray[np.float64]

FUNCTIONS = {"constants": 3, "on_post": 5, "on_pre": 5}
"""Functions of a pairwise rule, and their numbers of arguments."""
TEACHING = {"constants": 3, "teach": 4}
"""Required functions of a rule for trials, and their numbers of arguments."""
MORE_TEACHING = {"settle": 4, "encourage": 2}
"""Optional functions of a rule for trials, and their numbers of arguments."""


def weight(y: Any, e: int, c: Any) -> Any:
    """Return the weight. A pre spike sends the weight if a rule has no function `sent`."""
    return y[0, e]


@dataclass(frozen=True, slots=True)
class Trace:
    """A trace of the spikes of one side. `pre[k]` or `post[k]` is the value of the k-th trace that a rule lists.

    Attributes:
        tau: name of the parameter with the time constant. "tau_minus" may be a parameter of the target. If the name is
            "", the trace is the time in ms since the last spike, and infinite before the first spike.
        nearest: whether a spike sets the trace to `adds`, so that only the last spike counts. If not, each spike adds
            `adds`.
        adds: the amount that a spike adds.
        starts: name of the parameter with the value of a pre trace at step 0. If the name is "", the value is 0.
    """

    tau: str
    nearest: bool = False
    adds: float = 1.0
    starts: str = ""


OF_EACH: Mapping[str, Any] = {"arrays": True, "of_distance": True}
"""Options of `quantity` for a parameter that may have a value per synapse, like a weight."""

K_PLUS, K_MINUS = Trace("tau_plus"), Trace("tau_minus")
"""Traces of NEST's all-to-all pair rules."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Synapse(Choice):
    """Base of all synapse models.

    Class attributes:
        learns: "" (static), "pairs" (spike pairs), "trials" (at the end of a trial), "moves" (at the end of an agent's
            move) or "chip" (by a chip's own engine).
        chip: name of the chip if the parameters are registers of one chip; "" for a model of all backends.
        takes_graded: whether a plastic synapse accepts spikes with payloads.
        pre, post: the traces that a pairwise rule reads.
        modulated: whether a dopamine concentration modulates the rule.
        draws: whether `on_pre` gets a random number per synapse and pre spike.
        delays: whether the rule changes delays, see `neuro.model.synapses.base`.
        supervised: whether a rule for trials needs labels.
        peaks: whether a rule for trials needs the largest V_m of each neuron up to the decision.
        states: the states of a synapse other than its weight.
        width: the number of constants, including tables of decays.
        ordered: pairs of parameters. The first of a pair must be less than the second.
        arithmetic: the class or module with the functions above, see `OfModule`.
    """

    kind: ClassVar[str] = "synapse"
    equation: ClassVar[str] = ""
    source: ClassVar[str] = ""
    learns: ClassVar[str] = ""
    chip: ClassVar[str] = ""
    takes_graded: ClassVar[bool] = False
    pre: ClassVar[tuple[Trace, ...]] = (K_PLUS,)
    post: ClassVar[tuple[Trace, ...]] = (K_MINUS,)
    modulated: ClassVar[bool] = False
    draws: ClassVar[bool] = False
    delays: ClassVar[bool] = False
    supervised: ClassVar[bool] = True
    peaks: ClassVar[bool] = False
    states: ClassVar[tuple[State, ...]] = ()
    width: ClassVar[int] = 20
    ordered: ClassVar[tuple[tuple[str, str], ...]] = ()
    arithmetic: ClassVar[OfModule] = OfModule(("on_post", "on_pre", "advance", "teach", "settle", "encourage"))

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except ModelError as error:
            word = error.path[0] if error.path else ""
            if word in {trace.tau for trace in (*self.pre, *self.post)} and not isinstance(
                getattr(self, word), (str, int, float)
            ):
                error.hint = error.hint or "all synapses of a neuron share its trace, so they share the time constant"
            raise
        for low, high in self.ordered:
            self._check_below(low, high)

    def _check_below(self, low: str, high: str) -> None:
        """Raise an error if two parameters of the same unit are numbers in the wrong order."""
        small, large, unit = getattr(self, low), getattr(self, high), self.quantities()[low].unit
        if not (isinstance(small, str) or isinstance(large, str) or small < large):
            unit_text = f" {unit}" if unit else ""
            raise ModelError(
                f"{self.name}.{low} = {small:g}{unit_text}: expected less than {high} = {large:g}{unit_text}",
                path=(low,),
            )

    @classmethod
    def identity(cls) -> str:
        """Return the names of the states of a third-party model.

        An edit of the model may swap two states of the same shape, and only the names show the difference.
        """
        return "" if cls.__module__.startswith("neuro.") else repr([state.name for state in cls.states])

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the initial states by name, each a number or an array with a number per synapse.

        Missing states start at 0.
        """
        return {}

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """Return the names of the numeric parameters in the order in which `constants` reads them."""
        return tuple(w for w, q in cls.quantities().items() if q.kind in ("number", "integer", "boolean"))

    @classmethod
    def sends(cls) -> Callable[..., Any]:
        """Return the function that computes the value that a pre spike sends."""
        function: Callable[..., Any] = getattr(cls.arithmetic, "sent", weight)
        return function

    def per_synapse(self) -> list[str]:
        """Return the names of the parameters with a value per synapse: arrays, distributions and functions."""
        values = self.parameters()
        return [word for word in self.numbers() if not isinstance(values[word], bool) and not is_number(values[word])]

    def per_synapse_fields(self) -> dict[str, str]:
        """Map each field of this class with a value per synapse to the name of its parameter."""
        varying, names = self.per_synapse(), [entry.name for entry in fields(self)]
        return {name: word_of(name) for name in names if word_of(name) in varying}

    def first_states(self) -> Floats:
        """Return the states at step 0 without the weight, shape (states, 1) or (states, synapses)."""
        initial = self.initial(self.parameters())
        return _columns([initial.get(state.name, 0.0) for state in self.states])

    def first_traces(self) -> Floats:
        """Return the pre traces at step 0, shape (traces,)."""
        parameters = self.parameters()
        return np.array([parameters.get(trace.starts, 0.0) for trace in self.pre], dtype=np.float64)

    def bounds(self) -> tuple[Any, Any]:
        """Return the smallest and the largest weight, as numbers or arrays. If Wmax is below 0, it is the smallest."""
        limits = self.parameters()
        if "Wmax" not in limits:
            return -math.inf, math.inf
        ends = limits.get("Wmin", 0.0), limits["Wmax"]
        return np.minimum(*ends), np.maximum(*ends)

    def outside(self, weight: Floats) -> int | None:
        """Return the index of the first weight beyond the bounds, or None.

        Only rules that learn by pairs, by moves or on a chip have bounds. `weight` has the shape (synapses,), or (1,)
        for a weight that all synapses share.
        """
        if self.learns not in ("pairs", "moves", "chip"):
            return None
        low, high = self.bounds()
        indices = np.flatnonzero((weight < low) | (weight > high))
        return int(indices[0]) if indices.size else None

    def expected_weight(self, synapse: int = 0) -> str:
        """Return the accepted weights of a synapse as text for messages."""
        low, high = (end[synapse] if np.ndim(end) else end for end in self.bounds())
        if math.isinf(high):
            return f"a weight >= {low:g}, the bound of {self.name}"
        return f"{low:g} to {high:g}, the bounds of {self.name}"

    def vector(self) -> Floats:
        """Return the numeric parameters as a vector, or a row per synapse if a parameter has a value per synapse."""
        values = self.parameters()
        columns = _columns([values[word] for word in self.numbers()])
        return np.ascontiguousarray(columns.T) if self.per_synapse() else columns[:, 0]

    def constants_of(self, vector: Floats, h: float) -> Floats:
        """Return the constants for parameters in the form of `vector`, shape (width,) or (synapses, width)."""
        c = np.zeros((*vector.shape[:-1], self.width))
        for synapse in np.ndindex(vector.shape[:-1]):
            self.arithmetic.constants(vector[synapse], h, c[synapse])
        return c

    def lessons(self, end: TrialEnd) -> Iterable[Lesson | Growth]:
        """Return the lessons at the end of a trial, in order. The default is a lesson for the neuron that decided."""
        return (Lesson(end.winner, end.tick, end.reward),) if end.reward else ()


def common(vector: Floats) -> Floats:
    """Return parameters in the form of `Synapse.vector` as one vector. Per-synapse values are those of synapse 0."""
    return vector if vector.ndim == 1 else vector[0]


def _columns(values: Sequence[Any]) -> Floats:
    """Return an array with a row per value. A single number is repeated to the length of the longest row."""
    table = np.zeros((len(values), max((np.size(value) for value in values), default=1)))
    for row, value in zip(table, values, strict=True):
        row[:] = value
    return table


@dataclass(frozen=True, kw_only=True, eq=False)
class Modulated(Synapse):
    """Base of the rules of spike pairs that are modulated by a concentration n: dopamine, reward or an error.

    Each post neuron has its own n.

    n is 0 until a signal sets it (`signal`) or the spikes of a population increase it (`dopamine`). With `dopamine`, a
    spike adds 1/tau_n to n of every post neuron, or of the neuron with the same index with `dopamine_rule` one_to_one.
    n decays with the parameter `tau_n`. In a rule without `tau_n`, n keeps the value that a signal sets.
    """

    learns: ClassVar[str] = "pairs"
    modulated: ClassVar[bool] = True

    signal: str | None = quantity(None, "", "the signal that sets n", kind="name")
    dopamine: str | None = quantity(None, "", "the population whose spikes release dopamine", kind="name")

    dopamine_rule: str = quantity(
        "all_to_all",
        "",
        "post neurons that a dopamine spike reaches",
        kind="word",
        words=("all_to_all", "one_to_one"),
    )
    dopamine_delay: float | None = quantity(None, "ms", "delay of dopamine; one step if not given", kind="delay")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.signal is not None and self.dopamine is not None:
            message = f"{self.name} has both 'signal' and 'dopamine': expected one source of dopamine"
            raise ModelError(message, path=("dopamine",))
        if self.dopamine is not None and "tau_n" not in self.numbers():
            message = f"{self.name}.dopamine = '{self.dopamine}': {self.name} has no tau_n, so n would never fall"
            raise ModelError(message, hint="name a signal instead", path=("dopamine",))


DELAY = 1
"""Row of `y` with the delay."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayRule(Synapse):
    """Base of the rules that change delays within [d_min, d_max].

    A delay in ms starts at the delay of the projection. At the emission of a spike the delay is rounded to the nearest
    number of steps, at least one. The spike keeps this number of steps, even if the delay of the synapse changes before
    the arrival.
    """

    delays: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (State("delay", "ms", "delay of a spike emitted now"),)

    d_min: float = quantity(0.1, "ms", "shortest delay", above=0)
    d_max: float = quantity(50.0, "ms", "longest delay, which fixes the size of the spike buffers", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.d_min > self.d_max:
            raise ModelError(
                f"{self.name}.d_min = {self.d_min:g}: expected at most d_max = {self.d_max:g}", path=("d_min",)
            )

    def delay_range(self, h: float) -> tuple[int, int]:
        """Return the smallest and the largest number of steps of `h` ms in a delay."""
        return max(1, math.floor(self.d_min / h + 0.5)), max(1, math.floor(self.d_max / h + 0.5))


def steps_of(delay: float, h: float, fewest: int, most: int) -> int:
    """Return the delay of a spike emitted now, in steps."""
    return math.floor(max(fewest, min(most, delay / h)) + 0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class static(Synapse):
    """Synapse that sends its weight after its delay. Source: NEST 3.10, `static_synapse`.

    With `receptor` all spikes go to the receptor of that name. The sign of the weight does not matter then. A current
    accepts weights of both signs. A conductance increases by the weight, which must not be negative.
    """

    equation: ClassVar[str] = "sends w"
    source: ClassVar[str] = "NEST 3.10 static_synapse"

    receptor: str | None = quantity(
        None,
        "",
        "receptor of the target; by default the sign of the weight chooses one of two receptors",
        kind="receptor",
    )
