"""The parts of a network as its author says them, frozen, and what they make together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import FrozenInstanceError, dataclass, field, replace
from typing import Any, ClassVar, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.core.choice import Choice
from neuro.core.errors import ModelError, Where, words_of
from neuro.core.quantities import Quantity, Value, quantity, word_of
from neuro.core.values import same, shown
from neuro.model.neurons import Model
from neuro.model.rules import Rule
from neuro.model.synapses import Synapse
from neuro.model.views import View, count, view
from neuro.model.wiring.neurons import neuron_table

AUTO = "auto"
WEIGHT = Quantity(doc="weight: mV or pA by the target's model", arrays=True, of_distance=True)
INITIAL = Quantity(doc="state at time 0", arrays=True)
RESOLUTION = Quantity(unit="ms", doc="length of a step", above=0)


@dataclass(frozen=True, eq=False)
class Part:
    """Base of the named parts. Two parts are equal when what was said of them is.

    Class attributes:
        word: its name in messages; the section of the language is its plural.
        words: its words in the language, by what each may be, in the order in which messages list them.
        needs: the words that must be there.
        defaults: values of words that are not said, where the attribute has no default of its own.
        ends: by word, the attributes for a population or projection and for a view of some of its neurons.
    """

    word: ClassVar[str] = "part"
    words: ClassVar[Mapping[str, Quantity]] = {}
    needs: ClassVar[tuple[str, ...]] = ()
    defaults: ClassVar[Mapping[str, Any]] = {}
    ends: ClassVar[Mapping[str, tuple[str, str]]] = {}
    name: str

    def value(self, word: str) -> Any:
        """Return what a word of the language says, of neurons the view if only some are meant."""
        name, view = self.ends.get(word, (word, ""))
        some = getattr(self, view) if view else None
        return getattr(self, name) if some is None else some

    def __init_subclass__(cls) -> None:
        cls.__repr__ = Part.__repr__  # type: ignore[method-assign]  # or @dataclass would make its own

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        mine, theirs = vars(self), vars(other)
        return all(same(mine[k], theirs[k]) for k in mine if k not in ("origin", "between"))

    def __hash__(self) -> int:
        return hash((type(self), self.name))

    def __repr__(self) -> str:
        from neuro.model.words import one_line

        return one_line(self)

    def __str__(self) -> str:
        from neuro.model.words import in_full

        return in_full(self)

    def _repr_html_(self) -> str:
        from neuro.model.words import in_html

        return in_html(self)


def refuse(
    part: AnyPart, message: str, hint: str = "", word: str = "", kind: str = "", about: tuple[str, ...] = ()
) -> NoReturn:
    """Raise the error for a part that cannot be as it is, or for one of its words, as "weight" or "stdp.signal"."""
    text = f"{part.word} '{part.name}': {message}"
    raise ModelError(text, where=part.origin, hint=hint, path=words_of(word), kind=kind, about=about)


@contextmanager
def naming_the_part(part: AnyPart, *path: str) -> Iterator[None]:
    """Give errors that are raised inside the part's name and place, and `path` in front of their own path."""
    try:
        yield
    except ModelError as error:
        named = error.at(part.origin, f"{part.word} '{part.name}'")
        raise named.but(path=(*path, *error.path)) from None


@dataclass(frozen=True, eq=False)
class Population(Part):
    """Neurons of one model, laid out in a shape.

    An index chooses some of them, see `View`: `exc[:100]`, `exc[::2]`, `exc[mask]`, `grid[2:4, :]`. `len` and iteration
    count neurons, and each is a view of one.

    Attributes:
        shape: sizes of the axes; `"auto"` where a grid projection or a recording decides.
        model: what each neuron is.
        initial: states at time 0 that differ from the model's own, by name.
        positions: coordinates, one row for each neuron; None where they follow from the shape.
        extent: length of each axis; None where neighbours are one unit apart, or where edges are open.
        periodic: whether what leaves at one edge comes in at the other.
        neurons: the table that lists its neurons, or None.
    """

    word: ClassVar[str] = "population"
    words: ClassVar[Mapping[str, Quantity]] = {
        "model": Quantity(kind="choice", choice=Model),
        "shape": Quantity(
            doc="number of neurons, or sizes of the axes; auto where a grid or recording decides",
            kind="shape",
            at_least=1,
            words=(AUTO,),
        ),
        "initial": replace(INITIAL, kind="states"),
        "positions": Quantity(
            doc="coordinates, a row of 1 to 3 for each neuron", kind="array", arrays=True, optional=True
        ),
        "extent": Quantity(
            doc="length of each axis, in the unit of positions", kind="array", above=0, arrays=True, optional=True
        ),
        "periodic": Quantity(doc="whether what leaves at one edge comes in at the other", kind="boolean"),
        "neurons": Quantity(kind="part", part=neuron_table),
    }
    needs: ClassVar[tuple[str, ...]] = ("model", "shape")
    defaults: ClassVar[Mapping[str, Any]] = {"periodic": False}
    are_neurons: ClassVar[bool] = True
    shape: tuple[int | str, ...]
    model: Model
    initial: Mapping[str, Value] = field(default_factory=dict)
    origin: Where | None = None
    positions: Value = None
    extent: Value = None
    periodic: bool = False
    neurons: neuron_table | None = None

    @property
    def sizes(self) -> tuple[int | str, ...]:
        """Its shape, where a recording decides it as far as that is there."""
        return self.model.sizes(self.shape)

    def __getitem__(self, index: Any) -> View:
        return view(self, index)

    def where(self, **only: Any) -> View:
        """The neurons whose columns in the table of neurons have these values.

        Args:
            only: by column a value, or a list of values of which one fits.

        Raises:
            ModelError: the population has no table, or there is no such column, value or neuron.
        """
        if self.neurons is None:
            message = f"population '{self.name}' has no table of neurons: expected one to choose by {', '.join(only)}"
            raise ModelError(message, hint="neurons=neuro.neuron_table(file, id=...)")
        return view(self, self.neurons.neurons.where(only))

    def __len__(self) -> int:
        return count(self)

    def __iter__(self) -> Iterator[View]:
        return iter(view(self, ...))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The ids."""
        return np.array(self.ids, dtype=dtype)

    def __getattr__(self, word: str) -> Any:
        raise AttributeError(_no_attribute(self, word, "sim.get({name}, {word!r}) reads it"))

    @property
    def ids(self) -> NDArray[np.int64]:
        """All its neurons, counted from 0.

        Raises:
            ModelError: its shape follows when it is compiled.
        """
        return view(self, ...).ids


def _no_attribute(part: Population, word: str, way: str) -> str:
    """What is said of an attribute that a population does not have, and the way to a number of its model."""
    model = vars(part).get("model")
    known = () if model is None else (*model.quantities(), *(state.name for state in model.states))
    if word_of(word) not in known:
        return f"'{type(part).__name__}' object has no attribute '{word}'"
    message = f"population '{part.name}' is a description: its {word_of(word)} is in a simulation"
    return f"{message}: {way.format(name=part.name, word=word_of(word))}"


def _refuse_change(part: Population, word: str, value: Any) -> None:
    raise FrozenInstanceError(_no_attribute(part, word, "sim.set({name}, {word}=...) sets it"))


Population.__setattr__ = _refuse_change  # type: ignore[method-assign, assignment]  # or @dataclass would make its own


@dataclass(frozen=True, eq=False)
class Projection(Part):
    """Connections from one population to another, by one rule and with one synapse model.

    Attributes:
        source, target: the populations.
        source_view, target_view: the neurons of each that the rule sees; None: all.
        between: the populations themselves, for telling; None where they are not known.
    """

    word: ClassVar[str] = "projection"
    words: ClassVar[Mapping[str, Quantity]] = {
        "from": Quantity(doc="the population whose spikes are sent, or some of its neurons", kind="neurons"),
        "to": Quantity(doc="the population that receives them, or some of its neurons", kind="neurons"),
        "rule": Quantity(kind="choice", choice=Rule),
        "weight": WEIGHT,
        "delay": Quantity(unit="ms", doc="delay, a multiple of the resolution", above=0, arrays=True, of_distance=True),
        "synapse": Quantity(kind="choice", choice=Synapse),
    }
    needs: ClassVar[tuple[str, ...]] = ("from", "to", "rule")
    defaults: ClassVar[Mapping[str, Any]] = {"weight": 1.0, "delay": 1.0, "synapse": "static"}
    ends: ClassVar[Mapping[str, tuple[str, str]]] = {
        "from": ("source", "source_view"),
        "to": ("target", "target_view"),
    }
    source: str
    target: str
    rule: Rule
    synapse: Synapse
    weight: Value
    delay: Value
    origin: Where | None = None
    source_view: View | None = None
    target_view: View | None = None
    between: tuple[Population, Population] | None = None


Side = Population | View | str | int | Sequence[int] | NDArray[Any] | None
"""Neurons at one end of a projection: a population, a view of it, or ids; None for all."""


@dataclass(frozen=True, eq=False)
class Signal(Part):
    """Values set from outside, one per neuron of a population: the dopamine of synapses onto it."""

    word: ClassVar[str] = "signal"
    words: ClassVar[Mapping[str, Quantity]] = {"to": Quantity(doc="the population it acts on", kind="name")}
    needs: ClassVar[tuple[str, ...]] = ("to",)
    to: str
    origin: Where | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Competition(Choice):
    """How neurons of a population act together; base of what a group may be.

    Class attributes:
        noun: what a chip or a simulator that cannot do it lacks.
        decides: whether the winner decides a trial.
        several: whether several may win in one trial.
    """

    kind: ClassVar[str] = "group"
    noun: ClassVar[str]
    decides: ClassVar[bool] = True
    several: ClassVar[bool] = False
    of: str = quantity(doc="the population", kind="name")

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so, as the text of an error; "" if they can."""
        return ""

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class winner_take_all(Competition):
    """One neuron of a population decides.

    With `first_to_fire` the first spike silences all others until the next trial or reset; without, only
    the best of each step fires and the others that reached the threshold are reset. The largest V_m - V_th
    wins; a tie is drawn.
    """

    noun: ClassVar[str] = "winner-take-all"
    first_to_fire: bool = quantity(True, "", "decide once instead of at each step", kind="boolean")

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return "the first to fire" if self.first_to_fire else "the best of each step"


@dataclass(frozen=True, kw_only=True, eq=False)
class local_winners(Competition):
    """Several neurons of a population of shape (maps, rows, columns) decide, each for what is near it.

    Who fires wins, and silences until the next trial or reset all neurons of all maps whose row and column are both at
    most `radius` from its own, itself with them, and its whole map once that has won `per_map` times. Of those that
    reach the threshold in one step the largest V_m - V_th wins first; a tie is drawn. Who is silenced goes on to add
    up its input.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007, with `per_map` 1. Any number finds several objects,
    each by a neuron in whose field it is (Mosca, MSc thesis, 2020, section 6.2.7).
    """

    noun: ClassVar[str] = "competition"
    several: ClassVar[bool] = True
    radius: int = quantity(doc="rows and columns around a winner that are silenced", kind="integer", at_least=0)
    per_map: int | None = quantity(None, "", "wins of each map; any number if not given", kind="integer", at_least=1)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so."""
        if len(shape) == 3:
            return ""
        return f"{self.name} of '{self.of}' of shape {list(shape)}: expected (maps, rows, columns)"

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return f"radius {self.radius}" + (f", {self.per_map} a map" if self.per_map else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class lateral_reset(Competition):
    """A spike resets all neurons along an axis: the first of them to fire silences the others for its time.

    Neurons that differ in no coordinate but the one of `axis` are rivals. When some of them reach the threshold in a
    step, the one with the largest V_m - V_th fires (a tie is drawn) and all others, wherever they stand, are reset as
    if they had fired: to V_reset, refractory for their t_ref. They emit nothing.
    Source: temporal winner-take-all of HFirst, Orchard et al., IEEE TPAMI 37:2028, 2015
    """

    noun: ClassVar[str] = "lateral reset"
    decides: ClassVar[bool] = False
    axis: int = quantity(0, "", "axis of its shape along which neurons are rivals", kind="integer", at_least=0)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so."""
        if self.axis < len(shape):
            return ""
        message = f"{self.name}.axis = {self.axis} of '{self.of}', whose shape is {list(shape)}"
        return f"{message}: expected at most {len(shape) - 1}"

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return f"a spike resets all along axis {self.axis}"


GROUPS: dict[str, type[Competition]] = {
    "winner_take_all": winner_take_all,
    "local_winners": local_winners,
    "lateral_reset": lateral_reset,
}
"""How the neurons of a group may compete, by name."""


@dataclass(frozen=True, eq=False)
class Group(Part):
    """Neurons that act together."""

    word: ClassVar[str] = "group"
    choice: Competition
    origin: Where | None = None


@dataclass(frozen=True, eq=False)
class Probe(Part):
    """What to record of a population or a projection: spikes, or states at intervals of `every` ms (None: each step).

    Attributes:
        of: the name of the population or projection.
        record: "spikes", "rate", a state, or several states.
        at: "pre_spikes" records synapses as each pre spike leaves them.
        mean: whether the mean over neurons or synapses is recorded instead of each.
        synapses: which ones of a projection, in the order of its weights; None: all.
        view: the neurons of a population that are recorded; None: all.
        pre, post: of a projection only the synapses from and onto these neurons; None: all.
    """

    word: ClassVar[str] = "probe"
    words: ClassVar[Mapping[str, Quantity]] = {
        "of": Quantity(doc="the population, some of its neurons, or the projection", kind="neurons"),
        "record": Quantity(
            doc="spikes, rate, or one or several states: of a population's neurons, or of a projection's synapses",
            kind="names",
        ),
        "every": Quantity(
            unit="ms", doc="interval between two records; each step if not given", above=0, optional=True
        ),
        "at": Quantity(doc="when to record, if not every so often", kind="word", words=("pre_spikes",), optional=True),
        "mean": Quantity(doc="whether to record the mean instead of each", kind="boolean"),
        "synapses": Quantity(
            doc="synapses of a projection, in the order of its weights; all if not given", kind="ids", optional=True
        ),
        "pre": Quantity(doc="of a projection only the synapses from these neurons", kind="neurons", arrays=True),
        "post": Quantity(doc="of a projection only the synapses onto these neurons", kind="neurons", arrays=True),
    }
    needs: ClassVar[tuple[str, ...]] = ("of",)
    defaults: ClassVar[Mapping[str, Any]] = {"record": "spikes", "mean": False}
    ends: ClassVar[Mapping[str, tuple[str, str]]] = {"of": ("of", "view")}
    of: str
    record: str | tuple[str, ...]
    every: float | None = None
    origin: Where | None = None
    view: View | None = None
    at: str | None = None
    mean: bool = False
    synapses: Value | None = None
    pre: View | None = None
    post: View | None = None

    def traces(self) -> dict[str, str]:
        """The name of the trace of each state; one of several states has a name of its own."""
        if isinstance(self.record, str):
            return {self.record: self.name}
        return {state: f"{self.name}.{state}" for state in self.record}


AnyPart: TypeAlias = Population | Projection | Signal | Group | Probe


@dataclass(frozen=True, kw_only=True, eq=False)
class labels(Choice):
    """Which label a map stands for: map m has the label m // maps_per_label."""

    kind: ClassVar[str] = "labels"
    of: str = quantity(doc="the population whose first axis is the map", kind="name")
    maps_per_label: int = quantity(1, "", "maps of each label", kind="integer", at_least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class reward(Choice):
    """The reward of a trial by its outcome; > 0 rewards, < 0 punishes, 0 teaches nothing."""

    kind: ClassVar[str] = "reward"
    correct: float = quantity(1.0, "", "the decision is the label")
    wrong: float = quantity(-1.0, "", "it is another one")
    silent: float = quantity(0.0, "", "there was no decision")


@dataclass(frozen=True, kw_only=True, eq=False)
class dropout(Choice):
    """Leave maps out while learning: a dropped map integrates but cannot fire.

    The share in epoch e is p decay^e. Source: Mosca 2020, section 6.2.6 and table 3.
    """

    kind: ClassVar[str] = "dropout"
    of: str = quantity(doc="the population", kind="name")
    axis: str = quantity("map", "", "what is dropped as one", kind="word", words=("map",))
    p: float = quantity(0.25, "", "share dropped in the first epoch", at_least=0, below=1)
    every: str = quantity("sample", "", "how long a draw holds", kind="word", words=("sample", "trial"))
    decay: float = quantity(1.0, "", "factor on p from epoch to epoch", at_least=0, at_most=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials(Choice):
    """Short presentations, each with a decision and, when labelled, a reward.

    A tick is one step of a trial; an input at time t is emitted in tick t / resolution, 0 <= t < duration.
    At the start of a trial no spike is under way and the states named in `reset` are as at time 0.
    """

    kind: ClassVar[str] = "trials"
    word: ClassVar[str] = "trials"
    input: str = quantity(doc="the spike_generator that receives the trials' spikes", kind="name")
    duration: float = quantity(doc="length of a trial", unit="ms", above=0)
    stop: str = quantity(
        "at_decision",
        "",
        "as soon as no neuron can decide any more, or after the full duration",
        kind="word",
        words=("at_decision", "full"),
    )
    labels: Any = quantity(None, "", "what the maps stand for", kind="part", part=labels)
    reward: Any = quantity(None, "", "the reward by outcome", kind="part", part=reward)
    dropout: Any = quantity(None, "", "maps left out while learning", kind="part", part=dropout)
    reset: Any = quantity(("V_m",), "", "states that start anew", kind="names")


DECIDED_BY = ("counts", "potential", "first")
"""How an output decides: most spikes, the highest mean potential, or the first spike."""
CENTRED = "centred"
"""Asks for a window round what each recording shows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Readout(Choice):
    """How recordings of event cameras are shown to a network, and how its output decides on their class."""

    kind: ClassVar[str] = "readout"
    word: ClassVar[str] = "readout"
    input: str = quantity(doc="the spike_generator of the pixels", kind="name")
    output: str = quantity(doc="the population of which each neuron stands for a class", kind="name")
    decide: Any = quantity(
        None,
        doc="by most spikes, the highest mean potential or the first spike; by spikes where there are some",
        kind="word",
        words=DECIDED_BY,
    )
    classes: Any = quantity(None, doc="names of the output's neurons, in their order", kind="names")
    duration: Any = quantity(None, "ms", "how long it runs for a recording; until each has come through", above=0)
    start: float = quantity(0.0, "ms", "from a recording's first event to its first step", at_least=0)
    scale: int = quantity(1, "px", "in a row and in a column that are one neuron", kind="integer", at_least=1)
    window: Any = quantity(
        None,
        "px",
        "of a larger sensor: column and row from which it is seen, or round what each recording shows",
        kind="shape",
        at_least=0,
        words=(CENTRED,),
    )
    merge: bool = quantity(False, doc="whether events of a pixel in one step are one spike", kind="boolean")

    def __post_init__(self) -> None:
        Choice.__post_init__(self)
        if self.window not in (None, (CENTRED,)) and (len(self.window) != 2 or CENTRED in self.window):
            message = f"readout.window = {shown(list(self.window))}: expected {CENTRED}, or [column, row]"
            raise ModelError(message, path=("window",))


class Description:
    """What a network consists of.

    Attributes:
        name: used in messages and files.
        resolution: length of a step in ms.
        populations, projections, signals, groups, probes: the parts by name, in the order of definition.
        trials_section: the trials, or None.
        readout_section: how it is asked about recordings, or None.
    """

    name: str
    resolution: float
    populations: dict[str, Population]
    projections: dict[str, Projection]
    signals: dict[str, Signal]
    groups: dict[str, Group]
    probes: dict[str, Probe]
    trials_section: Trials | None
    readout_section: Readout | None
