"""What a synapse model is: parameters and, where it learns, a few plain functions.

A pairwise rule reads traces that the backend keeps, as the rule lists them: of the spikes of its source (`pre`) and of
its target (`post`). A post spike reaches the synapse after the synapse's delay. At one instant dopamine comes first,
then post, then pre. Synapse `e` has the states `y[:, e]`; the first is the weight; `c` holds the rule's constants.

    constants(p, h, c)                        fill `c` from the parameters `p` (numbers only, in order of definition);
                                              once, or for each synapse where parameters have a value for each
    on_post(y, e, c, pre, post)               a post spike arrives; the traces there, of strictly earlier spikes
    on_pre(y, e, c, pre, post)                a pre spike; likewise. With `draws` also `u`, a random number in [0, 1)
    sent(y, e, c)                             what the pre spike sends then; without this function the weight
    advance(y, e, c, begin, end, n, grid)     what happens between events (steps), for subclasses of `Modulated`:
                                              n is the modulator's concentration at `begin`, `grid` the delivery grid

A rule that changes delays (`delays`) has the delay in ms as its first state, `y[1]`. It counts from where spikes set
out: `pre` knows the emissions, which arrive `y[1]` later, and post spikes reach the synapse at once.

A rule for trials says in its method `lessons` whom the end of a trial teaches (`Lesson`), and has
`constants` and

    teach(w, since, lesson, c)                new weight of one input of a neuron that is taught: `since` is the time in
                                              ms from the arrival of the input's first spike (with `spikes: each` of
                                              each in turn) to the moment of the lesson, negative after it, -inf
                                              without a spike; of a rule with `delays` not the weight but the delay in
                                              ms, now and new
    settle(w, since, total, c)                new weight after all inputs of the neuron were taught and have the sum
                                              `total`; only where the rule has it
    encourage(w, c)                           new weight of an input of maps that grow; only where lessons name some
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
"""The functions of a pairwise rule and how many arguments each takes."""
TEACHING = {"constants": 3, "teach": 4}
"""Those of a rule for trials."""
MORE_TEACHING = {"settle": 4, "encourage": 2}
"""Those that it may have beside."""


def weight(y: Any, e: int, c: Any) -> Any:
    """What a synapse sends whose rule does not say."""
    return y[0, e]


@dataclass(frozen=True, slots=True)
class Trace:
    """What a rule knows of the spikes of one side: `pre[k]` or `post[k]` for the k-th that it lists.

    Attributes:
        tau: the parameter that is its time constant; "tau_minus" may be the target's. "" for a time: the ms since the
            last spike, infinite before the first.
        nearest: whether a spike puts it to `adds`, so that only the last one counts; else each spike adds `adds`.
        adds: what a spike adds.
        starts: the parameter that is its value at step 0, of a pre trace; 0 if not said.
    """

    tau: str
    nearest: bool = False
    adds: float = 1.0
    starts: str = ""


OF_EACH: Mapping[str, Any] = {"arrays": True, "of_distance": True}
"""What a parameter accepts that may have a value for each synapse: what weights do."""

K_PLUS, K_MINUS = Trace("tau_plus"), Trace("tau_minus")
"""The traces of spike pairs, all to all, of NEST's models."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Synapse(Choice):
    """Base of every synapse model.

    Class attributes:
        learns: "" (static), "pairs" (spike pairs), "trials" (at the end of a trial) or "chip" (by a chip's own engine).
        chip: the chip whose registers the parameters are, "" for a model of all backends.
        takes_graded: whether one that learns takes spikes with payloads.
        pre, post: the traces that a pairwise rule reads.
        modulated: whether a dopamine concentration acts on it.
        draws: whether `on_pre` takes a random number, another for each synapse and pre spike.
        delays: whether it changes delays, see `neuro.model.synapses.base`.
        supervised: whether a rule for trials needs labels.
        peaks: whether a rule for trials asks for the largest V_m of each neuron up to the decision.
        states: the states of a synapse beside its weight.
        width: how many constants `constants` fills; tables of decays may be among them.
        ordered: pairs of parameters of which the first is less than the second.
        arithmetic: what has the functions above: the class or its module, see `OfModule`.
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
                error.hint = error.hint or "a trace belongs to a neuron, so all its synapses have one time constant"
            raise
        for low, high in self.ordered:
            self._check_below(low, high)

    def _check_below(self, low: str, high: str) -> None:
        """Refuse a rule of which one parameter is not less than another of the same unit, once it is known."""
        small, large, unit = getattr(self, low), getattr(self, high), self.quantities()[low].unit
        if not (isinstance(small, str) or isinstance(large, str) or small < large):
            of_unit = f" {unit}" if unit else ""
            raise ModelError(
                f"{self.name}.{low} = {small:g}{of_unit}: expected less than {high} = {large:g}{of_unit}", path=(low,)
            )

    @classmethod
    def identity(cls) -> str:
        """The names of a third-party model's states: an edit may swap two, and all arrays still fit."""
        return "" if cls.__module__.startswith("neuro.") else repr([state.name for state in cls.states])

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Where its states start, by name, as a number or one for each synapse; those not named start at 0."""
        return {}

    @classmethod
    def numbers(cls) -> tuple[str, ...]:
        """Words of the numeric parameters, in the order in which `constants` reads them."""
        return tuple(w for w, q in cls.quantities().items() if q.kind in ("number", "integer", "boolean"))

    @classmethod
    def sends(cls) -> Callable[..., Any]:
        """The function that says what a pre spike sends."""
        found: Callable[..., Any] = getattr(cls.arithmetic, "sent", weight)
        return found

    def of_each(self) -> list[str]:
        """Words of the parameters that are no single number: one for each synapse, or what says these."""
        values = self.parameters()
        return [word for word in self.numbers() if not isinstance(values[word], bool) and not is_number(values[word])]

    def fields_of_each(self) -> dict[str, str]:
        """Fields of the parameters that are no single number, and their words."""
        each, names = self.of_each(), [entry.name for entry in fields(self)]
        return {name: word_of(name) for name in names if word_of(name) in each}

    def first_states(self) -> Floats:
        """The states at step 0, without the weight, shape (states, 1) or (states, synapses)."""
        given = self.initial(self.parameters())
        return _columns([given.get(state.name, 0.0) for state in self.states])

    def first_traces(self) -> Floats:
        """The pre traces at step 0."""
        given = self.parameters()
        return np.array([given.get(trace.starts, 0.0) for trace in self.pre], dtype=np.float64)

    def bounds(self) -> tuple[Any, Any]:
        """The smallest and the largest weight, of all or of each synapse; Wmax below 0 is the smallest."""
        limits = self.parameters()
        if "Wmax" not in limits:
            return -math.inf, math.inf
        ends = limits.get("Wmin", 0.0), limits["Wmax"]
        return np.minimum(*ends), np.maximum(*ends)

    def outside(self, weight: Floats) -> int | None:
        """The first synapse whose weight is not within the bounds, for rules that learn by pairs or by moves.

        None for other rules, whose weights may begin anywhere. Weights of all synapses or one.
        """
        if self.learns not in ("pairs", "moves", "chip"):
            return None
        low, high = self.bounds()
        bad = np.flatnonzero((weight < low) | (weight > high))
        return int(bad[0]) if bad.size else None

    def expected_weight(self, synapse: int = 0) -> str:
        """Which weights a synapse takes, for messages."""
        low, high = (end[synapse] if np.ndim(end) else end for end in self.bounds())
        if math.isinf(high):
            return f"a weight >= {low:g}, as {self.name} takes no other"
        return f"{low:g} to {high:g}, the bounds of {self.name}"

    def vector(self) -> Floats:
        """The numeric parameters as one vector; a row for each synapse where some have a value for each."""
        values = self.parameters()
        columns = _columns([values[word] for word in self.numbers()])
        return np.ascontiguousarray(columns.T) if self.of_each() else columns[:, 0]

    def constants_of(self, vector: Floats, h: float) -> Floats:
        """The constants for parameters in the form of `vector`, shape (width,) or (synapses, width)."""
        c = np.zeros((*vector.shape[:-1], self.width))
        for synapse in np.ndindex(vector.shape[:-1]):
            self.arithmetic.constants(vector[synapse], h, c[synapse])
        return c

    def lessons(self, end: TrialEnd) -> Iterable[Lesson | Growth]:
        """Whom the end of a trial teaches, for rules for trials, in this order: here the neuron that decided."""
        return (Lesson(end.winner, end.tick, end.reward),) if end.reward else ()


def common(vector: Floats) -> Floats:
    """What all synapses share in parameters in the form of `Synapse.vector`; of others the first synapse's."""
    return vector if vector.ndim == 1 else vector[0]


def _columns(values: Sequence[Any]) -> Floats:
    """A row for each value, as long as the longest of them."""
    table = np.zeros((len(values), max((np.size(value) for value in values), default=1)))
    for row, value in zip(table, values, strict=True):
        row[:] = value
    return table


@dataclass(frozen=True, kw_only=True, eq=False)
class Modulated(Synapse):
    """Base of rules of spike pairs that are modulated by n of their post neuron: dopamine, reward, an error.

    n is 0 until a signal sets it (`signal`), or the spikes of a population raise it (`dopamine`; each adds 1/tau_n to n
    of every post neuron, or of its own with `dopamine_rule` one_to_one). With a parameter `tau_n` n decays; without it
    n stays as it was set, so only a signal can say it.
    """

    learns: ClassVar[str] = "pairs"
    modulated: ClassVar[bool] = True

    signal: str | None = quantity(None, "", "the signal that sets n", kind="name")
    dopamine: str | None = quantity(None, "", "the population whose spikes release dopamine", kind="name")
    dopamine_rule: str = quantity(
        "all_to_all",
        "",
        "which post neurons a spike reaches",
        kind="word",
        words=("all_to_all", "one_to_one"),
    )
    dopamine_delay: float | None = quantity(None, "ms", "delay of dopamine; the resolution if not given", kind="delay")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.signal is not None and self.dopamine is not None:
            message = f"{self.name} has both 'signal' and 'dopamine': expected one source of dopamine"
            raise ModelError(message, path=("dopamine",))
        if self.dopamine is not None and "tau_n" not in self.numbers():
            message = f"{self.name}.dopamine = '{self.dopamine}': {self.name} has no tau_n, so n would never fall"
            raise ModelError(message, hint="name a signal instead", path=("dopamine",))


DELAY = 1
"""The row of `y` that is the delay."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayRule(Synapse):
    """Base of the rules that change delays within [d_min, d_max].

    A delay is a number of ms, which begins at the delay of the projection. A spike reads it when it sets out, takes as
    many steps as are nearest, at least one, and keeps them whatever becomes of the delay.
    """

    delays: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (State("delay", "ms", "how long a spike takes that sets out now"),)

    d_min: float = quantity(0.1, "ms", "shortest delay", above=0)
    d_max: float = quantity(50.0, "ms", "longest delay; fixed, as it says how much may be under way", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.d_min > self.d_max:
            raise ModelError(
                f"{self.name}.d_min = {self.d_min:g}: expected at most d_max = {self.d_max:g}", path=("d_min",)
            )

    def delay_range(self, h: float) -> tuple[int, int]:
        """The fewest and the most steps of `h` ms that a spike may take."""
        return max(1, math.floor(self.d_min / h + 0.5)), max(1, math.floor(self.d_max / h + 0.5))


def steps_of(delay: float, h: float, fewest: int, most: int) -> int:
    """How many steps a spike takes that sets out now."""
    return math.floor(max(fewest, min(most, delay / h)) + 0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class static(Synapse):
    """Sends its weight after its delay. Source: NEST 3.10, `static_synapse`.

    With `receptor` all spikes go to the receptor of that name, whatever the sign of their weight: a current takes the
    weight as it is, a conductance grows by it, so it is not negative.
    """

    equation: ClassVar[str] = "sends w"
    source: ClassVar[str] = "NEST 3.10 static_synapse"

    receptor: str | None = quantity(
        None,
        "",
        "the receptor of the target; if omitted, the sign of the weight chooses (of two receptors)",
        kind="receptor",
    )
