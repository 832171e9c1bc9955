"""The settings of a training, checked before anything runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from neuro import ModelError
from neuro.apps import Quantity, Settings, check, setting, unknown

LOSSES = ("count", "potential", "first_spike", "mse")
SHARE = "a share, 0 to less than 1"
AUGMENTATIONS = {"shift": "a whole number of px >= 0", "warp": SHARE, "mirror": SHARE}
CENTRED = "centred"
"""Asks for a window round what each recording shows."""


@dataclass(frozen=True, kw_only=True)
class TrainingPlan(Settings):
    """The settings of a training.

    Attributes:
        input: the population of the pixels.
        output: the population of which each neuron stands for a class, or follows a target.
        trainable: projections whose weights learn, or NAME=weight,delay, or POPULATION=tau_m,V_th; the weights of all
            that carry spikes if there are none.
        epochs: how often each recording is shown; 0 trains nothing.
        duration: of a recording, ms.
        start: ms from a recording's first event to its first step.
        scale: pixels in a row and in a column that are one neuron.
        window: the part of a larger sensor that is seen: "centred" round what each recording shows, or column and row
            of its first pixel, as in "40,32"; None: the sensor is as large as the population.
        batch: recordings between two steps of learning.
        rate: the largest learning rate of the cycle, for weights of about 0.1 in their unit; ten times as much for
            those ten times as large, and so on. For delays and parameters of neurons as it is, in their unit.
        decay: of weights, a share of themselves x this rate in each step; nothing else decays.
        loss: a name of `LOSSES`; "mse" of the output's potentials, for targets in place of labels.
        temperature: by how many spikes, mV or steps more one class is likelier by a factor of e.
        surrogate, slope: see `neuro_torch.surrogates`.
        shift: px by which recordings are moved at random on each axis.
        warp: by how much recordings are turned (rad), made larger and sheared (shares) at random.
        mirror: share of the recordings, drawn at random, that are mirrored, left to right.
        cost: what a microjoule of a recording adds to the loss, by chip.
        bits: of the weights while they learn, on the grid of `chip`; None: as they are.
        on: the chip whose grid weights lie on; if not given the first of `cost`, or Loihi.
        prune: share of the synapses that go, the smallest, after half of the epochs.
        neurons_per_core: put fewer neurons on a core of a chip than it allows, so that the busiest has less to do.
        seed: of everything random.
        device: a device of torch.

    Raises:
        ModelError: a value cannot be.
    """

    input: str = setting("pixels", "", "the population of the pixels", option="NAME")
    output: str = setting("out", "", "the population with a neuron a class", option="NAME")
    trainable: tuple[str, ...] = setting(
        (), "", "a projection whose weights learn, NAME=weight,delay, or POPULATION=tau_m,V_th; repeatable",
        kind="names", option="--learn NAME",
    )  # fmt: skip
    epochs: int = setting(60, "", "how often each recording is shown; 0 tests only", at_least=0, option="N")
    duration: float = setting(100.0, "ms", "of each recording, in ms", above=0, option="--for MS")
    start: float = setting(0.0, "", "what is left out before that, in ms", at_least=0, option="MS")
    scale: int = setting(1, "", "pixels in a row and column that are one neuron", at_least=1, option="N")
    window: str | None = setting(
        None, "", "of a larger sensor: its part from that pixel, or 'centred' on each recording",
        kind="name", option="X,Y",
    )  # fmt: skip
    batch: int = setting(20, "", "recordings between two steps of learning", at_least=1, option="N")
    rate: float = setting(0.01, "", "the largest learning rate, for weights of about 0.1", above=0, option="R")
    decay: float = setting(0.01, "", "of weights, in each step, times the rate", at_least=0, option="R")
    loss: str = setting("count", "", "one of " + ", ".join(LOSSES), option="NAME")
    temperature: float = setting(
        3.0, "", "spikes, mV or steps that make a class e times likelier", above=0, option="N"
    )  # fmt: skip
    surrogate: str = setting("fast_sigmoid", "", "one of fast_sigmoid, arctan, slayer, triangle", option="NAME")
    slope: float = setting(1.0, "", "of the surrogate, per V_th - V_reset", above=0, option="X")
    shift: int = setting(0, at_least=0)
    warp: float = setting(0.0)
    mirror: float = setting(0.0)
    cost: Mapping[str, float] = field(default_factory=dict)
    bits: int | None = setting(
        None, "", "of weights while they learn, on a chip's grid", kind="integer", at_least=1, option="N"
    )  # fmt: skip
    on: str | None = setting(
        None, "", "of --bits: that of --cost, or loihi, if not given", kind="name", option="--chip NAME"
    )  # fmt: skip
    prune: float = setting(0.0, "", "drop so many synapses, the smallest, half way", option="SHARE")
    neurons_per_core: int | None = setting(
        None, "", "of a chip, fewer than it allows", kind="integer", at_least=1, option="N"
    )  # fmt: skip
    seed: int = 0
    device: str = setting("cpu", "", "a device of torch, such as cuda", option="NAME")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("prune", "warp", "mirror"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ModelError(f"{name} = {getattr(self, name)!r}: expected {SHARE}")
        if self.window is not None:
            corner(self.window)
        if self.loss not in LOSSES:
            raise unknown("loss", self.loss, LOSSES)
        for name, weight in self.cost.items():
            check(Quantity(at_least=0), weight, f"cost of {name}")

    def place(self) -> str:
        """Return nothing: messages have the names alone."""
        return ""

    @property
    def learns(self) -> dict[str, tuple[str, ...]]:
        """Learning values by projection or population, for those with a choice."""
        parts = (text.partition("=") for text in self.trainable)
        return {name: tuple(words.split(",")) if equals else ("weight",) for name, equals, words in parts}

    @property
    def chip(self) -> str:
        """The chip whose grid the weights lie on."""
        return self.on or next(iter(self.cost), "loihi")

    def readout(self, classes: Sequence[str]) -> dict[str, Any]:
        """Return the words of `neuro.Readout` for tests: the neuron with most spikes decides."""
        words: dict[str, Any] = {"duration": self.duration, "start": self.start, "scale": self.scale, "merge": True}
        if self.window is not None:
            words["window"] = corner(self.window) or CENTRED
        return {"input": self.input, "output": self.output, "decide": "counts", "classes": tuple(classes), **words}


def corner(text: str) -> tuple[int, int] | None:
    """Column and row of the window's first pixel; None for one round what each recording shows.

    Raises:
        ModelError: it is neither "centred" nor a column and a row, as in "40,32".
    """
    if text == CENTRED:
        return None
    column, comma, row = (part.strip() for part in text.partition(","))
    if not (comma and column.isdecimal() and row.isdecimal()):
        expected = "expected 'centred', or column and row of its first pixel"
        raise ModelError(f"--window {text}: {expected}", hint="--window centred, or --window 0,0")
    return int(column), int(row)


def augmentation(texts: Sequence[str]) -> dict[str, float]:
    """Return random changes of recordings from texts such as "shift=2", "warp=0.1".

    Raises:
        ModelError: a change is unknown, or its number is invalid.
    """

    def expected(name: str) -> str:
        if name not in AUGMENTATIONS:
            raise unknown("augmentation", name, AUGMENTATIONS)
        return AUGMENTATIONS[name]

    return _numbers("--augment", texts, "shift=2", expected)


def costs(texts: Sequence[str]) -> dict[str, float]:
    """Return the cost of a microjoule by chip from texts such as "loihi=0.1".

    Raises:
        ModelError: a text is not of the form NAME=NUMBER.
    """
    return _numbers("--cost", texts, "loihi=0.1", lambda name: "a number for each microjoule of a recording")


def _numbers(option: str, texts: Sequence[str], example: str, expected: Callable[[str], str]) -> dict[str, float]:
    """Return numbers by name from texts; `expected` gives the number that a name takes, for messages."""
    numbers = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals or not value:
            raise ModelError(f"{option} {text}: expected NAME=NUMBER", hint=f"{option} {example}")
        accepted = expected(name)
        try:
            numbers[name] = float(value)
        except ValueError:
            raise ModelError(f"{option} {name}={value}: expected {accepted}") from None
    return numbers
