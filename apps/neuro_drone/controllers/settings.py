"""Settings of controllers, and values for each axis."""

from __future__ import annotations

from dataclasses import Field, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Quantity, Settings, check

__all__ = ["ControllerSettings", "each_axis"]


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Base of the settings of controllers; a `gain` may be one number for all axes, or a list of one for each.

    Attributes:
        name: of the controller, for messages.
    """

    name: str = field(default="", kw_only=True, metadata={"fixed": True})

    def place(self) -> str:
        """Return the controller with its name."""
        return f"controller '{self.name}'"

    def checked(self, one: Field[Any], q: Quantity, value: Any, what: str) -> Any:
        """Return a value, or of a `gain` one for each axis; see `Settings.checked`."""
        if one.name != "gain":
            return super().checked(one, q, value, what)
        if isinstance(value, (list, tuple)) and len(value) in (2, 3):
            return tuple(check(q, each, f"{what}[{k}]") for k, each in enumerate(value))
        try:
            return super().checked(one, q, value, what)
        except ModelError as error:
            raise ModelError(f"{error.message} or a list of two or three, one an axis", hint=error.hint) from None


def each_axis(name: str, value: float | tuple[float, ...], axes: int) -> npt.NDArray[np.float64]:
    """Return the value of a setting for each axis, (axes,).

    Args:
        name: of the setting, for messages.
        value: of it.
        axes: of the scenario.

    Raises:
        ModelError: it is a list, and not of one for each.
    """
    if isinstance(value, tuple) and len(value) != axes:
        raise ModelError(f"{name} = {list(value)}: expected a number or a list of {axes}, one an axis")
    return np.broadcast_to(np.asarray(value, float), axes)
