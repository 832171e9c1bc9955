"""Results of finished runs, read from a file. The methods for values are those of a simulation."""

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
    """Results of a run.

    The methods for spikes, traces and weights are those of a simulation, see `neuro.files.results.Results`.
    """

    def plot(self, of: Any = None, window: Any = None) -> Figure:
        """Draw raster, rates and traces of the run, as `neuro.plots.overview` does.

        Args:
            of: a population or a list of populations; default: all recorded ones.
            window: begin and end in ms; default: the whole run.

        Raises:
            ModelError: the file has no spikes of these populations.
        """
        from neuro.plots import overview

        return overview(self, of, window=window)

    def energy(self, target: str | PathLike[str], *, step_s: float | None = None, chips: int | None = None) -> Energy:
        """Return the energy bill of the run on a chip, as `neuro.Simulation.energy` does.

        Args:
            target: name of a chip, or path of a table file.
            step_s: duration of a step on the chip in s; by default the chip's own time.
            chips: number of chips that are on; by default the number that the network needs.

        Raises:
            ModelError: see `neuro.Simulation.energy`.
        """
        from neuro.files.finished_runs import energy

        return energy(self, self.network(played=False), target, step_s=step_s, chips=chips)


def read(path: str | PathLike[str]) -> Results:
    """Read the results of a finished or interrupted run from a file. Arrays are read on first access.

    Raises:
        ModelError: there is no such file, or the file has another format.
    """
    results = files.read(path)
    return Results(*(getattr(results, field.name) for field in fields(results)))
