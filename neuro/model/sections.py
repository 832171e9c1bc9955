"""Sections of a network description that specify its use: trials, readout, world."""

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
"""Criteria by which an output decides: most spikes, highest mean potential, first spike."""
CENTRED = "centred"
"""Value of `window` that centres the window on the events of each recording."""


@dataclass(frozen=True, kw_only=True, eq=False)
class labels(Choice):
    """Label of each map: map m has the label m // maps_per_label."""

    kind: ClassVar[str] = "labels"
    of: str = quantity(doc="the population whose first axis is the map", kind="name")
    maps_per_label: int = quantity(1, "", "number of maps per label", kind="integer", at_least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class reward(Choice):
    """Reward of a trial by outcome. Positive values reward, negative values punish, 0 teaches nothing."""

    kind: ClassVar[str] = "reward"
    correct: float = quantity(1.0, "", "reward if the decision is the label")
    wrong: float = quantity(-1.0, "", "reward if the decision is another label")
    silent: float = quantity(0.0, "", "reward without a decision")


@dataclass(frozen=True, kw_only=True, eq=False)
class dropout(Choice):
    """Dropout of maps while learning: a dropped map integrates but cannot fire.

    The share in epoch e is p decay^e. Source: Mosca 2020, section 6.2.6 and table 3.
    """

    kind: ClassVar[str] = "dropout"
    of: str = quantity(doc="the population", kind="name")
    axis: str = quantity("map", "", "unit that is dropped as a whole", kind="word", words=("map",))
    p: float = quantity(0.25, "", "share of maps dropped in the first epoch", at_least=0, below=1)
    every: str = quantity(
        "sample", "", "period after which dropped maps are drawn again", kind="word", words=("sample", "trial")
    )
    decay: float = quantity(1.0, "", "factor on p from epoch to epoch", at_least=0, at_most=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials(Choice):
    """Short presentations of an input, each with a decision and, if labelled, a reward.

    A tick is one step of a trial. An input at time t is emitted in tick t / resolution, 0 <= t < duration. At the start
    of a trial no spike is in transit, and the states named in `reset` have their values at time 0. While learning, an
    input spikes at most once, unless `spikes` says which of its spikes teach. `first` compares the first spike of an
    input with the decision, as in the text of Mosca, MSc thesis, 2020, section 6.2.4. `each` applies eqs 126 and 127 of
    the thesis to every spike.

    If synapses learn by dopamine, every trial starts with the states of neurons and synapses at their values at time 0,
    except the weights. When a trial that teaches ends, the reward sets the signals of the synapses, and the network
    runs on for `after`.
    """

    kind: ClassVar[str] = "trials"
    word: ClassVar[str] = "trials"
    input: str = quantity(doc="the spike_generator that receives the trials' spikes", kind="name")
    duration: float = quantity(doc="length of a trial", unit="ms", above=0)
    stop: str = quantity(
        "at_decision",
        "",
        "end of a trial: as soon as no neuron can decide any more, or after the full duration",
        kind="word",
        words=("at_decision", "full"),
    )
    spikes: str = quantity(
        "once",
        "",
        "spikes of an input that teach: the only spike (a second spike is an error), the first, or each in order",
        kind="word",
        words=("once", "first", "each"),
    )
    labels: Any = quantity(None, "", "the label of each map", kind="part", part=labels)
    reward: Any = quantity(None, "", "the reward by outcome", kind="part", part=reward)
    dropout: Any = quantity(None, "", "dropout of maps while learning", kind="part", part=dropout)
    reset: Any = quantity(("V_m",), "", "states of the output that are reset before each trial", kind="names")
    after: float = quantity(
        0.0,
        "ms",
        "time that the network runs on after a trial that teaches, with the dopamine that the reward sets",
        at_least=0,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Readout(Choice):
    """Presentation of event-camera recordings to a network, and classification by the network's output."""

    kind: ClassVar[str] = "readout"
    word: ClassVar[str] = "readout"
    input: str = quantity(doc="the spike_generator of the pixels", kind="name")
    output: str = quantity(doc="the population with a neuron per class", kind="name")
    decide: Any = quantity(
        None,
        doc="criterion: most spikes, highest mean potential or first spike; by default counts if there are spikes",
        kind="word",
        words=DECIDED_BY,
    )
    classes: Any = quantity(None, doc="names of the output's neurons, in their order", kind="names")
    duration: Any = quantity(
        None, "ms", "simulated time per recording; by default until every event has passed the network", above=0
    )
    start: float = quantity(0.0, "ms", "time from a recording's first event to the first step", at_least=0)
    scale: int = quantity(1, "px", "rows and columns of pixels per neuron", kind="integer", at_least=1)
    window: Any = quantity(
        None,
        "px",
        "part of a larger sensor: its first column and row, or centred on the events of each recording",
        kind="shape",
        at_least=0,
        words=(CENTRED,),
    )
    merge: bool = quantity(
        False, doc="whether several events of a pixel in one step count as one spike", kind="boolean"
    )

    def __post_init__(self) -> None:
        Choice.__post_init__(self)
        if self.window not in (None, (CENTRED,)) and (len(self.window) != 2 or CENTRED in self.window):
            message = f"readout.window = {shown(list(self.window))}: expected {CENTRED}, or [column, row]"
            raise ModelError(message, path=("window",))


@dataclass(frozen=True, kw_only=True, eq=False)
class Surroundings(Choice):
    """An environment of Gymnasium, named by its id or by a class in a file that the user gives with `--with`."""

    kind: ClassVar[str] = "environment"
    word: ClassVar[str] = "environment"
    strays: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("python", "file", "module", "class"), "a description imports nothing: {id: CLASS}, and --with FILE.py"
    )
    id: str = quantity(doc="id that gymnasium or an installed package registers, or the name of a class", kind="name")
    options: Any = quantity(None, "", "arguments of the environment's constructor", kind="words")

    def __post_init__(self) -> None:
        Choice.__post_init__(self)
        if ":" in self.id or self.id.endswith(".py"):
            module = self.id.partition(":")[0].removesuffix(".py").replace(".", "/")
            message = f"environment.id = {shown(self.id)}: a description imports nothing: expected an id or a class"
            raise ModelError(message, path=("id",), hint=f"name the file yourself: --with {module}.py")


@dataclass(frozen=True, kw_only=True, eq=False)
class World(Choice):
    """The environment of a network and the coupling between the two.

    In each control step the network receives the observation, runs, acts, and receives the reward.
    """

    kind: ClassVar[str] = "world"
    word: ClassVar[str] = "world"
    environment: Any = quantity(doc="the environment", kind="part", part=Surroundings)
    step: float = quantity(doc="simulated time per control step", unit="ms", above=0)
    observe: Any = quantity(doc="encoding of the observation, for each population", kind="choices", choice=Encoder)
    act: Any = quantity(doc="decoding of spikes into the action", kind="choice", choice=Decoder)
    reward: Any = quantity(None, "", "source of each signal", kind="choices", choice=Teacher)
    explore: int = quantity(0, "", "control steps of random actions before learning", kind="integer", at_least=0)
    episode: Any = quantity(None, "", "largest number of control steps per episode", kind="integer", at_least=1)
    process: bool = quantity(False, "", "whether the environment runs in a process of its own", kind="boolean")
    block: int = quantity(10_000, "", "control steps between two checkpoints", kind="integer", at_least=1)


def largest_in_world(world: World | None, signal: str) -> float | None:
    """Return the largest absolute value of a signal for a reward or error of 1; None if the world does not set it."""
    rewards = {} if world is None else world.reward or {}
    return abs(rewards[signal].scale) or None if signal in rewards else None
