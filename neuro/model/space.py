"""Functions of the distance between neurons, for probabilities, weights and delays, and masks of possible targets."""

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
TOLERANCE = 1e-9
"""Relative tolerance of a radius. Distances on a lattice have rounding errors, so a distance that exceeds the radius by
less than this share is treated as equal to the radius."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile(Choice):
    """Base of the functions of distance. A user-defined profile implements `at`.

    Distances are in the unit of positions.
    """

    kind: ClassVar[str] = "profile"

    @property
    def reach(self) -> float:
        """Distance beyond which the function is 0."""
        return math.inf

    def at(self, distance: Floats) -> Floats:
        """Return the values at distances >= 0, an array of the same shape."""
        raise NotImplementedError

    def values(self, distance: Floats) -> Floats:
        """Return the values of `at` after a check.

        Raises:
            ModelError: `at` returned an array of another shape, or values that are not finite.
        """
        PROFILES.check(type(self))
        values = check_returned(self.at(distance), distance.shape, f"{self!r} has")
        bad_indices = np.flatnonzero(~np.isfinite(values))
        if bad_indices.size:
            value = f"{values[bad_indices[0]]} at the distance {distance[bad_indices[0]]:g}"
            raise ModelError(f"{self!r} is {value}: expected finite numbers")
        return values.astype(np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class linear(Profile):
    """Linear function c + a d of the distance d."""

    c: float = quantity(0.0, "", "value at distance 0", of_value=True)
    a: float = quantity(1.0, "", "growth with each unit of distance", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Return the values at distances >= 0."""
        return self.c + self.a * distance


@dataclass(frozen=True, kw_only=True, eq=False)
class exponential(Profile):
    """Exponential function c + a exp(-d / beta) of the distance d."""

    beta: float = quantity(1.0, "", "length constant, over which the function falls to 1/e", above=0)
    a: float = quantity(1.0, "", "height above c at distance 0", of_value=True)
    c: float = quantity(0.0, "", "value at large distances", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Return the values at distances >= 0."""
        return self.c + self.a * np.exp(-distance / self.beta)


@dataclass(frozen=True, kw_only=True, eq=False)
class gaussian(Profile):
    """Gaussian function c + a exp(-(d - mean)^2 / (2 std^2)) of the distance d."""

    std: float = quantity(1.0, "", "width", above=0)
    mean: float = quantity(0.0, "", "distance of the peak")
    a: float = quantity(1.0, "", "height of the peak above c", of_value=True)
    c: float = quantity(0.0, "", "value at large distances", of_value=True)

    def at(self, distance: Floats) -> Floats:
        """Return the values at distances >= 0."""
        return self.c + self.a * np.exp(-0.5 * ((distance - self.mean) / self.std) ** 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class box(Profile):
    """Step function: `a` up to a radius, `c` beyond it."""

    radius: float = quantity(1.0, "", "distance up to which the value is a", at_least=0)
    a: float = quantity(1.0, "", "value up to the radius", of_value=True)
    c: float = quantity(0.0, "", "value beyond the radius", of_value=True)

    @property
    def reach(self) -> float:
        """Distance beyond which the function is 0."""
        return self.radius * (1.0 + TOLERANCE) if self.c == 0.0 else math.inf

    def at(self, distance: Floats) -> Floats:
        """Return the values at distances >= 0."""
        return np.where(distance <= self.radius * (1.0 + TOLERANCE), self.a, self.c)


PROFILES: Registry[type[Profile]] = Registry(
    "profile",
    (linear, exponential, gaussian, box),
    takes=lambda part: isinstance(part, type) and issubclass(part, Profile),
    group="neuro.profiles",
    complete=lambda part: check_method(part, Profile, "at", "returns its values"),
)
"""All functions of distance by name."""


@dataclass(frozen=True, eq=False)
class of_distance(Choice):
    """A weight or delay that is a function of the distance between source and target."""

    kind: ClassVar[str] = "of_distance"
    profile: Any = quantity(doc="function of the distance", kind="choice", choice=Profile)

    def in_unit(self, q: Quantity, what: str) -> of_distance:
        """Return a copy whose parameters with a unit are converted to the unit of the described weight or delay."""
        profile = self.profile.in_unit(q, what)
        return self if profile is self.profile else of_distance(profile)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mask(Choice):
    """Base of the masks, which limit where targets may be relative to their source."""

    kind: ClassVar[str] = "mask"

    @property
    def reach(self) -> float:
        """Distance beyond which every target is outside the mask."""
        raise NotImplementedError

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Return a boolean per target, true inside the mask. `displacement` from the source has the shape (axes, n)."""
        raise NotImplementedError

    def misfit(self, axes: int) -> str:
        """Return an error message if the mask cannot be used in a space with this number of axes, or ""."""
        return ""


@dataclass(frozen=True, kw_only=True, eq=False)
class circular(Mask):
    """A line, disc or ball around the source."""

    radius: float = quantity(doc="largest distance", above=0)

    @property
    def reach(self) -> float:
        """Distance beyond which every target is outside the mask."""
        return self.radius * (1.0 + TOLERANCE)

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Return a boolean per target, true inside the mask. `displacement` has the shape (axes, n)."""
        return np.asarray((displacement**2).sum(axis=0) <= self.reach**2)


@dataclass(frozen=True, kw_only=True, eq=False)
class rectangular(Mask):
    """A box given by two corners relative to the source. Coordinates are in the order of the shape's axes."""

    lower_left: Any = quantity(doc="smallest coordinates", arrays=True)
    upper_right: Any = quantity(doc="largest coordinates", arrays=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        for word in ("lower_left", "upper_right"):
            corner = getattr(self, word)
            if not isinstance(corner, np.ndarray) or corner.ndim != 1:
                message = f"rectangular.{word} = {shown(corner)}"
                raise ModelError(f"{message}: expected a list, a number for each axis", path=(word,))
        if self.lower_left.shape != self.upper_right.shape or not np.all(self.lower_left < self.upper_right):
            corners = f"{self.lower_left.tolist()} and {self.upper_right.tolist()}"
            text = f"rectangular: found the corners {corners}: expected the first below the second on every axis"
            raise ModelError(text, path=("upper_right",))

    @property
    def _slack(self) -> Floats:
        """Tolerance of the corners on each axis, in the unit of positions."""
        return TOLERANCE * np.asarray(self.upper_right - self.lower_left, dtype=np.float64)

    @property
    def reach(self) -> float:
        """Distance beyond which every target is outside the mask."""
        farthest = np.maximum(np.abs(self.lower_left), np.abs(self.upper_right)) + self._slack
        return float(np.sqrt((farthest**2).sum()))

    def inside(self, displacement: Floats) -> NDArray[np.bool_]:
        """Return a boolean per target, true inside the mask. `displacement` has the shape (axes, n)."""
        low, high = (corner[:, None] for corner in (self.lower_left - self._slack, self.upper_right + self._slack))
        return np.asarray(np.all((displacement >= low) & (displacement <= high), axis=0))

    def misfit(self, axes: int) -> str:
        """Return the error message unless the corners have a coordinate per axis."""
        n_coordinates = len(self.lower_left)
        return (
            "" if n_coordinates == axes else f"rectangular has corners of {n_coordinates} coordinates: expected {axes}"
        )


MASKS: dict[str, type[Mask]] = {"circular": circular, "rectangular": rectangular}
"""All masks by name."""
