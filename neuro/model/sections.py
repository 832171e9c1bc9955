"""The sections of a network that say how it is used: trials, recordings, world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.coding.world import Decoder, Encoder, Teacher
from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.core.values import shown

DECIDED_BY = ("counts", "potential", "first")
"""How an output decides: most spikes, the highest mean potential, or the first spike."""
CENTRED = "centred"
"""Asks for a window round what each recording shows."""


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
    At the start of a trial no spike is under way and the states named in `reset` are as at time 0. While learning, an
    input spikes at most once, unless `spikes` says which of its spikes teach. `first` asks if an input came before the
    decision, as the text of Mosca, MSc thesis, 2020, section 6.2.4, does; `each` applies its eqs 126 and 127 to each.

    Where synapses learn by dopamine, all states of neurons and synapses but the weights are as at time 0 when a trial
    starts. When a trial that teaches ends, the reward sets their signals, and the network goes on for `after`.
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
    spikes: str = quantity(
        "once",
        "",
        "which spikes of an input teach: its only one (a second is refused), the first, or each after the other",
        kind="word",
        words=("once", "first", "each"),
    )
    labels: Any = quantity(None, "", "what the maps stand for", kind="part", part=labels)
    reward: Any = quantity(None, "", "the reward by outcome", kind="part", part=reward)
    dropout: Any = quantity(None, "", "maps left out while learning", kind="part", part=dropout)
    reset: Any = quantity(("V_m",), "", "states of the output that start anew", kind="names")
    after: float = quantity(
        0.0,
        "ms",
        "how long the network goes on after a trial that teaches, with dopamine as the reward set it",
        at_least=0,
    )


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings(Choice):
    """An environment of Gymnasium, by its id, or a class of a file that the user names by `--with`."""

    kind: ClassVar[str] = "environment"
    word: ClassVar[str] = "environment"
    strays: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("python", "file", "module", "class"), "a description imports nothing: {id: CLASS}, and --with FILE.py"
    )
    id: str = quantity(
        doc="its id as gymnasium or an installed package registers it, or the name of a class", kind="name"
    )
    options: Any = quantity(None, "", "arguments with which it is made", kind="words")

    def __post_init__(self) -> None:
        Choice.__post_init__(self)
        if ":" in self.id or self.id.endswith(".py"):
            module = self.id.partition(":")[0].removesuffix(".py").replace(".", "/")
            message = f"environment.id = {shown(self.id)}: a description imports nothing: expected an id or a class"
            raise ModelError(message, path=("id",), hint=f"name the file yourself: --with {module}.py")


@dataclass(frozen=True, kw_only=True, eq=False)
class World(Choice):
    """The world of a network: in each control step the network sees, runs, acts, and is taught."""

    kind: ClassVar[str] = "world"
    word: ClassVar[str] = "world"
    environment: Any = quantity(doc="in which environment", kind="part", part=Surroundings)
    step: float = quantity(doc="time of the network in a control step", unit="ms", above=0)
    observe: Any = quantity(doc="how each population sees the observation", kind="choices", choice=Encoder)
    act: Any = quantity(doc="how spikes become the action", kind="choice", choice=Decoder)
    reward: Any = quantity(None, "", "what sets each signal", kind="choices", choice=Teacher)
    explore: int = quantity(0, "", "control steps of random actions before it learns", kind="integer", at_least=0)
    episode: Any = quantity(None, "", "control steps of an episode at most", kind="integer", at_least=1)
    process: bool = quantity(False, "", "whether the environment is a process of its own", kind="boolean")
    block: int = quantity(10_000, "", "control steps between two checkpoints", kind="integer", at_least=1)


def largest_in_world(world: World | None, signal: str) -> float | None:
    """Return the largest absolute value to which a world sets a signal, of an error or reward of 1; None if none."""
    rewards = {} if world is None else world.reward or {}
    return abs(rewards[signal].scale) or None if signal in rewards else None
