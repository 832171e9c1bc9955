"""Parts of a network description (populations, projections, signals, groups, probes), all immutable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import FrozenInstanceError, dataclass, field, replace
from typing import Any, ClassVar, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, Where, words_of
from neuro.core.quantities import Quantity, Value, word_of
from neuro.core.values import same
from neuro.model.groups import (
    GROUPS as GROUPS,
    Competition as Competition,
    lateral_reset as lateral_reset,
    local_winners as local_winners,
    winner_take_all as winner_take_all,
)
from neuro.model.neurons import Model
from neuro.model.rules import Rule
from neuro.model.sections import (
    CENTRED as CENTRED,
    DECIDED_BY as DECIDED_BY,
    Readout as Readout,
    Surroundings as Surroundings,
    Trials as Trials,
    World as World,
    dropout as dropout,
    labels as labels,
    reward as reward,
)
from neuro.model.signals import Source
from neuro.model.synapses import Synapse
from neuro.model.views import View, count, view
from neuro.model.wiring.neurons import neuron_table

AUTO = "auto"
WEIGHT = Quantity(doc="weight: mV or pA by the target's model", arrays=True, of_distance=True)
INITIAL = Quantity(doc="state at time 0", arrays=True)
RESOLUTION = Quantity(unit="ms", doc="length of a step", above=0)


@dataclass(frozen=True, eq=False)
class Part:
    """Base of the named parts. Two parts are equal if all their attributes are equal; their origins are not compared.

    Class attributes:
        word: the name of the kind of part in messages. The plural is the name of its section in YAML.
        words: for each word of a part, the quantity that it accepts, in the order of messages.
        needs: the required words.
        defaults: default values of the words whose attribute has no default of its own.
        ends: for each word that names neurons, two attributes of the part. The first has the name of the population or
            projection, the second has the view if only some neurons are chosen.
    """

    word: ClassVar[str] = "part"
    words: ClassVar[Mapping[str, Quantity]] = {}
    needs: ClassVar[tuple[str, ...]] = ()
    defaults: ClassVar[Mapping[str, Any]] = {}
    ends: ClassVar[Mapping[str, tuple[str, str]]] = {}
    name: str

    def value(self, word: str) -> Any:
        """Return the value of a word of the language. For neurons the value is the view, if there is one."""
        name_attribute, view_attribute = self.ends.get(word, (word, ""))
        view = getattr(self, view_attribute) if view_attribute else None
        return getattr(self, name_attribute) if view is None else view

    def __init_subclass__(cls) -> None:
        cls.__repr__ = Part.__repr__  # type: ignore[method-assign]  # else @dataclass would replace it

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        own_values, other_values = vars(self), vars(other)
        return all(same(own_values[k], other_values[k]) for k in own_values if k not in ("origin", "between"))

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
    """Raise an error about a part, or about a word of the part such as "weight" or "stdp.signal"."""
    text = f"{part.word} '{part.name}': {message}"
    raise ModelError(text, where=part.origin, hint=hint, path=words_of(word), kind=kind, about=about)


@contextmanager
def naming_the_part(part: AnyPart, *path: str) -> Iterator[None]:
    """Add the name and the origin of the part to errors raised in the block, and put `path` before their path."""
    try:
        yield
    except ModelError as error:
        error_of_part = error.at(part.origin, f"{part.word} '{part.name}'")
        raise error_of_part.but(path=(*path, *error.path)) from None


@dataclass(frozen=True, eq=False)
class Population(Part):
    """Neurons of one model, laid out in a shape.

    An index chooses some of the neurons: `exc[:100]`, `exc[::2]`, `exc[mask]`, `grid[2:4, :]` (see `View`). `len`
    counts the neurons. Iteration yields a view of each neuron.

    Attributes:
        shape: sizes of the axes. `"auto"` is an axis that a grid projection or a recording decides.
        model: the neuron model.
        initial: states at time 0 that differ from the model's defaults, by name.
        positions: coordinates, one row per neuron, or None if positions follow from the shape.
        extent: length of each axis, or None. If it is None, neighbours are one unit apart, or the edges are open.
        periodic: whether the space is periodic, so that opposite edges touch.
        neurons: the table that lists the neurons, or None.
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
        "periodic": Quantity(doc="whether opposite edges touch (periodic boundary conditions)", kind="boolean"),
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
        """The shape. Axes that follow from a recording are filled in as soon as the recording is available."""
        return self.model.sizes(self.shape)

    def __getitem__(self, index: Any) -> View:
        return view(self, index)

    def where(self, **only: Any) -> View:
        """Return the neurons whose columns in the table of neurons have the given values.

        Args:
            only: for each column a value, or a list of accepted values.

        Raises:
            ModelError: the population has no table, or the column, the value or a matching neuron does not exist.
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
        """Return the ids of the neurons."""
        return np.array(self.ids, dtype=dtype)

    def __getattr__(self, word: str) -> Any:
        raise AttributeError(_no_attribute(self, word, "sim.get({name}, {word!r}) reads it"))

    @property
    def ids(self) -> NDArray[np.int64]:
        """Ids of all neurons, counted from 0.

        Raises:
            ModelError: the shape is not known before the network is compiled.
        """
        return view(self, ...).ids


def _no_attribute(part: Population, word: str, method_hint: str) -> str:
    """Return the message for an attribute that a population lacks. `method_hint` names a method of a simulation."""
    model = vars(part).get("model")
    attributes = () if model is None else (*model.quantities(), *(state.name for state in model.states))
    if word_of(word) not in attributes:
        return f"'{type(part).__name__}' object has no attribute '{word}'"
    message = f"population '{part.name}' is a description: its {word_of(word)} is in a simulation"
    return f"{message}: {method_hint.format(name=part.name, word=word_of(word))}"


def _refuse_change(part: Population, word: str, value: Any) -> None:
    raise FrozenInstanceError(_no_attribute(part, word, "sim.set({name}, {word}=...) sets it"))


Population.__setattr__ = _refuse_change  # type: ignore[method-assign, assignment]  # else @dataclass would replace it


@dataclass(frozen=True, eq=False)
class Projection(Part):
    """Connections from one population to another, by one rule and with one synapse model.

    Attributes:
        source, target: names of the two populations.
        source_view, target_view: the neurons that the rule connects at each end, or None for all.
        between: the two populations if they are known, used for printing only.
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
    """A value per neuron of a population, such as the dopamine concentration at the synapses onto the neuron.

    Attributes:
        values: the source of the values while the network runs. If it is None, a program sets the signal.
    """

    word: ClassVar[str] = "signal"
    words: ClassVar[Mapping[str, Quantity]] = {
        "to": Quantity(doc="the population that receives the signal", kind="name"),
        "values": Quantity(
            doc="values or their source; a program sets the signal if not given",
            kind="choice",
            choice=Source,
            arrays=True,
            optional=True,
        ),
    }
    needs: ClassVar[tuple[str, ...]] = ("to",)
    to: str
    origin: Where | None = None
    values: Value = None


@dataclass(frozen=True, eq=False)
class Group(Part):
    """A named rule of competition, `choice`, between the neurons of a population."""

    word: ClassVar[str] = "group"
    choice: Competition
    origin: Where | None = None


@dataclass(frozen=True, eq=False)
class Probe(Part):
    """A recording of spikes, or of states at intervals of `every` ms (each step if `every` is None).

    Attributes:
        of: the name of the population or projection.
        record: "spikes", "rate", a state, or several states.
        at: "pre_spikes" records the state of synapses just after each presynaptic spike.
        mean: whether the mean over neurons or synapses is recorded instead of each value.
        synapses: indices of the recorded synapses of a projection, in the order of its weights, or None for all.
        view: the recorded neurons of a population, or None for all.
        pre, post: for a projection, only synapses from and onto these neurons are recorded. None stands for all
            neurons.
    """

    word: ClassVar[str] = "probe"
    words: ClassVar[Mapping[str, Quantity]] = {
        "of": Quantity(doc="the population, some of its neurons, or the projection", kind="neurons"),
        "record": Quantity(
            doc="spikes, rate, or one or several states of a population's neurons or a projection's synapses",
            kind="names",
        ),
        "every": Quantity(unit="ms", doc="sampling interval; each step if not given", above=0, optional=True),
        "at": Quantity(
            doc="event to record at, instead of a fixed interval", kind="word", words=("pre_spikes",), optional=True
        ),
        "mean": Quantity(doc="whether to record the mean instead of each value", kind="boolean"),
        "synapses": Quantity(
            doc="synapses of a projection, in the order of its weights; all if not given", kind="ids", optional=True
        ),
        "pre": Quantity(doc="for a projection: record only synapses from these neurons", kind="neurons", arrays=True),
        "post": Quantity(doc="for a projection: record only synapses onto these neurons", kind="neurons", arrays=True),
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
        """Return the name of the trace of each recorded state. With several states the name is `probe.state`."""
        if isinstance(self.record, str):
            return {self.record: self.name}
        return {state: f"{self.name}.{state}" for state in self.record}


AnyPart: TypeAlias = Population | Projection | Signal | Group | Probe


class Description:
    """A network as parts and sections, without the methods that build it.

    Attributes:
        name: the name in messages and files.
        resolution: length of a step in ms.
        populations, projections, signals, groups, probes: the parts by name, in the order of definition.
        trials_section: the trials, or None.
        readout_section: presentation and classification of recordings, or None.
        world_section: the environment and its coupling to the network, or None.
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
    world_section: World | None
