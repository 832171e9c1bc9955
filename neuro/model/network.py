"""A network as its author says it: populations, projections, signals, groups, trials and probes.

The parts are frozen; the network only gathers them. It knows no backend, no array layout and no steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from neuro.core.checks import check
from neuro.core.errors import ModelError, Where, here, unknown
from neuro.core.quantities import Choice, Quantity, Value, quantity, same
from neuro.core.values import shown
from neuro.model.neurons import Model
from neuro.model.rules import Rule
from neuro.model.synapses import Synapse, static

AUTO = "auto"
WEIGHT = Quantity(doc="weight: mV or pA by the target's model", arrays=True)
DELAY = Quantity(unit="ms", doc="delay, a multiple of the resolution", above=0, arrays=True)
INITIAL = Quantity(doc="state at time 0", arrays=True)
RESOLUTION = Quantity(unit="ms", doc="length of a step", above=0)
EVERY = Quantity(unit="ms", doc="interval between two records; each step if not given", above=0, optional=True)
RECORD = Quantity(doc="spikes, or a state of the population's model", kind="name")
SHAPE = Quantity(
    doc="number of neurons, or sizes of the axes; auto where a grid decides", kind="shape", at_least=1, words=(AUTO,)
)


@dataclass(frozen=True, eq=False)
class Part:
    """Base of the named parts. Two parts are equal when all but their origin is."""

    word: ClassVar[str] = "part"
    name: str

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        mine, theirs = vars(self), vars(other)
        return all(same(mine[k], theirs[k]) for k in mine if k != "origin")

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, eq=False)
class Population(Part):
    """Neurons of one model, laid out in a shape.

    Attributes:
        shape: sizes of the axes; `"auto"` where a grid projection decides.
        model: what each neuron is.
        initial: states at time 0 that differ from the model's own, by name.
    """

    word: ClassVar[str] = "population"
    shape: tuple[int | str, ...]
    model: Model
    initial: Mapping[str, Value] = field(default_factory=dict)
    origin: Where | None = None


@dataclass(frozen=True, eq=False)
class Projection(Part):
    """Connections from one population to another, by one rule and with one synapse model."""

    word: ClassVar[str] = "projection"
    source: str
    target: str
    rule: Rule
    synapse: Synapse
    weight: Value
    delay: Value
    origin: Where | None = None


@dataclass(frozen=True, eq=False)
class Signal(Part):
    """Values set from outside, one per neuron of a population: the dopamine of synapses onto it."""

    word: ClassVar[str] = "signal"
    to: str
    origin: Where | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class winner_take_all(Choice):
    """One neuron of a population decides.

    With `first_to_fire` the first spike silences all others until the next trial or reset; without, only
    the best of each step fires and the others that reached the threshold are reset. The largest V_m - V_th
    wins; a tie is drawn.
    """

    kind: ClassVar[str] = "group"
    of: str = quantity(doc="the population", kind="name")
    first_to_fire: bool = quantity(True, "", "decide once instead of at each step", kind="boolean")


@dataclass(frozen=True, eq=False)
class Group(Part):
    """Neurons that act together."""

    word: ClassVar[str] = "group"
    choice: winner_take_all
    origin: Where | None = None


@dataclass(frozen=True, eq=False)
class Probe(Part):
    """What to record of a population: its spikes, or a state at intervals of `every` ms (None: each step)."""

    word: ClassVar[str] = "probe"
    of: str
    record: str
    every: float | None = None
    origin: Where | None = None


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
    stop: str = quantity("at_decision", "", "when a trial ends", kind="word", words=("at_decision", "full"))
    labels: Any = quantity(None, "", "what the maps stand for", kind="part", part=labels)
    reward: Any = quantity(None, "", "the reward by outcome", kind="part", part=reward)
    dropout: Any = quantity(None, "", "maps left out while learning", kind="part", part=dropout)
    reset: Any = quantity(("V_m",), "", "states that start anew", kind="names")


P = TypeVar("P", bound=Part)


class Network:
    """A network under construction.

    Args:
        name: its name, used in messages and files.
        resolution: length of a step in ms.

    Attributes:
        populations, projections, signals, groups, probes: the parts by name, in the order of definition.
        trials_section: the trials, or None.
        place: where the next part comes from; None means the caller's line.
    """

    def __init__(self, name: str = "network", *, resolution: float = 0.1) -> None:
        self.name = check_name(name, "network", here())
        self.place: Where | None = None
        self.resolution: float = self._checked(RESOLUTION, resolution, "resolution", ("resolution",))
        self.populations: dict[str, Population] = {}
        self.projections: dict[str, Projection] = {}
        self.signals: dict[str, Signal] = {}
        self.groups: dict[str, Group] = {}
        self.probes: dict[str, Probe] = {}
        self.trials_section: Trials | None = None
        self.trials_origin: Where | None = None

    def population(
        self,
        name: str,
        shape: int | Iterable[int | str],
        model: Model,
        *,
        initial: Mapping[str, Any] | None = None,
    ) -> Population:
        """Add neurons of one model.

        Args:
            name: a new name.
            shape: number of neurons, or sizes of the axes (`"auto"` where a grid decides).
            model: e.g. `neuro.iaf_psc_exp(tau_m=10.0)`.
            initial: states at time 0: a number, an array or a distribution by the state's name.

        Returns:
            The part, to be passed to `connect` and others.
        """
        what = f"population '{name}'"
        sizes = self._checked(SHAPE, shape, f"{what}: shape", ("shape",))
        self._expect(model, Model, what, "a model such as neuro.iaf_psc_exp()")
        self._expect({} if initial is None else initial, Mapping, what, "states by name such as {'V_m': -60.0}")
        states = [s.name for s in model.states if not s.hidden]
        start = {}
        for state, value in (initial or {}).items():
            path = ("initial", str(state))
            if state not in states:
                raise unknown(f"state of {model.name}", state, states, path=path).at(self._where(), what)
            start[state] = self._checked(INITIAL, value, f"{what}: initial.{state}", path)
        return self._add(self.populations, Population(name, sizes, model, start, self._where()))

    def connect(
        self,
        source: Population | str,
        target: Population | str,
        rule: Rule,
        synapse: Synapse | None = None,
        *,
        weight: Any = 1.0,
        delay: Any = 1.0,
        name: str | None = None,
    ) -> Projection:
        """Connect two populations.

        Args:
            source: a population of this network, or its name.
            target: likewise.
            rule: e.g. `neuro.all_to_all()`.
            synapse: e.g. `neuro.stdp(Wmax=3.0)`; static if not given.
            weight: a number, an array (one per synapse, see docs), or a distribution.
            delay: the same, in ms.
            name: a new name; `source_target` if not given.
        """
        label = name if name is not None else f"{getattr(source, 'name', source)}_{getattr(target, 'name', target)}"
        what = f"projection '{label}'"
        pre, post = self._name_of(source, what, "from"), self._name_of(target, what, "to")
        self._expect(rule, Rule, what, "a rule such as neuro.all_to_all()")
        chosen = static() if synapse is None else synapse
        self._expect(chosen, Synapse, what, "a synapse such as neuro.static()")
        part = Projection(
            label,
            pre,
            post,
            rule,
            chosen,
            self._checked(WEIGHT, weight, f"{what}: weight", ("weight",)),
            self._checked(DELAY, delay, f"{what}: delay", ("delay",)),
            self._where(),
        )
        return self._add(self.projections, part)

    def signal(self, name: str, *, to: Population | str) -> Signal:
        """Add a signal: one value per neuron of `to`, set while running by `sim.signal`."""
        return self._add(self.signals, Signal(name, self._name_of(to, f"signal '{name}'", "to"), self._where()))

    def group(self, name: str, choice: winner_take_all) -> Group:
        """Add a group, e.g. `net.group("choice", neuro.winner_take_all(of="s2"))`."""
        self._expect(choice, winner_take_all, f"group '{name}'", "a group such as neuro.winner_take_all(of='out')")
        return self._add(self.groups, Group(name, choice, self._where()))

    def probe(self, name: str, of: Population | str, record: str = "spikes", *, every: float | None = None) -> Probe:
        """Record the spikes of a population, or one of its states every `every` ms (each step if not given)."""
        what = f"probe '{name}'"
        interval = self._checked(EVERY, every, f"{what}: every", ("every",))
        record = self._checked(RECORD, record, f"{what}: record", ("record",))
        return self._add(self.probes, Probe(name, self._name_of(of, what, "of"), record, interval, self._where()))

    def trials(self, **words: Any) -> Trials:
        """Say how trials go; the words are those of `neuro.Trials`."""
        if self.trials_section is not None:
            raise ModelError("trials: said twice", where=self._where())
        try:
            section = Trials.from_words(words)
        except ModelError as error:
            raise error.at(self._where(), "trials") from None
        self.trials_section, self.trials_origin = section, self._where()
        return section

    def save(self, path: str | Path) -> None:
        """Write YAML that loads to an equal network; large arrays go to an HDF5 file beside it."""
        from neuro.model.language.writer import save

        save(self, path)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Network):
            return NotImplemented
        skip = ("trials_origin", "place")
        mine, theirs = vars(self), vars(other)
        return all(same(mine[k], theirs[k]) for k in mine if k not in skip)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return (
            f"Network({self.name!r}, {len(self.populations)} populations, {len(self.projections)} projections, "
            f"resolution={self.resolution:g})"
        )

    def _add(self, table: dict[str, P], part: P) -> P:
        check_name(part.name, part.word, self._where())
        if part.name in table:
            raise ModelError(f"{part.word} '{part.name}' is defined twice", where=self._where(), path=(part.name,))
        table[part.name] = part
        return part

    def _where(self) -> Where | None:
        return self.place or here()

    def _checked(self, q: Quantity, value: Any, what: str, path: tuple[str, ...]) -> Any:
        try:
            return check(q, value, what, path)
        except ModelError as error:
            raise error.at(self._where()) from None

    def _name_of(self, population: Population | str, what: str, role: str) -> str:
        name = population.name if isinstance(population, Population) else population
        if not isinstance(name, str):
            raise ModelError(f"{what}: {role} = {shown(name)}: expected a name", where=self._where(), path=(role,))
        if name not in self.populations:
            raise unknown("population", name, self.populations, path=(role,)).at(self._where(), what)
        return name

    def _expect(self, value: object, kind: type, what: str, expected: str) -> None:
        if isinstance(value, type) and issubclass(value, kind):
            message, hint = f"{value.__name__} is a class", f"write {value.__name__}()"
        elif not isinstance(value, kind):
            message, hint = f"found {shown(value)}", ""
        else:
            return
        raise ModelError(f"{what}: {message}: expected {expected}", where=self._where(), hint=hint)


def check_name(name: Any, what: str, where: Where | None) -> str:
    """Return the name of a network or a part if it can be one."""
    if not isinstance(name, str) or not name or not all(c.isalnum() or c in "_-." for c in name):
        raise ModelError(f"{what} name {shown(name)}: expected letters, digits, '_', '-' or '.'", where=where)
    return name
