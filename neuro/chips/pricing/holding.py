"""What a run is like, and whether a published figure holds for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from neuro.chips.description import CONDITIONS, Figure, Range
from neuro.program.counts import Counts
from neuro.program.program import Program

if TYPE_CHECKING:
    from neuro.chips.placing.placement import Placement

Run = Mapping[str, float]
"""Of `neuro.chips.description.CONDITIONS` by name, what a run has; what is not known is left out."""


def run_of(program: Program, counts: Counts, placement: Placement | None, chips: int) -> Run:
    """The conditions of a run.

    Args:
        program: what ran.
        counts: of the run.
        placement: where its neurons lie, None where nothing is placed.
        chips: that are on.
    """
    found = {"resolution": program.resolution, "chips": float(chips)}
    if placement is not None:
        found["tiles"] = float(placement.tiles_used)
    if counts.neuron_updates:
        spikes = sum(counts.populations[part.name].spikes for part in program.populations if part.kind == "neuron")
        found["rate"] = spikes / (counts.neuron_updates * program.resolution * 1e-3)
    return found


def why_extrapolated(figure: Figure, run: Run) -> str:
    """Why a figure is not known to hold for a run, "" if it does."""
    if figure.guess:
        return figure.guess
    told = [
        f"{name} {_told(run[name], name)}, published for {_span(figure.holds[name], name)}"
        for name in CONDITIONS
        if name in figure.holds and name in run and not _within(run[name], figure.holds[name])
    ]
    return "; ".join(told)


def range_of(figure: Figure, run: Run) -> Range:
    """Between what a figure may lie in a run."""
    return figure.range(bool(why_extrapolated(figure, run)))


def _within(value: float, ends: Range) -> bool:
    return bool(ends[0] * (1.0 - 1e-9) <= value <= ends[1] * (1.0 + 1e-9))


def _told(value: float, name: str) -> str:
    return f"{value:.4g} {CONDITIONS[name][0]}".rstrip()


def _span(ends: Range, name: str) -> str:
    return _told(ends[0], name) if ends[0] == ends[1] else f"{ends[0]:.4g} to {_told(ends[1], name)}"
