"""Functions of the distance between two neurons, and masks: which pairs are connected, how strongly and how late."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import check_returned
from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.own_parts import check_method
from neuro.core.quantities import Quantity, quantity
from neuro.core.registry import Registry
from neuro.core.values import shown

Floats = NDArray[np.float64]
SLACK = 1e-9
"""Distances on a lattice are rounded: one beyond a radius by less than this share of it counts as the radius."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile(Choice):
    """Base of the functions of distance. One of one's own says its values in `at`.

    Distances are in the unit of positions.
    """

    kind: ClassVar[str] = "profile"

    @property
    def reach(self) -> float:
        """The distance beyond which it is 0."""
        return math.inf

    def at(self, distance: Floats) -> Floats:
        """Its values at distances >= 0, an array of the same shape."""
        raise NotImplementedError

    def values(self, distance: Floats) -> Floats:
        """The checked values of `at`.

        Raises:
            ModelError: they are not so many finite numbers.
        """
        PROFILES.check(type(self))
        values = check_returned(self.at(distance), distance.shape, f"{self!r} has")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            found = f"{values[bad[0]]} at the distance {distance[bad[0]]:g}"
            raise ModelError(f"{self!r} is {found}: expected finite numbers")
        return values.astype(np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class linear(Profile):
    """c + a d at the distance d."""

    c: float = quantity(0.0, "", "value at distance 0", of_value=True)
    a: float = quantity(1.0, "", "growth with each unit of distance", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Its values."""
        return self.c + self.a * distance


@dataclass(frozen=True, kw_only=True, eq=False)
class exponential(Profile):
    """c + a exp(-d / beta) at the distance d."""

    beta: float = quantity(1.0, "", "distance over which it falls to 1/e", above=0)
    a: float = quantity(1.0, "", "height above c at distance 0", of_value=True)
    c: float = quantity(0.0, "", "value far away", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Its values."""
        return self.c + self.a * np.exp(-distance / self.beta)


@dataclass(frozen=True, kw_only=True, eq=False)
class gaussian(Profile):
    """c + a exp(-(d - mean)^2 / (2 std^2)) at the distance d."""

    std: float = quantity(1.0, "", "width", above=0)
    mean: float = quantity(0.0, "", "distance of the peak")
    a: float = quantity(1.0, "", "height of the peak above c", of_value=True)
    c: float = quantity(0.0, "", "value far away", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Its values."""
        return self.c + self.a * np.exp(-0.5 * ((distance - self.mean) / self.std) ** 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class box(Profile):
    """`a` up to a radius, c beyond it."""

    radius: float = quantity(1.0, "", "distance up to which it is a", at_least=0)
    a: float = quantity(1.0, "", "value up to the radius", of_value=True)
    c: float = quantity(0.0, "", "value beyond it", of_value=True)

    @property
    def reach(self) -> float:
        """The distance beyond which it is 0."""
        return self.radius * (1.0 + SLACK) if self.c == 0.0 else math.inf

    def at(self, distance: Floats) -> Floats:
        """Its values."""
        return np.where(distance <= self.radius * (1.0 + SLACK), self.a, self.c)


PROFILES: Registry[type[Profile]] = Registry(
    "profile",
    (linear, exponential, gaussian, box),
    takes=lambda part: isinstance(part, type) and issubclass(part, Profile),
    group="neuro.profiles",
    complete=lambda part: check_method(part, Profile, "at", "says its values"),
)
"""All functions of distance by name."""


@dataclass(frozen=True, eq=False)
class of_distance(Choice):
    """A weight or a delay that follows from the distance between source and target."""

    kind: ClassVar[str] = "of_distance"
    profile: Any = quantity(doc="the function", kind="choice", choice=Profile)

    def in_unit(self, q: Quantity, what: str) -> of_distance:
        """The same with numbers in place of parameters that were said with a unit."""
        profile = self.profile.in_unit(q, what)
        return self if profile is self.profile else of_distance(profile)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mask(Choice):
    """Base of the masks: where a target may lie, seen from its source."""

    kind: ClassVar[str] = "mask"

    @property
    def reach(self) -> float:
        """The distance beyond which nothing lies inside."""
        raise NotImplementedError

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Whether targets lie inside; `displacement` is from source to target, shape (axes, n)."""
        raise NotImplementedError

    def misfit(self, axes: int) -> str:
        """Why it cannot be used in a space of so many axes; "" if it can."""
        return ""


@dataclass(frozen=True, kw_only=True, eq=False)
class circular(Mask):
    """A line, disc or ball around the source."""

    radius: float = quantity(doc="largest distance", above=0)

    @property
    def reach(self) -> float:
        """The distance beyond which nothing lies inside."""
        return self.radius * (1.0 + SLACK)

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Whether targets lie inside."""
        return np.asarray((displacement**2).sum(axis=0) <= self.reach**2)


@dataclass(frozen=True, kw_only=True, eq=False)
class rectangular(Mask):
    """A box, given by two corners seen from the source; the coordinates have the order of the shape's axes."""

    lower_left: Any = quantity(doc="smallest coordinates", arrays=True)
    upper_right: Any = quantity(doc="largest coordinates", arrays=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for word in ("lower_left", "upper_right"):
            found = getattr(self, word)
            if not isinstance(found, np.ndarray) or found.ndim != 1:
                message = f"rectangular.{word} = {shown(found)}"
                raise ModelError(f"{message}: expected a list, a number for each axis", path=(word,))
        if self.lower_left.shape != self.upper_right.shape or not np.all(self.lower_left < self.upper_right):
            found = f"{self.lower_left.tolist()} and {self.upper_right.tolist()}"
            text = f"rectangular: found the corners {found}: expected the first below the second on every axis"
            raise ModelError(text, path=("upper_right",))

    @property
    def _slack(self) -> Floats:
        return SLACK * np.asarray(self.upper_right - self.lower_left, dtype=np.float64)

    @property
    def reach(self) -> float:
        """The distance beyond which nothing lies inside."""
        farthest = np.maximum(np.abs(self.lower_left), np.abs(self.upper_right)) + self._slack
        return float(np.sqrt((farthest**2).sum()))

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Whether targets lie inside."""
        low, high = (corner[:, None] for corner in (self.lower_left - self._slack, self.upper_right + self._slack))
        return np.asarray(np.all((displacement >= low) & (displacement <= high), axis=0))

    def misfit(self, axes: int) -> str:
        """Why it cannot be used in a space of so many axes."""
        found = len(self.lower_left)
        return "" if found == axes else f"rectangular has corners of {found} coordinates: expected {axes}"


MASKS: dict[str, type[Mask]] = {"circular": circular, "rectangular": rectangular}
"""All masks by name."""
