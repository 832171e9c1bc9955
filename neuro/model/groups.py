"""How the neurons of a group may act together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.choice import Choice
from neuro.core.quantities import quantity


@dataclass(frozen=True, kw_only=True, eq=False)
class Competition(Choice):
    """How neurons of a population act together; base of what a group may be.

    Class attributes:
        noun: what a chip or a simulator that cannot do it lacks.
        decides: whether the winner decides a trial.
        several: whether several may win in one trial.
    """

    kind: ClassVar[str] = "group"
    noun: ClassVar[str]
    decides: ClassVar[bool] = True
    several: ClassVar[bool] = False
    of: str = quantity(doc="the population", kind="name")

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so, as the text of an error; "" if they can."""
        return ""

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class winner_take_all(Competition):
    """One neuron of a population decides.

    With `first_to_fire` the first spike silences all others until the next trial or reset; without, only
    the best of each step fires and the others that reached the threshold are reset. The largest V_m - V_th
    wins; a tie is drawn.
    """

    noun: ClassVar[str] = "winner-take-all"
    first_to_fire: bool = quantity(True, "", "decide once instead of at each step", kind="boolean")

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return "the first to fire" if self.first_to_fire else "the best of each step"


@dataclass(frozen=True, kw_only=True, eq=False)
class local_winners(Competition):
    """Several neurons of a population of shape (maps, rows, columns) decide, each for what is near it.

    Who fires wins, and silences until the next trial or reset all neurons of all maps whose row and column are both at
    most `radius` from its own, itself with them, and its whole map once that has won `per_map` times. Of those that
    reach the threshold in one step the largest V_m - V_th wins first; a tie is drawn. Who is silenced goes on to add
    up its input.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007, with `per_map` 1. Any number finds several objects,
    each by a neuron in whose field it is (Mosca, MSc thesis, 2020, section 6.2.7).
    """

    noun: ClassVar[str] = "competition"
    several: ClassVar[bool] = True
    radius: int = quantity(doc="rows and columns around a winner that are silenced", kind="integer", at_least=0)
    per_map: int | None = quantity(None, "", "wins of each map; any number if not given", kind="integer", at_least=1)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so."""
        if len(shape) == 3:
            return ""
        return f"{self.name} of '{self.of}' of shape {list(shape)}: expected (maps, rows, columns)"

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return f"radius {self.radius}" + (f", {self.per_map} a map" if self.per_map else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class lateral_reset(Competition):
    """A spike resets all neurons along an axis: the first of them to fire silences the others for its time.

    Neurons that differ in no coordinate but the one of `axis` are rivals. When some of them reach the threshold in a
    step, the one with the largest V_m - V_th fires (a tie is drawn) and all others, wherever they stand, are reset as
    if they had fired: to V_reset, refractory for their t_ref. They emit nothing.
    Source: temporal winner-take-all of HFirst, Orchard et al., IEEE TPAMI 37:2028, 2015
    """

    noun: ClassVar[str] = "lateral reset"
    decides: ClassVar[bool] = False
    axis: int = quantity(0, "", "axis of its shape along which neurons are rivals", kind="integer", at_least=0)

    def misfit(self, shape: tuple[int, ...]) -> str:
        """Why neurons of this shape cannot compete so."""
        if self.axis < len(shape):
            return ""
        message = f"{self.name}.axis = {self.axis} of '{self.of}', whose shape is {list(shape)}"
        return f"{message}: expected at most {len(shape) - 1}"

    def told(self) -> str:
        """Which neurons fire, in a few words."""
        return f"a spike resets all along axis {self.axis}"


GROUPS: dict[str, type[Competition]] = {
    "winner_take_all": winner_take_all,
    "local_winners": local_winners,
    "lateral_reset": lateral_reset,
}
"""How the neurons of a group may compete, by name."""
