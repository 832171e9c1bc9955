"""Distributions of random weights, delays and initial states."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import check_returned
from neuro.core.choice import Choice
from neuro.core.errors import ModelError
from neuro.core.own_parts import check_method
from neuro.core.quantities import quantity
from neuro.core.registry import Registry

_BLOCK = 1 << 16
"""Number of values drawn at a time. A block fits in the cache while it is compared with the bounds."""

_MANY = 1 << 20
"""Smallest number of values for which `normal` uses compiled code."""

_MAX_DEVIATIONS = 40.0
"""Upper limit of the distance of a drawn normal number from the mean, in standard deviations."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Distribution(Choice):
    """Base of the distributions."""

    kind: ClassVar[str] = "distribution"

    single: bool = quantity(
        False, "", "whether values are rounded to the nearest 32-bit float within the bounds", kind="boolean"
    )

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw n values."""
        raise NotImplementedError

    def checked_sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw n values with `sample` and check them.

        Raises:
            ModelError: `sample` returned another number of values, or values that are not finite.
        """
        DISTRIBUTIONS.check(type(self))
        values = check_returned(self.sample(rng, n), (n,), f"{self!r} drew")
        if not np.isfinite(values).all():
            raise ModelError(f"{self!r} drew {values[~np.isfinite(values)][0]}: expected finite numbers")
        new_values: NDArray[np.float64] = np.add(values, 0.0, dtype=np.float64)  # adding 0 turns -0.0 into 0.0
        self._round(new_values)
        return new_values

    def _round(self, values: NDArray[np.float64]) -> None:
        """Round values in place to 32-bit floats if `single` is set."""
        if self.single:
            low, high = (_within(getattr(self, word, end), -end) for word, end in (("low", -np.inf), ("high", np.inf)))
            rounded = values.astype(np.float32)
            np.clip(rounded, low, high, out=rounded)
            np.add(rounded, 0.0, out=values)

    def pieces(self, rng: np.random.Generator, n: int) -> Iterator[NDArray[np.float64]]:
        """Yield the n values of `checked_sample` in pieces. A piece is overwritten when the next piece is requested.

        Raises:
            ModelError: `sample` returned another number of values, or values that are not finite.
        """
        yield self.checked_sample(rng, n)


def _within(bound: float, inner_direction: float) -> np.float32:
    """Return the 32-bit float nearest to a bound that is within the bound.

    `inner_direction` is infinity for a lower bound and -infinity for an upper bound.
    """
    nearest = np.float32(bound)
    is_outside = nearest > bound if inner_direction < 0.0 else nearest < bound
    return np.nextafter(nearest, np.float32(inner_direction)) if is_outside else nearest


@dataclass(frozen=True, kw_only=True, eq=False)
class uniform(Distribution):
    """Uniform distribution between `low` and `high`."""

    low: float = quantity(0.0, "", "smallest value", of_value=True)
    high: float = quantity(1.0, "", "upper bound, not included", of_value=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.measured and self.low > self.high:
            raise ModelError(f"uniform.low = {self.low:g}: expected at most high = {self.high:g}", path=("low",))

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw n values."""
        return rng.uniform(self.low, self.high, n)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Clipped(Distribution):
    """Base of distributions with bounds. Values outside the bounds are drawn again."""

    low: float = quantity(-math.inf, "", "values below are drawn again", infinite=True, of_value=True)
    high: float = quantity(math.inf, "", "values above are drawn again", infinite=True, of_value=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.measured and not self.low < self.high:
            raise ModelError(f"{self.name}.low = {self.low:g}: expected less than high = {self.high:g}", path=("low",))

    def _draw(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        raise NotImplementedError

    def sample(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        """Draw n values. Values outside [low, high] are drawn again.

        Raises:
            ModelError: fewer than one value in a thousand is within the bounds.
        """
        values = np.empty(n)
        for first in range(0, n, _BLOCK):
            self._fill(rng, values[first : first + _BLOCK])
        return values

    def _fill(self, rng: np.random.Generator, values: NDArray[np.float64]) -> None:
        values[:] = self._draw(rng, values.size)
        for _ in range(1000):
            outside = np.flatnonzero((values < self.low) | (values > self.high))
            if outside.size == 0:
                return
            values[outside] = self._draw(rng, outside.size)
        raise self._too_few_within()

    def _too_few_within(self) -> ModelError:
        return ModelError(f"{self!r}: fewer than 1 in 1000 values is between low and high: expected wider bounds")


@dataclass(frozen=True, kw_only=True, eq=False)
class normal(_Clipped):
    """Normal distribution, truncated to [low, high]."""

    mean: float = quantity(0.0, "", "mean before truncation", of_value=True)
    std: float = quantity(1.0, "", "standard deviation before truncation", at_least=0, of_value=True)

    def _draw(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        return rng.normal(self.mean, self.std, n)

    def pieces(self, rng: np.random.Generator, n: int) -> Iterator[NDArray[np.float64]]:
        """Yield the n values of `checked_sample` in pieces. A piece is overwritten when the next piece is requested.

        Raises:
            ModelError: fewer than one value in a thousand is within the bounds.
        """
        may_overflow = not math.isfinite(abs(self.mean) + _MAX_DEVIATIONS * self.std)
        if n < _MANY or may_overflow or type(self) is not normal:
            yield from super().pieces(rng, n)
            return
        try:
            from neuro.kernels.normals import Normals
        except ImportError:  # some versions of numba have NumPy's tables in another module
            yield from super().pieces(rng, n)
            return
        normals, buffer = Normals(rng), np.empty(_BLOCK)
        for first in range(0, n, _BLOCK):
            piece = buffer[: n - first]
            if not normals.fill(piece, self.mean, self.std, self.low, self.high):
                raise self._too_few_within()
            self._round(piece)
            yield piece


@dataclass(frozen=True, kw_only=True, eq=False)
class lognormal(_Clipped):
    """Log-normal distribution, truncated to [low, high]. Its logarithm is normally distributed."""

    mean: float = quantity(0.0, "", "mean of the logarithm")
    std: float = quantity(1.0, "", "standard deviation of the logarithm", at_least=0)

    def _draw(self, rng: np.random.Generator, n: int) -> NDArray[np.float64]:
        return rng.lognormal(self.mean, self.std, n)


DISTRIBUTIONS: Registry[type[Distribution]] = Registry(
    "distribution",
    (uniform, normal, lognormal),
    takes=lambda part: isinstance(part, type) and issubclass(part, Distribution),
    group="neuro.distributions",
    complete=lambda part: check_method(part, Distribution, "sample", "draws values"),
)
"""All distributions by name."""
