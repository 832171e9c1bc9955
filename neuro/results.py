"""Runs that were written to a file: `read` gives what a simulation gives, by the same calls."""

from __future__ import annotations

from dataclasses import dataclass, fields
from os import PathLike
from typing import TYPE_CHECKING, Any

from neuro.files import results as files
from neuro.files.parts import Trace, Train, Weights

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from neuro.chips.energy import Energy

__all__ = ["Results", "Trace", "Train", "Weights", "read"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Results(files.Results):
    """A run; its spikes, traces and weights are asked for as of a simulation, see `neuro.files.results.Results`."""

    def plot(self, of: Any = None, window: Any = None) -> Figure:
        """Raster, rates and traces of the run, as `neuro.plots.overview` draws them.

        Args:
            of: a population or a list of these; all that was recorded if not given.
            window: begin and end in ms; all of the run if not given.

        Raises:
            ModelError: nothing of this was recorded.
        """
        from neuro.plots import overview

        return overview(self, of, window=window)

    def energy(self, target: str | PathLike[str], *, step_s: float | None = None, chips: int | None = None) -> Energy:
        """What the run would take on a chip, as `neuro.Simulation.energy` gives it.

        Args:
            target: the name of a chip, or a table file of your own.
            step_s: how long a step takes on the chip in s; the chip's own time if not given.
            chips: that are on; those that the network needs if not given.

        Raises:
            ModelError: as of a simulation.
        """
        from neuro.files.finished_runs import energy

        return energy(self, self.network(played=False), target, step_s=step_s, chips=chips)


def read(path: str | PathLike[str]) -> Results:
    """Read the file of a run, also of one that was ended while it wrote; arrays when they are asked for.

    Raises:
        ModelError: there is no such file, or it is none of this format.
    """
    found = files.read(path)
    return Results(*(getattr(found, field.name) for field in fields(found)))
