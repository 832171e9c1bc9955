"""What stands in for the derivative of a spike: a spike is a step of the potential, whose derivative teaches nothing.

All are functions of x = (V_m - V_th) / (V_th - V_reset), so a slope means the same whatever the potentials of a model
are; and all are 1 at the threshold, so that a slope only says how far from it a neuron still learns.

| name | derivative | source |
| --- | --- | --- |
| `fast_sigmoid` | 1 / (1 + slope abs(x))^2 | Zenke and Ganguli, Neural Comput. 30(6):1514, 2018 |
| `arctan` | 1 / (1 + (pi / 2 slope x)^2) | Fang et al., ICCV 2021 |
| `slayer` | exp(-slope abs(x)) | Shrestha and Orchard, NeurIPS 2018 |
| `triangle` | max(0, 1 - slope abs(x)) | Esser et al., PNAS 113(41):11441, 2016; Bellec et al., NeurIPS 2018 |
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from neuro.core.errors import ModelError, unknown

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["SURROGATES", "ArcTan", "FastSigmoid", "Slayer", "Surrogate", "Triangle", "derivative_at", "surrogate_of"]


@dataclass(frozen=True, slots=True)
class Surrogate:
    """A surrogate derivative.

    Attributes:
        slope: how fast it falls with the distance from the threshold, per V_th - V_reset; > 0.
        code: its number in kernels, see `derivative_at`.
        name: as given to `neuro_torch.Module`.

    Raises:
        ModelError: the slope is not a number > 0.
    """

    slope: float
    code: ClassVar[int]
    name: ClassVar[str]

    def __post_init__(self) -> None:
        slope = self.slope
        if isinstance(slope, bool) or not isinstance(slope, (int, float)) or not 0.0 < slope < math.inf:
            raise ModelError(f"surrogate '{self.name}': slope = {slope!r}: expected a number > 0")

    def derivative(self, x: Tensor) -> Tensor:
        """At x = (V_m - V_th) / (V_th - V_reset), element by element."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class FastSigmoid(Surrogate):
    """1 / (1 + slope abs(x))^2, with long tails: neurons far from the threshold learn, too. The default."""

    slope: float = 1.0
    code: ClassVar[int] = 0
    name: ClassVar[str] = "fast_sigmoid"

    def derivative(self, x: Tensor) -> Tensor:
        """At x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 + self.slope * x.abs()).square().reciprocal()


@dataclass(frozen=True, slots=True)
class ArcTan(Surrogate):
    """1 / (1 + (pi / 2 slope x)^2): flat at the threshold."""

    slope: float = 10.0
    code: ClassVar[int] = 1
    name: ClassVar[str] = "arctan"

    def derivative(self, x: Tensor) -> Tensor:
        """At x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 + (0.5 * math.pi * self.slope * x).square()).reciprocal()


@dataclass(frozen=True, slots=True)
class Slayer(Surrogate):
    """exp(-slope abs(x)), of SLAYER."""

    slope: float = 10.0
    code: ClassVar[int] = 2
    name: ClassVar[str] = "slayer"

    def derivative(self, x: Tensor) -> Tensor:
        """At x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (-self.slope * x.abs()).exp()


@dataclass(frozen=True, slots=True)
class Triangle(Surrogate):
    """max(0, 1 - slope abs(x)): nobody farther than 1 / slope from the threshold learns."""

    slope: float = 1.0
    code: ClassVar[int] = 3
    name: ClassVar[str] = "triangle"

    def derivative(self, x: Tensor) -> Tensor:
        """At x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 - self.slope * x.abs()).clamp(min=0.0)


SURROGATES: Mapping[str, type[Surrogate]] = {each.name: each for each in (FastSigmoid, ArcTan, Slayer, Triangle)}
"""Surrogates by name."""


def surrogate_of(told: str | Surrogate, slope: float | None = None) -> Surrogate:
    """The surrogate that a user asked for.

    Args:
        told: its name, or itself.
        slope: of a name; None takes the surrogate's own.

    Raises:
        ModelError: there is none of that name, the slope cannot be, or it is told twice.
    """
    if isinstance(told, Surrogate):
        if slope is not None:
            raise ModelError(
                f"slope = {slope!r}: the surrogate has one already, {told.slope:g}", hint="give one of them"
            )
        return told
    if told not in SURROGATES:
        raise unknown("surrogate", str(told), SURROGATES)
    kind: Any = SURROGATES[told]
    surrogate: Surrogate = kind() if slope is None else kind(slope)
    return surrogate


def derivative_at(code: int, slope: float, x: float) -> float:
    """The same for one number, in plain arithmetic: kernels compile it.

    Args:
        code: `Surrogate.code`.
        slope: its slope.
        x: (V_m - V_th) / (V_th - V_reset).
    """
    far = slope * abs(x)
    if code == 0:
        return 1.0 / ((1.0 + far) * (1.0 + far))
    if code == 1:
        return 1.0 / (1.0 + (0.5 * math.pi * far) * (0.5 * math.pi * far))
    if code == 2:
        return math.exp(-far)
    return max(0.0, 1.0 - far)
