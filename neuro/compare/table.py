"""A comparison on the terminal."""

from __future__ import annotations

from typing import Any

from neuro.compare import cells
from neuro.compare.result import Comparison
from neuro.core.tables import table

DISTANCE = "distance: edits per spike (Victor and Purpura, 10 ms), 0 where equal, 1 where no spike has a partner"


def show(comparison: Comparison, out: Any) -> None:
    """Print tables of the backends, populations, projections, chips' own counts and bills, then what else to know.

    Args:
        comparison: what was found.
        out: a rich console.
    """
    first = comparison.first.backend
    title = f"{comparison.network}: {comparison.ms:g} ms, seed {comparison.seed}, compared with {first}"
    out.print(table(cells.SUMMARY, cells.summary(comparison), title=title))
    out.print(table(cells.POPULATIONS, cells.populations(comparison)))
    out.print(DISTANCE, markup=False)
    for columns, rows in (
        (cells.PROJECTIONS, cells.projections(comparison)),
        (cells.NATIVE, cells.natives(comparison)),
        (cells.ENERGY, cells.bills(comparison)),
    ):
        listed = list(rows)
        if listed:
            out.print()
            out.print(table(columns, listed))
    for line in _remarks(comparison):
        out.print(line, markup=False)


def _remarks(comparison: Comparison) -> list[str]:
    refused = [f"refused: {run.refused}" for run in comparison.runs if run.refused]
    unpriced = [f"no bill for {bill.target}: {bill.reason}" for bill in cells.unpriced(comparison)]
    inputs = [
        f"input of {run.backend}: {cells.INPUTS[run.inputs]} as on {comparison.first.backend}"
        for run in comparison.ran
        if run.inputs != "same"
    ]
    warnings = [f"warning: {text}" for run in comparison.runs for text in run.warnings]
    return [*refused, *inputs, *warnings, *unpriced, *(f"note: {note}" for note in comparison.notes)]
