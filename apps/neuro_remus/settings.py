"""How ReMuS is set: the thesis' values, better ones, and changes by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from neuro import ModelError
from neuro_remus.frontend import FrontEnd

ORDERS = ("recordings", "frames")
VOTES = ("majority", "potentials")
FOLLOW = {"maps": "the classes and per_class", "rows": "the front end's size", "columns": "the front end's size"}


@dataclass(frozen=True, slots=True)
class Settings:
    """What a training is told beside its recordings.

    Attributes:
        network: parameters of the network ``remus`` that differ from its file's.
        epochs: how often all recordings are shown.
        order: what is shuffled in each epoch, whole recordings or all their frames.
        rate_decay: factor on the rates of learning from epoch to epoch.
        vote: how the frames of a recording decide, see `neuro_remus.decide`.
        front: what turns events into C1 spikes.
    """

    network: Mapping[str, float] = field(default_factory=dict)
    epochs: int = 8
    order: str = "recordings"
    rate_decay: float = 1.0
    vote: str = "majority"
    front: FrontEnd = field(default_factory=FrontEnd)

    def __post_init__(self) -> None:
        _one_of("order", self.order, ORDERS)
        _one_of("vote", self.vote, VOTES)
        if isinstance(self.epochs, bool) or not isinstance(self.epochs, int) or self.epochs < 1:
            raise ModelError(f"epochs = {self.epochs!r}: expected a whole number >= 1")
        if not isinstance(self.rate_decay, (int, float)) or not 0 < self.rate_decay <= 1:
            raise ModelError(f"rate_decay = {self.rate_decay!r}: expected a number > 0 and <= 1")

    def changed(self, values: Mapping[str, Any]) -> Settings:
        """Settings with some values changed.

        Args:
            values: by name: fields of `Settings`, of `FrontEnd`, or parameters of the network.

        Raises:
            ModelError: a value follows from others, or is of another kind than expected. Names that
                nothing bears are found when the network is loaded.
        """
        own = {f.name for f in fields(self)} - {"network", "front"}
        fronts = {f.name for f in fields(FrontEnd)}
        for name in values:
            if name in FOLLOW:
                raise ModelError(f"'{name}' cannot be set: it follows from {FOLLOW[name]}")
        front = {name: _like(getattr(self.front, name), values[name], name) for name in values if name in fronts}
        network = {name: values[name] for name in values if name not in own | fronts}
        return replace(
            self,
            network={**self.network, **network},
            front=_checked(replace(self.front, **front)),
            **{name: values[name] for name in values if name in own},
        )

    def as_words(self) -> dict[str, Any]:
        """All values as plain data, for files."""
        return asdict(self) | {"network": dict(self.network)}

    @classmethod
    def from_words(cls, words: Mapping[str, Any]) -> Settings:
        """What `as_words` gave, also after a way through JSON."""
        front: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in words["front"].items()}
        return cls(**{**words, "front": FrontEnd(**front)})


def _one_of(name: str, value: object, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ModelError(f"{name} = {value!r}: expected {' or '.join(known)}")


def _like(example: Any, value: Any, name: str) -> Any:
    """The value in the form of an example: a positive number, a list of such, or true or false."""
    if isinstance(example, tuple):
        if not isinstance(value, (list, tuple)) or not value:
            raise ModelError(f"{name} = {value!r}: expected a list of numbers")
        return tuple(_like(example[0], one, name) for one in value)
    if isinstance(example, bool):
        if not isinstance(value, bool):
            raise ModelError(f"{name} = {value!r}: expected true or false")
        return value
    kind, least = type(example), -float("inf") if name == "orientations" else 0.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least < value < float("inf"):
        raise ModelError(f"{name} = {value!r}: expected a number{' > 0' if least == 0 else ''}")
    if kind(value) != value:
        raise ModelError(f"{name} = {value!r}: expected a whole number")
    return kind(value)


def _checked(front: FrontEnd) -> FrontEnd:
    """The front end, if its values go together."""
    if len(front.size) != 2 or min(front.size) < 2:
        raise ModelError(f"size = {list(front.size)}: expected width and height, at least 2 px each")
    if not len(front.sizes) == len(front.sigmas) == len(front.wavelengths):
        raise ModelError("sizes, sigmas and wavelengths: expected as many of each, one a scale")
    if even := [size for size in front.sizes if size % 2 == 0]:
        raise ModelError(f"sizes: found {even[0]}: expected odd numbers, so that a filter has a middle")
    if front.min_response >= 1:
        raise ModelError(f"min_response = {front.min_response:g}: expected less than 1, a frame's largest response")
    return front


SETTINGS = {
    "thesis": Settings(),
    "best": Settings(
        network={"per_class": 8, "rescue": True, "dropout": 0.5, "decay": 0.8},
        order="frames",
        vote="potentials",
    ),
}
"""`thesis`: table 3. `best`: eight grids a class, "rescue" in place of epsilon, frames shuffled, summed potentials."""
