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
"""Value of `window` that centres the window on each recording."""


@dataclass(frozen=True, kw_only=True)
class TrainingPlan(Settings):
    """The settings of a training.

    Attributes:
        input: name of the population of the pixels.
        output: name of the population with a neuron for each class or target.
        trainable: projections whose weights learn, or NAME=weight,delay, or POPULATION=tau_m,V_th; by default the
            weights of all projections that carry spikes.
        epochs: number of times that each recording is shown; 0 trains nothing.
        duration: duration of the used part of each recording, ms.
        start: time from the first event of a recording to the first step, ms.
        scale: side of the square of pixels that share a neuron, px.
        window: used part of a larger sensor: "centred" on the events of each recording, or column and row of the
            first pixel, as in "40,32"; None if the sensor is as large as the population.
        batch: number of recordings for each step of learning.
        rate: largest learning rate of the cycle, for weights of about 0.1 in their unit. The rate of
            other weights is in proportion to their size. Delays and parameters of neurons have this rate in their unit.
        decay: in each step a weight loses the share `decay` times the rate. Only weights decay.
        loss: name of a loss in `LOSSES`; "mse" compares the output's potentials with targets, the others use labels.
        temperature: lead in spikes, mV or steps that makes a class e (2.72) times as likely.
        surrogate, slope: see `neuro_torch.surrogates`.
        shift: largest random shift of recordings along each axis, px.
        warp: largest random rotation in rad, and largest relative change of size and shear.
        mirror: share of the recordings, drawn at random, that are mirrored, left to right.
        cost: increase of the loss for each microjoule that a recording takes on a chip, by name of the chip.
        bits: number of bits of the weights during the training, on the grid of `chip`; None for no rounding.
        on: chip whose grid the weights use; by default the first of `cost`, or Loihi.
        prune: share of the synapses that is removed after half of the epochs, the smallest weights first.
        neurons_per_core: number of neurons on a core, below the chip's limit, so that the busiest core has less work.
        seed: seed of all random numbers.
        device: name of a torch device.

    Raises:
        ModelError: a value is invalid.
    """

    input: str = setting("pixels", "", "population that receives the recordings", option="NAME")
    output: str = setting("out", "", "population with one neuron per class", option="NAME")
    trainable: tuple[str, ...] = setting(
        (), "", "part to train: PROJECTION, PROJECTION=weight,delay or POPULATION=tau_m,V_th; default: all; repeatable",
        kind="names", option="--learn NAME",
    )  # fmt: skip
    epochs: int = setting(60, "", "number of passes over the recordings; 0 only tests", at_least=0, option="N")
    duration: float = setting(100.0, "ms", "duration of the used part of a recording, ms", above=0, option="--for MS")
    start: float = setting(0.0, "", "time in each recording at which the used part begins, ms", at_least=0, option="MS")
    scale: int = setting(1, "", "binning: N x N neighbouring pixels feed one neuron", at_least=1, option="N")
    window: str | None = setting(
        None, "", "part of a larger sensor to use: column and row of its upper left pixel, or 'centred' on the events",
        kind="name", option="X,Y",
    )  # fmt: skip
    batch: int = setting(20, "", "batch size: number of recordings per update of the weights", at_least=1, option="N")
    rate: float = setting(
        0.01, "", "peak learning rate for weights near 0.1; scales with the size of the weights", above=0, option="R"
    )
    decay: float = setting(
        0.01, "", "weight decay of AdamW: each update removes R x --rate of a weight", at_least=0, option="R"
    )
    loss: str = setting("count", "", "loss function: " + ", ".join(LOSSES), option="NAME")
    temperature: float = setting(
        3.0,
        "",
        "temperature of the softmax over classes: spikes for count, mV for potential, steps for first_spike",
        above=0,
        option="X",
    
    )  # fmt: skip
    surrogate: str = setting("fast_sigmoid", "", "gradient: fast_sigmoid, arctan, slayer or triangle", option="NAME")
    slope: float = setting(1.0, "", "steepness of --surrogate, for V_m in units of V_th - V_reset", above=0, option="X")
    shift: int = setting(0, at_least=0)
    warp: float = setting(0.0)
    mirror: float = setting(0.0)
    cost: Mapping[str, float] = field(default_factory=dict)
    bits: int | None = setting(
        None, "", "round weights to N bits during training, on the grid of --chip; default: no rounding",
        kind="integer", at_least=1, option="N",
    )  # fmt: skip
    on: str | None = setting(
        None, "", "chip for --bits; default: the chip of --cost, or loihi", kind="name", option="--chip NAME"
    )  # fmt: skip
    prune: float = setting(
        0.0, "", "share of the synapses to remove after half of the epochs, smallest weights first", option="SHARE"
    )
    neurons_per_core: int | None = setting(
        None, "", "largest number of neurons per core, for the energy; default: the chip's limit",
        kind="integer", at_least=1, option="N",
    )  # fmt: skip
    seed: int = 0
    device: str = setting("cpu", "", "PyTorch device, e.g. cuda", option="NAME")

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
        """Return "", because error messages begin with the setting's name."""
        return ""

    @property
    def learns(self) -> dict[str, tuple[str, ...]]:
        """Names of the learning parameters, by each projection or population in `trainable`."""
        parts = (text.partition("=") for text in self.trainable)
        return {name: tuple(names.split(",")) if equals else ("weight",) for name, equals, names in parts}

    @property
    def chip(self) -> str:
        """Name of the chip whose grid the weights use."""
        return self.on or next(iter(self.cost), "loihi")

    def readout(self, classes: Sequence[str]) -> dict[str, Any]:
        """Return the settings of `neuro.Readout` for tests: the neuron with most spikes decides."""
        timing: dict[str, Any] = {"duration": self.duration, "start": self.start, "scale": self.scale, "merge": True}
        if self.window is not None:
            timing["window"] = corner(self.window) or CENTRED
        return {"input": self.input, "output": self.output, "decide": "counts", "classes": tuple(classes), **timing}


def corner(text: str) -> tuple[int, int] | None:
    """Return column and row of the window's first pixel, or None for "centred".

    Raises:
        ModelError: the text is neither "centred" nor a column and a row, as in "40,32".
    """
    if text == CENTRED:
        return None
    column, comma, row = (part.strip() for part in text.partition(","))
    if not (comma and column.isdecimal() and row.isdecimal()):
        expected = "expected 'centred', or column and row of the first pixel"
        raise ModelError(f"--window {text}: {expected}", hint="e.g. --window centred, or --window 0,0")
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
    """Return numbers by name from texts. `expected` describes the numbers that a name accepts, for error messages."""
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
