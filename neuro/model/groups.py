"""Groups: rules of competition between the neurons of a population."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.choice import Choice
from neuro.core.quantities import quantity


@dataclass(frozen=True, kw_only=True, eq=False)
class Competition(Choice):
    """Base of the rules of competition between the neurons of a population.

    Class attributes:
        noun: name of the rule in errors of chips and simulators that cannot run it.
        decides: whether the winner decides a trial.
        several: whether several neurons may win in one trial.
    """

    kind: ClassVar[str] = "group"
    noun: ClassVar[str]
    decides: ClassVar[bool] = True
    several: ClassVar[bool] = False
    of: str = quantity(doc="the population", kind="name")

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Return the error message for a shape that the rule cannot have, or ""."""
        return ""

    def summary(self) -> str:
        """Return a few words about the neurons that fire, for tables."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class winner_take_all(Competition):
    """One neuron of a population wins.

    With `first_to_fire`, the first spike silences all other neurons until the next trial or reset. Without it,
    several neurons may reach the threshold in a step. The neuron with the largest V_m - V_th then fires, and the others
    are reset. Ties are broken at random.
    """

    noun: ClassVar[str] = "winner-take-all"
    first_to_fire: bool = quantity(True, "", "decide once instead of at each step", kind="boolean")

    def summary(self) -> str:
        """Return a few words about the neurons that fire, for tables."""
        return "the first to fire" if self.first_to_fire else "the best of each step"


@dataclass(frozen=True, kw_only=True, eq=False)
class local_winners(Competition):
    """Several neurons of a population of shape (maps, rows, columns) win, each within its neighbourhood.

    A neuron that fires wins. Until the next trial or reset, the winner silences itself and the neurons of all maps
    whose row and whose column differ by at most `radius` from its own. After `per_map` wins, the whole map of the
    winner is silent. If several neurons reach the threshold in one step, the largest V_m - V_th wins first, and ties
    are broken at random. Silenced neurons still integrate their input.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007, with `per_map` 1. Without `per_map`, several objects
    are detected, each by a neuron whose receptive field contains the object (Mosca, MSc thesis, 2020, section 6.2.7).
    """

    noun: ClassVar[str] = "competition"
    several: ClassVar[bool] = True
    radius: int = quantity(doc="silenced rows and columns on each side of a winner", kind="integer", at_least=0)
    per_map: int | None = quantity(None, "", "allowed wins per map; no limit if not given", kind="integer", at_least=1)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Return the error message unless the shape has three axes."""
        if len(shape) == 3:
            return ""
        return f"{self.name} of '{self.of}' of shape {list(shape)}: expected (maps, rows, columns)"

    def summary(self) -> str:
        """Return the radius and the limit per map as text."""
        return f"radius {self.radius}" + (f", {self.per_map} per map" if self.per_map else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class lateral_reset(Competition):
    """A spike resets all neurons along an axis, so that the first neuron to fire delays the others.

    Neurons whose coordinates differ only along `axis` are rivals. If several rivals reach the threshold in a step, the
    rival with the largest V_m - V_th fires, and ties are broken at random. All its rivals, below the threshold
    or not, are reset as after a spike: V_m is set to V_reset and the neuron is refractory for t_ref, but rivals
    emit no spike.
    Source: temporal winner-take-all of HFirst, Orchard et al., IEEE TPAMI 37:2028, 2015
    """

    noun: ClassVar[str] = "lateral reset"
    decides: ClassVar[bool] = False
    axis: int = quantity(0, "", "axis of the shape along which neurons compete", kind="integer", at_least=0)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Return the error message if the shape lacks the axis."""
        if self.axis < len(shape):
            return ""
        message = f"{self.name}.axis = {self.axis} of '{self.of}', whose shape is {list(shape)}"
        return f"{message}: expected at most {len(shape) - 1}"

    def summary(self) -> str:
        """Return the axis as text."""
        return f"a spike resets all along axis {self.axis}"


GROUPS: dict[str, type[Competition]] = {
    "winner_take_all": winner_take_all,
    "local_winners": local_winners,
    "lateral_reset": lateral_reset,
}
"""Kinds of groups by name."""
