"""Surrogate derivatives of a spike. The true derivative of a threshold is 0 almost everywhere and gives no gradient.

All surrogates are functions of x = (V_m - V_th) / (V_th - V_reset), so a slope means the same for models of any scale.
Each is 1 at the threshold; the slope sets how far from the threshold a neuron still learns. For graded neurons
x = (change - vth) / vth, where the change is the quantity that the model compares with the threshold of sending.

| name | derivative | source |
| --- | --- | --- |
| `fast_sigmoid` | 1 / (1 + slope abs(x))^2 | Zenke and Ganguli, Neural Comput. 30(6):1514, 2018 |
| `arctan` | 1 / (1 + (pi / 2 slope x)^2) | Fang et al., ICCV 2021 |
| `slayer` | exp(-slope abs(x)) | Shrestha and Orchard, NeurIPS 2018 |
| `triangle` | max(0, 1 - slope abs(x)) | Esser et al., PNAS 113(41):11441, 2016; Bellec et al., NeurIPS 2018 |

Your own surrogate is a plain function of x and slope (`Own`). Kernels compile it; on tensors it is rewritten as models
are.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import FunctionType
from typing import TYPE_CHECKING, Any, ClassVar

from neuro.core.errors import ModelError, unknown

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["SURROGATES", "ArcTan", "FastSigmoid", "Own", "Slayer", "Surrogate", "Triangle", "surrogate_of"]

Plain = Callable[[float, float], float]
"""Derivative of one neuron as a plain function of x and slope, which kernels compile."""


@dataclass(frozen=True, slots=True)
class Surrogate:
    """A surrogate derivative.

    Attributes:
        slope: rate at which the derivative falls with the distance from the threshold, per V_th - V_reset; > 0.
        name: name of the surrogate in `neuro_torch.Module`.

    Raises:
        ModelError: the slope is not a number > 0.
    """

    slope: float
    name: ClassVar[str]

    def __post_init__(self) -> None:
        slope = self.slope
        if isinstance(slope, bool) or not isinstance(slope, (int, float)) or not 0.0 < slope < math.inf:
            raise ModelError(f"surrogate '{self.name}': slope = {slope!r}: expected a number > 0")

    @property
    def at(self) -> Plain:
        """The derivative as a plain function of x and slope, which kernels compile."""
        raise NotImplementedError

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class FastSigmoid(Surrogate):
    """1 / (1 + slope abs(x))^2, with long tails: neurons far from the threshold learn, too. The default."""

    slope: float = 1.0
    name: ClassVar[str] = "fast_sigmoid"

    @property
    def at(self) -> Plain:
        """The derivative as a plain function of x and slope."""
        return _fast_sigmoid

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 + self.slope * x.abs()).square().reciprocal()


@dataclass(frozen=True, slots=True)
class ArcTan(Surrogate):
    """1 / (1 + (pi / 2 slope x)^2): flat at the threshold."""

    slope: float = 10.0
    name: ClassVar[str] = "arctan"

    @property
    def at(self) -> Plain:
        """The derivative as a plain function of x and slope."""
        return _arctan

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 + (0.5 * math.pi * self.slope * x).square()).reciprocal()


@dataclass(frozen=True, slots=True)
class Slayer(Surrogate):
    """exp(-slope abs(x)), of SLAYER."""

    slope: float = 10.0
    name: ClassVar[str] = "slayer"

    @property
    def at(self) -> Plain:
        """The derivative as a plain function of x and slope."""
        return _slayer

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (-self.slope * x.abs()).exp()


@dataclass(frozen=True, slots=True)
class Triangle(Surrogate):
    """max(0, 1 - slope abs(x)): 0 farther than 1 / slope from the threshold."""

    slope: float = 1.0
    name: ClassVar[str] = "triangle"

    @property
    def at(self) -> Plain:
        """The derivative as a plain function of x and slope."""
        return _triangle

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        return (1.0 - self.slope * x.abs()).clamp(min=0.0)


@dataclass(frozen=True, slots=True, repr=False)
class Own(Surrogate):
    """Your own surrogate: a plain function of x and slope on single numbers, defined in a file or a notebook.

    Global numbers that the function reads are fixed when it is first compiled.

    ```python
    def gauss(x, slope):
        return math.exp(-((slope * x) ** 2))


    module = neuro_torch.Module(net, ["in_hidden"], surrogate=gauss, slope=2.0)
    ```

    Raises:
        ModelError: the function has other arguments, cannot run for all neurons at once, or returns NaN.
    """

    function: Plain
    slope: float = field(default=1.0, kw_only=True)
    name: ClassVar[str] = "own"

    def __post_init__(self) -> None:
        super(Own, self).__post_init__()
        _check(self)

    def __repr__(self) -> str:
        return f"Own({self.function.__name__}, slope={self.slope:g})"

    @property
    def at(self) -> Plain:
        """The function itself."""
        return self.function

    def derivative(self, x: Tensor) -> Tensor:
        """Return the derivative at x = (V_m - V_th) / (V_th - V_reset), element by element."""
        import torch

        from neuro_torch.lanes import Lanes

        values = Lanes(x.device).run(self.function, x, self.slope)
        return torch.as_tensor(values, device=x.device).to(x.dtype).expand_as(x)


SURROGATES: Mapping[str, type[Surrogate]] = {kind.name: kind for kind in (FastSigmoid, ArcTan, Slayer, Triangle)}
"""Surrogates by name."""


def surrogate_of(what: str | Surrogate | Plain, slope: float | None = None) -> Surrogate:
    """Return the surrogate that a user chose.

    Args:
        what: a name, a surrogate, or a function as for `Own`.
        slope: slope for a name or a function; None is the surrogate's default.

    Raises:
        ModelError: the name is unknown, the slope is out of range, or a surrogate already has a slope.
    """
    if isinstance(what, Surrogate):
        if slope is not None:
            raise ModelError(
                f"slope = {slope!r}: the surrogate has one already, {what.slope:g}", hint="give the slope in one place"
            )
        if type(what).at is Surrogate.at:
            raise ModelError(f"surrogate: {type(what).__name__} has no function of one number: {_EXPECTED}", hint=_LIKE)
        return what
    if isinstance(what, FunctionType):
        return Own(what) if slope is None else Own(what, slope=slope)
    if not isinstance(what, str):
        raise ModelError(f"surrogate: found {what!r}: {_EXPECTED}", hint=_LIKE)
    if what not in SURROGATES:
        raise unknown("surrogate", what, SURROGATES)
    kind: Any = SURROGATES[what]
    surrogate: Surrogate = kind() if slope is None else kind(slope)
    return surrogate


_EXPECTED = f"expected {', '.join(SURROGATES)}, or a plain function of x and slope"
_LIKE = "def gauss(x, slope): return math.exp(-((slope * x) ** 2))"


def _check(surrogate: Own) -> None:
    """Refuse a function that cannot be compiled or cannot run for all neurons at once."""
    import torch

    from neuro_torch.translate import Untranslatable

    function = surrogate.function
    name = getattr(function, "__name__", repr(function))
    if not isinstance(function, FunctionType) or name == "<lambda>":
        raise ModelError(f"surrogate '{name}': found no function defined by def: {_EXPECTED}", hint=_LIKE)
    arguments = list(inspect.signature(function).parameters)
    if len(arguments) != 2:
        raise ModelError(
            f"surrogate '{name}': found the arguments ({', '.join(arguments)}): expected (x, slope)", hint=_LIKE
        )
    if function.__closure__:
        variables = ", ".join(function.__code__.co_freevars)
        raise ModelError(
            f"surrogate '{name}': it uses {variables} of the enclosing function: expected x and slope only"
        )
    try:
        inspect.getsource(function)
    except OSError:
        raise ModelError(f"surrogate '{name}': source not found: expected a function in a file or a notebook") from None
    try:
        numbers = [float(function(x, surrogate.slope)) for x in (-1.0, 0.0, 1.0)]
        surrogate.derivative(torch.linspace(-1.0, 1.0, 3))
    except Untranslatable as error:
        raise ModelError(f"surrogate '{name}': it cannot run for all neurons at once: {error}", hint=_LIKE) from None
    except Exception as error:
        message = f"surrogate '{name}': {type(error).__name__}: {error}: expected plain arithmetic of one number"
        raise ModelError(message, hint=_LIKE) from None
    if not all(map(math.isfinite, numbers)):
        raise ModelError(f"surrogate '{name}': found {numbers} at x = -1, 0 and 1: expected numbers")


def _fast_sigmoid(x: float, slope: float) -> float:
    far = slope * abs(x)
    return 1.0 / ((1.0 + far) * (1.0 + far))


def _arctan(x: float, slope: float) -> float:
    far = slope * abs(x)
    return 1.0 / (1.0 + (0.5 * math.pi * far) * (0.5 * math.pi * far))


def _slayer(x: float, slope: float) -> float:
    return math.exp(-slope * abs(x))


def _triangle(x: float, slope: float) -> float:
    return max(0.0, 1.0 - slope * abs(x))
