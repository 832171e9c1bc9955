"""The settings of a training, checked before anything runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from neuro import ModelError
from neuro.apps import unknown

LOSSES = ("count", "potential", "first_spike", "mse")
SHARE = "a share, 0 to less than 1"
AUGMENTATIONS = {"shift": "a whole number of px >= 0", "warp": SHARE, "mirror": SHARE}
CENTRED = "centred"
"""Asks for a window round what each recording shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingPlan:
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

    input: str
    output: str
    trainable: tuple[str, ...] = ()
    epochs: int = 60
    duration: float = 100.0
    start: float = 0.0
    scale: int = 1
    window: str | None = None
    batch: int = 20
    rate: float = 0.01
    decay: float = 0.01
    loss: str = "count"
    temperature: float = 3.0
    surrogate: str = "fast_sigmoid"
    slope: float = 1.0
    shift: int = 0
    warp: float = 0.0
    mirror: float = 0.0
    cost: Mapping[str, float] = field(default_factory=dict)
    bits: int | None = None
    on: str | None = None
    prune: float = 0.0
    neurons_per_core: int | None = None
    seed: int = 0
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, least in (("epochs", 0), ("batch", 1), ("scale", 1), ("shift", 0)):
            self._whole(name, least)
        for name, unit in (("duration", " ms"), ("rate", ""), ("slope", ""), ("temperature", "")):
            _expect(name, getattr(self, name), lambda v: 0.0 < v < math.inf, f"a number > 0{unit}")
        for name in ("decay", "start"):
            _expect(name, getattr(self, name), lambda v: 0.0 <= v < math.inf, "a number >= 0")
        for name in ("prune", "warp", "mirror"):
            _expect(name, getattr(self, name), lambda v: 0.0 <= v < 1.0, SHARE)
        for name in ("bits", "neurons_per_core"):
            if getattr(self, name) is not None:
                self._whole(name, 1)
        if self.window is not None:
            corner(self.window)
        if self.loss not in LOSSES:
            raise unknown("loss", self.loss, LOSSES)
        for name, weight in self.cost.items():
            _expect(f"cost of {name}", weight, lambda v: 0.0 <= v < math.inf, "a number >= 0")

    def _whole(self, name: str, least: int) -> None:
        _expect(name, getattr(self, name), lambda v: type(v) is int and v >= least, f"a whole number >= {least}")

    @property
    def learns(self) -> dict[str, tuple[str, ...]]:
        """What of which projection or population learns, where that is given."""
        parts = (text.partition("=") for text in self.trainable)
        return {name: tuple(words.split(",")) if equals else ("weight",) for name, equals, words in parts}

    @property
    def chip(self) -> str:
        """The chip whose grid the weights lie on."""
        return self.on or next(iter(self.cost), "loihi")

    def readout(self, classes: Sequence[str]) -> dict[str, Any]:
        """The words of `neuro.Readout` by which the network is asked as it is tested: the neuron that fires most."""
        seen: dict[str, Any] = {"duration": self.duration, "start": self.start, "scale": self.scale, "merge": True}
        if self.window is not None:
            seen["window"] = corner(self.window) or CENTRED
        return {"input": self.input, "output": self.output, "decide": "counts", "classes": tuple(classes), **seen}

    def as_words(self) -> dict[str, Any]:
        """All of it as plain data."""
        return asdict(self) | {"trainable": list(self.trainable), "cost": dict(self.cost)}


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


def augmentation(texts: Sequence[str]) -> dict[str, Any]:
    """How recordings are changed at random, from texts such as "shift=2", "warp=0.1".

    Raises:
        ModelError: there is no such change, or its number is none.
    """
    found = {}
    for name, value in (_named("augment", text) for text in texts):
        if name not in AUGMENTATIONS:
            raise unknown("augmentation", name, AUGMENTATIONS)
        try:
            found[name] = int(value) if name == "shift" else float(value)
        except ValueError:
            raise ModelError(f"--augment {name}={value}: expected {AUGMENTATIONS[name]}") from None
    return found


def costs(texts: Sequence[str]) -> dict[str, float]:
    """What a microjoule costs, by chip, from texts such as "loihi=0.1".

    Raises:
        ModelError: a text is no name and number.
    """
    found = {}
    for name, value in (_named("cost", text) for text in texts):
        try:
            found[name] = float(value)
        except ValueError:
            raise ModelError(f"--cost {name}={value}: expected a number for each microjoule of a recording") from None
    return found


def _named(option: str, text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals or not value:
        example = {"augment": "shift=2", "cost": "loihi=0.1"}[option]
        raise ModelError(f"--{option} {text}: expected NAME=NUMBER", hint=f"--{option} {example}")
    return name, value


def _expect(name: str, value: Any, fits: Callable[[Any], bool], expected: str) -> None:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not fits(value):
        raise ModelError(f"{name} = {value!r}: expected {expected}")
